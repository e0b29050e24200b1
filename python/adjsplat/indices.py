"""Indices of a model: which box of voxels one covers."""

from __future__ import annotations

import reprlib
from typing import Any

import numpy as np


def expanded(key: Any) -> tuple[Any, ...]:
    """Returns the parts of an index for z, y and x."""
    key = key if isinstance(key, tuple) else (key,)
    dots = [at for at, part in enumerate(key) if part is Ellipsis]
    if len(dots) > 1 or len(key) - len(dots) > 3:
        raise IndexError("a model has three indices: z, y, x")
    at = dots[0] if dots else len(key)
    missing = (slice(None),) * (3 - len(key) + len(dots))
    return key[:at] + missing + key[at + 1 :]


def covered(part: Any, points: int, axis: int) -> tuple[int, int, Any]:
    """Returns first point and length of the range that an index covers, and the index within it."""
    if isinstance(part, slice):
        start, stop, step = part.indices(points)
        picked = range(start, stop, step)
        if not picked:
            return 0, 0, slice(None)
        low = min(picked[0], picked[-1])
        return low, max(picked[0], picked[-1]) - low + 1, slice(None, None, step)
    try:
        # A truth value is a mask to numpy, not 0 or 1.
        index = None if isinstance(part, (bool, np.bool_)) else part.__index__()
    except (AttributeError, TypeError):
        index = None
    if index is None:
        kind = type(part).__name__
        raise TypeError(f"a model is indexed by whole numbers and slices, not {kind}; take f.to_numpy() first")
    if not -points <= index < points:
        raise IndexError(f"index {reprlib.repr(index)} is out of bounds for axis {axis} with {points} points")
    return index % points, 1, 0
