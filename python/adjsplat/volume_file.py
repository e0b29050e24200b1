"""Volumes in files as arrays that are read only when a brick is: plans, Dask and MPI take them."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

from . import _native
from .build import BuildWarning, Place, Reading, file_paths

#: The lowest point and the size (x, y, z) of a box of a volume.
Box = tuple[list[int], list[int]]


class VolumePart(NamedTuple):
    """A box of a volume in files, which has not been read yet."""

    volume: VolumeFile
    box: Box


class VolumeFile:
    """A volume that `adj build` reads, as an array (z, y, x) whose parts are read where a brick is scanned or built.

    `volume` is a path, a folder of slices, or a list or pattern of paths of slices: DICOM, Zarr and OME-Zarr, TIFF, NRRD,
    MetaImage, NIfTI, VTK, SLC, raw. The other arguments are those of `build`. It travels to other processes as paths, so
    all must see the files under the same paths.

    >>> np.arange(4096, dtype=np.uint16).tofile("ct.raw")
    >>> volume = adj.VolumeFile("ct.raw", shape=(16, 16, 16), dtype="u2")
    >>> volume.shape
    (16, 16, 16)
    >>> adj.dask.build(volume, "ct.adjs", slab=8, visible=(2000, None)).count
    2096
    """

    def __init__(
        self,
        volume: Any,
        *,
        shape: Sequence[int] | None = None,
        dtype: Any = None,
        skip: int = 0,
        volume_index: int = 0,
        level: int = 0,
        series: str | int | None = None,
        outside_files: bool = False,
        unscaled: bool = False,
    ):
        paths = file_paths(volume)
        self._files = [path if path.startswith("phantom:") else os.path.abspath(path) for path in paths]
        self._reading = (shape, dtype, skip, volume_index, level, series, outside_files, unscaled)
        self._is_raw = shape is not None
        source = self._source()
        for note in source.notes:
            warnings.warn(note, BuildWarning, stacklevel=2)
        x, y, z = source.dims
        #: Number of points (z, y, x).
        self.shape = (z, y, x)

    def _source(self, place: Place | None = None, box: Box | None = None) -> _native.Source:
        where = Place(None, None, None, "RAS", None) if place is None else place
        return _native.file_source(self._files, Reading(*self._reading), where, box)

    def __getitem__(self, box: tuple[slice, slice, slice]) -> VolumePart:
        if not isinstance(box, tuple) or len(box) != 3 or not all(isinstance(side, slice) for side in box):
            raise TypeError(f"a part of a volume is a box of three slices (z, y, x), not {box!r}")
        ranges = [side.indices(points) for side, points in zip(box, self.shape)]
        if any(step != 1 or last <= first for first, last, step in ranges):
            raise ValueError(f"a part of a volume is a box with steps of 1, not {box!r}")
        low, size = [first for first, _, _ in ranges], [last - first for first, last, _ in ranges]
        return VolumePart(self, (low[::-1], size[::-1]))

    def __repr__(self) -> str:
        z, y, x = self.shape
        return f"<adjsplat.VolumeFile {z} x {y} x {x} (z, y, x), {self._files[0]}>"
