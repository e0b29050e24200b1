"""Building from arrays of every kind, and from files; what one array gives, all others of its numbers give."""

import json

import numpy as np
import pytest
from conftest import blob

import adjsplat as adj


def same(a, b):
    assert a._native.to_bytes() == b._native.to_bytes()


LAYOUTS = {
    "fortran": lambda a: np.asfortranarray(a),
    "reversed": lambda a: a[::-1, ::-1, ::-1].copy()[::-1, ::-1, ::-1],
    "every other": lambda a: np.repeat(np.repeat(np.repeat(a, 2, 0), 2, 1), 2, 2)[::2, ::2, ::2],
    "transposed": lambda a: a.transpose(2, 0, 1).copy().transpose(1, 2, 0),
    "broadcast type": lambda a: np.lib.stride_tricks.as_strided(a, a.shape, a.strides),
    "swapped bytes": lambda a: a.astype(a.dtype.newbyteorder("S")),
    "read-only": lambda a: np.frombuffer(a.tobytes(), a.dtype).reshape(a.shape),
    "unaligned": lambda a: np.frombuffer(b"x" + a.tobytes(), a.dtype, offset=1).reshape(a.shape),
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("dtype", ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"])
def test_strides_and_byte_order_do_not_matter(dtype, layout):
    array = (blob(dtype=np.float64) / 2).astype(dtype)
    same(adj.build(LAYOUTS[layout](array), visible=(30, None)), adj.build(array, visible=(30, None)))


@pytest.mark.parametrize(("dtype", "held"), [("?", "u1"), ("f2", "f4"), ("i8", "i4"), ("u8", "u4")])
def test_types_that_the_library_has_not_are_held_by_others(dtype, held):
    array = (blob() > 60).astype(dtype) if dtype == "?" else blob().astype(dtype)
    low = 1 if dtype == "?" else 60
    same(adj.build(array, visible=(low, None)), adj.build(array.astype(held), visible=(low, None)))


def test_the_grid_is_set_and_turned(volume):
    turn = (0, -1, 0, 1, 0, 0, 0, 0, 1)
    f = adj.build(volume, visible=(60, None), spacing=(1, 2, 3), origin=(4, 5, 6), direction=turn, unit="mm")
    assert (f.spacing, f.origin, f.direction, f.unit) == ((1, 2, 3), (4, 5, 6), turn, "mm")
    g = adj.build(volume, visible=(60, None), spacing=(1, 2, 3), origin=(4, 5, 6), direction=turn, frame="LPS")
    assert g.origin == (-4, -5, 6) and g.direction == (0, 1, 0, -1, 0, 0, 0, 0, 1)


def test_an_array_without_a_direction_has_the_axes_of_the_frame(volume, tmp_path):
    f = adj.build(volume, visible=(60, None), origin=(4, 5, 6), frame="LPS")
    g = adj.build(volume, visible=(60, None), origin=(4, 5, 6), frame="LPS", direction=np.eye(3))
    assert (f.affine == g.affine).all() and np.diag(f.affine).tolist() == [-1, -1, 1, 1]
    pytest.importorskip("dask")
    volume.tofile(tmp_path / "v.raw")
    raw = {"shape": volume.shape, "dtype": "u1"}
    place = {"visible": (60, None), "origin": (4, 5, 6), "frame": "LPS"}
    assert (adj.build(tmp_path / "v.raw", **raw, **place).affine == f.affine).all()
    built = adj.dask.build(adj.VolumeFile(tmp_path / "v.raw", **raw), tmp_path / "a.adj", slab=8, **place)
    assert (built.affine == f.affine).all()


def test_what_is_visible(volume):
    count = lambda **chosen: adj.build(volume, **chosen).count
    assert count(visible=(60, 100)) == ((volume >= 60) & (volume <= 100)).sum()
    assert count(visible=(None, 59)) == (volume <= 59).sum()
    assert count(transfer=adj.TransferFunction.range(60)) == count(transfer={"kind": "range", "low": 60})
    labels = (volume // 50).astype(np.int64)
    assert adj.build(labels, labels="distinct").count == (labels > 0).sum()
    with pytest.warns(adj.BuildWarning, match="labels that the palette does not name"):
        f = adj.build(labels, labels={1: "#ff0000", 3: ("core", (0, 1, 0), 0.5)})
    assert f.count == np.isin(labels, [1, 3]).sum() and f.transfer.kind == "labels"
    # Without a word the values decide.
    assert 0 < adj.build(volume).count < volume.size


def test_the_model_says_how_far_values_are_rounded():
    volume = np.random.default_rng(1).integers(0, 60_000, (9, 10, 11), np.uint16)
    for bits, least in ((None, 100), (8, 100), (16, 0)):
        f = adj.build(volume, visible=(1, None), value_bits=bits)
        error = np.abs(f.to_numpy().astype(float) - volume).max()
        assert least <= error <= f.attrs["values"]["rounding"] + 0.01 and f.attrs["values"]["rounding"] < 120


def test_nan_is_transparent_and_told():
    array = blob(dtype=np.float32)
    array[10, 10:12, 10] = np.nan
    with pytest.warns(adj.BuildWarning, match="2 samples are NaN"):
        f = adj.build(array, visible=(60, None))
    assert f.count == (array >= 60).sum()
    array[10, 10, 10] = 0
    with pytest.warns(adj.BuildWarning, match="^1 sample is NaN or infinite and therefore transparent$"):
        adj.build(array, visible=(60, None))


def test_a_file_is_the_model_in_memory(volume, tmp_path):
    f = adj.build(volume, tmp_path / "a.adj", visible=(60, None))
    assert f.path == str(tmp_path / "a.adj")
    same(f, adj.build(volume, visible=(60, None)))
    one = adj.build(volume, tmp_path / "b.adj", visible=(60, None), threads=1, memory="64MiB")
    same(f, one)
    f.verify()


def test_zarr_and_dask_are_read_slab_by_slab(volume, tmp_path):
    zarr = pytest.importorskip("zarr")
    dask = pytest.importorskip("dask.array")
    whole = adj.build(volume, visible=(60, None))
    stored = zarr.create_array(str(tmp_path / "v.zarr"), shape=volume.shape, chunks=(6, 8, 28), dtype=volume.dtype)
    stored[:] = volume
    from adjsplat.arrays import Slices

    slices = Slices(stored, None)
    assert slices.depth == 6 and slices.buffer_bytes == 2 * 6 * 24 * 28
    assert Slices(stored, 4 * 3 * 24 * 28).depth == 3

    class Watched:
        """Passes reads on, and notes how many slices each asks for."""

        shape, dtype, chunks, name, reads = stored.shape, stored.dtype, stored.chunks, "array", []

        def __getitem__(self, key):
            self.reads.append(key)
            return stored[key]

    same(adj.build(Watched(), visible=(60, None)), whole)
    assert Watched.reads == [slice(0, 6), slice(6, 12), slice(12, 18), slice(18, 24)]
    assert adj.build(stored, visible=(60, None)).count == whole.count
    lazy = dask.from_array(volume, chunks=(7, 5, 5))
    f = adj.build(lazy, visible=(60, None))
    assert (f.to_numpy() == whole.to_numpy()).all()
    # The program's own reader sees the same volume; zarr leaves out chunks of zeros, of which it warns.
    with pytest.warns(adj.BuildWarning, match="3 of 12 chunks are absent"):
        f = adj.build(tmp_path / "v.zarr", visible=(60, None))
    assert (f.to_numpy() == whole.to_numpy()).all()


def test_what_an_array_raises_comes_back(volume):
    class Broken:
        shape, dtype = volume.shape, volume.dtype

        def __getitem__(self, key):
            if key.start >= 7:
                raise ConnectionError("the store is gone")
            return volume[key]

    with pytest.raises(ConnectionError, match="the store is gone"):
        adj.build(Broken(), visible=(60, None))


def test_an_array_whose_slices_change_their_shape_raises(volume):
    class Lying:
        shape, dtype = volume.shape, volume.dtype

        def __getitem__(self, key):
            return volume[key][:, :10]

    with pytest.raises(ValueError, match="gives slices of the shape"):
        adj.build(Lying(), visible=(60, None))


def test_an_image_of_simpleitk_that_nobody_else_holds_is_built_from_its_own_samples():
    sitk = pytest.importorskip("SimpleITK")
    # So large that its memory goes back to the system as soon as it is freed.
    array = blob((60, 800, 800))
    place = {"spacing": (1, 1, 1), "origin": (0, 0, 0), "direction": np.eye(3), "frame": "LPS"}
    built = adj.build(sitk.GetImageFromArray(array), visible=(60, None))
    same(built, adj.build(array, visible=(60, None), **place))


def test_files_of_several_formats(volume, tmp_path):
    whole = adj.build(volume, visible=(60, None))
    (tmp_path / "v.raw").write_bytes(volume.tobytes())
    with pytest.raises(ValueError, match=r"v\.raw.*give shape=\(z, y, x\) and dtype=$"):
        adj.build(tmp_path / "v.raw", visible=(60, None))
    raw = adj.build(tmp_path / "v.raw", visible=(60, None), shape=volume.shape, dtype="u1")
    assert (raw.to_numpy() == whole.to_numpy()).all()
    (tmp_path / "v16.raw").write_bytes(b"head" + volume.astype(">u2").tobytes())
    big = adj.build(
        str(tmp_path / "v16.raw"), visible=(60, None), shape=volume.shape, dtype=">u2", skip=4, spacing=(1, 2, 3)
    )
    assert (big.to_numpy() == whole.to_numpy()).all() and big.spacing == (1, 2, 3)
    for z, plane in enumerate(volume):
        (tmp_path / f"slice{z}.bin").write_bytes(plane.tobytes())
    pattern = adj.build(tmp_path / "slice*.bin", visible=(60, None), shape=volume.shape, dtype="u1")
    listed = adj.build(
        [tmp_path / f"slice{z}.bin" for z in range(20)], visible=(60, None), shape=volume.shape, dtype="u1"
    )
    assert (pattern.to_numpy() == whole.to_numpy()).all() and (listed.to_numpy() == whole.to_numpy()).all()
    nibabel = pytest.importorskip("nibabel")
    affine = np.array([[-1.0, 0, 0, 5], [0, 2, 0, 6], [0, 0, 3, 7], [0, 0, 0, 1]])
    nibabel.save(nibabel.Nifti1Image(volume.T, affine), tmp_path / "v.nii.gz")
    nifti = adj.build(tmp_path / "v.nii.gz", visible=(60, None))
    assert (nifti.to_numpy() == whole.to_numpy()).all() and np.allclose(nifti.affine, affine)
    with pytest.raises(FileNotFoundError):
        adj.build(tmp_path / "nothing*.bin")
    with pytest.raises(FileNotFoundError):
        adj.build(tmp_path / "nothing.nii")


def test_an_image_of_simpleitk_that_is_no_volume_or_has_two_frames_is_refused(volume):
    sitk = pytest.importorskip("SimpleITK")
    for dimensions in (2, 4):
        with pytest.raises(ValueError, match=f"the image has {dimensions} dimensions, but a volume has 3"):
            adj.build(sitk.Image([4] * dimensions, sitk.sitkUInt8), visible=(60, None))
    for frame in ("RAS", "LPS"):
        with pytest.raises(ValueError, match="its own spacing, origin, direction and frame"):
            adj.build(sitk.GetImageFromArray(volume), visible=(60, None), frame=frame)
    with pytest.raises(TypeError, match="not Image; give SimpleITK.GetArrayFromImage"):
        adj.dask.build(sitk.GetImageFromArray(volume), "a.adjs", slab=8, visible=(60, None))


def test_the_advice_for_an_image_of_pyvista_leads_to_the_model(model):
    pytest.importorskip("pyvista")
    image = model.to_pyvista()
    with pytest.raises(TypeError, match="not ImageData; give image.point_data.name..reshape"):
        adj.build(image, visible=(60, None))
    array = image.point_data["values"].reshape(image.dimensions[::-1])
    built = adj.build(array, visible=(60, None), spacing=image.spacing, origin=image.origin)
    assert built.count == model.count and np.allclose(built.affine, model.affine)


def test_a_real_volume(real_data):
    f = adj.build(real_data / "scivis-engine" / "engine.nii.gz", visible=(60, None))
    assert f.shape == (128, 256, 256) and f.count == 1_216_893
    with pytest.warns(adj.BuildWarning, match="777 voxels have labels"):
        frog = adj.build(real_data / "frogtissue" / "frogtissue.mhd", labels="frog")
    assert frog.shape == (136, 470, 500) and frog.spacing == (1, 1, 1.5)


def test_progress_is_told_and_may_stop_the_build(volume, tmp_path):
    told = []
    adj.build(volume, tmp_path / "a.adj", visible=(60, None), progress=lambda *step: told.append(step))
    assert ("pack", 20, 20) in told and told[-1] == ("flush", 1, 1)
    assert {phase for phase, _, _ in told} == {"pack", "assemble x", "assemble y", "assemble z", "flush"}

    class Enough(Exception):
        pass

    def stop(phase, done, total):
        if phase == "assemble y":
            raise Enough

    with pytest.raises(Enough):
        adj.build(volume, tmp_path / "b.adj", visible=(60, None), progress=stop)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.adj"]


def test_the_output_replaces_only_adj_files(volume, tmp_path):
    raw = tmp_path / "v.raw"
    raw.write_bytes(volume.tobytes())
    other = tmp_path / "notes.txt"
    other.write_text("keep me")
    for out in (raw, other):
        before = out.read_bytes()
        with pytest.raises(ValueError):
            adj.build(raw, out, visible=(60, None), shape=volume.shape, dtype="u1")
        assert out.read_bytes() == before
    with pytest.raises(FileNotFoundError):
        adj.build(volume, tmp_path / "no" / "folder.adj", visible=(60, None))


def test_an_adj_file_is_no_volume(file):
    with pytest.raises(ValueError, match="holds no volume"):
        adj.build(file, visible=(60, None))


def test_the_transfer_function_is_stored(volume):
    magma = adj.TransferFunction.points([(60, "#000000", 0.1), (200, "#ffffff", 0.9)])
    f = adj.build(volume, transfer=magma)
    assert f.transfer == magma and json.loads(magma.to_json()) == f.attrs["transfer_function"]
