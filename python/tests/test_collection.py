"""Collections: what is split or built in bricks joins to the bytes of one build; pictures are near those of the whole."""

import os
import pathlib
import pickle
import time

import numpy as np
import pytest
from conftest import blob

import adjsplat as adj


def bytes_of(path):
    return pathlib.Path(path).read_bytes()


def test_a_model_is_split_joined_and_drawn(file, tmp_path):
    f = adj.open(file)
    bricks = adj.split(f, tmp_path / "a.adjs", brick=(7, 0, 10))
    assert (bricks.shape, bricks.count, len(bricks.bricks)) == (f.shape, f.count, 9)
    assert bricks.bricks[-1].low == (14, 0, 20) and bricks.bricks[-1].shape == (6, 24, 8)
    assert bricks.faults == [] and bricks.verify() == []
    assert bricks.join(tmp_path / "b.adj").count == f.count
    assert bytes_of(tmp_path / "b.adj") == bytes_of(file)
    # A collection opens like a file.
    assert adj.open(tmp_path / "a.adjs")._native.to_bytes() == bytes_of(file)
    assert pickle.loads(pickle.dumps(bricks)).shape == f.shape


def test_an_open_range_colours_bricks_as_parts_of_the_whole(tmp_path):
    # Each brick had the colours of its own values: 18.5 dB.
    ramp = np.zeros((32, 32, 32), np.uint8) + np.arange(20, 212, 6, dtype=np.uint8)[:, None, None]
    f = adj.build(ramp, tmp_path / "a.adj", visible=(30, None))
    bricks = adj.split(f, tmp_path / "a.adjs", slab=8)
    view = {"size": (90, 80), "azimuth": 20, "elevation": 5, "quality": "reference"}
    view["transfer"] = adj.TransferFunction.range(10)
    pictures = []
    for draw, drawn in [(adj.render, f), (adj.Collection.render, bricks), (adj.dask.render, bricks)]:
        with pytest.warns(UserWarning, match="values 20 to 30 are visible"):
            pictures.append(draw(drawn, **view))
    # As with the stored function: slabs are seen across their cuts.
    assert adj.compare(pictures[0], pictures[1]).psnr > 35
    assert np.abs(pictures[2] - pictures[1]).max() < 1e-5


@pytest.mark.parametrize("look", [{}, {"elevation": 88}, {"mode": "xray", "exposure": 1}, {"perspective": 40}])
def test_pictures_by_brick_and_by_task_are_near_those_of_the_whole(file, tmp_path, look):
    f = adj.open(file)
    bricks = adj.split(f, tmp_path / "a.adjs", slab=6, partition="xyz")
    view = {"size": (80, 60), "azimuth": 20, "elevation": 10, "quality": "reference"} | look
    whole = adj.render(f, **view)
    one = bricks.render(**view)
    assert np.abs(one - whole).max() < (1e-3 if "perspective" in look else 1e-5)
    assert np.abs(adj.dask.render(bricks, **view) - one).max() < 1e-5
    with pytest.raises(ValueError, match="join the collection first"):
        bricks.render(mode="maximum")
    with pytest.raises(ValueError, match="exposure"):
        bricks.render(mode="xray")


def test_bricks_that_cannot_be_used_are_named(file, tmp_path):
    bricks = adj.split(adj.open(file), tmp_path / "a.adjs", slab=5)
    os.remove(tmp_path / "a.adjs" / bricks.bricks[1].file)
    with pytest.raises(ValueError, match="1 of 4 bricks cannot be used.*brick-0-00005.*is missing"):
        adj.Collection(tmp_path / "a.adjs")
    rest = adj.Collection(tmp_path / "a.adjs", partial=True)
    assert rest.count == bricks.count and len(rest.bricks) == 4
    assert len(rest.faults) == 1 and "brick-0-00005" in rest.faults[0]
    assert rest.join(tmp_path / "rest.adj").count == bricks.count - bricks.bricks[1].voxels
    assert rest.render(size=(20, 20))[..., 3].max() > 0


