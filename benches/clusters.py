#!/usr/bin/env python3
"""What builds and pictures brick by brick take, and whether they are right: the numbers of docs/studies/scale.md.

    .ci/python    # makes target/python; for times, install a release build: maturin build --release
    target/python/bin/python benches/clusters.py volume /tmp/gyroid        # 2048 x 2048 x 512, 8 bits: 2.1 GB
    target/python/bin/python benches/clusters.py dask /tmp/gyroid          # hashes, memory and seconds of 1, 2, 4 workers
    target/python/bin/python benches/clusters.py kills /tmp/gyroid         # ten builds, a worker killed in each
    target/python/bin/python benches/clusters.py mpi /tmp/gyroid           # hashes and seconds of 1 to 4 ranks
    target/python/bin/python benches/clusters.py constants /tmp/gyroid     # what the model of docs/studies/scale.md is made of
    target/python/bin/python benches/clusters.py model                     # its predictions for 1 to 4,096 nodes
    target/python/bin/python benches/clusters.py views                     # decibels from one process's picture
    target/python/bin/python benches/clusters.py network /tmp/gyroid       # two hosts; the link is cut for ten seconds

Each line that says "right" was compared with one build or one process; a difference ends the program with exit code 1.
Open MPI, and for `network` iproute2 and root, must be there.
"""

import contextlib
import hashlib
import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

import dask
import numpy as np
import zarr
from distributed import Client, LocalCluster

import adjsplat as adj

SHAPE = (512, 2048, 2048)
SLAB = 32
#: A sheet of the gyroid: about a twentieth of the volume.
VISIBLE = (124, 131)
ALLOWED = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}


def main(words):
    steps = {
        "volume": volume,
        "dask": with_dask,
        "kills": kills,
        "mpi": mpi,
        "views": views,
        "network": network,
        "client": client,
        "constants": constants,
        "model": model,
    }
    if not words or words[0] not in steps:
        sys.exit(__doc__)
    steps[words[0]](*map(pathlib.Path, words[1:]))


def right(is_right, what):
    print(f"{what}: {'right' if is_right else 'WRONG'}", flush=True)
    if not is_right:
        sys.exit(1)


def sha256(path):
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def gyroid(shape, first, last, period=170):
    """Slices of a gyroid with values from 0 to 255."""
    z, y, x = (np.arange(points, dtype=np.float32) * np.float32(2 * np.pi / period) for points in shape)
    z = z[first:last, None, None]
    y, x = y[None, :, None], x[None, None, :]
    found = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
    return ((found + 1.5) * 85).round().astype(np.uint8)


def volume(folder, shape=SHAPE):
    """Writes the volume as .npy, as a zarr array and as OME-Zarr, and a smaller one."""
    folder.mkdir(exist_ok=True)
    plain = np.lib.format.open_memmap(folder / "large.npy", mode="w+", dtype=np.uint8, shape=shape)
    chunks = tuple(min(side, chunk) for side, chunk in zip(shape, (32, 512, 512)))
    large = zarr.create_array(folder / "large.zarr", shape=shape, chunks=chunks, dtype="u1", overwrite=True)
    group = zarr.open_group(folder / "large.ome.zarr", mode="w", zarr_format=2)
    image = group.create_array(
        "0", shape=shape, chunks=chunks, dtype="u1", chunk_key_encoding={"name": "v2", "separator": "/"}
    )
    axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    scale = [{"type": "scale", "scale": [1.0, 1.0, 1.0]}]
    datasets = [{"path": "0", "coordinateTransformations": scale}]
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": datasets}]
    for first in range(0, shape[0], chunks[0]):
        slab = gyroid(shape, first, first + chunks[0])
        for stored in (plain, large, image):
            stored[first : first + chunks[0]] = slab
    small = zarr.create_array(folder / "small.zarr", shape=(384,) * 3, chunks=(32, 128, 128), dtype="u1", overwrite=True)
    small[:] = gyroid((384,) * 3, 0, 384)


@contextlib.contextmanager
def cluster(workers, **more):
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 10}),
        tempfile.TemporaryDirectory() as scratch,
        LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address=None, local_directory=scratch, **more
        ) as local,
        Client(local) as client,
    ):
        yield client


def used():
    """Processor seconds of this process so far, and the most MiB that it had."""
    status = pathlib.Path("/proc/self/status").read_text()
    peak = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    return time.process_time(), int(peak.split()[1]) / 1024


