"""Models: the visible voxels of a volume, in an .adj file or in memory."""

from __future__ import annotations

import builtins
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _native, convert, export
from .arguments import output_path
from .export import ExportReport
from .indices import covered, expanded
from .lanes import Lane
from .transfer import TransferFunction, as_transfer

if TYPE_CHECKING:
    from .edit import Edit


def open(path: str | os.PathLike[str], *, mapped: bool = True) -> Model:
    """Opens an .adj file. It is mapped, not read: this takes microseconds, whatever its size.

    Raises `OSError` if there is no such file, and `FormatError` (with `offset` and `rule`) if it is damaged. Nobody may
    shorten or change a mapped file in place; replacing it by another of its name is safe. `mapped=False` reads the file
    into memory instead, for places where that cannot be promised.

    >>> with adj.open("engine.adj") as f:
    ...     print(f.shape, f.count)
    (64, 64, 64) 143360
    """
    path = os.path.abspath(os.fsdecode(path))
    if mapped:
        return Model(_native.Model.open(path), path)
    # Opened as a map first: it refuses pipes and folders, and names the file in its errors.
    _native.Model.open(path)
    with builtins.open(path, "rb") as file:
        return Model(_native.Model.from_bytes(file.read()), path)


class Model:
    """The visible voxels of a volume, and the transfer function that they are drawn with.

    `open` and `build` return models. Arrays, `shape`, slices and positions are ordered (z, y, x), as in tifffile, zarr
    and napari. `spacing`, `origin` and `direction` are ordered (x, y, z), as in SimpleITK; where the volume's file names
    an anatomical frame, the world's axes are R, A, S, as in NIfTI (SimpleITK's are L, P, S: `to_sitk` converts).

    A model never changes. Threads may share it; another process that unpickles it opens the file by itself. After
    `close`, everything raises `ValueError`, except that arrays which were handed out stay valid.
    """

    def __init__(self, native: _native.Model, path: str | None):
        self._native: _native.Model | None = native
        self._path = path
        self._attrs: Mapping[str, Any] | None = None

    @property
    def _open(self) -> _native.Model:
        if self._native is None:
            raise ValueError(f"{self._path or 'the model'} is closed")
        return self._native

    # --- The file

    @property
    def path(self) -> str | None:
        """The file's absolute path; None for a model in memory."""
        return self._path

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._native is None

    def close(self) -> None:
        """Lets go of the file. The map itself goes with the last array that came from it."""
        self._native = None

    def __enter__(self) -> Model:
        _ = self._open
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def nbytes(self) -> int:
        """Bytes of the file."""
        return self._open.nbytes

    @property
    def attrs(self) -> Mapping[str, Any]:
        """What the file says about itself, as in zarr, but read-only: source, transfer function, values, unit.

        >>> f.attrs["source"]["sample_type"]
        'u8'
        """
        description = self._open.description
        if self._attrs is None:
            found = json.loads(description) if description else {}
            self._attrs = MappingProxyType(found if isinstance(found, dict) else {})
        return self._attrs

    def verify(self) -> None:
        """Checks every rule of the format, checksums included; raises `FormatError` at the first broken one."""
        self._open.verify(self._path or "memory")

    def save(self, path: str | os.PathLike[str]) -> Model:
        """Writes the model to a file, whole or not at all, and opens it.

        The file says which values the build stored, and so it keeps the transfer function of the build. The model that is
        returned is drawn with the same function as this one.
        """
        path = output_path(path)
        self._open.save(path)
        return with_look_of(open(path), self)

    # --- The grid

    @property
    def shape(self) -> tuple[int, int, int]:
        """Points along (z, y, x).

        >>> f.shape
        (64, 64, 64)
        """
        x, y, z = self._open.dims
        return z, y, x

    @property
    def ndim(self) -> int:
        """Always 3."""
        return 3

    @property
    def size(self) -> int:
        """Points of the whole grid, visible or not."""
        return math.prod(self.shape)

    @property
    def count(self) -> int:
        """Visible voxels."""
        return self._open.count

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Distances between points along (x, y, z), in world units."""
        x, y, z = self._open.spacing
        return x, y, z

    @property
    def origin(self) -> tuple[float, float, float]:
        """World position (x, y, z) of point (0, 0, 0)."""
        x, y, z = self._open.origin
        return x, y, z

    @property
    def direction(self) -> tuple[float, ...]:
        """Nine numbers, row after row, of the matrix whose columns are the world directions of the axes x, y, z.

        >>> f.direction
        (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
        """
        return tuple(float(part) for part in np.transpose(self._open.direction).ravel())

    @property
    def affine(self) -> np.ndarray:
        """The matrix (4, 4) from indices (x, y, z, 1) to the world, as nibabel's."""
        affine = np.eye(4)
        affine[:3, :3] = np.transpose(self._open.direction) * self._open.spacing
        affine[:3, 3] = self._open.origin
        return affine

    @property
    def unit(self) -> str | None:
        """The unit of spacing and origin, such as "mm", if the volume's file named one."""
        unit = self.attrs.get("unit")
        return unit if isinstance(unit, str) else None

    @property
    def bounds(self) -> tuple[slice, slice, slice]:
        """The smallest box (z, y, x) of slices that holds all visible voxels: `f[f.bounds]` is the volume, cropped."""
        low, high = self._open.bounds() or ((0, 0, 0), (-1, -1, -1))
        x, y, z = (slice(a, b + 1) for a, b in zip(low, high))
        return z, y, x

    # --- Values

    @property
    def dtype(self) -> np.dtype:
        """The type that values are handed out in: the smallest of whole numbers that holds all, else a float.

        It is float64 if the volume was, or if single precision would not tell the values apart.
        """
        low, step = self._open.value_scale
        high = low + step * (2 ** self._open.bits[0] - 1)
        highest = self.attrs.get("values", {})
        highest = highest.get("highest") if isinstance(highest, dict) else None
        if isinstance(highest, (int, float)) and low <= highest < high:
            high = float(highest)
        if float(low).is_integer() and float(step).is_integer():
            for name in ("uint8", "int16", "uint16", "int32", "uint32"):
                if np.iinfo(name).min <= min(low, 0) and high <= np.iinfo(name).max:
                    return np.dtype(name)
        source = self.attrs.get("source")
        if isinstance(source, dict) and source.get("sample_type") == "f64":
            return np.dtype("float64")
        # Single precision keeps codes apart unless they are far from 0, by their distances, or very small.
        largest = max(abs(low), abs(high))
        is_fine = step == 0 or largest / step < 2**22
        return np.dtype("float32" if is_fine and (largest == 0 or 1e-30 < largest < 1e38) else "float64")

    @property
    def transfer(self) -> TransferFunction:
        """The transfer function that pictures are drawn with."""
        return TransferFunction(self._open.transfer)

    def with_transfer(self, transfer: Any) -> Model:
        """Returns the same voxels, drawn with another transfer function.

        What the build left out stays invisible: `missing_values` tells which values these are.

        >>> f.with_transfer(adj.TransferFunction.range(150)).transfer.kind
        'range'
        """
        model = Model(self._open.with_transfer(as_transfer(transfer).to_json()), self._path)
        return model

    def missing_values(self, transfer: Any) -> list[tuple[float, float]]:
        """Returns the ranges (lowest, highest) of values that `transfer` shows and the build left out.

        >>> f.missing_values(adj.TransferFunction.range(150))
        []
        """
        return [(low, high) for low, high in self._open.missing_values(as_transfer(transfer).to_json())]

    @property
    def lanes(self) -> Mapping[str, Lane]:
        """The stored lanes by axis: arrays of the file's own bytes.

        >>> f.lanes["x"].steps.flags.writeable
        False
        """
        native = self._open
        return {axis: Lane(native, axis) for axis in native.lanes}

    def coordinates(self) -> np.ndarray:
        """Returns the positions (z, y, x) of the visible voxels, sorted as by `numpy.nonzero`: uint16, shape (count, 3)."""
        out = np.empty((self.count, 3), np.uint16)
        return out[: _native.read_positions(self._open, out)]

    def nonzero(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the positions as `numpy.nonzero` of the dense array would: three arrays z, y, x.

        >>> all((a == b).all() for a, b in zip(f.nonzero(), np.nonzero(f.to_numpy())))
        True
        """
        return tuple(self.coordinates().T.astype(np.intp))

    def values(self) -> np.ndarray:
        """Returns the value of each visible voxel, in the order of `coordinates`.

        >>> bool((f.values() == f.to_numpy()[f.nonzero()]).all())
        True
        """
        out = np.empty(self.count, self.dtype)
        return out[: _native.read_values(self._open, out)]

    def normals(self) -> np.ndarray:
        """Returns the normal of each visible voxel, in the order of `coordinates`: float32, shape (count, 3).

        Components are (x, y, z) in the world. A normal is a unit vector against the gradient, or 0 where there is none.
        """
        if not self._open.bits[1]:
            raise ValueError("the model stores no normals: it was built unshaded, or with normal_bits=0")
        out = np.empty((self.count, 3), np.float32)
        return out[: _native.read_normals(self._open, out)]

    def magnitudes(self) -> np.ndarray:
        """Returns the gradient magnitude of each visible voxel, in the order of `coordinates`, as float64."""
        if not self._open.bits[2]:
            raise ValueError("the model stores no magnitudes: its transfer function does not need them")
        out = np.empty(self.count, np.float64)
        return out[: _native.read_magnitudes(self._open, out)]

    # --- Dense arrays

    def block(
        self, low: tuple[int, int, int], shape: tuple[int, int, int], *, dtype: Any = None, fill: float = 0
    ) -> np.ndarray:
        """Returns the box of `shape` (z, y, x) whose first point is `low`, dense; `fill` stands for what is not visible."""
        if min(*low, *shape) < 0:
            raise ValueError(f"a block at {low} of the shape {shape} reaches beyond the volume")
        dtype = np.dtype(self.dtype if dtype is None else dtype).newbyteorder("=")
        if dtype not in _NATIVE:
            raise ValueError(f"dtype is {dtype}, but must be one of {', '.join(map(str, _NATIVE))}")
        if isinstance(fill, int) and abs(fill) > 2**53:
            raise ValueError(f"fill is beyond {dtype}: choose another number")
        is_whole = float(fill).is_integer()
        if dtype.kind != "f" and not (is_whole and np.iinfo(dtype).min <= fill <= np.iinfo(dtype).max):
            raise ValueError(f"{dtype} does not hold {fill}, which is to fill the block: choose another dtype")
        out = np.zeros(shape, dtype) if fill == 0 else np.full(shape, fill, dtype)
        if out.size:
            _native.read_block(self._open, out, tuple(reversed(low)))
        return out

    def __getitem__(self, key: Any) -> np.ndarray:
        """Returns a dense block: `f[100:164, :, :]`, `f[40]`, `f[..., ::2]`. What is not visible is 0.

        >>> f[10:12, :, 5].shape
        (2, 64)
        """
        _ = self._open
        ranges, keys = [], expanded(key)
        for axis, (part, points) in enumerate(zip(keys, self.shape)):
            ranges.append(covered(part, points, axis))
        low, shape, within = zip(*ranges)
        return self.block(low, shape)[within]

    #: `value in f` would compare whole slices; `f.values()` has the values.
    __contains__ = None

    def __len__(self) -> int:
        return self.shape[0]

    def __iter__(self) -> Iterator[np.ndarray]:
        return (self[z] for z in range(self.shape[0]))

    def to_numpy(self, *, dtype: Any = None, fill: float = 0) -> np.ndarray:
        """Returns the whole volume, dense; `fill` stands for what is not visible."""
        return self.block((0, 0, 0), self.shape, dtype=dtype, fill=fill)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        if copy is False:
            raise ValueError("a model stores no dense array, so one cannot be had without a copy")
        dense = self.to_numpy()
        return dense if dtype is None else dense.astype(dtype, copy=False)

    def __dask_tokenize__(self) -> tuple[Any, ...]:
        return "adjsplat.Model", self._open.fingerprint

    def to_dask(self, chunks: Any = "auto") -> Any:
        """Returns a dask array (z, y, x) that reads a block when it is computed."""
        return convert.to_dask(self, chunks)

    def to_xarray(self, *, chunks: Any = None) -> Any:
        """Returns an xarray DataArray with dimensions z, y, x and world coordinates; lazy if `chunks` are given.

        If the axes point along the world's, coordinates are those of the world. In an oblique volume they are distances
        from the first point; the attributes `origin` and `direction` place them.
        """
        return convert.to_xarray(self, chunks)

    def to_sitk(self) -> Any:
        """Returns a SimpleITK image; its origin and direction are turned from R, A, S to SimpleITK's L, P, S."""
        return convert.to_sitk(self)

    def to_pyvista(self) -> Any:
        """Returns a PyVista ImageData with the point data "values"."""
        return convert.to_pyvista(self)

    # --- Files of other formats

    def export(
        self,
        path: str | os.PathLike[str],
        *,
        fill: float | None = None,
        progress: Callable[[str, int, int], Any] | None = None,
    ) -> ExportReport:
        """Writes the visible voxels for other tools: a file, or a folder for .zarr, whole or not at all.

        The ending of `path` chooses the format: .nrrd, .nii, .nii.gz, .mha, .vti, .raw, .npz, .zarr (dense volumes), .csv,
        .vdb (sparse), .ply, .spz (3-D Gaussians). `fill` is the sample of points that are not visible, in dense formats; by
        default a value that the transfer function hides. Memory holds a few slices. docs/export.md says what each format
        keeps and loses.

        Raises `ValueError` if the ending is unknown or the format cannot hold the voxels, `OSError` if writing fails.

        >>> f.export("engine.nii.gz").dtype
        dtype('uint8')
        """
        return export.write(self, path, fill, progress)

    # --- Editing

    def edit(self) -> Edit:
        """Starts an edit: `f.edit().add(coordinates, values).remove(mask).save(path)`."""
        from .edit import Edit

        return Edit(self)

    def __reduce__(self) -> tuple[Any, ...]:
        if self._path is not None:
            return _reopened, (self._path, self._open.transfer)
        return _loaded, (self._open.to_bytes(), self._open.transfer)

    def __repr__(self) -> str:
        where = self._path or "in memory"
        if self.closed:
            return f"<adjsplat.Model closed, {where}>"
        z, y, x = self.shape
        return f"<adjsplat.Model {z} x {y} x {x} (z, y, x), {self.count} visible voxels, {where}>"


_NATIVE = tuple(np.dtype(name) for name in ("u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"))


def with_look_of(model: Model, other: Model) -> Model:
    """Returns the voxels of `model`, drawn with the transfer function of `other`."""
    return _with_text(model, other._open.transfer)


def _reopened(path: str, transfer: str) -> Model:
    return _with_text(open(path), transfer)


def _loaded(data: bytes, transfer: str) -> Model:
    return _with_text(Model(_native.Model.from_bytes(data), None), transfer)


def _with_text(model: Model, transfer: str) -> Model:
    return model if model._open.transfer == transfer else model.with_transfer(TransferFunction(transfer))
