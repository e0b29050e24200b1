#!/usr/bin/env python3
"""Bytes of real sets by part, beside the paper's formulas, as a Markdown table: docs/studies/memory.md.

    cargo build --release -p adj && python3 benches/memory_table.py ../shared/data

For each set: one and three lanes, with hidden voxels and, where finding them does not take minutes, without (under an
opaque transfer function, which is what hides most). The paper's (Orchard and Möller 2001, section 4.2): traditional 17 whd, A 5 (w+2)(h+2)(d+2) + 28 s,
B 47 s, with s the visible and the virtual voxels.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

ADJ = Path(__file__).parent.parent / "target/release/adj"
# Sets of which more voxels than these are visible keep their hidden ones here.
MOST_TO_CULL = 300_000
# Name, file in the folder, what is visible, lowest visible value of the opaque twin (None: a label map).
SETS = [
    ("frog", "frogtissue/frogtissue.mhd", ["--labels", "frog"], None),
    ("iron protein >= 30", "ironProt/ironProt.vtk", ["--range", "30.."], 30),
    ("CT head >= 1150", "headsq-quarter/quarter.nhdr", ["--range", "1150.."], 1150),
    ("SAG-anon >= 100", "SAG-anon", ["--range", "100.."], 100),
    ("engine >= 60", "scivis-engine/engine.nii.gz", ["--range", "60.."], 60),
    ("fuel >= 20", "scivis-fuel/fuel.nii.gz", ["--range", "20.."], 20),
    ("MR head >= 120", "seg3d-MR/MR.nii.gz", ["--unscaled", "--range", "120.."], 120),
    ("T1 brain >= 150", "stroke-T1/T1.nii.gz", ["--range", "150.."], 150),
    ("hydrogen >= 0.05", "hydrogen/hydrogen.vti", ["--range", "0.05.."], 0.05),
    ("carotid >= 150", "carotid/carotid.vtk", ["--range", "150.."], 150),
    ("atlas", "allen-human-atlas/AllenAtlas.nii.gz", ["--labels", "distinct"], None),
]


def adj(*words):
    return subprocess.run([ADJ, *words], check=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE).stdout


def rows(name, folder, *flags):
    """Builds a set and prints it with three lanes and with one; how many voxels are visible."""
    three, one = Path(folder) / "three.adj", Path(folder) / "one.adj"
    adj("build", *flags, "-o", three, "--quiet")
    adj("trim", three, "-o", one, "--lanes", "x", "--quiet")
    for file in (one, three):
        found = json.loads(adj("info", file, "--json"))
        row(name, found)
    return found["visible_voxels"]


def row(name, info):
    parts = dict.fromkeys(["steps", "values", "normals", "magnitudes"], 0)
    directory = 0
    for section in info["sections"]:
        if section["kind"] in parts:
            parts[section["kind"]] += section["bytes"]
        elif section["kind"] in ("tiles", "line ends"):
            directory += section["bytes"]
    total, visible = info["bytes_total"], info["visible_voxels"]
    rest = total - directory - sum(parts.values())
    w, h, d = info["dims"]
    s = visible + info["virtual_voxels"]
    paper = [17 * w * h * d, 5 * (w + 2) * (h + 2) * (d + 2) + 28 * s, 47 * s]
    numbers = [visible, parts["steps"], parts["values"], parts["normals"], directory, rest, total]
    cells = [name, "".join(lane["axis"] for lane in info["lanes"])]
    cells += [f"{number:,}" for number in numbers] + [f"{total / visible:.2f}"] + [f"{number:,}" for number in paper]
    print("| " + " | ".join(cells) + " |", flush=True)


def opaque(lowest):
    point = lambda value, opacity: {"value": value, "colour": "#ffffff", "opacity": opacity}
    return {"kind": "points", "points": [point(lowest, 0), point(lowest, 1)]}


def main(data):
    heads = ["set", "lanes", "visible", "steps", "values", "normals", "directory", "header, JSON, padding", "bytes"]
    print("| " + " | ".join(heads + ["a voxel", "traditional", "A", "B"]) + " |")
    print("|" + " --- |" * (len(heads) + 4))
    with tempfile.TemporaryDirectory() as folder:
        for name, file, visible, lowest in SETS:
            if rows(name, folder, data / file, *visible) > MOST_TO_CULL:
                continue
            if lowest is not None:
                transfer = Path(folder) / "opaque.json"
                transfer.write_text(json.dumps(opaque(lowest)))
                visible = [flag for flag in visible if flag == "--unscaled"] + ["--tf", transfer]
            rows(f"{name}, without hidden", folder, data / file, *visible, "--cull-hidden")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
