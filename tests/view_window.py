#!/usr/bin/env python3
"""Drives the window of `adj view` with a real mouse and keyboard on a display in memory.

Usage: tests/view_window.py ADJ. ADJ is the program, built with the feature `view`. Needs Xvfb, xdotool, xclip,
ImageMagick's `import`, numpy, and a Vulkan driver (software is enough).
"""

import os
import subprocess
import sys
import tempfile
import time

import numpy as np

SIZE = (1280, 720)
PATIENCE = 60  # seconds
VIEW = (slice(60, 660), slice(120, 840))  # rows and columns that show only the volume


def run(*command, **options):
    return subprocess.run(command, check=True, capture_output=True, **options).stdout


class Screen:
    """A display in memory, and what is on it."""

    def __init__(self, *options):
        read, write = os.pipe()
        command = ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{SIZE[0]}x{SIZE[1]}x24", "-nolisten", "tcp"]
        command += options
        self.server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
        os.close(write)
        with os.fdopen(read) as number:
            self.environment = dict(os.environ, DISPLAY=f":{number.readline().strip()}")
        self.environment.pop("WAYLAND_DISPLAY", None)

    def end(self):
        self.server.terminate()
        self.server.wait()

    def shot(self):
        raw = run("import", "-window", "root", "-depth", "8", "rgb:-", env=self.environment)
        return np.frombuffer(raw, np.uint8).reshape(SIZE[1], SIZE[0], 3).astype(int)

    def do(self, *words):
        run("xdotool", *map(str, words), env=self.environment)

    def drag(self, start, end, button=1):
        self.do("mousemove", *start, "mousedown", button)
        for part in range(1, 11):
            place = [round(a + (b - a) * part / 10) for a, b in zip(start, end)]
            self.do("mousemove", *place)
            time.sleep(0.03)
        self.do("mouseup", button)

    def wait(self, what, holds):
        start = time.time()
        while time.time() - start < PATIENCE:
            shot = self.shot()
            if holds(shot):
                return shot
            time.sleep(0.2)
        run("import", "-window", "root", "view_window.png", env=self.environment)
        sys.exit(f"{what}: not seen within {PATIENCE} s; the screen is in view_window.png")

    def settled(self):
        """Returns the screen once it stays the same for a second."""
        last, since = self.shot(), time.time()
        while time.time() - since < 1:
            now = self.shot()
            if (now != last).any():
                last, since = now, time.time()
        return last


def colourful(shot):
    """Whether the view shows a volume: more than its background's one colour."""
    return (np.ptp(shot[VIEW], axis=(0, 1)) > 60).all()


def differs(a, b):
    """The share of the view's pixels that differ."""
    return (np.abs(a[VIEW] - b[VIEW]).max(axis=2) > 12).mean()


def errors(shot):
    """The number of pixels of text in the colour of errors, where messages are."""
    red, green, blue = np.moveaxis(shot[40:160, :940], 2, 0)
    return int(((red > 180) & (green < 60) & (blue < 60)).sum())


def main():
    program = os.path.abspath(sys.argv[1])
    without = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    refused = subprocess.run([program, "view"], env=without, capture_output=True, text=True)
    assert refused.returncode == 2 and refused.stderr.count("\n") == 1 and "display: is missing" in refused.stderr, (
        refused
    )
    print("without a display: ", refused.stderr.strip())

    with tempfile.TemporaryDirectory() as folder:
        files = [os.path.join(folder, name) for name in ("gyroid.adj", "vessels.adj")]
        for file in files:
            name = os.path.basename(file).removesuffix(".adj")
            run(program, "build", f"phantom:{name}", "--dims", "96x96x96", "-o", file, "--quiet")
        screen = Screen()
        environment = dict(screen.environment, XDG_STATE_HOME=folder, XDG_RUNTIME_DIR=folder)
        # No portal and no zenity, so that no dialog for files can be shown.
        environment.update(DBUS_SESSION_BUS_ADDRESS="unix:path=" + os.path.join(folder, "absent"), PATH=folder)
        viewer = subprocess.Popen([program, "view", files[0]], env=environment)
        try:
            start = time.time()
            screen.wait("the first picture", colourful)
            print(f"the first picture after {time.time() - start:.1f} s")
            first = screen.settled()
            screen.drag((480, 360), (640, 330))
            turned = screen.settled()
            print(f"dragging changed {differs(first, turned):.0%} of the view")
            assert differs(first, turned) > 0.2
            # The histogram is at the top of the panel: a point that makes all but the ends transparent.
            screen.drag((1100, 150), (1100, 240))
            faded = screen.settled()
            print(f"a point that was dragged changed {differs(turned, faded):.0%}")
            # Of a shape of thin shells, most pixels show background before and after.
            assert differs(turned, faded) > 0.03
            # Without a window manager nobody gives a window the keyboard.
            screen.do("search", "--name", "adjsplat", "windowfocus", "--sync")
            screen.do("mousemove", 480, 600, "key", "ctrl+z")
            undone = screen.settled()
            assert differs(turned, undone) < 0.01, differs(turned, undone)
            assert not errors(undone), "an error is said already"
            screen.do("mousemove", 30, 16, "click", 1)
            time.sleep(0.5)
            screen.do("mousemove", 40, 50, "click", 1)
            said = screen.wait("that there are no dialogs", errors)
            print(f"without dialogs: a line of {errors(said)} pixels")
            # A window for a path is open instead.
            screen.do("type", "--delay", "20", os.path.join(folder, "absent.adj"))
            screen.do("key", "Return")
            refused = screen.wait("that the file is absent", lambda shot: 0 < errors(shot) != errors(said))
            print(f"an absent file: a line of {errors(refused)} pixels")
            screen.do("key", "ctrl+o")
            time.sleep(0.5)
            screen.do("type", "--delay", "20", files[1])
            screen.do("key", "Return")
            opened = screen.wait("the second file", lambda shot: colourful(shot) and differs(shot, undone) > 0.2)
            print(f"a second file changed {differs(undone, opened):.0%}")
            # What is copied is on the clipboard of the display, not in the program alone.
            screen.do("key", "ctrl+o")
            time.sleep(0.5)
            screen.do("type", "--delay", "20", "copied")
            screen.do("key", "ctrl+a", "key", "ctrl+c")
            time.sleep(0.5)
            copied = run("xclip", "-o", "-selection", "clipboard", env=screen.environment, timeout=PATIENCE)
            assert copied == b"copied", copied
            assert viewer.poll() is None, "the window closed"
            recent = open(os.path.join(folder, "adjsplat", "recent")).read().split()
            assert recent == files[::-1], recent
        finally:
            viewer.terminate()
            viewer.wait(timeout=PATIENCE)
            screen.end()
    print("the window passed")


if __name__ == "__main__":
    main()