def with_dask(folder):
    out = folder / "out"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    for name in ("large.zarr", "large.ome.zarr"):
        is_array = name == "large.zarr"
        source = zarr.open_array(folder / name, mode="r") if is_array else folder / name
        start = time.process_time()
        whole = adj.build(source, out / "whole.adj", visible=VISIBLE, memory="2GiB", threads=1)
        seconds = time.process_time() - start
        digest = sha256(out / "whole.adj")
        print(f"{name}: one build {seconds:.1f} s, {whole.count} voxels, sha256 {digest}", flush=True)
        whole.close()
        for workers in (1, 2, 4):
            with cluster(workers) as client:
                before = client.run(used)
                adj.dask.build(source, out / "joined.adj", slab=SLAB, visible=VISIBLE, memory="2GiB")
                after = client.run(used)
            taken = [after[worker][0] - before[worker][0] for worker in after]
            peak = max(rss for _, rss in after.values())
            idle = max(rss for _, rss in before.values())
            seconds = ", ".join(f"{one:.1f}" for one in sorted(taken, reverse=True))
            right(sha256(out / "joined.adj") == digest, f"  {workers} workers, joined file")
            print(f"  processor seconds {seconds}; at most {peak:.0f} MiB a worker, {idle:.0f} before", flush=True)
            right(sorted(os.listdir(out)) == ["joined.adj", "whole.adj"], "  nothing else is left")
    shutil.rmtree(out)


def kills(folder):
    """Builds ten times; each time a worker is killed at a random moment."""
    source = zarr.open_array(folder / "small.zarr", mode="r")
    with tempfile.TemporaryDirectory(dir=folder) as out:
        out = pathlib.Path(out)
        adj.build(source, out / "whole.adj", visible=VISIBLE)
        digest = sha256(out / "whole.adj")
        chance = random.Random(19)
        took = 4.0
        for number in range(10):
            with cluster(2) as client:
                pids = list(client.run(os.getpid).values())
                start = time.monotonic()
                moment = chance.uniform(0.02, 0.9) * took
                timer = threading.Timer(moment, os.kill, (chance.choice(pids), signal.SIGKILL))
                timer.start()
                adj.dask.build(source, out / "joined.adj", slab=8, visible=VISIBLE, retries=5)
                passed = time.monotonic() - start
                is_killed = not timer.is_alive()
                timer.cancel()
                # A build without a death says how long one takes.
                took = min(took, passed)
            is_equal = sha256(out / "joined.adj") == digest and sorted(os.listdir(out)) == ["joined.adj", "whole.adj"]
            right(is_equal and is_killed, f"kill {number} after {moment:.2f} of {passed:.2f} s, and nothing left")


def ranks(count, *words, folder):
    command = ["mpirun", "--oversubscribe", "-n", str(count), sys.executable, "-m", "adjsplat.mpi", *words, "--json"]
    ran = subprocess.run(command, cwd=folder, env=os.environ | ALLOWED, check=True, stdout=subprocess.PIPE)
    return json.loads(ran.stdout)["processor_seconds"]


def mpi(folder):
    out = folder / "out"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    built, drawn = {}, {}
    visible = f"{VISIBLE[0]}..{VISIBLE[1]}"
    view = ["--size", "800x800", "--azimuth", "20", "--elevation", "80", "--quality", "high"]
    for count in (1, 2, 3, 4):
        name = f"{count}.adjs"
        words = ["build", "../large.npy", "-o", name, "--visible", visible, "--slab", str(SLAB)]
        built[count] = max(ranks(count, *words, folder=out))
        adj.Collection(out / name).join(out / f"{count}.adj", memory="2GiB")
        digest = sha256(out / f"{count}.adj")
        right(digest == sha256(out / "1.adj"), f"{count} ranks, joined file, sha256 {digest}")
        drawn[count] = max(ranks(count, "render", name, "-o", f"{count}.exr", *view, folder=out))
        psnr = adj.compare(out / "1.exr", out / f"{count}.exr").psnr
        right(psnr > 110, f"{count} ranks, picture, {psnr:.0f} dB from one rank's")
        if count > 1:
            shutil.rmtree(out / name)
            os.remove(out / f"{count}.adj")
    for what, seconds in (("build", built), ("render", drawn)):
        shares = ", ".join(f"{n}: {s:.1f} s ({seconds[1] / n / s:.2f} of ideal)" for n, s in seconds.items())
        print(f"{what}, processor seconds of the slowest rank: {shares}", flush=True)
    shutil.rmtree(out)


