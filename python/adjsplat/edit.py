"""Edits: voxels added to a model and removed from it, written to a new file."""

from __future__ import annotations

import os
import warnings
from typing import Any

import numpy as np

from . import _native
from .arguments import function, level_count, output_path, thread_count, working_memory
from .arrays import refuse_masked
from .build import BuildWarning, Progress
from .model import Model, with_look

#: Voxels whose places in a mask are looked up at once.
LOOKED_UP = 1 << 20


class _Step:
    def __init__(self, positions: np.ndarray, values: Any = None, normals: Any = None, magnitudes: Any = None):
        self.positions, self.values, self.normals, self.magnitudes = positions, values, normals, magnitudes


class Edit:
    """Voxels to add to a model and to remove from it, in the order of the calls. The model itself stays as it is.

    Each edited voxel takes some 50 bytes of memory until the file is saved.

    >>> g = f.edit().remove(f.values() < 150).save("bright.adj")
    >>> bool(g.count == (f.values() >= 150).sum())
    True
    """

    def __init__(self, model: Model):
        self._model = model
        self._steps: list[_Step] = []

    def add(self, coordinates: Any, values: Any, *, normals: Any = None, magnitudes: Any = None) -> Edit:
        """Adds voxels at `coordinates` (n, 3), ordered (z, y, x), or replaces those that are there.

        `values` are n numbers or one for all, within the range that the file stores (`ValueError` beyond it); they are
        rounded as the file's are. `normals` (n, 3) are world vectors (x, y, z), scaled to length 1; without, a voxel has
        none. A file whose opacities depend on gradient magnitudes needs `magnitudes`.
        """
        positions = self._positions(coordinates)
        count = len(positions)
        self._steps.append(
            _Step(
                positions,
                _broadcast("values", values, (count,)),
                None if normals is None else _broadcast("normals", normals, (count, 3)),
                None if magnitudes is None else _broadcast("magnitudes", magnitudes, (count,)),
            )
        )
        return self

    def remove(self, mask: Any) -> Edit:
        """Removes voxels: where a boolean array of the volume's shape is true; or, with one boolean for each visible voxel
        in the order of `Model.coordinates`, these; or those at integer coordinates (n, 3). Others stay."""
        refuse_masked("mask", mask)
        mask = np.asarray(mask)
        if mask.dtype != bool:
            positions = self._positions(mask)
        elif mask.shape == self._model.shape:
            positions = self._visible_in(mask)
        elif mask.shape == (self._model.count,):
            positions = self._model.coordinates()[mask]
        else:
            need = f"{self._model.shape}, or ({self._model.count},) for the visible voxels"
            raise ValueError(f"the mask has the shape {mask.shape}, but must have {need}")
        self._steps.append(_Step(np.array(positions, dtype=np.uint32, order="C")))
        return self

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        levels: int | str | None = None,
        verify: bool = True,
        memory: int | str | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Model:
        """Writes the edited voxels to the file `path`, whole or not at all, and opens it; arguments are those of `build`.

        Raises `FormatError` if the model is damaged. `verify=False` does not check it: it is faster, but damage may pass
        into the file.

        Levels of detail are made if `levels` asks for them, as in `build`. Those of the model's file are of the voxels
        before the edit: they are left out, with a `BuildWarning`.

        The file keeps the transfer function that the model's file has; the model that is returned is drawn with that of
        this model. Raises `ValueError` if no voxel is left.
        """
        path = output_path(path)
        native = self._model._open
        # Progress may close the model.
        look = native.transfer
        wanted = level_count(levels)
        resources = working_memory(memory), thread_count(threads)
        progress = function("progress", progress)
        if verify:
            self._model.verify()
        saved, left_out = _native.save_edited(native, path, self._steps, wanted, resources, progress)
        if left_out and levels is None:
            note = f"the {left_out} levels of detail of the file are left out; levels={left_out} makes them anew"
            warnings.warn(note, BuildWarning, stacklevel=2)
        return with_look(Model(saved, path), look)

    def _visible_in(self, mask: np.ndarray) -> np.ndarray:
        """Returns the voxels, visible or added so far, where a dense mask is true; a part of them at a time is looked up."""
        voxels = [self._model.coordinates(), *(step.positions for step in self._steps if step.values is not None)]
        parts = [of[first : first + LOOKED_UP] for of in voxels for first in range(0, len(of), LOOKED_UP)]
        return np.concatenate([voxels[0][:0], *(part[mask[tuple(part.T)]] for part in parts)])

    def _positions(self, coordinates: Any) -> np.ndarray:
        refuse_masked("coordinates", coordinates)
        positions = np.asarray(coordinates)
        if positions.size == 0:
            return np.empty((0, 3), np.uint32)
        if positions.ndim != 2 or positions.shape[1] != 3:
            raise ValueError(f"coordinates have the shape {positions.shape}, but must have (n, 3): z, y, x")
        if positions.dtype.kind not in "ui":
            raise TypeError(f"coordinates are {positions.dtype}, but must be whole numbers")
        if (positions < 0).any() or (positions >= np.array(self._model.shape)).any():
            raise ValueError(f"coordinates lie outside the volume of shape {self._model.shape}")
        # A copy: the caller may change the array before the edit is saved.
        return np.array(positions, dtype=np.uint32, order="C")

    def __repr__(self) -> str:
        return f"<adjsplat.Edit of {self._model!r}, {len(self._steps)} steps>"


def _broadcast(name: str, numbers: Any, shape: tuple[int, ...]) -> np.ndarray:
    refuse_masked(name, numbers)
    array = np.asarray(numbers)
    if array.dtype.kind not in "uif":
        raise TypeError(f"{name} are {array.dtype}, but must be real numbers")
    array = array.astype(np.float64)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    try:
        return np.ascontiguousarray(np.broadcast_to(array, shape))
    except ValueError:
        raise ValueError(f"{name} have the shape {array.shape}, but must have {shape}") from None
