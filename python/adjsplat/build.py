"""Building models: from arrays, from zarr and dask, from files of every format."""

from __future__ import annotations

import glob
import os
import reprlib
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from . import _native
from .arguments import (
    byte_count,
    function,
    level_count,
    output_path,
    path_text,
    text,
    thread_count,
    truth,
    whole,
    whole_within,
)
from .arrays import Slices, is_array, no_volume
from .convert import TURNED
from .data_array import is_of_xarray, placed
from .model import Model
from .transfer import TransferFunction, as_transfer

Progress = Callable[[str, int, int], Any]


class BuildWarning(UserWarning):
    """What a user should know of what was written: NaN, labels without a name, rounded values, bricks that are left out."""


class Place:
    """Where a volume is in the world, checked."""

    def __init__(self, spacing: Any, origin: Any, direction: Any, frame: str, unit: str | None):
        if text("frame", frame) not in ("RAS", "LPS"):
            raise ValueError(f'frame is "{frame}", but must be RAS or LPS')
        turned = TURNED if frame == "LPS" else np.ones(3)
        self.spacing = _numbers("spacing", spacing, 3)
        origin = _numbers("origin", origin, 3)
        self.origin = None if origin is None else [float(part) for part in origin * turned]
        matrix = _numbers("direction", None if direction is None else np.ravel(np.asarray(direction)), 9)
        # The library takes a vector for each axis, which is a column of the matrix.
        self.direction = None if matrix is None else (matrix.reshape(3, 3) * turned[:, None]).T.tolist()
        self.unit = None if unit is None else text("unit", unit)


class Reading:
    """What a file does not say itself, checked."""

    def __init__(
        self,
        shape: Any,
        dtype: Any,
        skip: int,
        volume: int,
        level: int,
        series: Any,
        outside_files: bool,
        unscaled: bool,
    ):
        if (shape is None) != (dtype is None):
            raise ValueError("shape and dtype describe a file without a header; give both")
        self.raw = None
        if shape is not None:
            z, y, x = _sides(shape)
            dtype = np.dtype(dtype)
            if dtype.kind not in "uif":
                raise TypeError(f"dtype is {dtype}, but must be of whole or floating-point numbers")
            order = "be" if dtype.str[0] == ">" else "le"
            self.raw = ([x, y, z], f"{dtype.kind}{8 * dtype.itemsize}{order}")
        self.skip = whole_within("skip", skip, 0, 2**64 - 1)
        self.volume = whole_within("volume_index", volume, 0, 2**32 - 1)
        self.level = whole_within("level", level, 0, 2**32 - 1)
        if series is not None and not isinstance(series, str):
            series = str(whole("series", series))
        self.series = None if series is None else text("series", series)
        self.outside_files, self.unscaled = truth("outside_files", outside_files), truth("unscaled", unscaled)


class Packing:
    """What is stored, and what a build may use, checked."""

    def __init__(
        self,
        lanes: str,
        value_bits: int | None,
        normal_bits: int | None,
        memory: Any,
        threads: int | None,
        levels: int | str | None = None,
    ):
        if text("lanes", lanes) not in ("x", "xy", "xyz"):
            raise ValueError(f'lanes are "{lanes}", but must be x, xy or xyz')
        self.lanes = len(lanes)
        self.value_bits = None if value_bits is None else whole("value_bits", value_bits)
        self.normal_bits = None if normal_bits is None else whole("normal_bits", normal_bits)
        if self.value_bits not in (None, 8, 16):
            raise ValueError(f"value_bits are {value_bits}, but must be 8 or 16")
        if self.normal_bits not in (None, 0, 8, 16):
            raise ValueError(f"normal_bits are {normal_bits}, but must be 0, 8 or 16")
        self.levels = level_count(levels)
        self.memory, self.threads = byte_count(memory), thread_count(threads)


