"""A model as the arrays and images of other packages, which are imported when called."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ._optional import needed

if TYPE_CHECKING:
    from .model import Model

#: From R, A, S to L, P, S and back: x and y of the world change their signs.
TURNED = np.array([-1.0, -1.0, 1.0])


def to_dask(model: Model, chunks: Any) -> Any:
    array = needed("dask.array", "to_dask")
    return array.from_array(model, chunks=chunks, lock=False, asarray=False)


def to_xarray(model: Model, chunks: Any) -> Any:
    xarray = needed("xarray", "to_xarray")
    data = model.to_numpy() if chunks is None else to_dask(model, chunks)
    direction = np.reshape(model.direction, (3, 3))
    is_upright = (np.abs(direction) == np.eye(3)).all()
    coordinates = {}
    for a, name in enumerate("xyz"):
        points = np.arange(model.shape[2 - a]) * model.spacing[a]
        places = model.origin[a] + direction[a, a] * points if is_upright else points
        coordinates[name] = (name, places, {"units": model.unit} if model.unit else {})
    attrs = {"spacing": model.spacing, "origin": model.origin, "direction": model.direction}
    return xarray.DataArray(data, dims=("z", "y", "x"), coords=coordinates, attrs=attrs, name="values")


#: Distances between coordinates may differ from their mean by this share of it: files often round them.
REGULAR = 1e-3


def from_xarray(array: Any) -> tuple[Any, tuple[Any, Any, Any], str | None]:
    """Returns the array with dimensions in the order z, y, x; spacing, origin and direction; and the unit of lengths.

    Dimensions that are not called x, y and z keep their order. The attributes that `to_xarray` writes say where an oblique
    volume lies; else coordinates do. Without either the place is None.
    """
    if sorted(map(str, array.dims)) == ["x", "y", "z"]:
        array = array.transpose("z", "y", "x")
    names = list(reversed(array.dims))
    has_coordinates = len(names) == 3 and all(name in array.coords for name in names)
    units = {array.coords[name].attrs.get("units") for name in names} if has_coordinates else {None}
    unit = units.pop() if len(units) == 1 else None
    unit = unit if isinstance(unit, str) else None
    given = tuple(array.attrs.get(name) for name in ("spacing", "origin", "direction"))
    if all(np.size(part) == size for part, size in zip(given, (3, 3, 9))):
        return array, given, unit
    if not has_coordinates:
        return array, (None, None, None), None
    spacing, origin, direction = [], [], np.eye(3)
    for a, name in enumerate(names):
        places = np.asarray(array.coords[name])
        if places.ndim != 1 or places.dtype.kind not in "uif":
            return array, (None, None, None), None
        steps = np.diff(places.astype(np.float64))
        step = float(steps.mean()) if steps.size else 1.0
        if not np.isfinite(step) or step == 0 or (np.abs(steps - step) > REGULAR * abs(step)).any():
            raise ValueError(f"the coordinates of {name} are not regular; give spacing, or resample the array")
        direction[a, a] = np.sign(step)
        spacing.append(abs(step))
        origin.append(float(places[0]))
    return array, (spacing, origin, direction), unit


def to_sitk(model: Model) -> Any:
    sitk = needed("SimpleITK", "to_sitk")
    image = sitk.GetImageFromArray(model.to_numpy())
    image.SetSpacing(model.spacing)
    image.SetOrigin((np.array(model.origin) * TURNED).tolist())
    image.SetDirection((np.reshape(model.direction, (3, 3)) * TURNED[:, None]).ravel().tolist())
    return image


def to_pyvista(model: Model) -> Any:
    pyvista = needed("pyvista", "to_pyvista")
    z, y, x = model.shape
    image = pyvista.ImageData(dimensions=(x, y, z), spacing=model.spacing, origin=model.origin)
    image.direction_matrix = np.reshape(model.direction, (3, 3))
    # x varies fastest in both.
    image.point_data["values"] = model.to_numpy().ravel()
    return image
