"""Transfer functions: which values are visible, and their colours and opacities."""

from __future__ import annotations

import json
import math
import os
import reprlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from . import _native
from ._optional import needed
from .arguments import number, path_text, whole

#: Opacities below this are drawn as nothing: it is less than one step of an 8-bit picture.
FAINT = 1 / 255


class TransferFunction:
    """Maps a value, and where the function says so its gradient's magnitude, to colour and opacity.

    Opacities are from 0 to 1 per voxel (per edge of a cube with the volume of one cell), or per `reference_length`. A
    function never changes; two with the same numbers are equal. The JSON is that of the program `adj`.

    >>> bone = TransferFunction.points([(150, "#8a5a3c", 0.0), (300, "#e8d3b0", 0.4), (900, (1, 0.98, 0.94), 0.9)])
    >>> float(bone.opacity(225))
    0.2
    >>> TransferFunction.from_json(bone.to_json()) == bone
    True
    """

    __slots__ = ("_text",)

    def __init__(self, document: Mapping[str, Any] | str):
        if not isinstance(document, (str, Mapping)):
            raise TypeError(f"a transfer function is made of a dict or JSON text, not of {reprlib.repr(document)}")
        text = document if isinstance(document, str) else _json(document)
        try:
            self._text = _native.transfer_json(text)
        except ValueError as error:
            # It quotes words of the document, which may have several lines.
            raise ValueError(str(error).replace("\n", " ")) from None

    @classmethod
    def from_json(cls, text: str) -> TransferFunction:
        """Reads JSON: an object with `kind` (points, range, contour, region or labels) and that kind's fields.

        >>> TransferFunction.from_json('{"kind": "range", "low": 60}').kind
        'range'
        """
        return cls(text)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> TransferFunction:
        """Reads a JSON file, or a colour table of 3D Slicer (`.ctbl`)."""
        return cls(_native.transfer_file(path_text(path)))

    @classmethod
    def preset(cls, name: str) -> TransferFunction:
        """Returns a built-in function: ct-bone, ct-skin, ct-angio, mr, labels, frog or gyroid.

        `ct-bone+1024` is `ct-bone` for values that are 1024 above Hounsfield units.

        >>> TransferFunction.preset("ct-bone+1024").opacity([1100, 2000]).round(2).tolist()
        [0.0, 0.9]
        """
        return cls(_native.transfer_preset(name))

    @classmethod
    def range(cls, low: float | None = None, high: float | None = None, *, opacity: float = 0.8) -> TransferFunction:
        """Shows the values from `low` to `high`, ends included; None leaves an end open.

        >>> TransferFunction.range(60).opacity([59, 60, 1000]).tolist()
        [0.0, 0.8, 0.8]
        """
        # Infinity is an open end, too.
        given = (("low", low, -math.inf), ("high", high, math.inf))
        ends = {name: end for name, end, no_end in given if end is not None and end != no_end}
        ends = {name: number(name, end) for name, end in ends.items()}
        return cls({"kind": "range", "opacity": number("opacity", opacity), **ends})

    @classmethod
    def contour(
        cls, value: float, *, opacity: float = 0.9, colour: Any = None, cap: str | None = None
    ) -> TransferFunction:
        """Shows the surface where the volume has this value, two voxels thick.

        `cap` closes it where the volume's faces cut the body of higher values ("above") or lower ones ("below").
        """
        contour = {"value": number("value", value), "opacity": number("opacity", opacity)} | (
            {} if colour is None else {"colour": _colour(colour)}
        )
        return cls({"kind": "contour", "contours": [contour]} | ({} if cap is None else {"cap": cap}))

    @classmethod
    def points(
        cls,
        points: Sequence[tuple[float, Any, float]],
        *,
        gradient: Sequence[tuple[float, float]] = (),
        shaded: bool = True,
    ) -> TransferFunction:
        """Interpolates between points (value, colour, opacity) with ascending values; constant beyond the ends.

        A colour is `"#rrggbb"` or three numbers from 0 to 1, in sRGB. `gradient` lists (magnitude, factor): a ramp by
        which opacities are multiplied.
        """
        document = {
            "kind": "points",
            "points": [
                {"value": number("a value", v), "colour": _colour(c), "opacity": number("an opacity", o)}
                for v, c, o in points
            ],
            "shaded": shaded,
        }
        ramp = [
            {"magnitude": number("a magnitude", m), "factor": number("a factor", f)}
            for m, f in (() if gradient is None else gradient)
        ]
        if ramp:
            document["gradient"] = ramp
        return cls(document)

    @classmethod
    def labels(cls, labels: Mapping[int, Any] | None = None, *, others: str = "transparent") -> TransferFunction:
        """Returns the palette of a label map: for each label a colour, or (name, colour), or (name, colour, opacity).

        Other labels are "transparent", or opaque in "distinct" colours. Without `labels`, every label above 0 has a
        colour of its own.

        >>> TransferFunction.labels({1: "#b31b2c", 7: ("liver", (0.5, 0.2, 0.1), 0.5)}).opacity([0, 1, 2, 7]).tolist()
        [0.0, 1.0, 0.0, 0.5]
        """
        if labels is None:
            return cls.preset("labels")
        if not isinstance(labels, Mapping):
            raise TypeError(f"labels must be a dict of label to colour, not {reprlib.repr(labels)}")

        def entry(label: int, look: Any) -> dict[str, Any]:
            if isinstance(look, tuple) and look and isinstance(look[0], str) and len(look) in (2, 3):
                name, colour, opacity = (*look, 1.0)[:3]
            else:
                name, colour, opacity = str(label), look, 1.0
            opacity = number("an opacity", opacity)
            return {"label": whole("a label", label), "name": name, "colour": _colour(colour), "opacity": opacity}

        return cls(
            {"kind": "labels", "labels": [entry(label, look) for label, look in labels.items()], "others": others}
        )

    @classmethod
    def from_matplotlib(
        cls,
        cmap: Any,
        clim: tuple[float, float],
        *,
        opacity: str | float | Sequence[float] = "sigmoid",
        samples: int = 64,
        shaded: bool = True,
    ) -> TransferFunction:
        """Takes the colours of a matplotlib colour map, spread over `clim`, the values (lowest, highest).

        `opacity` runs over the same values: "linear", "geom" (the square) or "sigmoid", each also with "_r" behind it for
        the reverse; a number; or a list of numbers from 0 to 1, evenly spread and interpolated. Values below `clim` are
        transparent, and opacities below 1/255 count as 0, so that the file does not store them; values above look like the
        highest.

        >>> magma = TransferFunction.from_matplotlib("magma", (100, 200), opacity="linear")
        >>> magma.opacity([99, 150, 300]).round(3).tolist()
        [0.0, 0.5, 1.0]
        """
        colormaps = needed("matplotlib", "TransferFunction.from_matplotlib").colormaps
        low, high = (number("an end of clim", end) for end in clim)
        if not (np.isfinite([low, high]).all() and low < high):
            raise ValueError(f"clim is {clim}, but must be two finite values, the lower one first")
        if not 2 <= samples <= 4096:
            raise ValueError(f"samples are {samples}, but must be 2 to 4096")
        share = np.linspace(0, 1, samples)
        if not isinstance(opacity, str) and (count := np.size(opacity)) > 1:
            # The list's own points too: between the samples it may have peaks.
            share = np.unique(np.concatenate([share, np.linspace(0, 1, count)]).round(12))
        opacities = _opacities(opacity, share)
        opacities[opacities < FAINT] = 0.0
        if isinstance(cmap, str) and cmap not in colormaps:
            raise ValueError(f'matplotlib has no colour map "{cmap}"')
        colours = (colormaps[cmap] if isinstance(cmap, str) else cmap)(share)[:, :3]
        points = [(v, tuple(c), o) for v, c, o in zip(low + share * (high - low), colours, opacities)]
        if opacities[0] > 0:
            # Beyond its ends a function is constant: a step keeps the values below transparent.
            points.insert(0, (points[0][0], points[0][1], 0.0))
        return cls.points(points, shaded=shaded)

    @property
    def kind(self) -> str:
        """The kind: "points", "range", "contour", "region" or "labels"."""
        return self.to_dict()["kind"]

    def to_json(self) -> str:
        """Returns the function as JSON, which `adj build --tf FILE` reads too."""
        return self._text

    def to_dict(self) -> dict[str, Any]:
        """Returns the function as what its JSON says."""
        return json.loads(self._text)

    def opacity(self, values: Any, magnitude: float = 0.0) -> np.ndarray:
        """Returns the opacity of each value, at a gradient of this magnitude, as float64 of the same shape."""
        values = np.asarray(values, dtype=np.float64)
        return _native.transfer_opacities(
            self._text, np.ascontiguousarray(values).ravel(), number("magnitude", magnitude)
        ).reshape(values.shape)

    def colour(self, values: Any) -> np.ndarray:
        """Returns linear red, green and blue of each value, as float32 with one more dimension.

        >>> TransferFunction.labels({1: "#ff0000"}).colour(1).tolist()
        [1.0, 0.0, 0.0]
        """
        values = np.asarray(values, dtype=np.float64)
        colours = _native.transfer_colours(self._text, np.ascontiguousarray(values).ravel())
        return colours.reshape(*values.shape, 3)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TransferFunction) and self._text == other._text

    def __hash__(self) -> int:
        return hash(self._text)

    def __reduce__(self) -> tuple[Any, ...]:
        return TransferFunction, (self._text,)

    def __repr__(self) -> str:
        return f"TransferFunction({json.dumps(self.to_dict())})"