ARRAYS = {
    "numpy": lambda array, folder: array,
    "dask": lambda array, folder: pytest.importorskip("dask.array").from_array(array, chunks=(6, 12, 28)),
    "zarr": lambda array, folder: _zarr(array, folder),
}


def _zarr(array, folder):
    zarr = pytest.importorskip("zarr")
    stored = zarr.create_array(str(folder / "a.zarr"), shape=array.shape, chunks=(6, 12, 28), dtype=array.dtype)
    stored[:] = array
    return stored


@pytest.mark.parametrize("kind", ARRAYS)
@pytest.mark.parametrize("dtype", ["u1", "i2", "f4"])
def test_dask_builds_the_bytes_of_one_build(kind, dtype, tmp_path):
    values = (blob(dtype=np.float64) * (1 if dtype == "u1" else 7)).astype(dtype)
    array = ARRAYS[kind](values, tmp_path)
    options = {"visible": (60, None), "spacing": (1, 2, 3), "unit": "mm"}
    whole = adj.build(array, tmp_path / "whole.adj", **options)
    built = adj.dask.build(array, tmp_path / "built.adj", slab=6, **options)
    assert built.count == whole.count
    ours, theirs = (bytes_of(tmp_path / name) for name in ("built.adj", "whole.adj"))
    assert ours == theirs
    bricks = adj.dask.build(array, tmp_path / "bricks.adjs", brick=(9, 9, 9), **options)
    bricks.join(tmp_path / "joined.adj")
    assert bytes_of(tmp_path / "joined.adj") == theirs
    three = adj.dask.build(array, tmp_path / "three.adjs", slab=10, partition="xyz", **options)
    assert three.join(tmp_path / "joined.adj").count == whole.count == three.count
    assert bytes_of(tmp_path / "joined.adj") == theirs
    left = {"three.adjs", "whole.adj", "built.adj", "bricks.adjs", "joined.adj", "a.zarr"}
    assert {path.name for path in tmp_path.iterdir()} <= left


def test_dask_places_an_xarray_as_one_build_does(tmp_path):
    pytest.importorskip("xarray")
    mirror = np.diag([-1, 1, 1])
    first = adj.build(blob(), visible=(60, None), spacing=(1, 1, 2), origin=(7, 8, 9), direction=mirror, unit="mm")
    array = first.to_xarray()
    whole = adj.build(array, tmp_path / "whole.adj", visible=(60, None))
    assert (whole.affine == first.affine).all()
    for name, given in (("same", array), ("turned", array.transpose("x", "y", "z")), ("lazy", array.chunk(z=7))):
        adj.dask.build(given, tmp_path / f"{name}.adj", slab=6, visible=(60, None))
        assert bytes_of(tmp_path / f"{name}.adj") == bytes_of(tmp_path / "whole.adj")
    with pytest.raises(ValueError, match="dimensions in another order"):
        adj.BrickPlan(array.transpose("x", "y", "z"), slab=6, visible=(60, None))


def test_what_cannot_be_built_leaves_nothing(tmp_path):
    array = blob()
    with pytest.raises(ValueError, match="nothing is visible"):
        adj.dask.build(array, tmp_path / "a.adjs", slab=5, visible=(250, 251))
    with pytest.raises(ValueError, match="give slab"):
        adj.dask.build(array, tmp_path / "a.adjs", visible=(60, None))
    with pytest.raises(ValueError, match="say what is visible"):
        adj.dask.build(array, tmp_path / "a.adjs", slab=5)
    with pytest.raises(FileNotFoundError):
        adj.dask.build(array, tmp_path / "no" / "a.adjs", slab=5, visible=(60, None))
    assert list(tmp_path.iterdir()) == []
    adj.dask.build(array, tmp_path / "a.adjs", slab=5, visible=(60, None))
    with pytest.raises(FileExistsError):
        adj.dask.build(array, tmp_path / "a.adjs", slab=5, visible=(60, None))
    with pytest.warns(adj.BuildWarning, match="NaN"):
        adj.dask.build(np.where(array > 100, np.nan, array), tmp_path / "b.adjs", slab=5, visible=(60, None))


