"""Exports: the visible voxels in the formats of other tools."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from . import _native
from .arguments import function, path_in_folder

if TYPE_CHECKING:
    from .model import Model


class ExportReport(NamedTuple):
    """What an export wrote: how many voxels, in which samples, and how exactly."""

    voxels: int
    """Number of voxels."""
    nbytes: int
    """Bytes of the file, or of all files of a folder."""
    dtype: np.dtype | None
    """Type of the samples; None for tables and Gaussians."""
    fill: float | None
    """The sample of points that are not visible; None for formats that have none."""
    rounding: float
    """The most by which a value differs from the model's; 0 if all are exact."""
    notes: tuple[str, ...]
    """Remarks, one line each."""


class ExportWarning(UserWarning):
    """Something about an export that may be wrong, such as a fill value that is visible."""


def write(
    model: Model,
    path: str | os.PathLike[str],
    fill: float | None,
    verify: bool,
    progress: Callable[[str, int, int], Any] | None,
) -> ExportReport:
    out = path_in_folder(path)
    if model.path is not None and os.path.exists(out) and os.path.samefile(model.path, out):
        raise ValueError(f"{out} is the model itself, which the export would replace; give another name")
    try:
        fill = None if fill is None else float(fill)
    except OverflowError:
        raise ValueError("fill is beyond all sample types") from None
    progress = function("progress", progress)
    if verify:
        model.verify()
    voxels, nbytes, name, filled, rounding, notes = _native.export(model._open, out, fill, progress)
    for note in notes:
        if note.startswith("warning: "):
            warnings.warn(note.removeprefix("warning: "), ExportWarning, stacklevel=3)
    dtype = None if name is None else np.dtype(f"{name[0]}{int(name[1:]) // 8}")
    remarks = tuple(note for note in notes if not note.startswith("warning: "))
    return ExportReport(voxels, nbytes, dtype, filled, rounding, remarks)