def as_transfer(transfer: Any) -> TransferFunction:
    """Returns a transfer function: one, its document as a dict, a preset's name, or the path of a file of one."""
    if isinstance(transfer, TransferFunction):
        return transfer
    if isinstance(transfer, Mapping):
        return TransferFunction(transfer)
    if isinstance(transfer, os.PathLike):
        return TransferFunction.read(transfer)
    if isinstance(transfer, str):
        is_file = transfer.endswith((".json", ".ctbl")) or os.path.exists(transfer)
        return TransferFunction.read(transfer) if is_file else TransferFunction.preset(transfer)
    raise TypeError(
        f"transfer is {type(transfer).__name__}, but must be a TransferFunction, a dict, a preset or a path"
    )


def _colour(colour: Any) -> Any:
    if isinstance(colour, str):
        return colour
    try:
        parts = list(colour)
    except TypeError:
        need = 'a colour must be "#rrggbb" or three numbers from 0 to 1'
        raise TypeError(f"{need}, not {reprlib.repr(colour)}") from None
    return [number("a part of a colour", part) for part in parts]


def _opacities(opacity: str | float | Sequence[float], share: np.ndarray) -> np.ndarray:
    shapes = {"linear": share, "geom": share**2, "sigmoid": 1 / (1 + np.exp(-10 * (2 * share - 1)))}
    if isinstance(opacity, str):
        name = opacity.removesuffix("_r")
        if name not in shapes:
            raise ValueError(f'opacity is "{opacity}", but must be linear, geom or sigmoid, with _r for the reverse')
        return (shapes[name][::-1] if opacity.endswith("_r") else shapes[name]).copy()
    given = np.atleast_1d(np.asarray(opacity, dtype=np.float64))
    if given.ndim != 1 or given.size == 0 or not ((given >= 0) & (given <= 1)).all():
        raise ValueError("opacities must be numbers from 0 to 1")
    return np.interp(share, np.linspace(0, 1, given.size), given) if given.size > 1 else np.full(share.shape, given[0])


def _json(document: Mapping[str, Any]) -> str:
    try:
        return json.dumps(document, default=_plain, allow_nan=False)
    except ValueError as error:
        if "Circular" in str(error):
            raise ValueError("a transfer function cannot hold itself") from None
        raise ValueError("the numbers of a transfer function must be finite") from None


def _plain(number: Any) -> Any:
    """Turns numpy's numbers and arrays into those of JSON."""
    if isinstance(number, (np.generic, np.ndarray)):
        return number.tolist()
    raise TypeError(f"{type(number).__name__} has no place in a transfer function")
