"""Collections: what is split or built in bricks joins to the bytes of one build; pictures are near those of the whole."""

import os
import pathlib
import pickle

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


def _workers(client):
    found = client.run(os.getpid, on_error="ignore")
    return [{"pid": pid} for pid in found.values() if isinstance(pid, int)]
