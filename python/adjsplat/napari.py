"""Opens .adj files in napari, as a labels layer or an image layer with a bounded dense copy."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from .model import Model, open

#: Most bytes of the dense copy. What does not fit is taken with every second, third ... point along each axis.
MOST_BYTES = 2 << 30


def get_reader(path: str | list[str]) -> Any:
    """Returns the reader for an .adj file; None for anything else. napari calls it."""
    return read if isinstance(path, str) and path.endswith(".adj") and os.path.isfile(path) else None


def read(path: str) -> list[tuple[np.ndarray, dict[str, Any], str]]:
    """Returns the layer of a file: the box of its visible voxels, dense, where it is in the world."""
    with open(path) as f:
        return [layer(f, os.path.splitext(os.path.basename(path))[0])]


def layer(f: Model, name: str, most_bytes: int | None = None) -> tuple[np.ndarray, dict[str, Any], str]:
    """Returns a model as napari's layer: data (z, y, x), its properties, and "labels" or "image"."""
    most_bytes = MOST_BYTES if most_bytes is None else most_bytes
    is_labels = f.transfer.kind == "labels"
    dtype = f.dtype
    box, step = f.bounds, 1
    while dtype.itemsize * np.prod([len(range(part.start, part.stop, step)) for part in box], dtype=float) > most_bytes:
        step += 1
    picked = [range(part.start, part.stop, step) for part in box]
    data = np.empty([len(part) for part in picked], dtype)
    rest = tuple(slice(part.start, part.stop, part.step) for part in picked[1:])
    # Slice by slice: a block with steps would first be read without them.
    for at, z in enumerate(picked[0]):
        data[at] = f[(z, *rest)]
    low = [part.start for part in picked]
    # From indices of the copy to those of the model, then to the world; both in napari's order z, y, x.
    to_model = np.diag([step, step, step, 1.0])
    to_model[:3, 3] = low
    order = [2, 1, 0, 3]
    affine = f.affine[np.ix_(order, order)] @ to_model
    properties = {"name": name, "affine": affine, "metadata": {"attrs": dict(f.attrs), "step": step}}
    return data, properties, "labels" if is_labels else "image"