#: What `constants` printed for docs/studies/scale.md: seconds of one processor, and bytes.
CONSTANTS = {
    "start": 0.651,
    "read_sample": 2.88e-10,
    "unpack_sample": 2.3e-09,
    "scan_sample": 1.13e-09,
    "build_sample": 2.01e-10,
    "build_voxel": 1.39e-07,
    "preview_voxel": 3.39e-08,
    "bytes_voxel": 13,
    "join_voxel": 1.25e-07,
    "draw_voxel": 2.95e-07,
    "composite_pixel": 6.9e-09,
}


def constants(folder):
    """Measures what a scan, a build, a join and a picture take, on one thread."""
    array = np.load(folder / "large.npy", mmap_mode="r")
    found = {"start": time.process_time()}

    def seconds(step):
        start = time.process_time()
        result = step()
        return time.process_time() - start, result

    with tempfile.TemporaryDirectory(dir=folder) as out:
        out = pathlib.Path(out)
        plan = adj.BrickPlan(array, slab=SLAB, visible=VISIBLE, preview=1)
        samples = [np.array(array[plan.samples_of(index)]) for index in range(plan.scans)]
        count = sum(part.size for part in samples)
        # One brick after the other, as a worker has them.
        took, _ = seconds(lambda: [np.array(array[plan.samples_of(index)]).size for index in range(plan.scans)])
        found["read_sample"] = took / count
        packed = zarr.open_array(folder / "large.zarr", mode="r")
        took, _ = seconds(lambda: [packed[plan.samples_of(index)].size for index in range(plan.scans)])
        found["unpack_sample"] = took / count
        took, findings = seconds(lambda: [plan.scan(index, part, threads=1) for index, part in enumerate(samples)])
        found["scan_sample"] = took / count
        # Bricks with next to no visible voxels take what samples take; the remainder is what voxels take.
        empty = adj.BrickPlan(array, slab=SLAB, visible=(255, 255), preview=1)
        empty = empty.agree([empty.scan(index, part, threads=1) for index, part in enumerate(samples)])
        agreed = plan.agree(findings)
        # The same with a preview of every second point, as a collection of this size has.
        coarse = adj.BrickPlan(array, slab=SLAB, visible=VISIBLE)
        coarse = coarse.agree([coarse.scan(index, part, threads=1) for index, part in enumerate(samples)])
        for each in (empty, coarse, agreed):
            shutil.rmtree(out / "bricks.adjs", ignore_errors=True)
            os.mkdir(out / "bricks.adjs")

            def build(each=each):
                return [each.build(index, part, out / "bricks.adjs", threads=1) for index, part in enumerate(samples)]

            took, voxels = seconds(build)
            if each is empty:
                found["build_sample"] = took / count
                continue
            finishing, bricks = seconds(lambda each=each: each.finish(out / "bricks.adjs"))
            if each is coarse:
                found["preview_voxel"] = (took + finishing) / sum(voxels)
            else:
                found["build_voxel"] = (took - found["build_sample"] * count) / sum(voxels)
                found["preview_voxel"] -= (took + finishing) / sum(voxels)
        files = [out / "bricks.adjs" / brick.file for brick in bricks.bricks if brick.file]
        found["bytes_voxel"] = sum(file.stat().st_size for file in files) / bricks.count
        took, _ = seconds(lambda: bricks.join(out / "joined.adj", threads=1, memory="2GiB").close())
        found["join_voxel"] = took / bricks.count
        view = {"size": (800, 800), "azimuth": 20, "elevation": 80, "quality": "high", "threads": 1}
        took, picture = seconds(lambda: bricks.render(**view))
        found["draw_voxel"] = took / bricks.count
        took, _ = seconds(lambda: adj.composite([picture] * 11))
        found["composite_pixel"] = took / 10 / (800 * 800)
    for name, value in found.items():
        print(f'    "{name}": {value:.3g},')


