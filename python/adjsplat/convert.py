"""A model as the arrays and images of other packages, which are imported when called."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ._optional import needed

if TYPE_CHECKING:
    from .voxels import Voxels

#: From R, A, S to L, P, S and back: x and y of the world change their signs.
TURNED = np.array([-1.0, -1.0, 1.0])


def to_dask(model: Voxels, chunks: Any) -> Any:
    array = needed("dask.array", "to_dask")
    if chunks is None:
        raise TypeError('chunks are None, but must be "auto", a number of points or three of them (z, y, x)')
    try:
        return array.from_array(model, chunks=chunks, lock=False, asarray=False)
    except ArithmeticError:
        raise ValueError(f"chunks are {chunks!r}, but must have at least 1 point along z, y and x") from None


def to_xarray(model: Voxels, chunks: Any) -> Any:
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


def to_sitk(model: Voxels) -> Any:
    sitk = needed("SimpleITK", "to_sitk")
    image = sitk.GetImageFromArray(model.to_numpy())
    image.SetSpacing(model.spacing)
    image.SetOrigin((np.array(model.origin) * TURNED).tolist())
    image.SetDirection((np.reshape(model.direction, (3, 3)) * TURNED[:, None]).ravel().tolist())
    return image


def to_pyvista(model: Voxels) -> Any:
    pyvista = needed("pyvista", "to_pyvista")
    z, y, x = model.shape
    image = pyvista.ImageData(dimensions=(x, y, z), spacing=model.spacing, origin=model.origin)
    image.direction_matrix = np.reshape(model.direction, (3, 3))
    # x varies fastest in both.
    image.point_data["values"] = model.to_numpy().ravel()
    return image
