"""A model as arrays and images of other packages, judged by its dense array and its place in the world."""

import builtins
import pickle

import numpy as np
import pytest

import adjsplat as adj

TURN = (0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@pytest.fixture
def turned(volume):
    return adj.build(volume, visible=(60, None), spacing=(1, 1.5, 2.5), origin=(10, -20, 30), direction=TURN, unit="mm")


def test_dask_reads_blocks(file):
    dask = pytest.importorskip("dask.array")
    f = adj.open(file)
    lazy = f.to_dask((8, 10, 9))
    assert (
        isinstance(lazy, dask.Array)
        and lazy.chunks == ((8, 8, 4), (10, 10, 4), (9, 9, 9, 1))
        and lazy.dtype == np.uint8
    )
    assert (lazy.compute() == f.to_numpy()).all()
    # Equal files give equal names, so that dask computes them once.
    assert lazy.name == adj.open(file).to_dask((8, 10, 9)).name
    assert (lazy[3:7, ::2].compute(scheduler="threads") == f[3:7, ::2]).all()
    assert (pickle.loads(pickle.dumps(lazy)).sum().compute(scheduler="sync")) == f.to_numpy().sum()


@pytest.mark.parametrize("chunks", [(0, 1, 2), 0])
def test_chunks_without_points_are_refused(model, chunks):
    pytest.importorskip("xarray")
    pytest.importorskip("dask")
    with pytest.raises(ValueError, match="at least 1 point"):
        model.to_xarray(chunks=chunks)


def test_xarray_has_world_coordinates(model, turned):
    pytest.importorskip("xarray")
    a = model.to_xarray()
    assert a.dims == ("z", "y", "x") and (a.values == model.to_numpy()).all()
    assert a.x.values[:2].tolist() == [10, 11] and a.y.values[1] == -18.5 and a.z.values[-1] == 30 + 19 * 2.5
    assert float(a.sel(z=32.5, y=-18.5, x=12)) == model[1, 1, 2]
    assert a.attrs["origin"] == model.origin
    mirrored = adj.build(model.to_numpy(), visible=(60, None), direction=(1, 0, 0, 0, -1, 0, 0, 0, 1), origin=(0, 5, 0))
    assert mirrored.to_xarray().y.values[:3].tolist() == [5, 4, 3]
    b = turned.to_xarray(chunks=8)
    assert b.chunks is not None and b.x.values[:2].tolist() == [0, 1] and b.x.attrs["units"] == "mm"
    assert b.attrs["direction"] == TURN and (b.values == turned.to_numpy()).all()


def test_sitk_has_the_same_points_in_its_own_frame(turned):
    sitk = pytest.importorskip("SimpleITK")
    image = turned.to_sitk()
    assert image.GetSize() == (28, 24, 20) and image.GetSpacing() == (1, 1.5, 2.5)
    assert (sitk.GetArrayFromImage(image) == turned.to_numpy()).all()
    for index in [(0, 0, 0), (3, 5, 7), (27, 23, 19)]:
        ras = turned.affine @ [*index, 1]
        lps = image.TransformIndexToPhysicalPoint(index)
        assert np.allclose(lps, [-ras[0], -ras[1], ras[2]])
    back = adj.build(image, visible=(60, None))
    assert (back.to_numpy() == turned.to_numpy()).all() and np.allclose(back.affine, turned.affine)


def test_a_nifti_file_is_where_sitk_finds_it(turned, tmp_path):
    sitk = pytest.importorskip("SimpleITK")
    sitk.WriteImage(turned.to_sitk(), str(tmp_path / "a.nii.gz"))
    read = adj.build(tmp_path / "a.nii.gz", visible=(60, None))
    assert np.allclose(read.affine, turned.affine, atol=1e-5) and (read.to_numpy() == turned.to_numpy()).all()


def test_pyvista_has_the_same_points(turned):
    pytest.importorskip("pyvista")
    image = turned.to_pyvista()
    assert image.dimensions == (28, 24, 20)
    dense = turned.to_numpy()
    for z, y, x in [(0, 0, 0), (7, 5, 3), (10, 12, 9), (19, 23, 27)]:
        at = x + 28 * (y + 24 * z)
        assert np.allclose(image.points[at], (turned.affine @ [x, y, z, 1])[:3])
        assert image.point_data["values"][at] == dense[z, y, x]


@pytest.mark.parametrize(
    ("package", "use"),
    [
        ("dask", lambda f: f.to_dask()),
        ("xarray", lambda f: f.to_xarray()),
        ("SimpleITK", lambda f: f.to_sitk()),
        ("pyvista", lambda f: f.to_pyvista()),
        ("matplotlib", lambda f: adj.TransferFunction.from_matplotlib("magma", (0, 1))),
    ],
)
def test_an_absent_package_is_named(model, package, use, monkeypatch):
    import sys

    for name in [name for name in sys.modules if name.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    found = builtins.__import__

    def without(name, *rest, **named):
        if name.split(".")[0] == package:
            raise ModuleNotFoundError(f"No module named {package!r}")
        return found(name, *rest, **named)

    monkeypatch.setattr(builtins, "__import__", without)
    monkeypatch.setattr("importlib.import_module", lambda name: without(name))
    with pytest.raises(ImportError, match=f"pip install {package}"):
        use(model)


@pytest.mark.parametrize("chunks", [None, (8, 8, 8)])
def test_an_xarray_keeps_its_place(volume, chunks):
    pytest.importorskip("xarray")
    turned = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    for direction in (np.eye(3), np.diag([1, -1, 1]), turned):
        f = adj.build(
            volume, visible=(60, None), spacing=(1, 1.5, 2.5), origin=(10, -20, 30), direction=direction, unit="mm"
        )
        g = adj.build(f.to_xarray(chunks=chunks), visible=(60, None))
        assert (g.spacing, g.origin, g.direction, g.unit) == (f.spacing, f.origin, f.direction, "mm")
        assert (g.to_numpy() == f.to_numpy()).all()


def test_coordinates_of_an_xarray_give_its_place(volume):
    xarray = pytest.importorskip("xarray")
    z, y, x = volume.shape
    coordinates = {"z": 5 + 2.5 * np.arange(z), "y": 9 - 0.5 * np.arange(y), "x": np.arange(x)}
    array = xarray.DataArray(volume, dims=("z", "y", "x"), coords=coordinates)
    for given in (array, array.transpose("x", "z", "y")):
        f = adj.build(given, visible=(60, None))
        assert f.shape == volume.shape and f.spacing == (1, 0.5, 2.5) and f.origin == (0, 9, 5)
        assert f.direction == (1, 0, 0, 0, -1, 0, 0, 0, 1)
    assert adj.build(array, visible=(60, None), spacing=(3, 3, 3)).spacing == (3, 3, 3)
    with pytest.warns(adj.BuildWarning, match="^y: the coordinates do not tell"):
        f = adj.build(array.drop_vars("y"), visible=(60, None))
    assert f.spacing == (1, 1, 2.5) and f.origin == (0, 0, 5)
    uneven = array.assign_coords(y=np.arange(y) ** 2)
    with pytest.raises(ValueError, match="the coordinates of y are not regular"):
        adj.build(uneven, visible=(60, None))


CUTS = [
    (slice(2, None), slice(None), slice(3, None)),
    (slice(None), slice(None), slice(None, None, 2)),
    (slice(None, None, -1), slice(None), slice(None, None, -2)),
    (slice(4, 5), slice(None, None, 3), slice(1, None)),
]


@pytest.mark.parametrize("cut", CUTS)
def test_a_cut_xarray_lies_where_its_voxels_were(volume, cut):
    pytest.importorskip("xarray")
    oblique = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    for direction in (np.eye(3), np.diag([-1, 1, -1]), oblique):
        f = adj.build(volume, spacing=(1, 1.5, 2.5), origin=(10, -20, 30), direction=direction)
        g = adj.build(f.to_xarray()[cut])
        for axes in ((0, 0, 0), (1, 1, 1)):
            # The last voxel of an axis of one voxel is its first.
            here = [(size - 1) * end for size, end in zip(g.shape, axes)]
            there = [range(size)[part][index] for size, part, index in zip(f.shape, cut, here)]
            places = [
                np.array(m.origin) + np.reshape(m.direction, (3, 3)) @ (np.array(zyx[::-1]) * m.spacing)
                for m, zyx in ((f, there), (g, here))
            ]
            np.testing.assert_allclose(places[0], places[1], atol=1e-5)


def test_an_xarray_keeps_its_axes_whatever_of_its_place_is_given(volume):
    xarray = pytest.importorskip("xarray")
    coordinates = {name: 3 + 2.0 * np.arange(size) for name, size in zip("zyx", volume.shape)}
    array = xarray.DataArray(volume, dims=("z", "y", "x"), coords=coordinates).transpose("x", "z", "y")
    f = adj.build(array, spacing=(1, 2, 3), frame="LPS")
    assert f.shape == volume.shape and f.spacing == (1, 2, 3) and f.origin == (-3, -3, 3)
    g = adj.build(array, origin=(0, 0, 0))
    assert g.spacing == (2, 2, 2) and g.origin == (0, 0, 0)
    h = adj.build(array, direction=np.diag([-1, 1, 1]))
    assert h.spacing == (2, 2, 2) and h.origin == (3, 3, 3) and h.direction[0] == -1
    for mirrored in (array[::-1], h.to_xarray().drop_vars("x")):
        assert adj.build(mirrored, spacing=(1, 2, 3), origin=(0, 0, 0)).direction == h.direction


def test_what_else_xarray_has_is_refused(volume):
    xarray = pytest.importorskip("xarray")
    variable = xarray.Variable(("z", "y", "x"), volume)
    for other in (variable, xarray.Dataset({"a": variable})):
        with pytest.raises(TypeError, match="is no volume; give a DataArray"):
            adj.build(other, visible=(60, None))
    with pytest.raises(TypeError, match="^chunks are None, but must be [^\n]*$"):
        adj.build(volume, visible=(60, None)).to_dask(None)


def test_coordinates_that_are_no_numbers_are_refused(volume):
    xarray = pytest.importorskip("xarray")
    days = np.arange(volume.shape[0]).astype("datetime64[D]")
    array = xarray.DataArray(volume, dims=("z", "y", "x"), coords={"z": days})
    with pytest.raises(ValueError, match="the coordinates of z are not numbers; give spacing and origin"):
        adj.build(array)
    assert adj.build(array, spacing=(1, 2, 3), origin=(0, 0, 0)).spacing == (1, 2, 3)


def test_one_slice_of_an_xarray_is_warned_about(volume):
    xarray = pytest.importorskip("xarray")
    array = xarray.DataArray(
        volume, dims=("z", "y", "x"), coords={n: 2.0 * np.arange(s) for n, s in zip("zyx", volume.shape)}
    )
    with pytest.warns(adj.BuildWarning, match="^z: the coordinates do not tell"):
        assert adj.build(array[3:4]).origin == (0, 0, 6)


def test_large_whole_numbers_are_as_exact_as_the_model_says():
    array = np.array([[[1833471437, 1833471440, 2147483646]]], np.int32)
    f = adj.build(array, visible=(1833471437, None))
    error = np.abs(f.values() - array.ravel().astype(np.float64)).max()
    assert f.dtype == np.float64 and error <= f.attrs["values"]["rounding"] < 10


def test_values_of_double_precision_stay_apart():
    for low, step in ((0, 1e-60), (1e9, 0.01), (0.1, 0.1)):
        array = low + step * np.arange(60.0).reshape(3, 4, 5)
        f = adj.build(array, visible=(array[1, 0, 0], None))
        assert f.dtype == np.float64
        # Codes of eight bits: half of one of 255 steps.
        assert np.allclose(f.values(), array[array >= array[1, 0, 0]], rtol=0, atol=40 * step / 255 * 0.51)
        assert np.unique(f.values()).size == f.count
