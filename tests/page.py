#!/usr/bin/env python3
"""Tests `adj serve`, and the page in a real browser: what it fetches, draws, and says of faults.

Usage: tests/page.py ADJ PAGE. ADJ is the program, built with the feature `serve`; PAGE is the folder that
src/view/page/build made. Needs Chromium, playwright, numpy and pillow; WebGPU is Chromium's own in software.
"""

import base64
import contextlib
import gzip
import http.client
import http.server
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import urllib.parse
import zlib

import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright

PROGRAM, PAGE = map(os.path.abspath, sys.argv[1:3])
# Small windows, for what draws is software: views of 150 x 240 and of 270 x 320 pixels beside the panel.
SIZE = {"width": 480, "height": 320}
LARGE = {"width": 600, "height": 400}
PATIENCE = 120  # seconds
CANCEL = (46, 72)  # the place of the button that stops opening
WEBGPU = ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"]
NEAR = 45  # decibels
REAL_VOLUMES = os.environ.get("ADJ_DATA_FOLDER", os.path.join(os.path.dirname(__file__), "../../shared/data"))


def adj(*words):
    ran = subprocess.run([PROGRAM, *words], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr


def refused(*words):
    """Runs `adj serve`, which must stop with one line; returns the line."""
    ran = subprocess.run([PROGRAM, "serve", *words], capture_output=True, text=True, timeout=PATIENCE)
    assert ran.returncode == 2 and ran.stderr.count("\n") == 1 and ran.stderr.startswith("adj: "), ran
    return ran.stderr


# Seconds that a viewer waits for a silent server where a test waits for that; else it is a minute.
IMPATIENT = 2
HURRY = f"""
const later = globalThis.setTimeout;
globalThis.setTimeout = (call, time, ...rest) => later(call, time === 60000 ? {1000 * IMPATIENT} : time, ...rest);
"""

# Without a screen Chromium shows no canvas that WebGPU draws, and takes its device away. So the page draws its window into a
# texture of its own, which can be read.
SCREEN = """
let device, format, texture;
GPUCanvasContext.prototype.configure = (how) => { ({ device, format } = how); texture = undefined; };
GPUCanvasContext.prototype.unconfigure = () => {};
GPUCanvasContext.prototype.getCurrentTexture = function () {
  const { width, height } = this.canvas;
  if (texture?.width !== width || texture?.height !== height) {
    const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC;
    texture = device.createTexture({ size: [width, height], format, usage });
  }
  return texture;
};
globalThis.lose_device = () => device.destroy();
globalThis.base64 = (bytes) => {
  const parts = [];
  for (let at = 0; at < bytes.length; at += 32768) parts.push(String.fromCharCode(...bytes.subarray(at, at + 32768)));
  return btoa(parts.join(""));
};
globalThis.screen_pixels = async () => {
  const { width, height } = texture;
  const bytesPerRow = 256 * Math.ceil(width / 64);
  const usage = GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ;
  const buffer = device.createBuffer({ size: bytesPerRow * height, usage });
  const encoder = device.createCommandEncoder();
  encoder.copyTextureToBuffer({ texture }, { buffer, bytesPerRow }, [width, height]);
  device.queue.submit([encoder.finish()]);
  await buffer.mapAsync(GPUMapMode.READ);
  return { width, height, bytesPerRow, format, bytes: base64(new Uint8Array(buffer.getMappedRange())) };
};
"""


# Notes in `seen` what is shown: the quality, whether all that it needs has arrived, and the bytes that were fetched so far.
WATCH = """
globalThis.seen = [];
const watch = () => {
  const { quality, whole, fetched, finished } = globalThis.adjsplat?.state() ?? {};
  const last = seen.at(-1);
  if (quality && (last?.quality !== quality || last.whole !== whole || last.finished !== finished)) {
    seen.push({ quality, whole, finished, fetched: fetched[0] });
  }
  requestAnimationFrame(watch);
};
watch();
"""


class Serving:
    """`adj serve` and the links that it printed."""

    def __init__(self, *files):
        command = [PROGRAM, "serve", *files, "--page", PAGE]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.links = [self.process.stdout.readline().strip() for _ in files]
        self.port = urllib.parse.urlsplit(self.links[0]).port

    def get(self, path, **headers):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE)
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()

    def end(self):
        self.process.terminate()
        self.process.wait(timeout=PATIENCE)