def test_a_path_that_is_there_or_has_no_folder_is_an_error_of_the_system(model, tmp_path):
    adj.split(model, tmp_path / "a.adjs", slab=8)
    with pytest.raises(FileExistsError, match="is there already"):
        adj.split(model, tmp_path / "a.adjs", slab=8)
    for use in (
        lambda path: adj.split(model, path, slab=8),
        lambda path: adj.save(path, np.zeros((4, 4, 4), np.float32)),
        lambda path: model.save(path),
        lambda path: model.export(path),
    ):
        with pytest.raises(FileNotFoundError, match="no such folder"):
            use(tmp_path / "no" / "a.nii")


def test_a_joined_file_replaces_no_file_of_its_collection(model, tmp_path):
    bricks = adj.split(model, tmp_path / "a.adjs", slab=8, preview=2)
    (tmp_path / "link.adj").symlink_to(tmp_path / "a.adjs" / bricks.bricks[0].file)
    kept = {path: path.read_bytes() for path in (tmp_path / "a.adjs").iterdir()}
    assert len(kept) == 4
    for path in [*kept, tmp_path / "link.adj"]:
        with pytest.raises(ValueError, match="is one of the files that this call reads; give another name"):
            bricks.join(path)
    assert {path: path.read_bytes() for path in kept} == kept


def test_memory_and_previews_that_have_no_effect_are_refused(model, tmp_path):
    bricks = adj.split(model, tmp_path / "a.adjs", slab=8)
    for use in (
        lambda memory: bricks.join(tmp_path / "a.adj", memory=memory),
        lambda memory: adj.split(model, tmp_path / "b.adjs", slab=8, memory=memory),
        lambda memory: model.edit().save(tmp_path / "a.adj", memory=memory),
        lambda memory: adj.dask.build(blob(), tmp_path / "a.adj", slab=8, visible=(60, None), memory=memory),
    ):
        for memory in (1, "63MiB"):
            with pytest.raises(ValueError, match=f"memory is '?{memory}'?, but must be at least 64MiB"):
                use(memory)
    options = {"slab": 8, "visible": (60, None)}
    with pytest.raises(ValueError, match="memory bounds the joining of an .adj file"):
        adj.dask.build(blob(), tmp_path / "b.adjs", memory="1GiB", **options)
    with pytest.raises(ValueError, match="preview is for a collection"):
        adj.dask.build(blob(), tmp_path / "a.adj", preview=2, **options)
    assert [path.name for path in tmp_path.iterdir()] == ["a.adjs"]


def test_a_collection_does_not_get_the_name_of_a_file(model, tmp_path):
    with pytest.raises(ValueError, match="ends in .adj, but a collection is a folder; end it in .adjs"):
        adj.split(model, tmp_path / "a.adj", slab=8)
    assert list(tmp_path.iterdir()) == []


def test_a_split_does_not_drop_a_transfer_function(model, tmp_path):
    other = model.with_transfer(adj.TransferFunction.range(100))
    with pytest.raises(ValueError, match="not the one that the model was built with.*without with_transfer"):
        adj.split(other, tmp_path / "a.adjs", slab=8)
    assert list(tmp_path.iterdir()) == []
    bricks = adj.split(other.with_transfer(model.transfer), tmp_path / "a.adjs", slab=20)
    view = {"size": (30, 20), "quality": "reference"}
    assert np.abs(bricks.render(transfer=other.transfer, **view) - adj.render(other, **view)).max() < 1e-5
    # A closed range of 16 bits was taken for another function.
    wide = adj.build(blob().astype(np.int16) * 7, tmp_path / "wide.adj", visible=(400, 1200))
    assert adj.split(wide.with_transfer(wide.transfer), tmp_path / "wide.adjs", slab=8).count == wide.count