def predicted(shape, share, nodes, cores, slab, reading="read_sample", disk=2e9, network=3e9, latency=3e-6):
    """Seconds, bytes and memory of a build in slabs and of a picture, for `shape` samples of one byte: docs/studies/scale.md."""
    pixels = 800 * 800
    c = CONSTANTS
    samples, workers = float(np.prod(shape)), nodes * cores
    bricks = -(-shape[0] // slab)
    # The slowest worker has the most bricks.
    of_worker = -(-bricks // workers) / bricks
    read = samples * (1 + 2 / slab)
    build = of_worker * read * (2 * c[reading] + c["scan_sample"] + c["build_sample"])
    build += c["start"] + of_worker * share * samples * (c["build_voxel"] + c["preview_voxel"])
    stored = share * samples * c["bytes_voxel"]
    rounds = int(np.ceil(np.log2(workers)))
    sent = 2 * pixels * 16 * (1 - 1 / workers)
    picture = c["start"] + of_worker * share * samples * c["draw_voxel"]
    # Each brick's picture is put behind those before it; swaps add up to one picture more.
    picture += pixels * c["composite_pixel"] * (of_worker * bricks + 1)
    return {
        "build_s": build + (2 * read + stored) / (disk * nodes),
        "picture_s": picture + rounds * latency + (sent + pixels * 16) / network,
        "read_bytes": 2 * read,
        "written_bytes": stored,
        "sent_bytes": sent,
        # The brick's samples, and what is visible of it twice: as found, and as written.
        "memory_bytes": 90e6 + (slab + 2) * shape[1] * shape[2] + share * slab * shape[1] * shape[2] * 2 * c["bytes_voxel"],
    }


def model():
    """Prints the model's predictions: first for the runs that it is checked with, then for clusters of 16 cores a node."""
    print("check, 2048 x 2048 x 512, 3.04 % visible, slabs of 32: the slowest of 1 to 4 workers or ranks")
    for workers in (1, 2, 3, 4):
        one, packed = (
            predicted(SHAPE, 0.0304, workers, 1, SLAB, reading, disk=np.inf, network=np.inf)
            for reading in ("read_sample", "unpack_sample")
        )
        numbers = [f"{seconds:.1f}" for seconds in (one["build_s"], packed["build_s"], one["picture_s"])]
        print(f"| {workers} | " + " | ".join(numbers) + f" | {_size(one['memory_bytes'])} |")
    for edge in (2048, 8192, 32768):
        for nodes in (1, 4, 16, 64, 256, 1024, 4096):
            slab = max(1, min(64, edge // (16 * nodes)))
            one = predicted((edge,) * 3, 0.03, nodes, 16, slab)
            numbers = [f"{one['build_s']:.3g}", f"{one['picture_s']:.3g}", *(_size(one[name]) for name in list(one)[2:])]
            print(f"| {edge}^3 | {nodes} | {slab} | " + " | ".join(numbers) + " |")


def _size(count):
    for unit, size in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return f"{count:.0f} B"


#: Name; azimuth and elevation, or an eye inside; angle of view.
VIEWS = [
    ("parallel, along z", {"azimuth": 20, "elevation": 80}),
    ("parallel, elevation 20", {"azimuth": 30, "elevation": 20}),
    ("parallel, along x", {"azimuth": 90, "elevation": 5}),
    ("perspective 40", {"azimuth": 100, "elevation": 30, "perspective": 40}),
    ("eye inside", {"camera": {"position": [90, 110, 100], "target": [150, 160, 190], "up": [0, 0, 1], "fov": 70}}),
]


def views():
    """Prints decibels between pictures by 1 to 4 ranks and one process's picture of the whole."""
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        array = gyroid((256,) * 3, 0, 256, period=80)
        for name, opacity in (("opaque", 0.9), ("faint", 0.01)):
            points = [
                {"value": 110, "opacity": 0, "colour": "#2060ff"},
                {"value": 128, "opacity": opacity, "colour": "#ff8020"},
            ]
            points.append({"value": 146, "opacity": 0, "colour": "#40ff60"})
            whole = adj.build(array, folder / f"{name}.adj", transfer={"kind": "points", "points": points})
            adj.split(whole, folder / f"{name}-z.adjs", slab=64)
            adj.split(whole, folder / f"{name}-xyz.adjs", slab=64, partition="xyz")
            for label, view in VIEWS:
                for quality in ("high", "reference"):
                    one = adj.render(whole, (400, 400), quality=quality, **view)
                    adj.save(folder / "one.exr", one)
                    words = [part for key, value in view.items() for part in (f"--{key}", _word(value))]
                    row = []
                    for cut in ("z", "xyz"):
                        found = []
                        for count in (1, 2, 3, 4):
                            words_of = [
                                "render",
                                f"{name}-{cut}.adjs",
                                "-o",
                                "a.exr",
                                "--size",
                                "400x400",
                                "--quality",
                                quality,
                            ]
                            ranks(count, *words_of, *words, folder=folder)
                            found.append(adj.compare(folder / "one.exr", folder / "a.exr").psnr)
                        row.append(f"{cut} {min(found):.0f}")
                    print(f"{name}, {label}, {quality}: least of 1 to 4 ranks, dB: {', '.join(row)}", flush=True)


def _word(value):
    return json.dumps(value) if isinstance(value, dict) else str(value)


#: Names of two hosts, which are network namespaces, their addresses, and what links them.
HOSTS = (("adjsplat-a", "10.19.0.1"), ("adjsplat-b", "10.19.0.2"))


def on(host, *words):
    return ["ip", "netns", "exec", host, *map(str, words)]


def network(folder):
    """Builds with the scheduler and the client on one host and workers on both; cuts the link in the middle for ten seconds."""
    run = lambda *words: subprocess.run(list(map(str, words)), check=True)
    (a, address), (b, _) = HOSTS
    processes = []
    with tempfile.TemporaryDirectory(dir=folder) as out:
        out = pathlib.Path(out)
        adj.build(zarr.open_array(folder / "large.zarr", mode="r"), out / "whole.adj", visible=VISIBLE, memory="2GiB")
        digest = sha256(out / "whole.adj")
        scratch = tempfile.mkdtemp()
        try:
            for host, _ in HOSTS:
                run("ip", "netns", "add", host)
                run("ip", "-n", host, "link", "set", "lo", "up")
            run("ip", "link", "add", "adj-a", "netns", a, "type", "veth", "peer", "name", "adj-b", "netns", b)
            for (host, of_host), link in zip(HOSTS, ("adj-a", "adj-b")):
                run("ip", "-n", host, "address", "add", f"{of_host}/24", "dev", link)
                run("ip", "-n", host, "link", "set", link, "up")
            quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": scratch}
            scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", address, "--no-dashboard"]
            processes.append(subprocess.Popen(on(a, *scheduler), **quiet))
            for host, of_host in HOSTS:
                worker = [sys.executable, "-m", "distributed.cli.dask_worker", f"tcp://{address}:8786", "--nthreads", 1]
                worker += ["--host", of_host, "--no-dashboard", "--local-directory", scratch]
                processes.append(subprocess.Popen(on(host, *worker), **quiet))
            client = on(a, sys.executable, __file__, "client", folder / "large.zarr", out / "joined.adj", address)
            building = subprocess.Popen(client, stdout=subprocess.PIPE, text=True)
            # It says when both hosts have begun to build bricks.
            print(building.stdout.readline().strip(), flush=True)
            time.sleep(2)
            is_running = building.poll() is None
            run("ip", "-n", b, "link", "set", "adj-b", "down")
            time.sleep(10)
            is_cut = building.poll() is None
            run("ip", "-n", b, "link", "set", "adj-b", "up")
            print("the link was cut for 10 s and is back", flush=True)
            print(building.communicate()[0].strip(), flush=True)
            right(is_running and is_cut and building.returncode == 0, "the build ran before, during and after the cut")
            right(sha256(out / "joined.adj") == digest, "joined file")
            right(sorted(os.listdir(out)) == ["joined.adj", "whole.adj"], "nothing else is left")
        finally:
            for process in processes:
                process.terminate()
            for process in processes:
                process.wait()
            for host, _ in HOSTS:
                subprocess.run(["ip", "netns", "del", host], check=False)
            shutil.rmtree(scratch, ignore_errors=True)


def client(source, out, address):
    """The part of `network` that runs on the first host."""
    with Client(f"tcp://{address}:8786") as found:
        found.wait_for_workers(2)

        def watch():
            hosts = lambda: {worker.split("/")[2].split(":")[0] for worker, tasks in found.processing().items() if tasks}
            while len(hosts()) < 2:
                time.sleep(0.1)
            print("workers on", *sorted(hosts()), flush=True)

        threading.Thread(target=watch, daemon=True).start()
        start = time.monotonic()
        adj.dask.build(zarr.open_array(source, mode="r"), out, slab=8, visible=VISIBLE, memory="2GiB", retries=5)
        print(f"built in {time.monotonic() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
