#!/usr/bin/env python3
"""Bytes of real sets by part, beside the paper's formulas, as a Markdown table: docs/studies/memory.md.

    cargo build --release && python3 benches/memory_table.py ../shared/data

For each set: one and three lanes, each with and without hidden voxels (where it can be seen as a solid: an opaque
transfer function). The paper's (Orchard and Möller 2001, section 4.2): traditional 17 whd, A 5 (w+2)(h+2)(d+2) + 28 s,
B 47 s, with s the visible and the virtual voxels.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

ADJ = Path(__file__).parent.parent / "target/release/adj"
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


def build(volume, visible, lanes, folder, cull):
    """The file's facts, by `adj info`."""
    out = Path(folder) / "set.adj"
    command = [ADJ, "build", volume, *visible, "--lanes", lanes, "-o", out, "--quiet", "--json"]
    subprocess.run(command + (["--cull-hidden"] if cull else []), check=True, stdout=subprocess.PIPE)
    text = subprocess.run([ADJ, "info", out, "--json"], check=True, stdout=subprocess.PIPE).stdout
    return json.loads(text)


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
            for lanes in ("x", "xyz"):
                row(name, build(data / file, visible, lanes, folder, False))
            if lowest is not None:
                transfer = Path(folder) / "opaque.json"
                transfer.write_text(json.dumps(opaque(lowest)))
                visible = [flag for flag in visible if flag == "--unscaled"] + ["--tf", transfer]
            for lanes in ("x", "xyz"):
                row(f"{name}, without hidden", build(data / file, visible, lanes, folder, True))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