def test_a_brick_that_is_removed_after_opening_is_named(model, tmp_path):
    dask = pytest.importorskip("dask")
    bricks = adj.split(model, tmp_path / "a.adjs", slab=8)
    os.remove(tmp_path / "a.adjs" / bricks.bricks[1].file)
    with dask.config.set(scheduler="synchronous"), pytest.raises(ValueError, match=bricks.bricks[1].file):
        adj.dask.render(bricks, (20, 20))


def test_an_asynchronous_client_is_refused_with_what_to_do_and_that_works(tmp_path):
    distributed = pytest.importorskip("distributed")
    import asyncio

    async def built():
        async with distributed.Client(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, asynchronous=True
        ):
            build = lambda: adj.dask.build(blob(), tmp_path / "a.adjs", slab=8, visible=(60, None))
            with pytest.raises(TypeError, match="the Dask client is asynchronous"):
                build()
            assert list(tmp_path.iterdir()) == []
            return await asyncio.to_thread(build)

    assert asyncio.run(built()).count == adj.build(blob(), visible=(60, None)).count


def test_a_plan_refuses_samples_of_another_place(tmp_path):
    array = blob()
    plan = adj.BrickPlan(array, visible=(60, None), slab=5)
    with pytest.raises(ValueError, match="samples of brick 0"):
        plan.scan(0, array[:5])
    with pytest.raises(ValueError, match="not agreed"):
        plan.build(0, array[plan.samples_of(0)], tmp_path)
    with pytest.raises(ValueError, match="brick: 4 does not exist; there are 4"):
        plan.samples_of(4)
    plan = plan.agree([plan.scan(k, array[plan.samples_of(k)]) for k in range(plan.scans)])
    assert plan.is_agreed and pickle.loads(pickle.dumps(plan)).to_json() == plan.to_json()
    with pytest.raises(ValueError, match="visible voxels are there"):
        plan.finish(tmp_path)


def test_of_two_builds_of_one_collection_one_says_that_it_is_there(tmp_path):
    array = blob()
    plan = adj.BrickPlan(array, visible=(60, None), slab=5)
    plan = plan.agree([plan.scan(k, array[plan.samples_of(k)]) for k in range(plan.scans)])
    folders = [adj.collection.building_folder(str(tmp_path / "a.adjs")) for _ in range(2)]
    for folder in folders:
        for k in range(plan.count):
            plan.build(k, array[plan.samples_of(k)], folder)
    first = adj.collection.finished(plan, folders[0], str(tmp_path / "a.adjs"))
    with pytest.raises(FileExistsError, match="is there already"):
        adj.collection.finished(plan, folders[1], str(tmp_path / "a.adjs"))
    assert first.verify() == []


def test_findings_of_an_earlier_scan_are_refused():
    array = blob(dtype=np.float32)
    plan = adj.BrickPlan(array, visible=(60, None), slab=10)
    found = [plan.scan(k, array[plan.samples_of(k)]) for k in range(plan.scans)]
    with pytest.raises(ValueError, match="scan brick 1 too"):
        plan.agree(found[:1])
    with pytest.raises(ValueError, match="twice"):
        plan.agree([found[0], found[0]])
    with pytest.raises(ValueError, match="another plan, or of an earlier scan"):
        plan.agree(found).agree(found)


