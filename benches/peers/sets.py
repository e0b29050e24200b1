"""Sets that every program gets: the same bytes, the same look, the same cameras.

In: a folder of real volumes and `adj raw`, for their samples and for phantoms. Out, in a folder for each set:
`codes.raw`, one byte a voxel; `look.txt`, opacity and linear red, green, blue of each of the 256 codes; `look.json`,
the same as a transfer function of ours; `set.json`, everything else.

Samples of more than a byte become codes on two straight lines that meet at the lowest visible value, so that exactly
the same voxels are visible. Opacity is 0.8 where a value is visible, 1 where a label is.
"""

import colorsys
import json
import math
import subprocess
from dataclasses import dataclass

import numpy

OPACITY = 0.8
DARK, LIGHT = (0.48, 0.22, 0.11), (1.0, 0.95, 0.86)
TYPES = {"u8": "u1", "i16": "<i2", "u16": "<u2", "f32": "<f4"}


@dataclass
class Source:
    """Where a set comes from: a file in the folder of real volumes, or a phantom with its size."""

    name: str
    place: str
    low: float
    high: float = math.inf
    labels: bool = False
    flags: tuple = ()

    @property
    def volume(self):
        """Whether it is a file."""
        return not self.place.startswith("phantom:")


BIG = ("--dims", "512x512x512")
SETS = [
    Source("frog", "frogtissue/frogtissue.mhd", 1, 15, labels=True),
    Source("engine", "scivis-engine/engine.nii.gz", 60),
    Source("head", "headsq-quarter/quarter.nhdr", 1150),
    Source("iron", "ironProt/ironProt.vtk", 30),
    Source("carotid", "carotid/carotid.vtk", 150),
    Source("sag", "SAG-anon", 100),
    Source("mr", "seg3d-MR/MR.nii.gz", 120),
    Source("atlas", "allen-human-atlas/AllenAtlas.nii.gz", 1, labels=True),
    Source("gyroid", "phantom:gyroid", 117.5, 138.5, flags=BIG),
    Source("shells", "phantom:shells", 191, flags=BIG),
    Source("vessels", "phantom:vessels", 92, flags=BIG),
    Source("noise", "phantom:noise", 1, flags=BIG),
]


def ask(adj, *words):
    """What the program prints as JSON."""
    run = subprocess.run([adj, *map(str, words), "--quiet", "--json"], check=True, stdout=subprocess.PIPE)
    return json.loads(run.stdout)


def codes_of(samples, low, high):
    """Samples as bytes, and the lowest and highest code that is visible."""
    if samples.dtype == numpy.uint8:
        return samples, math.ceil(low), math.floor(min(high, 255))
    least, most = float(samples.min()), float(samples.max())
    first = min(max(round(255 * (low - least) / (most - least)), 1), 254)
    codes = numpy.where(
        samples >= low,
        first + (samples.astype("f4") - low) * ((255 - first) / (most - low)),
        (samples.astype("f4") - least) * ((first - 1) / (low - least)),
    )
    return numpy.rint(codes).astype("u1"), first, 255


def look_of(source, first, last, most):
    """Opacity and linear colour of each code, and the same as a transfer function of ours."""
    top = min(last, most)
    look = numpy.zeros((256, 4))
    for code in range(first, top + 1):
        if source.labels:
            look[code] = 1.0, *colorsys.hsv_to_rgb(code * 0.618034 % 1, 0.55, 0.85)
        else:
            part = (code - first) / max(top - first, 1)
            look[code] = OPACITY, *(a + (b - a) * part for a, b in zip(DARK, LIGHT))
    if source.labels:
        kind = "labels"
        entries = [{"label": code, "name": str(code), "colour": colour_of(look[code]), "opacity": 1.0}
                   for code in range(first, top + 1)]
    else:
        kind = "points"
        ends = [(first, 0.0), (first, OPACITY), (top, OPACITY), (top, 0.0)]
        entries = [{"value": code, "colour": colour_of(look[code]), "opacity": opacity}
                   for code, opacity in ends]
    return look, {"kind": kind, kind: entries}


def colour_of(row):
    """sRGB components of a look's linear colour."""
    return [float(12.92 * c if c <= 0.0031308 else 1.055 * c ** (1 / 2.4) - 0.055) for c in row[1:]]


def prepare(adj, source, volumes, folder):
    """Makes a set's folder, unless it is there from the same source."""
    folder.mkdir(parents=True, exist_ok=True)
    described = folder / "set.json"
    if described.exists():
        before = json.loads(described.read_text())
        if before.get("made_from") == repr(source):
            return before
    place = volumes / source.place if source.volume else source.place
    raw = folder / "codes.raw"
    said = ask(adj, "raw", place, *source.flags, "-o", raw)
    samples = numpy.fromfile(raw, TYPES[said["type"]])
    codes, first, last = codes_of(samples, source.low, source.high)
    codes.tofile(raw)
    look, document = look_of(source, first, last, int(codes.max()))
    numpy.savetxt(folder / "look.txt", look, "%.6f")
    (folder / "look.json").write_text(json.dumps(document))
    visible = ((codes >= first) & (codes <= last)).reshape(said["dims"][::-1])
    bounds = []
    for axis in (2, 1, 0):
        there = numpy.flatnonzero(visible.any(axis=tuple(a for a in range(3) if a != axis)))
        bounds.append([int(there[0]), int(there[-1])])
    result = {
        "made_from": repr(source),
        "name": source.name,
        "place": source.place,
        "dims": said["dims"],
        "spacing": said["spacing"],
        "labels": source.labels,
        "first": first,
        "last": last,
        "visible": int(visible.sum()),
        "bounds": bounds,
    }
    described.write_text(json.dumps(result, indent=1))
    return result
