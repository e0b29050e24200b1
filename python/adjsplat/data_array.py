"""Where an xarray DataArray lies in the world."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

#: Distances between coordinates may differ from their mean by this share of it: files often round them.
REGULAR = 1e-3

#: Steps of coordinates that differ from the written spacing by less than this share of it differ by rounding only.
ROUNDED = 1e-6


class Placed(NamedTuple):
    """An array in the order z, y, x and what is known of its place; spacing and origin as (x, y, z)."""

    array: Any
    spacing: Any
    origin: Any
    direction: Any
    unit: str | None
    #: What the caller should be warned of.
    notes: list[str]


def is_of_xarray(volume: Any) -> bool:
    """Returns whether `volume` is a DataArray; refuses what else xarray has."""
    if type(volume).__module__.partition(".")[0] != "xarray":
        return False
    if not hasattr(volume, "coords") or hasattr(volume, "data_vars"):
        raise TypeError(f"an xarray {type(volume).__name__} is no volume; give a DataArray, such as dataset[name]")
    return True


def in_order(array: Any) -> Any:
    """Returns a DataArray with its dimensions in the order z, y, x, if these are their names."""
    return array.transpose("z", "y", "x") if sorted(map(str, array.dims)) == ["x", "y", "z"] else array


def placed(array: Any, spacing: Any, origin: Any, direction: Any) -> Placed:
    """Places a DataArray. Dimensions that are not called x, y and z keep their order.

    What the caller gave of the place stays; the rest comes from the coordinates, so that a cut or thinned array lies where
    its voxels were. Coordinates are places in the world or, as `Model.to_xarray` writes them for a volume that lies
    obliquely, distances along its axes from the attribute `origin`. Without coordinates the attributes `spacing`, `origin`
    and `direction` hold, if all are there.
    """
    array = in_order(array)
    names = list(reversed(array.dims))
    unit = _unit(array, names)
    if len(names) != 3:
        return Placed(array, spacing, origin, direction, unit, [])
    given = (spacing, origin, direction)
    written = _written(array)
    if not any(name in array.coords for name in names):
        parts = [own if part is None else part for part, own in zip(given, written or given)]
        return Placed(array, parts[0], parts[1], parts[2], unit, [])
    base, usual = np.eye(3), np.ones(3)
    is_oblique = False
    if written is not None:
        is_oblique = bool((np.abs(written[2]) != np.eye(3)).any())
        base = written[2] if is_oblique else base
        usual = written[0] if is_oblique else written[0] * np.diag(written[2])
    notes: list[str] = []
    needs = (origin is None, spacing is None)
    axes = [_first_and_step(array, name, size, needs) for name, size in zip(names, usual)]
    unknown = [str(name) for name, (_, step) in zip(names, axes) if step is None]
    if unknown and spacing is None and written is None:
        notes.append(
            f"{' and '.join(unknown)}: the coordinates do not tell how far apart voxels are; 1 is taken; give spacing"
        )
    first = np.array([first for first, _ in axes])
    steps = np.array([size if step is None else step for size, (_, step) in zip(usual, axes)])
    start = written[1] + base @ first if is_oblique and written is not None else first
    return Placed(
        array,
        np.abs(steps) if spacing is None else spacing,
        start if origin is None else origin,
        base * np.where(steps < 0, -1.0, 1.0) if direction is None else direction,
        unit,
        notes,
    )


def _written(array: Any) -> tuple[Any, Any, Any] | None:
    """Returns the attributes spacing, origin and direction, if all are there."""
    parts = []
    for name, size in (("spacing", 3), ("origin", 3), ("direction", 9)):
        try:
            part = np.asarray(array.attrs.get(name), dtype=np.float64)
        except (TypeError, ValueError):
            return None
        if part.size != size or not np.isfinite(part).all():
            return None
        parts.append(part.ravel())
    return parts[0], parts[1], parts[2].reshape(3, 3)


def _first_and_step(array: Any, name: Any, usual: float, needs: tuple[bool, bool]) -> tuple[float, float | None]:
    """Returns the first coordinate of a dimension and the step from one to the next, None where they tell none.

    `needs` says whether the first coordinate and the step are needed; coordinates that do not give them are then refused.
    """
    if name not in array.coords:
        return 0.0, None
    places = np.asarray(array.coords[name])
    if places.dtype.kind not in "uif":
        if not any(needs):
            return 0.0, None
        raise ValueError(f"the coordinates of {name} are not numbers; give spacing and origin")
    places = places.astype(np.float64)
    if places.size < 2:
        return (float(places[0]) if places.size else 0.0), None
    steps = np.diff(places)
    step = float(steps.mean())
    is_regular = np.isfinite(step) and step != 0 and bool((np.abs(steps - step) <= REGULAR * abs(step)).all())
    if needs[1] and not is_regular:
        raise ValueError(f"the coordinates of {name} are not regular; give spacing, or resample the array")
    return float(places[0]), usual if abs(step - usual) <= ROUNDED * abs(usual) else step


def _unit(array: Any, names: list[Any]) -> str | None:
    """Returns the unit that the coordinates name, if they agree."""
    units = {array.coords[name].attrs.get("units") for name in names if name in array.coords}
    unit = units.pop() if len(units) == 1 else None
    return unit if isinstance(unit, str) else None
