"""Opens .adj files in napari, as a labels layer or an image layer with a bounded dense copy.

A large file with levels of detail becomes a multiscale layer, of which napari shows the level that suits the zoom.
"""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np

from .model import Model, open
from .voxels import Voxels

#: Most bytes of the dense copies. What does not fit is taken from coarser levels of detail; without such, with every second,
#: third ... point along each axis.
MOST_BYTES = 2 << 30

#: Most points along an axis of the coarsest copy, which napari shows in 3-D: levels that are coarser still are left out.
MOST_POINTS = 512


def get_reader(path: str | list[str]) -> Any:
    """Returns the reader for an .adj file; None for anything else. napari calls it."""
    return read if isinstance(path, str) and path.endswith(".adj") and os.path.isfile(path) else None


def read(path: str) -> list[tuple[np.ndarray | list[np.ndarray], dict[str, Any], str]]:
    """Returns the layer of a file: the box of its visible voxels, dense, where it is in the world."""
    with open(path) as f:
        return [layer(f, os.path.splitext(os.path.basename(path))[0])]


def layer(
    f: Model, name: str, most_bytes: int | None = None, most_points: int | None = None
) -> tuple[np.ndarray | list[np.ndarray], dict[str, Any], str]:
    """Returns a model as napari's layer: data (z, y, x), its properties, and "labels" or "image".

    Data are a list, the finest first, if several levels of detail are of use: those that fit into `most_bytes` together,
    down to the first with at most `most_points` along each axis.
    """
    most_bytes = MOST_BYTES if most_bytes is None else most_bytes
    most_points = MOST_POINTS if most_points is None else most_points
    levels: list[Voxels] = list(f.levels)
    last = next((n for n, level in enumerate(levels) if _points(level) <= most_points), len(levels) - 1)
    levels = levels[: last + 1]
    # All levels have the box of the coarsest, in whole blocks, so that they lie over each other.
    boxes = [_box(level, levels[-1]) for level in levels]
    sizes = [f.dtype.itemsize * math.prod(shape) for _, shape in boxes]
    while len(levels) > 1 and sum(sizes) > most_bytes:
        del levels[0], boxes[0], sizes[0]
    if len(levels) > 1:
        data: Any = [_dense(level, *box) for level, box in zip(levels, boxes)]
        low, step = boxes[0][0], 1
    else:
        data, low, step = _thinned(levels[0], most_bytes)
    # From indices of the copy to those of the level, then to the world; both in napari's order z, y, x.
    to_level = np.diag([step, step, step, 1.0])
    to_level[:3, 3] = low
    order = [2, 1, 0, 3]
    affine = levels[0].affine[np.ix_(order, order)] @ to_level
    metadata = {"attrs": dict(f.attrs), "step": step, "level": getattr(levels[0], "level", 0)}
    properties = {"name": name, "affine": affine, "metadata": metadata, "multiscale": len(levels) > 1}
    return data, properties, "labels" if f.transfer.kind == "labels" else "image"


def _points(level: Voxels) -> int:
    """Returns the points of the box of a level's visible voxels along its longest axis."""
    return max(part.stop - part.start for part in level.bounds)


def _box(level: Voxels, coarsest: Voxels) -> tuple[list[int], list[int]]:
    """Returns lowest point and shape of the box that the visible voxels of the coarsest level take in `level`.

    It may reach beyond the level's end: the coarsest level's blocks do.
    """
    low, shape = [], []
    for axis, part in enumerate(coarsest.bounds):
        factor = round(coarsest.spacing[2 - axis] / level.spacing[2 - axis])
        low.append(part.start * factor)
        shape.append((part.stop - part.start) * factor)
    return low, shape


def _dense(level: Voxels, low: list[int], shape: list[int]) -> np.ndarray:
    """Returns a box of a level, with 0 beyond the level's end."""
    data = np.zeros(shape, level.dtype)
    ends = [min(first + points, whole) for first, points, whole in zip(low, shape, level.shape)]
    rest = tuple(slice(first, end) for first, end in zip(low[1:], ends[1:]))
    # Slice by slice: a block would take its memory once more.
    for z in range(low[0], ends[0]):
        part = level[(z, *rest)]
        data[z - low[0], : part.shape[0], : part.shape[1]] = part
    return data


def _thinned(level: Voxels, most_bytes: int) -> tuple[np.ndarray, list[int], int]:
    """Returns the box of a level's visible voxels with every n-th point, its lowest point, and n."""
    dtype, box, step = level.dtype, level.bounds, 1
    while dtype.itemsize * np.prod([len(range(part.start, part.stop, step)) for part in box], dtype=float) > most_bytes:
        step += 1
    picked = [range(part.start, part.stop, step) for part in box]
    data = np.empty([len(part) for part in picked], dtype)
    rest = tuple(slice(part.start, part.stop, part.step) for part in picked[1:])
    # Slice by slice: a block with steps would first be read without them.
    for at, z in enumerate(picked[0]):
        data[at] = level[(z, *rest)]
    return data, [part.start for part in picked], step
