#!/usr/bin/env python3
"""What leaving out pixels costs and saves, as a Markdown table: docs/studies/sampling.md.

    cargo build --release -p adj && python3 benches/sampling.py ../shared/data

Draws each set with every pixel and with enough (`--sampling`), at 512 x 512, standard quality, two threads, and compares
them over the pixels that are not empty: decibels and the largest difference of the linear pictures. Times are the best
of nine views of a turn, each view in turn with both. Needs numpy and OpenEXR (Python packages).
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy
import OpenEXR

ADJ = Path(__file__).parent.parent / "target/release/adj"
# Name, file in the folder, what is visible, magnification.
SETS = [
    ("iron protein", "ironProt/ironProt.vtk", ["--range", "30.."], 1),
    ("CT head, half size", "headsq-quarter/quarter.nhdr", ["--range", "1150.."], 1),
    ("carotid", "carotid/carotid.vtk", ["--range", "150.."], 1),
    ("hydrogen", "hydrogen/hydrogen.vti", ["--range", "0.05.."], 1),
    ("fuel", "scivis-fuel/fuel.nii.gz", ["--range", "20.."], 1),
    ("zarr T1", "nifti-zarr/tests/data/example4d.nii.gz", ["--range", "200.."], 1),
    ("T1 brain, 3 times", "stroke-T1/T1.nii.gz", ["--range", "150.."], 3),
    ("engine, 3 times", "scivis-engine/engine.nii.gz", ["--range", "60.."], 3),
    ("frog (opaque), 6 times", "frogtissue/frogtissue.mhd", ["--labels", "frog"], 6),
]


def adj(*words):
    subprocess.run([ADJ, *map(str, words)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def picture(path):
    channels = OpenEXR.File(str(path)).channels()
    if "RGBA" in channels:
        return channels["RGBA"].pixels.astype(numpy.float64)
    return numpy.stack([channels[name].pixels for name in "RGBA"], -1).astype(numpy.float64)


def compared(folder, file, zoom, projection):
    view = ["--renderer", "cpu", "--size", "512x512", "--elevation", "20", "--zoom", zoom, "--threads", "2", *projection]
    view += ["--background", "transparent", "-q"]
    worst, largest = 1e9, 0.0
    best = {"every": 1e9, "enough": 1e9}
    for azimuth in range(10, 370, 40):
        pictures = []
        for sampling in best:
            out, stats = folder / f"{sampling}.exr", folder / "stats.json"
            adj("render", file, "-o", out, "--azimuth", azimuth, "--sampling", sampling, "--stats", stats, *view)
            best[sampling] = min(best[sampling], *json.loads(stats.read_text())["frame_ms"])
            pictures.append(picture(out))
        there = numpy.abs(pictures[0]).max(-1) + numpy.abs(pictures[1]).max(-1) > 0
        difference = (pictures[0] - pictures[1])[there]
        worst = min(worst, -10 * numpy.log10(max((difference**2).mean(), 1e-20)))
        largest = max(largest, numpy.abs(difference).max())
    return worst, largest, best["every"], best["enough"]


def main():
    data = Path(sys.argv[1])
    print("| set | projection | dB, worst view | largest difference | every pixel, ms | enough, ms | times faster |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for label, path, visible, zoom in SETS:
            file = folder / "set.adj"
            adj("build", data / path, "-o", file, "-q", *visible)
            for projection in ([], ["--perspective", "45"]):
                worst, largest, every, enough = compared(folder, file, zoom, projection)
                kind = "perspective" if projection else "parallel"
                shown = "equal" if worst >= 199 else f"{worst:.1f}"
                print(f"| {label} | {kind} | {shown} | {largest:.3f} | {every:.2f} | {enough:.2f} | {every / enough:.2f} |", flush=True)


if __name__ == "__main__":
    main()