def build(
    volume: Any,
    out: str | os.PathLike[str] | None = None,
    *,
    visible: tuple[float | None, float | None] | None = None,
    transfer: Any = None,
    labels: Any = None,
    spacing: Sequence[float] | None = None,
    origin: Sequence[float] | None = None,
    direction: Any = None,
    frame: str | None = None,
    unit: str | None = None,
    lanes: str = "xyz",
    value_bits: int | None = None,
    normal_bits: int | None = None,
    levels: int | str | None = None,
    memory: int | str | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    shape: Sequence[int] | None = None,
    dtype: Any = None,
    skip: int = 0,
    volume_index: int = 0,
    level: int = 0,
    series: str | int | None = None,
    outside_files: bool = False,
    unscaled: bool = False,
) -> Model:
    """Builds a model of the visible voxels of a volume, in the file `out`, or in memory.

    `volume` is one of

    * a numpy array (z, y, x) of any real number type, byte order and strides; whole slices are read in place;
    * a zarr or dask array, or anything with `shape`, `dtype` and slices, of which a few slices at a time are in memory;
    * an xarray DataArray; its coordinates give what you do not give of its place, and must be regular;
    * a SimpleITK image, which brings its own spacing, origin, direction and frame;
    * a path, or a list or pattern of paths of slices, that `adj build` reads: DICOM, Zarr and OME-Zarr, TIFF, NRRD,
      MetaImage, NIfTI, VTK, SLC, raw; or `phantom:NAME`.

    What is visible, one of; without, the values decide, and `Model.transfer` tells how:

    * `visible=(low, high)`: the values in this range, ends included; None leaves an end open;
    * `transfer=`: a `TransferFunction`, its dict, a preset's name, or a path;
    * `labels=`: for a label map: "distinct", "file" (the palette in the volume's file), "frog", a path, or a dict of label
      to colour.

    The volume's place, in place of what its file says: `spacing`, `origin` (x, y, z) and `direction` (nine numbers, row
    after row, whose columns are the axes) as in SimpleITK. `frame` says in which world `origin` and `direction` are: "RAS"
    (NIfTI, the default) or "LPS" (SimpleITK, DICOM). Without `direction`, the axes of an array or raw file are that world's.

    What is stored: `lanes` ("x", "xy", "xyz"), `value_bits` (8 or 16) and `normal_bits` (0, 8 or 16); `levels`, a number of
    coarser levels of detail besides, or "auto".

    `value_bits` are the bits of a stored value: by default 8, or 16 where 8 would turn visible voxels transparent or mix up
    labels. Whole numbers are exact if all are among 256 (or 65,536) multiples of one step. Other values are rounded;
    `attrs["values"]["rounding"]` of the model is the most by which one is. `value_bits=16` keeps all whole numbers of 16
    bits. `normal_bits` are those of each component of a normal: 8, 16, or 0 for none.

    `memory` bounds the bytes of the process (or "256MiB") while a file is written. What a library takes to decode its array
    is counted with twice the slices that are read at a time; zarr may take twice as much. `threads` defaults to all
    processors. The result depends on neither. `progress(phase, done, total)` is called about twenty times a second; what
    it raises stops the build, as Ctrl-C does, and no file is left. Of two builds that write one path at the same time, one
    file stays, and both may return it.

    Of files: `shape` (z, y, x), `dtype` and `skip` describe one without a header; `volume_index`, `level` and `series`
    choose one of several volumes, resolutions or DICOM series; `outside_files` allows headers to name files in other
    folders; `unscaled` ignores slope and intercept.

    Raises `ValueError` and `TypeError` for what cannot be used, `OSError` for the system's refusals, `FormatError` for
    damaged files, `MemoryError`. Warns with `BuildWarning`.

    >>> ramp = np.arange(27, dtype=np.float32).reshape(3, 3, 3)
    >>> adj.build(ramp, visible=(20, None), spacing=(1, 1, 2.5))
    <adjsplat.Model 3 x 3 x 3 (z, y, x), 7 visible voxels, in memory>
    """
    if sum(choice is not None for choice in (visible, transfer, labels)) > 1:
        raise ValueError("visible, transfer and labels each say what is visible; give one of them")
    chosen = chosen_transfer(visible, transfer, labels)
    if type(volume).__module__.partition(".")[0] == "SimpleITK":
        if any(part is not None for part in (spacing, origin, direction, frame)):
            raise ValueError("a SimpleITK image brings its own spacing, origin, direction and frame")
        if volume.GetDimension() != 3:
            raise ValueError(f"the image has {volume.GetDimension()} dimensions, but a volume has 3: x, y, z")
        spacing, origin, direction, frame = volume.GetSpacing(), volume.GetOrigin(), volume.GetDirection(), "LPS"
        from SimpleITK import GetArrayViewFromImage

        # The view does not keep the image, whose memory it shows: this name does.
        image = volume
        volume = GetArrayViewFromImage(image)
    volume, place = placed_volume(volume, spacing, origin, direction, frame, unit, is_raw=shape is not None)
    packing = Packing(lanes, value_bits, normal_bits, memory, threads, levels)
    if is_array(volume):
        of_files = (
            shape,
            dtype,
            series,
            skip or None,
            volume_index or None,
            level or None,
            outside_files or None,
            unscaled or None,
        )
        if any(option is not None for option in of_files):
            raise ValueError(
                "shape, dtype, skip, volume_index, level, series, outside_files and unscaled are for files"
            )
        slices = Slices(volume, packing.memory)
        source = _native.array_source(
            slices.read, slices.dims, slices.sample_type, slices.name, place, slices.buffer_bytes
        )
        files: list[str] = []
    else:
        files = file_paths(volume)
        reading = Reading(shape, dtype, skip, volume_index, level, series, outside_files, unscaled)
        source = _native.file_source(files, reading, place, None)
        for note in source.notes:
            warnings.warn(note, BuildWarning, stacklevel=2)
    path = None if out is None else output_path(out, files)
    model, lines = _native.build(source, chosen, path, packing, function("progress", progress))
    for line in lines:
        warnings.warn(line, BuildWarning, stacklevel=2)
    return Model(model, path)


