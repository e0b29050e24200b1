"""Levels of detail: the voxels of a file on coarser grids."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _native
from .voxels import Voxels

if TYPE_CHECKING:
    from .model import Model


class Level(Voxels):
    """A coarser level of detail of a model: `f.levels[n]`.

    A voxel of a level stands for a block of points of the level before, of which at least one is visible. Its value and its
    normal are means over what is seen of the block, its `coverage` is the share that is visible. All else is as of a model:
    arrays, slices, lanes, conversions. `attrs`, `unit` and `dtype` are the model's. Once the model is closed, everything
    raises `ValueError`.
    """

    def __init__(self, model: Model, number: int):
        self._model = model
        self._level: _native.Model = model._open.level(number)
        #: The level's number, from 1.
        self.level = number

    @property
    def _open(self) -> _native.Model:
        _ = self._model._open
        return self._level

    @property
    def model(self) -> Model:
        """The model that the level is of."""
        return self._model

    @property
    def _description(self) -> dict[str, Any]:
        return self._model._description

    def coverage(self) -> np.ndarray:
        """Returns which share of its block is visible, for each voxel in the order of `coordinates`: float32, 0 to 1.

        >>> level = g.levels[1]
        >>> dense = np.zeros(level.shape, np.float32)
        >>> dense[level.nonzero()] = level.coverage()
        >>> blocks = (g.to_numpy() > 0).reshape(32, 2, 32, 2, 32, 2)
        >>> bool((dense == blocks.mean(axis=(1, 3, 5))).all())
        True
        """
        return self._coverages()[0]

    def centres(self) -> np.ndarray:
        """Returns the mean place (z, y, x) of what is visible of each block, in points of the level: (count, 3), float32.

        Pictures show the voxel there. It is within 0.375 of `coordinates`.
        """
        return self._coverages()[1]

    def _coverages(self) -> tuple[np.ndarray, np.ndarray]:
        shares, centres = np.empty(self.count, np.float32), np.empty((self.count, 3), np.float32)
        count = _native.read_coverages(self._open, shares, centres)
        return shares[:count], centres[:count]

    def __reduce__(self) -> tuple[Any, ...]:
        return Level, (self._model, self.level)

    def __repr__(self) -> str:
        of = "a model in memory" if self._model.path is None else os.path.basename(self._model.path)
        if self._model.closed:
            return f"<adjsplat.Level {self.level} of {of}, closed>"
        z, y, x = self.shape
        return f"<adjsplat.Level {self.level}, {z} x {y} x {x} (z, y, x), {self.count} visible voxels, of {of}>"
