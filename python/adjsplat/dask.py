"""Building and drawing collections with Dask: on one machine's threads, or on the workers of any cluster.

With a `dask.distributed.Client` in force its workers do the work, else Dask's threads. Workers and client must see the
output's folder under one path.
"""

from __future__ import annotations

import operator
import os
import shutil
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from . import _native
from ._optional import needed
from .arguments import output_path, path_text, whole_within, working_memory
from .build import BuildWarning
from .collection import (
    BrickPlan,
    BrickRenderer,
    Collection,
    as_volume,
    building_folder,
    collection_path,
    finished,
    put_together,
)
from .model import Model
from .render import Look
from .volume_file import VolumeFile


def build(
    array: Any,
    out: str | os.PathLike[str],
    *,
    slab: int | None = None,
    brick: Sequence[int] | None = None,
    memory: int | str | None = None,
    retries: int = 3,
    **options: Any,
) -> Collection | Model:
    """Builds a collection (`out` ends in .adjs) or an .adj file of a volume, brick by brick.

    `array` is a zarr, dask or other array, a `VolumeFile`, or what a `VolumeFile` takes: a path, a folder of slices, a list
    or pattern of paths of slices. Of files each task reads what its brick needs.

    `slab` or `brick` say how large bricks are, as for `split`; each task holds the samples of one brick and its visible
    voxels, so they bound a worker's memory. `options` are those of `BrickPlan`: what is visible, where, and how it is
    stored. The array is read once or twice, and once more if opacity depends on the largest gradient. A file has the bytes
    that `adjsplat.build` gives of the whole array; joining takes at most `memory` bytes. `memory` is for files only, and
    `preview` for collections only.

    With a client of `dask.distributed`, tasks that fail, or whose worker does, run again, at most `retries` times; Dask's
    threads run each task once. The output appears complete or not at all.

    >>> array = np.arange(4096, dtype=np.uint16).reshape(16, 16, 16)
    >>> adj.dask.build(array, "ramp-of-tasks.adjs", slab=4, visible=(2000, None)).count
    2096
    """
    dask = needed("dask", "adjsplat.dask")
    array = as_volume(array)
    is_file = not path_text(out).rstrip("/").endswith(".adjs")
    path = output_path(out) if is_file else collection_path(out)
    if slab is None and brick is None:
        raise ValueError("give slab, the slices of a brick along z, or brick, its points (z, y, x)")
    if memory is not None and not is_file:
        raise ValueError("memory bounds the joining of an .adj file; leave it out for a collection")
    if options.get("preview") is not None and is_file:
        raise ValueError("preview is for a collection; leave it out for an .adj file")
    limit, retries = working_memory(memory), whole_within("retries", retries, 0, 2**31 - 1)
    # Slices of a Dask array are tasks themselves, those of a numpy array travel, and parts of files are read late; slices of
    # other arrays are read where they are needed.
    is_sliced = isinstance(array, (np.ndarray, VolumeFile)) or hasattr(array, "__dask_graph__")
    part = operator.getitem if is_sliced else dask.delayed(operator.getitem, pure=False)
    if is_file:
        options["preview"] = 1
    plan = BrickPlan(array, slab=slab, brick=brick, **options)
    scan, make = dask.delayed(_scan, pure=False), dask.delayed(_build, pure=False)
    collection = f"{path}.adjs" if is_file else path
    building = building_folder(collection)
    try:
        while not plan.is_agreed:
            text = plan.to_json()
            tasks = [scan(text, index, part(array, plan.samples_of(index))) for index in range(plan.scans)]
            plan = plan.agree(_computed(dask, tasks, retries))
        text = plan.to_json()
        tasks = [make(text, index, part(array, plan.samples_of(index)), building) for index in range(plan.count)]
        _computed(dask, tasks, retries)
        for line in plan.warnings:
            warnings.warn(line, BuildWarning, stacklevel=2)
        if not is_file:
            return finished(plan, building, path)
        plan.finish(building)
        return Collection(building).join(path, memory=limit)
    finally:
        shutil.rmtree(building, ignore_errors=True)


def render(
    collection: Collection | str | os.PathLike[str], *view: Any, transfer: Any = None, **look: Any
) -> np.ndarray:
    """Draws a picture of a collection: each brick by a task, the pictures put together in a tree of tasks.

    The arguments are those of `Collection.render`, which draws the same picture up to rounding. `threads`, 1 by default, are
    those of a task.

    >>> adj.dask.render(adj.split(f, "drawn.adjs", slab=16), size=(64, 48), azimuth=30).shape
    (48, 64, 4)
    """
    dask = needed("dask", "adjsplat.dask")
    opened = collection if isinstance(collection, Collection) else Collection(collection)
    draw, over = dask.delayed(_draw_brick, pure=False), dask.delayed(put_together, pure=False)

    def each(order: list[int], look: Look, camera: str, function: str | None) -> np.ndarray | None:
        pictures = [draw(opened.path, index, look, camera, function) for index in order]
        while len(pictures) > 1:
            pairs = [pictures[k : k + 2] for k in range(0, len(pictures), 2)]
            pictures = [over(*pair, look.mode) if len(pair) == 2 else pair[0] for pair in pairs]
        return _computed(dask, pictures, 3)[0] if pictures else None

    look.setdefault("threads", 1)
    return BrickRenderer(opened, transfer=transfer, each=each).render(*view, **look)


def _computed(dask: Any, tasks: list[Any], retries: int) -> list[Any]:
    """Computes tasks with the cluster's client in force, or else with the scheduler that Dask is set to."""
    try:
        from distributed import get_client

        client = get_client()
    except (ImportError, ValueError):
        return list(dask.compute(*tasks))
    if client.asynchronous:
        raise TypeError(
            "the Dask client is asynchronous, but this call waits for its tasks: make the client without "
            "asynchronous=True, or make this call in a thread, as by asyncio.to_thread"
        )
    futures = client.compute(tasks, retries=retries)
    try:
        return list(client.gather(futures))
    except BaseException:
        # The cluster would go on with the other tasks, and try failed ones again.
        client.cancel(futures)
        raise


def _scan(plan: str, index: int, samples: Any) -> str:
    return BrickPlan.from_json(plan).scan(index, samples, threads=1)


def _build(plan: str, index: int, samples: Any, folder: str) -> int:
    return BrickPlan.from_json(plan).build(index, samples, folder, threads=1)


def _draw_brick(path: str, index: int, look: Look, camera: str, transfer: str | None) -> np.ndarray | None:
    return _native.Collection.open(path, True).render_brick(index, look, camera, transfer)