def placed_volume(
    volume: Any, spacing: Any, origin: Any, direction: Any, frame: str | None, unit: str | None, *, is_raw: bool
) -> tuple[Any, Place]:
    """Returns a volume and its place; an xarray DataArray has its own, and is turned to the order z, y, x."""
    if is_of_xarray(volume):
        volume, spacing, origin, direction, own_unit, notes = placed(volume, spacing, origin, direction)
        unit = own_unit if unit is None else unit
        for note in notes:
            warnings.warn(note, BuildWarning, stacklevel=3)
    if direction is None and (is_raw or is_array(volume)):
        # The axes of an array or raw file are those of the named world; other files have their own.
        direction = np.eye(3)
    return volume, Place(spacing, origin, direction, "RAS" if frame is None else frame, unit)


def chosen_transfer(visible: Any, transfer: Any, labels: Any) -> str | None:
    """Returns what is visible: a transfer function's JSON, "file" for the file's own palette, or None."""
    if visible is not None:
        need = f"visible must be two values (low, high), each a number or None for an open end, not {visible!r}"
        if isinstance(visible, (str, bytes)) or not isinstance(visible, Sequence | np.ndarray):
            raise TypeError(need)
        if len(visible) != 2:
            raise ValueError(need)
        return TransferFunction.range(*visible).to_json()
    if transfer is not None:
        return as_transfer(transfer).to_json()
    if labels is None or isinstance(labels, str) and labels == "file":
        return labels
    if isinstance(labels, Mapping) and "kind" not in labels:
        return TransferFunction.labels(labels).to_json()
    palette = TransferFunction.labels() if isinstance(labels, str) and labels == "distinct" else as_transfer(labels)
    if palette.kind != "labels":
        raise ValueError(f"labels need a palette, but this is a function of kind {palette.kind}")
    return palette.to_json()


def file_paths(volume: Any) -> list[str]:
    """Returns the paths that `volume` names: one, several, or a pattern."""
    if isinstance(volume, (str, bytes, os.PathLike)):
        path = path_text(volume)
        if not os.path.exists(path) and any(sign in path for sign in "*?["):
            found = sorted(file for file in glob.glob(path) if os.path.isfile(file))
            if not found:
                raise FileNotFoundError(2, "no file matches this pattern", path)
            return found
        if path.endswith(".adj") and os.path.isfile(path):
            raise ValueError(
                f"{path} is an .adj file, which holds no volume; open it, or give the volume that it was built from"
            )
        return [path]
    is_list = isinstance(volume, Sequence) and not isinstance(volume, memoryview)
    if is_list and volume and all(isinstance(file, (str, bytes, os.PathLike)) for file in volume):
        return [path_text(file) for file in volume]
    raise no_volume("an array (z, y, x), a path or a list of paths", volume)


def _numbers(name: str, numbers: Any, count: int) -> np.ndarray | None:
    if numbers is None:
        return None
    need = f"{name} must be {count} numbers, not {numbers!r}"
    try:
        array = np.asarray(numbers, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(need) from None
    if array.shape != (count,):
        raise ValueError(need)
    return array


def _sides(shape: Any) -> list[int]:
    need = f"shape must be three whole numbers (z, y, x), not {reprlib.repr(shape)}"
    if isinstance(shape, (str, bytes)) or not isinstance(shape, Sequence | np.ndarray):
        raise TypeError(need)
    if len(shape) != 3:
        raise ValueError(need)
    return [whole_within("a side of shape", points, 1, 65535) for points in shape]
