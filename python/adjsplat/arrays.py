"""Arrays as slices of plain samples, which is how a build reads them."""

from __future__ import annotations

from typing import Any

import numpy as np

#: Most bytes of an array that is not in memory (zarr, dask) which are read at once, unless a slice is larger.
SLAB_BYTES = 256 << 20

#: Number types that the library has none for, and those that hold the same numbers.
WIDENED = {"b1": "u1", "f2": "f4"}
#: Numbers of 64 bits are taken if they fit these 32.
NARROWED = {"i8": "i4", "u8": "u4"}

#: Packages whose images have no shape and slices, and how to get these.
IMAGES = {
    "pyvista": "image.point_data[name].reshape(image.dimensions[::-1]), and spacing and origin",
    "SimpleITK": 'SimpleITK.GetArrayFromImage(image), and spacing, origin, direction and frame="LPS"',
}


def is_array(volume: Any) -> bool:
    """Returns whether `volume` has slices of numbers: numpy, zarr, dask, xarray, h5py arrays."""
    return hasattr(volume, "shape") and hasattr(volume, "dtype") and hasattr(volume, "__getitem__")


def no_volume(kinds: str, volume: Any) -> TypeError:
    """Returns the error for what is none of `kinds` of volumes, with advice for images of other packages."""
    advice = IMAGES.get(type(volume).__module__.partition(".")[0])
    return TypeError(f"a volume is {kinds}, not {type(volume).__name__}{'' if advice is None else f'; give {advice}'}")


def refuse_masked(name: str, array: Any) -> None:
    """Refuses an array whose mask would be ignored."""
    # Dask tells by this empty array what its blocks are.
    if isinstance(array, np.ma.MaskedArray) or isinstance(getattr(array, "_meta", None), np.ma.MaskedArray):
        raise TypeError(f"{name} is masked; fill its masked values first: array.filled(0)")


class Slices:
    """Hands out the slices of an array (z, y, x), contiguous and in this machine's byte order.

    Slices of a numpy array that are so already are views: nothing is copied here. Of other arrays as many slices are
    read at once as their chunks are deep, within `SLAB_BYTES` or a quarter of `memory`.
    """

    def __init__(self, array: Any, memory: int | None):
        refuse_masked("the array", array)
        shape = tuple(array.shape)
        if len(shape) != 3:
            raise ValueError(f"the array has {len(shape)} dimensions, but a volume has 3: z, y, x")
        if any(points != points for points in shape):
            raise ValueError("the array does not know its shape; call array.compute_chunk_sizes() first")
        if 0 in shape:
            raise ValueError(f"the array has the shape {shape}, but each side must be at least 1")
        dtype = np.dtype(array.dtype)
        code = f"{dtype.kind}{dtype.itemsize}"
        self.target = np.dtype(WIDENED.get(code) or NARROWED.get(code) or code) if dtype.kind in "buif" else None
        if self.target is None or self.target.itemsize > 8:
            raise TypeError(f"the array holds {dtype}, but a volume holds real numbers of 8 to 64 bits")
        self.array, self.shape, self.code = array, shape, code
        self.is_narrowed = code in NARROWED
        #: Points along x, y, z.
        self.dims = [int(points) for points in reversed(shape)]
        self.sample_type = f"{self.target.kind}{8 * self.target.itemsize}"
        self.name = str(getattr(array, "name", None) or "array").strip("/") or "array"
        self.depth = 1 if isinstance(array, np.ndarray) else self._slab_depth(dtype, memory)
        self.slab: np.ndarray | None = None
        self.first = 0
        slab_bytes = self.depth * shape[1] * shape[2] * dtype.itemsize
        #: The slab, and what decoding it may take once more; a numpy array is the caller's.
        self.buffer_bytes = 0 if isinstance(array, np.ndarray) else 2 * slab_bytes

    def _slab_depth(self, dtype: np.dtype, memory: int | None) -> int:
        chunks = getattr(self.array, "shards", None) or getattr(self.array, "chunks", None)
        deep = chunks[0] if chunks else 1
        # Dask lists the depth of every chunk.
        deep = max(deep) if isinstance(deep, tuple) else deep
        most = SLAB_BYTES if memory is None else min(SLAB_BYTES, memory // 4)
        fitting = most // max(1, self.shape[1] * self.shape[2] * dtype.itemsize)
        return int(max(1, min(deep, fitting, self.shape[0])))

    def read(self, z: int) -> np.ndarray:
        """Returns slice `z`."""
        if isinstance(self.array, np.ndarray):
            return self._plain(self.array[z])
        if self.slab is None or not self.first <= z < self.first + len(self.slab):
            self.slab = None
            self.first = z - z % self.depth
            self.slab = np.asarray(self.array[self.first : self.first + self.depth])
            given = self.slab.dtype
            if f"{given.kind}{given.itemsize}" != self.code:
                raise ValueError(f"the array says that it holds {self.array.dtype}, but gives slices of {given}")
        return self._plain(self.slab[z - self.first])

    def _plain(self, plane: np.ndarray) -> np.ndarray:
        plane = np.asarray(plane)
        if plane.shape != self.shape[1:]:
            raise ValueError(f"the array gives slices of the shape {plane.shape}, not {self.shape[1:]}")
        if self.is_narrowed:
            ends = np.iinfo(self.target)
            if plane.min() < ends.min or plane.max() > ends.max:
                raise ValueError(f"the array holds {plane.dtype} numbers beyond {self.target}; convert it to float64")
        return np.require(plane, self.target, ["C", "A"])