class Plain(http.server.SimpleHTTPRequestHandler):
    """A server of files that knows no ranges. It sends the file "trickling.adj" in pieces, for longer than a viewer waits for
    one."""

    def log_message(self, *_):
        pass

    def do_GET(self):
        path = self.translate_path(self.path)
        if not path.endswith("trickling.adj"):
            return super().do_GET()
        with open(path, "rb") as file:
            whole = file.read()
        self.send_response(200)
        self.send_header("Content-Length", str(len(whole)))
        self.end_headers()
        for piece in range(6):
            self.wfile.write(whole[piece * len(whole) // 6 : (piece + 1) * len(whole) // 6])
            time.sleep(IMPATIENT / 4)


class Ranges(Plain):
    """A server that knows ranges."""

    def before(self, start, end, whole):
        """Waits before it sends the bytes of a range of a file with so many bytes."""

    def do_GET(self):
        path = self.translate_path(self.path)
        wanted = self.headers.get("Range")
        if wanted is None:
            return super().do_GET()
        start, end = map(int, wanted.removeprefix("bytes=").split("-"))
        with open(path, "rb") as file:
            whole = file.read()
        part = whole[start : end + 1]
        self.before(start, start + len(part), len(whole))
        self.send_response(206)
        self.send_header("Content-Length", str(len(part)))
        self.send_header("Content-Range", f"bytes {start}-{start + len(part) - 1}/{len(whole)}")
        # A file that changes from request to request.
        self.send_header("ETag", f'"{start if "changing" in path else 0}"')
        self.end_headers()
        if "stalling" in path and start > 0:
            self.wfile.write(part[: len(part) // 2])
            time.sleep(PATIENCE)
        with contextlib.suppress(ConnectionError):  # of a viewer that was closed
            self.wfile.write(part)


class Slow(Ranges):
    """A server that takes long to send ranges, and that waits with the records of the second part until it is told."""

    asked = 0
    may_go_on = threading.Event()

    def before(self, start, end, whole):
        Slow.asked += 1
        time.sleep(0.5)
        # Before them come the head, the directories of three lanes, and steps, values and normals of the first part.
        if Slow.asked > 7:
            Slow.may_go_on.wait(PATIENCE)


class Held(Ranges):
    """A server that holds back the module of the web worker, so that a build does not end."""

    may_go_on = threading.Event()

    def do_GET(self):
        if "worker_bg" in self.path:
            Held.may_go_on.wait(PATIENCE)
        with contextlib.suppress(ConnectionError):  # of a worker that was ended
            super().do_GET()


class Tenth(Ranges):
    """A server that sends a tenth of a file, and the rest when it is told."""

    sent = 0
    lock = threading.Lock()
    may_go_on = threading.Event()

    def before(self, start, end, whole):
        with Tenth.lock:
            is_within = 10 * (Tenth.sent + end - start) <= whole
            Tenth.sent += end - start if is_within else 0
        if not is_within:
            Tenth.may_go_on.wait()


def serving(handler, root):
    """A server of the files in a folder, and its address."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), lambda *args: handler(*args, directory=root))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server, f"http://127.0.0.1:{server.server_port}/"


def wait(what, get, patience=PATIENCE):
    start = time.time()
    while time.time() - start < patience:
        if value := get():
            return value
        time.sleep(0.03)
    sys.exit(f"{what}: not seen within {patience} s")


def decoded(text):
    return np.frombuffer(base64.b64decode(text), np.uint8)


class Viewer:
    """The page at an address."""

    def __init__(self, browser, address, script="", size=SIZE, without=None):
        self.page = browser.new_page(viewport=size, has_touch=True)
        if without:
            self.page.route(without, lambda route: route.fulfill(status=404))
        self.page.add_init_script(SCREEN + script)
        self.answers, self.faults = [], []
        self.page.on("response", lambda answer: self.answers.append((answer.url, answer.status, answer.headers)))
        self.page.on("pageerror", lambda fault: self.faults.append(str(fault)))
        self.page.on("console", lambda line: self.faults.append(line.text) if line.type == "error" else None)
        self.page.goto(address)

    def state(self):
        return self.page.evaluate("globalThis.adjsplat?.state()") or {}

    def message(self):
        """What the page says in place of the viewer."""
        return self.page.inner_text("#message")

    def told(self):
        """What the viewer says."""
        return wait("a message", lambda: self.state().get("message"))

    def settled(self):
        """The state once the last picture is there."""
        return wait("the last picture", lambda: (state := self.state()).get("finished") and state)

    def picture(self):
        state = self.settled()
        columns, rows = state["size"]
        pixels = decoded(self.page.evaluate("base64(globalThis.adjsplat.pixels())"))
        return pixels.reshape(rows, columns, 4)[..., :3]

    def screen(self):
        """What the window shows."""
        got = self.page.evaluate("globalThis.screen_pixels()")
        rows = decoded(got["bytes"]).reshape(got["height"], got["bytesPerRow"])
        pixels = rows[:, : 4 * got["width"]].reshape(got["height"], got["width"], 4)
        return pixels[..., [2, 1, 0]] if got["format"].startswith("bgra") else pixels[..., :3]

    def drag(self, start, end):
        self.page.mouse.move(*start)
        self.page.mouse.down()
        self.page.mouse.move(*end, steps=8)
        # Held still, so that the view does not turn on by itself.
        time.sleep(0.3)
        self.page.mouse.up()

    def touch(self, *fingers):
        """Moves fingers over the screen: each has a start and an end."""
        session = self.page.context.new_cdp_session(self.page)
        for step in range(9):
            places = [[a + (b - a) * step / 8 for a, b in zip(start, end)] for start, end in fingers]
            points = [{"x": x, "y": y, "id": finger} for finger, (x, y) in enumerate(places)]
            kind = "touchMove" if step else "touchStart"
            session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
            time.sleep(0.05)
        time.sleep(0.3)
        session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    def drop_served(self, *paths):
        """Drops copies of files of the server onto the view, under their names without folders."""
        drop = """async (paths) => {
            const files = new DataTransfer();
            for (const path of paths) files.items.add(new File([await (await fetch(path)).blob()], path.split("/").at(-1)));
            document.querySelector("canvas").dispatchEvent(new DragEvent("drop", { dataTransfer: files, bubbles: true }));
        }"""
        self.page.evaluate(drop, paths)

    def drop(self, *paths):
        """Drags files and folders of the disk onto the view, as a desktop does."""
        session = self.page.context.new_cdp_session(self.page)
        dragged = {"items": [], "files": list(paths), "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver", "drop"):
            session.send("Input.dispatchDragEvent", {"type": kind, "x": 200, "y": 200, "data": dragged})

    def close_file(self):
        """Closes the file that is shown; returns its name."""
        file = self.state()["file"]
        count = self.state()["files"]
        self.page.keyboard.press("Alt+w")
        wait("one file less", lambda: self.state()["files"] == count - 1)
        return file

    def camera(self):
        """Azimuth, elevation, height, angle of view and target."""
        return list(map(float, self.state()["view"].split(",")))

    def close(self):
        assert not self.faults, self.faults
        self.page.close()


def decibels(a, b):
    error = ((a.astype(float) - b) ** 2).mean()
    return 10 * np.log10(255**2 / error) if error > 0 else np.inf


def of_program(file, viewer, folder, *options):
    """The picture that `adj render` draws from the page's camera."""
    state = viewer.settled()
    out = os.path.join(folder, "want.png")
    columns, rows = state["size"]
    background = "#" + "".join(f"{value:02x}" for value in state["background"])
    adj("render", file, "-o", out, "--camera", json.dumps(state["camera"]), "--size", f"{columns}x{rows}",
        "--quality", state["quality"], "--background", background, *options)  # fmt: skip
    return np.asarray(Image.open(out).convert("RGB"))


def check_server(files, folder):
    served = Serving(*files)
    try:
        path = urllib.parse.urlsplit(served.links[0]).query.removeprefix("file=")
        path = "/" + urllib.parse.unquote(path)
        whole = open(files[0], "rb").read()
        status, headers, body = served.get(path, Range="bytes=16-23")
        assert (status, body) == (206, whole[16:24]), (status, headers)
        assert headers["content-range"] == f"bytes 16-23/{len(whole)}"
        assert int.from_bytes(body, "little") == len(whole)
        assert served.get(path)[2] == whole
        assert served.get(path, Range=f"bytes={len(whole)}-")[0] == 416
        assert served.get(path, Range="bytes=-8")[2] == whole[-8:]
        assert served.get(path, Range=f"bytes=-{len(whole) + 8}")[2] == whole
        for absent in ["/files/other.adj", "/files/..%2fball.adj", "/files/%2e%2e/%2e%2e/etc/passwd", "/../Cargo.toml"]:
            assert served.get(absent)[0] == 404, absent
        assert served.get("/" + "a" * 300)[0] == 404
        status, headers, body = served.get("/", Host="attacker.example")
        assert status == 403 and b"127.0.0.1" in body and headers["x-content-type-options"] == "nosniff"
        assert served.get("/", Host=f"Localhost:{served.port}")[0] == 200
        # Only this machine reaches it.
        listening = f"0100007F:{served.port:04X}"
        assert any(listening in line for line in open("/proc/net/tcp")), "it listens on another address"
        assert str(served.port) in refused(files[0], "--page", PAGE, "--port", str(served.port))
    finally:
        served.end()
    other = shutil.copy(files[0], os.path.join(folder, "other.adj"))
    served = Serving(other)
    os.remove(other)
    os.mkfifo(other)
    try:
        assert served.get("/files/other.adj")[0] == 404, "a pipe in place of the file"
    finally:
        served.end()
    served = Serving(*reversed(files))
    served.end()
    # The address of a file is encoded, and encoded again in the link.
    named = [urllib.parse.unquote(urllib.parse.unquote(link.rsplit("files/")[1])) for link in served.links]
    assert named == [os.path.basename(file) for file in reversed(files)], named
    os.makedirs(os.path.join(folder, "twin"))
    twin = shutil.copy(files[0], os.path.join(folder, "twin"))
    assert "the name of two files" in refused(files[0], twin, "--page", PAGE)
    assert "build the page" in refused(files[0], "--page", folder)
    assert "absent.adj" in refused(os.path.join(folder, "absent.adj"), "--page", PAGE)
    volume = os.path.join(folder, "volume.nrrd")
    with open(volume, "wb") as file:
        file.write(ball_nrrd())
    served = Serving(volume)
    served.end()
    assert served.links[0].endswith("files/volume.nrrd"), "a volume of one file"
    bricks = os.path.join(folder, "bricks.adjs")
    adj("split", files[0], "-o", bricks, "--slab", "64", "--quiet")
    assert "adj join" in refused(bricks, "--page", PAGE)
    assert "is a folder" in refused(folder, "--page", PAGE)
    with open("/dev/full", "w") as full:
        ran = subprocess.run(
            [PROGRAM, "serve", files[0], "--page", PAGE], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert ran.returncode == 2 and "cannot write the result" in ran.stderr, ran
    print("adj serve passed")


def check_drawing(browser, files, folder):
    served = Serving(*files)
    try:
        viewer = Viewer(browser, served.links[0], size=LARGE)
        shown = viewer.picture()
        state = viewer.state()
        assert state["quality"] == "high" and state["message"] is None, state
        size = os.path.getsize(files[0])
        fetched = [int(headers["content-length"]) for url, _, headers in viewer.answers if "/files/" in url]
        assert all(status == 206 for url, status, _ in viewer.answers if "/files/" in url), viewer.answers
        assert state["fetched"] == [sum(fetched), size], (state, fetched)
        assert sum(fetched) < 0.5 * size, f"one lane of three, and their directories: {fetched} of {size}"
        near = decibels(shown, of_program(files[0], viewer, folder))
        print(f"{sum(fetched)} of {size} bytes fetched; {near:.1f} dB from the program's picture")
        assert near > NEAR and shown.std() > 10
        screen = viewer.screen()
        rows, columns = shown.shape[:2]
        # Below the menu and left of the panel; scale bar and axis cross lie over it.
        same = max(
            (np.abs(screen[top : top + rows, :columns].astype(int) - shown).max(axis=2) < 3).mean()
            for top in range(20, 80)
        )
        print(f"{same:.1%} of the view's pixels are on the screen")
        assert same > 0.97 and screen[:, columns + 10 :].std() > 10
        hosts = {urllib.parse.urlsplit(url).netloc for url, *_ in viewer.answers} - {""}
        assert hosts == {f"127.0.0.1:{served.port}"}, hosts

        # A click reads the voxels on its ray back from the device.
        rows_below, columns_wide = viewer.state()["size"][::-1]
        viewer.page.mouse.click(columns_wide / 2, 40 + rows_below / 2)
        picked = wait("a picked voxel", lambda: viewer.state()["picked"])
        assert all(0 <= index < 96 for index in picked), picked

        viewer.drag((120, 240), (240, 224))
        wait("another view", lambda: viewer.state()["view"] != state["view"])
        turned = viewer.picture()
        share = (np.abs(turned.astype(int) - shown).max(axis=2) > 12).mean()
        near = decibels(turned, of_program(files[0], viewer, folder))
        print(f"dragging changed {share:.0%} of the pixels; {near:.1f} dB from the program's picture")
        assert share > 0.1 and near > NEAR
        # From the side and from above: each lane is fetched once, when a view needs it.
        for key, lanes in (("3", 2), ("5", 3)):
            before = viewer.state()["view"]
            viewer.page.keyboard.press(key)
            wait("another side", lambda before=before: viewer.state()["view"] != before)
            near = decibels(viewer.picture(), of_program(files[0], viewer, folder))
            fetched = viewer.state()["fetched"][0]
            print(f"key {key}: {fetched} bytes fetched; {near:.1f} dB from the program's picture")
            assert near > NEAR and fetched < 60_000 + size * lanes / 3, (fetched, size)
        assert fetched < 1.01 * size

        # One finger turns, two magnify.
        before = viewer.camera()
        viewer.touch([(120, 240), (260, 240)])
        wait("a turn", lambda: abs(viewer.camera()[0] - before[0]) > 10)
        before = viewer.camera()
        viewer.touch([(165, 240), (65, 240)], [(205, 240), (305, 240)])
        wait("a pinch", lambda: viewer.camera()[2] < 0.6 * before[2])
        print(f"two fingers magnified {before[2] / viewer.camera()[2]:.1f} times")
        view = viewer.state()["view"]
        viewer.picture()
        viewer.close()

        # A link's camera and transfer function.
        points = [(100, "#ff0000", 0), (130, "#00ff00", 0.4), (200, "#0000ff", 1)]
        points = [{"value": value, "colour": colour, "opacity": opacity} for value, colour, opacity in points]
        function = json.dumps({"kind": "points", "points": points})
        query = urllib.parse.urlencode({"view": view, "tf": function})
        linked = Viewer(browser, f"{served.links[0]}&{query}")
        seen = linked.picture()
        assert linked.state()["view"] == view
        path = os.path.join(folder, "tf.json")
        open(path, "w").write(function)
        near = decibels(seen, of_program(files[0], linked, folder, "--tf", path))
        print(f"from a link: {near:.1f} dB")
        assert near > NEAR
        linked.close()

        wrong = Viewer(browser, f"{served.links[0]}&view=1,2,3")
        said = wrong.told()
        assert "azimuth,elevation" in said, said
        wrong.close()
    finally:
        served.end()


def check_plain_server(browser, files, folder):
    """A page in a folder of a server without ranges; files that are wrong."""
    root = os.path.join(folder, "root")
    shutil.copytree(PAGE, os.path.join(root, "some", "page"))
    data = os.path.join(root, "data")
    os.makedirs(data)
    whole = open(files[0], "rb").read()
    for name, content in {
        "whole.adj": whole,
        "cut.adj": whole[: len(whole) // 2],
        "trickling.adj": whole,
        "not.adj": b"<!doctype html><title>Not a volume</title>",
        "cut.nrrd": b"NRRD0004\ntype: uint8\n",
        "ball.nrrd": ball_nrrd(),
    }.items():
        open(os.path.join(data, name), "wb").write(content)
    server, base = serving(Plain, root)
    base += "some/page/"
    try:
        viewer = Viewer(browser, base + "?file=../../data/whole.adj")
        shown = viewer.picture()
        assert viewer.state()["fetched"] == [len(whole)] * 2
        assert decibels(shown, of_program(files[0], viewer, folder)) > NEAR
        viewer.close()
        viewer = Viewer(browser, base + "?file=../../data/trickling.adj", HURRY)
        wait("a file that takes longer than the viewer waits for a piece", lambda: viewer.state().get("fetched"))
        assert viewer.state()["fetched"] == [len(whole)] * 2
        viewer.close()
        for name, words in {
            "cut.adj": "cut.adj",
            "not.adj": "not.adj",
            "cut.nrrd": "cut.nrrd: ",
            "some.bin": "404",
            "absent.adj": "404",
            "http://other.example/a.adj": "cannot be fetched",
        }.items():
            address = name if "://" in name else "../../data/" + name
            viewer = Viewer(browser, base + "?file=" + address)
            said = viewer.told()
            print(f"{name}: {said}")
            assert words in said and "\n" not in said, said
            # A browser reports what it could not fetch.
            viewer.faults.clear()
            viewer.close()
        plain = browser.new_page(java_script_enabled=False)
        plain.goto(base)
        assert "allow JavaScript" in plain.inner_text(".message") and not plain.is_visible("#message"), "one text"
        plain.close()
        viewer = Viewer(browser, base, without="**/adjsplat_viewer.js")
        said = wait("why there is no viewer", lambda: "cannot begin" in viewer.message() and viewer.message())
        assert "adjsplat_viewer.js" in said and "Load the page again" in said, said
        viewer.faults.clear()
        viewer.close()
        check_volume_at(browser, base + "?file=../../data/ball.nrrd", os.path.join(data, "ball.nrrd"), folder)
    finally:
        server.shutdown()
    print("a server without ranges passed")


def check_slow_server(browser, folder):
    """What has arrived is shown while the rest arrives."""
    root = shutil.copytree(PAGE, os.path.join(folder, "slow"))
    file = os.path.join(root, "large.adj")
    adj("build", "phantom:gyroid", "--dims", "160x160x160", "-o", file, "--quiet")
    server, base = serving(Slow, root)
    try:
        viewer = Viewer(browser, base + "?file=large.adj")
        part = wait("a part", lambda: (state := viewer.state()).get("quality") and state)
        Slow.may_go_on.set()
        whole = wait("the whole", lambda: (state := viewer.state())["fetched"] > part["fetched"] and state)
        print(f"shown after {part['fetched'][0]} bytes")
        assert part["view"] == whole["view"]
        assert decibels(viewer.picture(), of_program(file, viewer, folder)) > NEAR
        viewer.close()
        with open(file, "rb") as whole:
            content = whole.read()
        for name, bytes_, words in [
            ("changing.adj", content, "cut or changed while it was fetched"),
            ("stalling.adj", content, "stalling.adj: cannot be fetched: the server sent nothing for 60 s"),
            ("short.adj", content[:-256], "was cut or grew"),
            ("tiny.adj", content[:100], "a header of 256 bytes"),
        ]:
            with open(os.path.join(root, name), "wb") as out:
                out.write(bytes_)
            viewer = Viewer(browser, base + "?file=" + name, HURRY)
            said = viewer.told()
            print(f"{name}: {said}")
            assert words in said, said
            viewer.close()
    finally:
        server.shutdown()


def check_levels(browser, folder):
    """Coarse levels of detail are seen first: before a tenth of the file has been sent."""
    root = shutil.copytree(PAGE, os.path.join(folder, "levels"))
    flags = ["--levels", "auto", "--quiet"]
    phantom, head = os.path.join(root, "shells.adj"), os.path.join(root, "SAG-anon.adj")
    adj("build", "phantom:shells", "--dims", "128x128x128", "-o", phantom, *flags)
    server, base = serving(Tenth, root)

    def begun(file):
        """A viewer that shows a file's first picture, and the file's size in bytes."""
        Tenth.sent = 0
        Tenth.may_go_on.clear()
        viewer = Viewer(browser, f"{base}?file={os.path.basename(file)}", WATCH)
        wait("a picture from a tenth of the file", lambda: viewer.page.evaluate("seen.length"))
        first, size = viewer.page.evaluate("seen[0].fetched"), os.path.getsize(file)
        assert 0 < first <= Tenth.sent <= size / 10, (first, Tenth.sent, size)
        print(f"{os.path.basename(file)}: the first picture after {first} of {size} bytes, {first / size:.1%}")
        return viewer, size

    try:
        viewer, size = begun(phantom)
        Tenth.may_go_on.set()
        near = decibels(viewer.picture(), of_program(phantom, viewer, folder))
        # What was noted up to the next picture of the window, with the last change.
        seen = viewer.page.evaluate("new Promise((done) => requestAnimationFrame(() => done(seen)))")
        rested = viewer.state()["fetched"][0]
        assert near > NEAR and seen[-1]["quality"] == "high" and seen[-1]["whole"], (near, seen)
        assert rested < 0.4 * size, f"a lane of the voxels, and one of each level: {seen}"
        # No picture gives way to a coarser one while more arrives.
        ranks = [["draft", "standard", "high"].index(shown["quality"]) for shown in seen]
        assert ranks == sorted(ranks) and not seen[0]["whole"], seen
        before = viewer.state()["view"]
        viewer.page.keyboard.press("5")
        wait("the view from above", lambda: viewer.state()["view"] != before)
        near_above = decibels(viewer.picture(), of_program(phantom, viewer, folder))
        above = viewer.state()["fetched"][0]
        print(f"{rested} bytes ({rested / size:.1%}) for the picture at high, {near:.1f} dB")
        print(f"with the view from above {above} ({above / size:.1%}), {near_above:.1f} dB")
        assert near_above > NEAR and rested < above < size, (near_above, above)
        viewer.close()

        # A real head; a device in software takes minutes to draw its voxels.
        volume = os.path.join(REAL_VOLUMES, "SAG-anon")
        if os.path.isdir(volume):
            adj("build", volume, "--range", "100..", "-o", head, *flags)
            viewer, _ = begun(head)
            viewer.close()
        else:
            assert os.environ.get("ADJ_DATA") != "require", f"{volume} is absent"
            print(f"SKIPPED: {volume} is absent", file=sys.stderr)
    finally:
        Tenth.may_go_on.set()
        server.shutdown()


def check_memory(browser, files, folder):
    """Voxels are on the device, not in the program's memory."""
    solid = os.path.join(folder, "solid.adj")
    adj("build", "phantom:constant", "--dims", "240x240x240", "-o", solid, "--quiet")
    served = Serving(files[0], solid)
    memory, fetched = [], []
    try:
        for link in served.links:
            # Nothing is in view, so that nothing has to be drawn.
            viewer = Viewer(browser, link + "&view=0,0,10,0,1e6,1e6,1e6")
            state = viewer.settled()
            memory.append(state["memory"])
            fetched.append(state["fetched"][0])
            viewer.close()
    finally:
        served.end()
    print(f"{fetched} bytes fetched, {memory} bytes of memory")
    # What pictures need varies by some megabytes; a part of the file has 4.
    assert fetched[1] > 50e6 and memory[1] - memory[0] < 20e6, (fetched, memory)


def ball(side=32):
    """A ball, darker towards its surface."""
    axes = np.ogrid[[slice(-1, 1, 1j * side)] * 3]
    return np.maximum(0, 1000 * (1 - sum(axis**2 for axis in axes))).astype("<u2")


def ball_nrrd():
    z, y, x = ball().shape
    head = f"NRRD0004\ntype: uint16\ndimension: 3\nsizes: {x} {y} {z}\nendian: little\nencoding: gzip\n\n"
    return head.encode() + gzip.compress(ball().tobytes())


def check_built(viewer, volume, folder):
    """The page shows a volume as the program does that builds it: a file, or the slices of one."""
    built = os.path.join(folder, "built.adj")
    adj("build", *([volume] if isinstance(volume, str) else volume), "-o", built, "--quiet")
    near = decibels(viewer.picture(), of_program(built, viewer, folder))
    print(f"{viewer.state()['file']}, built in the page: {near:.1f} dB")
    assert near > NEAR


def check_volume_at(browser, address, volume, folder):
    viewer = Viewer(browser, address)
    check_built(viewer, volume, folder)
    assert viewer.state()["fetched"] is None
    viewer.close()


def check_volumes(browser, folder):
    """Volumes are built in the page: from a server, dropped, with samples in a file beside the header, from slices."""
    root = shutil.copytree(PAGE, os.path.join(folder, "volumes"))
    z, y, x = ball().shape
    header = f"ObjectType = Image\nNDims = 3\nDimSize = {x} {y} {z}\nElementType = MET_USHORT\nElementDataFile = ball.raw\n"
    content = {"ball.nrrd": ball_nrrd(), "ball.raw": ball().tobytes(), "ball.mhd": header.encode()}
    content |= {"cut.nrrd": ball_nrrd()[:400], "what.ever": b"no volume"}
    paths = {name: os.path.join(root, name) for name in content}
    for name, written in content.items():
        open(paths[name], "wb").write(written)
    slices = [f"slice{number}.tif" for number in range(1, z + 1)]
    for name, plane in zip(slices, ball()):
        paths[name] = os.path.join(root, name)
        Image.fromarray(plane).save(paths[name])
    server, base = serving(Ranges, root)
    try:
        check_volume_at(browser, base + "?file=ball.nrrd", paths["ball.nrrd"], folder)
        viewer = Viewer(browser, base)
        wait("the viewer", lambda: "message" in viewer.state())
        for names, title, volume in [
            (["ball.nrrd"], "ball.nrrd", paths["ball.nrrd"]),
            (["ball.raw", "ball.mhd"], "ball.mhd", paths["ball.mhd"]),
            (slices, f"slice1.tif and {z - 1} more", [paths[name] for name in slices]),
        ]:
            viewer.drop_served(*names)
            wait(title, lambda title=title: viewer.state()["file"] == title)
            check_built(viewer, volume, folder)
            viewer.page.keyboard.press("Alt+w")
            wait("no file", lambda: viewer.state()["file"] is None)
        for name, words in {
            "cut.nrrd": "cut.nrrd: ",
            "what.ever": "what.ever: is in no format known here",
            "ball.raw": "ball.raw: is in no format known here",
            "ball.mhd": "ball.mhd: ball.raw is missing; open it together with this file",
        }.items():
            viewer.drop_served(name)
            wait(f"a line about {name}", lambda name=name: (viewer.state().get("message") or "").startswith(name))
            said = viewer.told()
            print(said)
            assert said.startswith(words) and "virtual:" not in said and "\n" not in said and "OpenOptions" not in said, said
        viewer.close()
    finally:
        server.shutdown()
    server, base = serving(Held, root)
    try:
        viewer = Viewer(browser, base + "?file=ball.nrrd")
        # Asking the page for its state also brings news of its workers.
        wait("the worker", lambda: viewer.state() and viewer.page.workers)
        viewer.page.mouse.click(*CANCEL)
        wait("the worker's end", lambda: viewer.state() and not viewer.page.workers)
        said = viewer.told()
        print(said)
        assert said == "ball.nrrd was not opened" and viewer.state()["file"] is None, said
        viewer.close()
    finally:
        Held.may_go_on.set()
        server.shutdown()
    print("volumes passed")


def ome_zarr(folder, volume):
    """Writes an OME-Zarr image of two levels; chunks lie in folders."""
    attributes = {"multiscales": [{"version": "0.4", "axes": [{"name": name, "type": "space"} for name in "zyx"]}]}
    attributes["multiscales"][0]["datasets"] = [
        {"path": str(level), "coordinateTransformations": [{"type": "scale", "scale": [2**level] * 3}]}
        for level in range(2)
    ]
    os.makedirs(folder)
    side = 12  # of a chunk: the last ones reach beyond the volume
    for level, points in enumerate((volume, volume[::2, ::2, ::2])):
        array = {"zarr_format": 2, "shape": points.shape, "chunks": [side] * 3, "dtype": "<u2", "order": "C"}
        array |= {"compressor": {"id": "zlib", "level": 1}, "filters": None, "fill_value": 0, "dimension_separator": "/"}
        for at in np.ndindex(*(-(-count // side) for count in points.shape)):
            part = points[tuple(slice(side * i, side * i + side) for i in at)]
            chunk = np.pad(part, [(0, side - count) for count in part.shape])
            path = os.path.join(folder, str(level), *map(str, at))
            os.makedirs(os.path.dirname(path), exist_ok=True)
            open(path, "wb").write(zlib.compress(chunk.tobytes()))
        json.dump(array, open(os.path.join(folder, str(level), ".zarray"), "w"))
    json.dump({"zarr_format": 2}, open(os.path.join(folder, ".zgroup"), "w"))
    json.dump(attributes, open(os.path.join(folder, ".zattrs"), "w"))


def tiff_slices(folder, volume):
    """Writes slices into a folder; returns their paths."""
    os.makedirs(folder)
    paths = [os.path.join(folder, f"slice{number}.tif") for number in range(1, len(volume) + 1)]
    for path, plane in zip(paths, volume):
        Image.fromarray(plane).save(path)
    return paths


# A folder whose list of files never comes.
ENDLESS = """
DataTransferItem.prototype.webkitGetAsEntry = () => (
  { name: "endless", isDirectory: true, createReader: () => ({ readEntries: () => { globalThis.is_asked = true; } }) });
"""
FOLDER = ((30, 17), (40, 78))  # the places of the menu "Open" and of its entry "Folder…"


def check_folders(browser, folder):
    """Folders that are dropped or chosen are opened as the program opens them."""
    root = shutil.copytree(PAGE, os.path.join(folder, "folders"))
    path = lambda *names: os.path.join(root, *names)  # noqa: E731
    slices = tiff_slices(path("slices"), ball())
    names = [f"slices/{os.path.basename(file)}" for file in slices]
    ome_zarr(path("ball.zarr"), ball())
    open(path("ball.nrrd"), "wb").write(ball_nrrd())
    os.makedirs(path("empty", "below"))
    tiff_slices(path("patient", "series 1"), ball(8))
    os.makedirs(path("bricks.adjs"))
    open(path("bricks.adjs", "collection.json"), "w").write("{}")
    # The same names in two folders.
    os.makedirs(path("twins"))
    shutil.copytree(path("slices"), path("twins", "slices"))
    half = np.ascontiguousarray(ball()[:, :16])
    header = "ObjectType = Image\nNDims = 3\nDimSize = 32 16 32\nElementType = MET_USHORT\nElementDataFile = half.raw\n"
    for name in ("one", "two"):
        os.makedirs(path(name))
        open(path(name, "half.raw"), "wb").write(half.tobytes())
        open(path(name, "half.mhd"), "w").write(header)
    nrrd = "NRRD0004\ntype: uint16\ndimension: 3\nsizes: 32 16 32\nendian: little\nencoding: raw\n\n"
    open(path("twins", "ball.nrrd"), "wb").write(nrrd.encode() + half.tobytes())
    volumes = ["slices", "ball.zarr"]
    head = os.path.join(REAL_VOLUMES, "SAG-anon")
    if os.path.isdir(head):
        os.makedirs(path("head"))
        # A device in software takes minutes to draw all of it.
        for name in sorted(os.listdir(head))[60:84]:
            shutil.copy(os.path.join(head, name), path("head"))
        volumes.append("head")
    else:
        assert os.environ.get("ADJ_DATA") != "require", f"{head} is absent"
        print(f"SKIPPED: {head} is absent", file=sys.stderr)

    server, base = serving(Ranges, root)
    try:
        viewer = Viewer(browser, base)
        wait("the viewer", lambda: "message" in viewer.state())
        for name in volumes:
            viewer.drop(path(name))
            wait(name, lambda name=name: viewer.state()["file"] == name)
            check_built(viewer, path(name), folder)
            viewer.close_file()

        # Folders and files that are dropped together: each folder by itself.
        viewer.drop(path("slices"), path("ball.nrrd"), path("ball.zarr"))
        wait("three files", lambda: viewer.state()["files"] == 3)
        opened = {viewer.close_file() for _ in range(3)}
        assert opened == {"slices", "ball.nrrd", "ball.zarr"}, opened

        # Files of the same name are opened each with its own content. Chromium gives the second of two files of the disk
        # another name, other browsers do not.
        twins = ["ball.nrrd", "twins/ball.nrrd"]
        viewer.drop_served(*twins)
        wait("two files", lambda: viewer.state()["files"] == 2)
        near = []
        for _ in twins:
            shown = viewer.picture()
            for twin in twins:
                built = os.path.join(folder, "twin.adj")
                adj("build", path(twin), "-o", built, "--quiet")
                near.append(decibels(shown, of_program(built, viewer, folder)))
            assert viewer.close_file() == "ball.nrrd"
        print(f"two files of one name: {', '.join(f'{value:.1f}' for value in near)} dB from either volume")
        first, second = near[:2], near[2:]
        assert max(first) > NEAR and max(second) > NEAR and np.argmax(first) != np.argmax(second), near

        for dropped, words in {
            ("empty",): "empty: is a folder without files",
            ("patient",): "patient: is a folder without TIFF or DICOM files, and no Zarr array; open a file in it, or one of "
            "its subfolders, such as series 1",
            ("bricks.adjs",): "bricks.adjs: is a collection of bricks",
            ("twins",): "twins: is a folder without TIFF or DICOM files",
            (*names, "twins/slices/slice7.tif"): "slice1.tif and 32 more: slice7.tif is the name of several slices",
            ("one/half.mhd", "one/half.raw", "two/half.raw"): "half.mhd: half.raw is the name of several files",
        }.items():
            if len(dropped) > 1:
                viewer.drop_served(*dropped)
            else:
                viewer.drop(path(*dropped))
            wait(words, lambda words=words: (viewer.state().get("message") or "").startswith(words))
            said = viewer.told()
            print(said)
            assert "virtual:" not in said and "\n" not in said and "OpenOptions" not in said, said
            assert viewer.state()["files"] == 0

        # Chosen from the menu.
        viewer.page.mouse.click(*FOLDER[0])
        with viewer.page.expect_file_chooser() as chooser:
            time.sleep(0.5)
            viewer.page.mouse.click(*FOLDER[1])
        chooser.value.set_files(path("ball.zarr"))
        wait("a folder that was chosen", lambda: viewer.state()["file"] == "ball.zarr")
        check_built(viewer, path("ball.zarr"), folder)
        viewer.close()

        viewer = Viewer(browser, base, ENDLESS)
        wait("the viewer", lambda: "message" in viewer.state())
        viewer.drop(path("slices"))
        wait("a question for the files", lambda: viewer.page.evaluate("globalThis.is_asked"))
        time.sleep(0.5)
        viewer.page.mouse.click(*CANCEL)
        said = viewer.told()
        print(said)
        assert said == "endless was not opened" and not viewer.page.workers, said
        viewer.close()
    finally:
        server.shutdown()
    Held.may_go_on.clear()
    server, base = serving(Held, root)
    try:
        viewer = Viewer(browser, base)
        wait("the viewer", lambda: "message" in viewer.state())
        viewer.drop(path("slices"))
        wait("the worker", lambda: viewer.state() and viewer.page.workers)
        viewer.page.mouse.click(*CANCEL)
        wait("the worker's end", lambda: viewer.state() and not viewer.page.workers)
        assert viewer.told() == "slices was not opened", viewer.told()
        # A file that is gone before the worker reads it.
        viewer.drop(path("slices"))
        wait("the worker", lambda: viewer.state() and viewer.page.workers)
        os.remove(slices[6])
        Held.may_go_on.set()
        wait("a line about it", lambda: "slice7.tif" in (viewer.state()["message"] or ""))
        said = viewer.told()
        print(said)
        assert "the browser cannot read it" in said and "virtual:" not in said and "\n" not in said, said
        viewer.close()
    finally:
        Held.may_go_on.set()
        server.shutdown()
    print("folders passed")


def check_dropped(browser, files, folder):
    """A file that is dropped is read like one on a server."""
    served = Serving(*files)
    try:
        viewer = Viewer(browser, served.links[0].split("?")[0])
        wait("the viewer", lambda: "message" in viewer.state())
        drop = """async ([address, name, bytes]) => {
            const content = await (await fetch(address)).blob();
            const files = new DataTransfer();
            files.items.add(new File([content.slice(0, bytes)], name));
            document.querySelector("canvas").dispatchEvent(new DragEvent("drop", { dataTransfer: files, bubbles: true }));
        }"""
        address = "files/" + urllib.parse.quote(os.path.basename(files[0]))
        viewer.page.evaluate(drop, [address, "cut.adj", 100_000])
        assert viewer.told().startswith("cut.adj: at byte 16: R4"), viewer.told()
        # Of two files dropped together, the one that opens does not hide what is wrong with the other.
        first = "files.items.add(new File([content.slice(0, 90_000)], 'first.adj')); files.items.add("
        both = drop.replace("files.items.add(", first)
        viewer.page.evaluate(both, [address, "second.adj", os.path.getsize(files[0])])
        wait("the second file", lambda: viewer.state()["file"] == "second.adj")
        assert viewer.told().startswith("first.adj: at byte 16: R4"), viewer.told()
        viewer.page.keyboard.press("Alt+w")
        wait("no file", lambda: viewer.state()["file"] is None)
        viewer.page.evaluate(drop, [address, "dropped.adj", os.path.getsize(files[0])])
        wait("the file", lambda: viewer.state()["file"] == "dropped.adj")
        near = decibels(viewer.picture(), of_program(files[0], viewer, folder))
        fetched, whole = viewer.state()["fetched"]
        print(f"dropped: {fetched} of {whole} bytes read; {near:.1f} dB")
        assert near > NEAR and fetched < 0.5 * whole
        viewer.page.keyboard.press("Alt+w")
        wait("no file", lambda: viewer.state()["file"] is None)
        # Larger than a device's largest picture.
        viewer.page.set_viewport_size({"width": 9000, "height": 300})
        width = "document.querySelector('canvas').width"
        wait("a canvas that the device can draw", lambda: viewer.page.evaluate(width) == 8192)
        viewer.page.evaluate(drop, [address, "wide.adj", os.path.getsize(files[0])])
        columns = wait("a wide picture", lambda: (viewer.state().get("size") or [0])[0])
        print(f"a window of 9000 pixels: a canvas of 8192, a view of {columns}")
        viewer.page.set_viewport_size(SIZE)
        viewer.page.evaluate("lose_device()")
        said = wait("a message", viewer.message)
        print(f"a lost device: {said}")
        assert "the graphics device was lost" in said
        viewer.faults.clear()
        viewer.close()
    finally:
        served.end()


def main():
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        files = [os.path.join(folder, name) for name in ("ball & shell.adj", "vessels.adj")]
        for file, phantom in zip(files, ("gyroid", "vessels")):
            adj("build", f"phantom:{phantom}", "--dims", "96x96x96", "-o", file, "--quiet")
        check_server(files, folder)
        chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
        launch = lambda flags: play.chromium.launch(executable_path=chromium, args=["--no-sandbox", *flags])  # noqa: E731
        browser = launch(WEBGPU)
        for check, *given in [
            (check_drawing, files),
            (check_plain_server, files),
            (check_slow_server,),
            (check_levels,),
            (check_dropped, files),
            (check_volumes,),
            (check_folders,),
            (check_memory, files),
        ]:
            start = time.time()
            check(browser, *given, folder)
            print(f"= {time.time() - start:.0f} s: {check.__name__}")
        browser.close()
        browser = launch(["--disable-gpu", "--disable-features=WebGPU", "--disable-blink-features=WebGPU"])
        served = Serving(*files)
        try:
            viewer = Viewer(browser, served.links[0])
            said = wait("a message", lambda: (text := viewer.message()) and "WebGPU" in text and text)
            print(f"without WebGPU: {said}")
        finally:
            served.end()
        browser.close()
    print("the page passed")


main()
