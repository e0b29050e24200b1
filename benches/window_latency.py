#!/usr/bin/env python3
"""Measures how soon the window of `adj view` answers: from a mouse that moves to the turned axis cross on the screen.

Usage: benches/window_latency.py FILE.adj ADJ [ADJ...] [--moves N]. Each ADJ is a program, built with the feature `view`; several
are measured in turn, twice each. Prints the median, the 90th and the 99th percentile in milliseconds. Needs Xvfb, xdotool, numpy, and
a Vulkan driver; without a graphics device of hardware the processor draws the volume and paints the window.

The mouse holds a button and moves by some pixels, again and again, up to 30 ms after the last answer, so that drafts are drawn all
the time. The screen is read from the display's memory every half millisecond.
"""

import argparse
import mmap
import os
import pathlib
import random
import struct
import subprocess
import sys
import tempfile
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "tests"))
from view_window import SIZE, Screen  # noqa: E402

CROSS = (slice(590, 680), slice(0, 70))  # rows and columns of the axis cross
VIEW = (slice(60, 580), slice(0, 940))  # of the volume
PATIENCE = 60  # seconds


class ReadScreen(Screen):
    """A display that is read from its memory, and whose mouse needs no new process for a move."""

    def __init__(self, folder):
        super().__init__("-fbdir", folder)
        # The format of xwd: words of a head, the colours of a table, rows of pixels.
        with open(os.path.join(folder, "Xvfb_screen0"), "rb") as file:
            memory = mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ)
        head = struct.unpack(">25I", memory[:100])
        start, row = head[0] + 12 * head[19], head[12]
        self.pixels = np.ndarray((SIZE[1], SIZE[0]), np.uint32, memory, start, (row, 4))
        self.mouse = subprocess.Popen(["xdotool", "-"], stdin=subprocess.PIPE, text=True, env=self.environment)

    def move(self, words):
        self.mouse.stdin.write(words + "\n")
        self.mouse.stdin.flush()

    def end(self):
        self.mouse.terminate()
        super().end()


def wait(what, holds):
    start = time.perf_counter()
    while not holds():
        if time.perf_counter() - start > PATIENCE:
            sys.exit(f"{what}: not seen within {PATIENCE} s")
        time.sleep(0.0005)
    return 1000 * (time.perf_counter() - start)


def answers(program, file, moves):
    """The milliseconds that the window takes to answer each move."""
    with tempfile.TemporaryDirectory() as folder:
        screen = ReadScreen(folder)
        environment = dict(screen.environment, XDG_STATE_HOME=folder, XDG_RUNTIME_DIR=folder)
        viewer = subprocess.Popen([program, "view", file], env=environment)
        try:
            wait("a picture", lambda: viewer.poll() is not None or len(np.unique(screen.pixels[VIEW][::8, ::8])) > 50)
            if viewer.poll() is not None:
                sys.exit(f"{program} has ended")
            time.sleep(1)
            place, times = [400, 300], []
            screen.move(f"mousemove {place[0]} {place[1]} mousedown 1")
            # A press and a move that come at once are not yet a drag.
            time.sleep(0.5)
            for move in range(moves + 10):
                before = screen.pixels[CROSS].copy()
                step = 12 if (move // 20) % 2 == 0 else -12
                place = [place[0] + step, place[1] + step // 4]
                screen.move(f"mousemove {place[0]} {place[1]}")
                took = wait("a turned cross", lambda before=before: (screen.pixels[CROSS] != before).any())
                # The first moves find drafts of another size.
                times += [took] if move >= 10 else []
                time.sleep(random.uniform(0, 0.03))
            screen.move("mouseup 1")
            return times
        finally:
            viewer.terminate()
            viewer.wait()
            screen.end()


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("file", type=pathlib.Path)
    options.add_argument("programs", nargs="+", metavar="ADJ")
    options.add_argument("--moves", type=int, default=300)
    options = options.parse_args()
    random.seed(1)
    for _ in range(2):
        for program in options.programs:
            times = answers(os.path.abspath(program), os.path.abspath(options.file), options.moves)
            median, most, nearly_all = np.percentile(times, [50, 90, 99])
            print(f"{program}, {options.file.name}: {median:.1f}, 90 % {most:.1f}, 99 % {nearly_all:.1f} ms", flush=True)


main()
