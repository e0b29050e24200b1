"""Lanes: the bytes of an .adj file as arrays, without copies."""

from __future__ import annotations

import numpy as np

from . import _native

#: A tile: 8 x 8 scan lines of a lane, as the file stores it (formats/adj-1.md).
TILE = np.dtype(
    [
        ("tile_u", "<u2"),
        ("tile_v", "<u2"),
        ("first_line", "<u4"),
        ("first_record", "<u8"),
        ("occupancy", "<u8"),
        ("low", "<u2"),
        ("high", "<u2"),
    ]
)


class Lane:
    """A stored lane: every visible voxel once, on the scan lines along one axis, as arrays that nothing copied.

    All arrays are read-only and stay valid after the model is closed. formats/adj-1.md says what they hold.
    """

    __slots__ = ("_model", "_wide_lines", "axis", "bits")

    def __init__(self, model: _native.Model, axis: str):
        #: The axis along which the lines run: "x", "y" or "z".
        self.axis = axis
        #: Bits of a value, of each component of a normal, of a magnitude, and of a coverage; 0 for what is not stored.
        self.bits = tuple(model.bits)
        self._model = model
        self._wide_lines = model.dims["xyz".index(axis)] > 1023

    def _section(self, name: str) -> np.ndarray:
        return _native.lane_section(self._model, self.axis, name)

    @property
    def tiles(self) -> np.ndarray:
        """The tiles that hold voxels, as records of the type `adjsplat.lanes.TILE`."""
        return self._section("tiles").view(TILE)

    @property
    def line_ends(self) -> np.ndarray:
        """For each line that holds voxels the end of its records, counted from its tile's first: uint16 or uint32."""
        return self._section("line ends").view("<u4" if self._wide_lines else "<u2")

    @property
    def steps(self) -> np.ndarray:
        """For each record the distance from the one before it on its line, uint8; 0 only bridges 255 points."""
        return self._section("steps")

    @property
    def values(self) -> np.ndarray:
        """For each record the code of its value: uint8 or uint16."""
        return self._section("values").view("<u2" if self.bits[0] == 16 else "u1")

    @property
    def normals(self) -> np.ndarray:
        """For each record the octahedral code of its normal: uint16 or uint32; empty if there are none."""
        return self._section("normals").view("<u4" if self.bits[1] == 16 else "<u2")

    @property
    def magnitudes(self) -> np.ndarray:
        """For each record the code of its gradient's magnitude, uint8; empty if there are none."""
        return self._section("magnitudes")

    @property
    def coverages(self) -> np.ndarray:
        """For each record of a level the code of what its block shows: uint8 masks or uint16; empty for level 0."""
        return self._section("coverages").view("<u2" if self.bits[3] == 16 else "u1")

    def __repr__(self) -> str:
        return f"<adjsplat.Lane along {self.axis}, {self.steps.size} records>"
