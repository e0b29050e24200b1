"""Exports, read back by numpy, nibabel, zarr and SimpleITK; the program's tests look at every format and type."""

import json
import os

import numpy as np
import pytest

import adjsplat as adj

VISIBLE = (60, None)


def test_dense_formats_hold_the_dense_array(model, tmp_path):
    report = model.export(tmp_path / "a.npz")
    assert report.dtype == np.uint8 and report.fill == 0 and report.rounding == 0 and report.voxels == model.count
    assert report.nbytes == (tmp_path / "a.npz").stat().st_size
    arrays = np.load(tmp_path / "a.npz")
    assert (arrays["values"] == model.to_numpy()).all() and tuple(arrays["spacing"]) == model.spacing
    nibabel = pytest.importorskip("nibabel")
    model.export(tmp_path / "a.nii.gz")
    image = nibabel.load(tmp_path / "a.nii.gz")
    assert (np.asarray(image.dataobj).T == model.to_numpy()).all() and np.allclose(image.affine, model.affine)
    zarr = pytest.importorskip("zarr")
    model.export(tmp_path / "a.zarr")
    assert (zarr.open_group(tmp_path / "a.zarr")["0"][:] == model.to_numpy()).all()
    for ending in ("nrrd", "mha", "vti"):
        again = adj.build(tmp_path / f"a.{ending}", visible=VISIBLE) if model.export(tmp_path / f"a.{ending}") else None
        assert (again.to_numpy() == model.to_numpy()).all() and np.allclose(again.affine, model.affine)


def test_double_precision_stays_as_it_is(tmp_path):
    values = np.array([0, 0.7, 0.9, 1.0]).reshape(1, 1, 4)
    f = adj.build(values, visible=(0.7, np.inf))
    report = f.export(tmp_path / "a.nii")
    assert report.dtype == np.float64 and report.rounding == 0
    assert adj.build(tmp_path / "a.nii", visible=(0.7, None)).count == f.count == 3
    tiny = adj.build(np.arange(200.0).reshape(2, 10, 10) * 1e-60, visible=(1e-58, None))
    assert tiny.export(tmp_path / "b.npz").fill == 0 and (np.load(tmp_path / "b.npz")["values"] > 0).sum() == tiny.count


@pytest.mark.parametrize("unit", ["\u00b5m", "\u03bcm", "micron", "micrometers", "Micrometre", "um"])
def test_units_are_known_by_all_their_names(tmp_path, volume, unit):
    nibabel = pytest.importorskip("nibabel")
    f = adj.build(volume, visible=VISIBLE, unit=unit)
    assert f.export(tmp_path / "a.nii").notes == ()
    assert nibabel.load(tmp_path / "a.nii").header.get_xyzt_units()[0] == "micron"
    f.export(tmp_path / "a.zarr")
    attributes = json.loads((tmp_path / "a.zarr" / ".zattrs").read_text())
    assert [axis["unit"] for axis in attributes["multiscales"][0]["axes"]] == 3 * ["micrometer"]


def test_units_that_a_format_has_no_name_for_are_left_out_with_a_note(tmp_path, volume):
    f = adj.build(volume, visible=VISIBLE, unit="l\u00e9gua")
    for name in ("a.nrrd", "a.nii", "a.mha", "a.zarr"):
        (note,) = f.export(tmp_path / name).notes
        assert note.endswith('has no name for the unit "l\u00e9gua", which is left out')
    assert b"unit" not in (tmp_path / "a.nrrd").read_bytes()[:400]


def test_a_fill_value_stands_for_what_is_not_visible(model, tmp_path):
    assert model.export(tmp_path / "a.npz", fill=7).fill == 7
    values = np.load(tmp_path / "a.npz")["values"]
    assert (values == np.where(model.to_numpy() > 0, model.to_numpy(), 7)).all()
    with pytest.warns(adj.ExportWarning, match="visible"):
        model.export(tmp_path / "a.npz", fill=100)
    with pytest.raises(ValueError, match="fill"):
        model.export(tmp_path / "a.npz", fill=-1)


def test_another_transfer_function_exports_what_it_shows(model, tmp_path):
    part = model.with_transfer(adj.TransferFunction.range(150))
    report = part.export(tmp_path / "a.csv")
    assert report.voxels == (model.values() >= 150).sum() > 0 and report.dtype is None
    with open(tmp_path / "a.csv", encoding="utf-8") as file:
        assert len(file.readlines()) == report.voxels + 1


def test_gaussians_and_sparse_grids_are_written(model, tmp_path):
    for ending in ("ply", "spz", "vdb"):
        report = model.export(tmp_path / f"a.{ending}")
        assert report.nbytes == os.path.getsize(tmp_path / f"a.{ending}") > 1000


def test_progress_is_told_and_cancels(model, tmp_path):
    told = []
    model.export(tmp_path / "a.raw", progress=lambda *step: told.append(step))
    assert told[-1][0] == "export" and told[-1][1] == told[-1][2]

    def fail(*_):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        model.export(tmp_path / "b.raw", progress=fail)
    assert os.listdir(tmp_path) == ["a.raw"]


def test_what_cannot_be_written_is_refused(file, tmp_path):
    f = adj.open(file)
    with pytest.raises(ValueError, match="ending"):
        f.export(tmp_path / "a.stl")
    with pytest.raises(OSError):
        f.export(tmp_path / "none" / "a.npz")
    with pytest.raises(ValueError, match="fill"):
        f.export(tmp_path / "a.csv", fill=0)
    (tmp_path / "a.zarr").mkdir()
    with pytest.raises(ValueError):
        f.export(tmp_path / "a.zarr")
    f.close()
    with pytest.raises(ValueError, match="closed"):
        f.export(tmp_path / "a.npz")
