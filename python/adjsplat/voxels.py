"""Voxels: what a file and each of its levels of detail have in common: a grid, values, dense arrays."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from . import _native, convert
from .indices import covered, expanded
from .lanes import Lane


class Voxels:
    """Visible voxels on a grid: those of a model, or of one of its levels of detail.

    Arrays, `shape`, slices and positions are ordered (z, y, x); `spacing`, `origin` and `direction` (x, y, z).
    """

    @property
    def _open(self) -> _native.Model:
        raise NotImplementedError

    @property
    def _description(self) -> dict[str, Any]:
        """What the file says about itself; nobody changes it."""
        raise NotImplementedError

    @property
    def attrs(self) -> Mapping[str, Any]:
        """What the file says about itself, as in zarr: source, transfer function, values, unit. A copy of it, read-only.

        `attrs["values"]["rounding"]` is the most by which a stored value differs from the volume's; 0 if all are exact.

        >>> f.attrs["source"]["sample_type"]
        'u8'
        """
        return MappingProxyType(copy.deepcopy(self._description))

    @property
    def nbytes(self) -> int:
        """Bytes of the file; of a level, its part of the file."""
        return self._open.nbytes

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
        unit = self._description.get("unit")
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

        It is float64 if the volume was, if single precision would not tell the values apart, or if it would round them by
        more than a small part of `attrs["values"]["rounding"]`.
        """
        low, step = self._open.value_scale
        high = low + step * (2 ** self._open.bits[0] - 1)
        values = self._description.get("values")
        highest, rounding = (values.get(name) if isinstance(values, dict) else None for name in ("highest", "rounding"))
        if isinstance(highest, (int, float)) and low <= highest < high:
            high = float(highest)
        if float(low).is_integer() and float(step).is_integer():
            for name in ("uint8", "int16", "uint16", "int32", "uint32"):
                if np.iinfo(name).min <= min(low, 0) and high <= np.iinfo(name).max:
                    return np.dtype(name)
        source = self._description.get("source")
        sample_type = source.get("sample_type") if isinstance(source, dict) else None
        if sample_type == "f64":
            return np.dtype("float64")
        # Single precision keeps codes apart unless they are far from 0, by their distances, or very small.
        largest = max(abs(low), abs(high))
        is_fine = step == 0 or largest / step < 2**22
        if sample_type != "f32" and isinstance(rounding, (int, float)) and rounding > 0:
            # It rounds by up to largest / 2**24: here at most a sixteenth of the build's rounding.
            is_fine = is_fine and largest / 2**20 <= rounding
        return np.dtype("float32" if is_fine and (largest == 0 or 1e-30 < largest < 1e38) else "float64")

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
        """Returns the positions of the visible voxels as three arrays z, y, x, in the order of `numpy.nonzero`.

        They are those of the dense array's values other than 0, unless a visible voxel has the value 0.

        >>> all((a == b).all() for a, b in zip(f.nonzero(), np.nonzero(f.to_numpy())))
        True
        """
        return tuple(self.coordinates().T.astype(np.intp))

    def values(self) -> np.ndarray:
        """Returns the value of each visible voxel, in the order of `coordinates`.

        By default a build stores values in 8 bits, so they may be rounded: `attrs["values"]["rounding"]` is the most by
        which one differs from the volume's. `build(value_bits=16)` rounds 256 times less.

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
        """Returns the box of `shape` (z, y, x) whose first point is `low`, dense; `fill` stands for what is not visible.

        With a `dtype` of whole numbers, values are rounded, and those beyond its range become its lowest or highest number.
        """
        if min(*low, *shape) < 0 or any(
            int(first) + int(size) > points for first, size, points in zip(low, shape, self.shape)
        ):
            raise ValueError(f"a block at {low} of the shape {shape} reaches beyond the volume")
        dtype = np.dtype(self.dtype if dtype is None else dtype).newbyteorder("=")
        if dtype not in _NATIVE:
            raise ValueError(f"dtype is {dtype}, but must be one of {', '.join(map(str, _NATIVE))}")
        if isinstance(fill, int) and abs(fill) > 2**53:
            raise ValueError(f"fill is beyond {dtype}: choose another number")
        is_whole = float(fill).is_integer()
        if dtype.kind == "f" and float(np.finfo(dtype).max) < abs(float(fill)) < math.inf:
            raise ValueError(f"{dtype} does not hold {fill:g}, which is to fill the block: choose another dtype")
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
        """Returns the whole volume, dense; `fill` stands for what is not visible, and `dtype` is as for `block`."""
        return self.block((0, 0, 0), self.shape, dtype=dtype, fill=fill)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        if copy is False:
            raise ValueError("a model stores no dense array, so one cannot be had without a copy")
        wanted = self.dtype if dtype is None else np.dtype(dtype)
        # Other types than those of `to_numpy` are numpy's to convert to.
        dense = self.to_numpy(dtype=wanted if wanted.newbyteorder("=") in _NATIVE else None)
        return dense.astype(wanted, copy=False)

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


_NATIVE = tuple(np.dtype(name) for name in ("u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"))