def test_a_preview_is_a_model_of_its_own(tmp_path):
    array = blob((40, 40, 40))
    bricks = adj.dask.build(array, tmp_path / "a.adjs", slab=7, preview=4, visible=(60, None), spacing=(1, 1, 2))
    coarse = bricks.preview
    assert (coarse.shape, list(coarse.spacing)) == ((10, 10, 10), [4, 4, 8])
    assert coarse.count == (array[::4, ::4, ::4] >= 60).sum()
    whole = adj.build(array, visible=(60, None), spacing=(1, 1, 2))
    assert (
        adj.split(whole, tmp_path / "b.adjs", slab=13, preview=4).preview._native.to_bytes()
        == coarse._native.to_bytes()
    )
    assert adj.split(whole, tmp_path / "c.adjs", slab=13).preview is None
    with pytest.raises(ValueError, match="preview is 0"):
        adj.split(whole, tmp_path / "d.adjs", slab=13, preview=0)
    os.remove(tmp_path / "a.adjs" / "preview.adj")
    without = adj.Collection(tmp_path / "a.adjs")
    assert without.preview is None and len(without.faults) == 1 and "preview.adj" in without.faults[0]
    assert without.join(tmp_path / "joined.adj").count == whole.count


def test_bricks_with_levels_have_those_of_one_build(tmp_path):
    pytest.importorskip("dask")
    array = blob((32, 24, 40))
    whole = adj.build(array, tmp_path / "whole.adj", visible=(60, None), levels=2)
    options = {"visible": (60, None), "levels": 2}
    bricks = adj.dask.build(array, tmp_path / "a.adjs", brick=(8, 12, 20), preview=4, **options)
    assert bricks.level_count == 2 and bricks.verify() == []
    bricks.join(tmp_path / "joined.adj")
    adj.dask.build(array, tmp_path / "b.adj", slab=8, **options)
    assert bytes_of(tmp_path / "joined.adj") == bytes_of(tmp_path / "b.adj") == bytes_of(whole.path)
    # A brick's level is its part of the whole's: so are its means of blocks.
    visible = (array >= 60).reshape(16, 2, 12, 2, 20, 2).mean(axis=(1, 3, 5))
    for brick in bricks.bricks:
        if brick.file is None:
            continue
        level = adj.open(tmp_path / "a.adjs" / brick.file).levels[1]
        dense = np.zeros(level.shape)
        dense[level.nonzero()] = level.coverage()
        part = tuple(slice(low // 2, (low + size) // 2) for low, size in zip(brick.low, brick.shape))
        assert (dense == visible[part]).all() and (level.to_numpy() == whole.levels[1][part]).all()
    # The preview is a level of the whole.
    assert (bricks.preview.to_numpy() == whole.levels[2].to_numpy()).all()
    view = {"size": (60, 50), "azimuth": 20, "elevation": 10, "quality": "reference"}
    slabs = adj.split(whole, tmp_path / "slabs.adjs", slab=8, partition="xyz")
    for level in (0, 1, 2):
        picture = adj.render(whole, level=level, **view)
        assert np.abs(slabs.render(level=level, **view) - picture).max() < 1e-5
        assert np.abs(adj.dask.render(slabs, level=level, **view) - picture).max() < 1e-5
    with pytest.raises(ValueError, match="levels 0 to 2"):
        slabs.render(level=3)


def test_a_plan_says_how_many_levels_its_bricks_hold():
    array = np.full((160, 8, 8), 100, np.uint8)
    plan = adj.BrickPlan(array, visible=(60, None), slab=4, levels="auto")
    assert plan.level_count == 2 and adj.BrickPlan.from_json(plan.to_json()).level_count == 2
    assert adj.BrickPlan(array, visible=(60, None), slab=5, levels="auto").level_count == 0
    assert adj.BrickPlan(array, visible=(60, None), slab=5).level_count == 0
    with pytest.raises(ValueError, match="are 2, but these bricks can hold 1"):
        adj.BrickPlan(array, visible=(60, None), slab=6, levels=2)
    with pytest.raises(ValueError, match="levels"):
        adj.BrickPlan(array, visible=(60, None), slab=6, levels=16)


def test_pictures_of_parts_are_put_together(file, tmp_path):
    bricks = adj.split(adj.open(file), tmp_path / "a.adjs", slab=5)
    near = np.zeros((4, 5, 4), np.float32)
    near[..., 3] = 0.5
    far = np.ones((4, 5, 4), np.float32)
    assert np.allclose(adj.composite([near, far])[0, 0], [0.5, 0.5, 0.5, 1])
    assert np.allclose(adj.composite([near, far], mode="xray")[0, 0], [1, 1, 1, 1])
    picture = bricks.render(size=(20, 30))
    adj.save(tmp_path / "a.exr", picture)
    assert np.array_equal(adj.composite([tmp_path / "a.exr"]), picture)
    with pytest.raises(ValueError, match="different sizes"):
        adj.composite([near, picture])
    with pytest.raises(ValueError, match="no pictures"):
        adj.composite([])
    with pytest.raises(ValueError, match="composite and xray"):
        adj.composite([near], mode="maximum")


def raw_slices(array, folder):
    for z, plane in enumerate(array):
        plane.astype(">u2").tofile(folder / f"slice{z}.raw")
    return adj.VolumeFile(str(folder / "*.raw"), shape=array.shape, dtype=">u2")


def tiff_slices(array, folder):
    tifffile = pytest.importorskip("PIL.Image")
    for z, plane in enumerate(array):
        tifffile.fromarray(plane.astype(np.uint16)).save(folder / f"slice{z}.tif")
    return str(folder)


def dicom_slices(array, folder):
    itk = pytest.importorskip("SimpleITK")
    for z, plane in enumerate(array):
        image = itk.GetImageFromArray(plane[None].astype(np.int16))
        keys = {"0008|0060": "CT", "0020|000e": "1.2.3.4", "0020|0032": f"0\\0\\{2 * z}", "0020|0013": str(z)}
        keys |= {"0028|1053": "2", "0028|1052": "-100", "0020|0037": "1\\0\\0\\0\\1\\0"}
        for key, value in keys.items():
            image.SetMetaData(key, value)
        writer = itk.ImageFileWriter()
        writer.KeepOriginalImageUIDOn()
        writer.SetFileName(str(folder / f"slice{len(array) - z}.dcm"))
        writer.Execute(image)
    return folder


def ome_zarr(array, folder):
    zarr = pytest.importorskip("zarr")
    group = zarr.open_group(str(folder / "a.ome.zarr"), mode="w", zarr_format=2)
    stored = group.create_array(
        "0", shape=array.shape, chunks=(5, 9, 11), dtype="u2", chunk_key_encoding={"name": "v2", "separator": "/"}
    )
    stored[:] = array
    axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    scale = [{"type": "scale", "scale": [2.0, 0.5, 0.5]}]
    datasets = [{"path": "0", "coordinateTransformations": scale}]
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": datasets}]
    return folder / "a.ome.zarr"


@pytest.mark.parametrize("stored", [raw_slices, tiff_slices, dicom_slices, ome_zarr])
def test_dask_builds_the_bytes_of_one_build_of_files(stored, tmp_path):
    folder = tmp_path / "slices"
    folder.mkdir()
    array = blob((17, 24, 28), np.float64).astype(np.uint16) * 5
    volume = stored(array, folder)
    options = {"visible": (300, None)}
    if isinstance(volume, adj.VolumeFile):
        whole = adj.build(volume._files, tmp_path / "whole.adj", shape=array.shape, dtype=">u2", **options)
    else:
        whole = adj.build(volume, tmp_path / "whole.adj", **options)
    assert 1000 < whole.count < array.size
    bricks = adj.dask.build(volume, tmp_path / "a.adjs", brick=(4, 11, 13), **options)
    bricks.join(tmp_path / "joined.adj")
    assert bytes_of(tmp_path / "joined.adj") == bytes_of(tmp_path / "whole.adj")
    assert (
        pickle.loads(pickle.dumps(adj.VolumeFile(volume) if not isinstance(volume, adj.VolumeFile) else volume)).shape
        == array.shape
    )


def test_parts_of_a_volume_in_files_are_boxes():
    volume = adj.VolumeFile("phantom:gyroid", shape=(8, 9, 10), dtype="u1")
    assert volume.shape == (8, 9, 10) and volume[2:5, :, 3:].box == ([3, 0, 2], [7, 9, 3])
    for box in (3, (slice(0, 2), 1, slice(None)), slice(0, 3)):
        with pytest.raises(TypeError, match="box of three slices"):
            volume[box]
    for box in ((slice(0, 8, 2),) * 3, (slice(5, 3), slice(None), slice(None))):
        with pytest.raises(ValueError, match="steps of 1"):
            volume[box]
    with pytest.raises(TypeError, match="a volume is an array"):
        adj.dask.build(3, "a.adjs", slab=3, visible=(1, None))
    with pytest.raises(FileNotFoundError):
        adj.dask.build("no.nrrd", "a.adjs", slab=3, visible=(1, None))


def test_a_worker_that_is_killed_changes_nothing(tmp_path):
    distributed = pytest.importorskip("distributed")
    import signal
    import threading

    array = np.kron(blob(), np.ones((4, 4, 4), np.uint8))
    stored = _zarr(array, tmp_path)
    adj.build(stored, tmp_path / "whole.adj", visible=(60, None))
    settings = {"distributed.scheduler.allowed-failures": 10, "distributed.nanny.environ": {}}
    import dask

    with (
        dask.config.set(settings),
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        done = threading.Event()
        killed = []

        def kill():
            while not done.wait(0.4) and len(killed) < 3:
                pids = [worker["pid"] for worker in _workers(client)]
                if pids:
                    os.kill(pids[0], signal.SIGKILL)
                    killed.append(pids[0])

        killer = threading.Thread(target=kill)
        killer.start()
        try:
            adj.dask.build(stored, tmp_path / "built.adj", slab=2, visible=(60, None), retries=10)
        finally:
            done.set()
            killer.join()
    assert killed
    assert bytes_of(tmp_path / "built.adj") == bytes_of(tmp_path / "whole.adj")
    assert {path.name for path in tmp_path.iterdir()} == {"a.zarr", "whole.adj", "built.adj"}


def test_the_dashboard_shows_the_steps(tmp_path):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        # Asked for once, it is recorded from then on.
        client.get_task_stream()
        bricks = adj.dask.build(blob(), tmp_path / "a.adjs", slab=5, visible=(60, None))
        adj.dask.render(bricks, (20, 20))
        names = [distributed.utils.key_split(task["key"]) for task in client.get_task_stream(count=1000)]
    assert [names.count(step) for step in ("scan", "build", "draw_brick", "put_together")] == [4, 4, 4, 3]


class Failing:
    """A volume whose first slab cannot be read, and whose others take long."""

    shape, dtype = (40, 24, 28), np.dtype("u1")

    def __getitem__(self, key):
        if key[0].start == 0:
            raise ValueError("the disk is gone")
        time.sleep(0.3)
        return np.full([len(range(*part.indices(n))) for part, n in zip(key, self.shape)], 200, np.uint8)


def test_a_build_that_fails_leaves_no_tasks_on_the_cluster(tmp_path):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster),
    ):
        with pytest.raises(ValueError, match="the disk is gone"):
            adj.dask.build(Failing(), tmp_path / "a.adjs", slab=1, visible=(60, None))
        # The client tells the scheduler in the background.
        for _ in range(40):
            if not cluster.scheduler.tasks:
                break
            time.sleep(0.05)
        assert not cluster.scheduler.tasks


def _workers(client):
    found = client.run(os.getpid, on_error="ignore")
    return [{"pid": pid} for pid in found.values() if isinstance(pid, int)]
