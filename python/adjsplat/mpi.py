"""Building and drawing collections with MPI, through mpi4py; all ranks see one file system.

    mpirun -n 4 python -m adjsplat.mpi build volume.npy -o head.adjs --visible 60.. --slab 64
    mpirun -n 4 python -m adjsplat.mpi render head.adjs -o head.png --azimuth 30 --elevation 20

A rank draws bricks that follow each other in depth. Pictures are put together by binary swap (Ma et al. 1994) where the
number of ranks is a power of two, else by direct send (Hsu 1993): each rank composites a part of the rows.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ._optional import needed
from .build import BuildWarning
from .collection import (
    BrickPlan,
    BrickRenderer,
    Collection,
    as_volume,
    building_folder,
    collection_path,
    finished,
    over,
    put_together,
)
from .pictures import picture_path, save
from .render import Look
from .volume_file import VolumeFile

#: The most numbers in a message, 1 GiB: MPI counts bytes with 31 bits.
MOST_NUMBERS = 1 << 28

#: Arguments of a view that `--camera` replaces.
ORBIT = ("azimuth", "elevation", "zoom", "perspective")


def build(
    array: Any,
    out: str | os.PathLike[str],
    *,
    slab: int | None = None,
    brick: Sequence[int] | None = None,
    comm: Any = None,
    **options: Any,
) -> Collection:
    """Builds a collection of a volume that every rank can read; all ranks call this, and all get it.

    `array` is an array, a `VolumeFile`, or what that takes. `slab`, `brick` and `options` are those of
    `adjsplat.dask.build`. A rank that fails ends the build on all ranks, which then raise RuntimeError with its message;
    nothing is left. So does one in which a step raises KeyboardInterrupt or SystemExit: it raises that, the others
    RuntimeError. A run that is killed, as by Ctrl-C of mpirun, leaves a folder `.NAME.adjs.XXXX.building`.
    """
    comm = _world() if comm is None else comm
    path = _together(comm, collection_path, out)
    array = _together(comm, as_volume, array)

    def planned() -> tuple[str, str]:
        plan = BrickPlan(array, slab=slab, brick=brick, **options)
        return plan.to_json(), building_folder(path)

    text, building = comm.bcast(_together(comm, planned if comm.rank == 0 else lambda: None), root=0)
    plan = BrickPlan.from_json(text)
    try:
        own = range(comm.rank, plan.count, comm.size)
        scans = range(comm.rank, plan.scans, comm.size)

        def scanned(plan: BrickPlan) -> dict[int, str]:
            return {index: plan.scan(index, array[plan.samples_of(index)], threads=1) for index in scans}

        def built(plan: BrickPlan) -> None:
            for index in own:
                plan.build(index, array[plan.samples_of(index)], building, threads=1)

        while not _together(comm, plan.__getattribute__, "is_agreed"):
            findings: dict[int, str] = {}
            for of_rank in comm.allgather(_together(comm, scanned, plan)):
                findings |= of_rank
            plan = plan.agree([findings[index] for index in range(plan.scans)])
        _together(comm, built, plan)
        _together(comm, lambda: finished(plan, building, path) if comm.rank == 0 else None)
    finally:
        if comm.rank == 0:
            shutil.rmtree(building, ignore_errors=True)
    if comm.rank == 0:
        for line in plan.warnings:
            warnings.warn(line, BuildWarning, stacklevel=2)
    return Collection(path)


def render(
    collection: Collection | str | os.PathLike[str], *view: Any, transfer: Any = None, comm: Any = None, **look: Any
) -> np.ndarray | None:
    """Draws a picture of a collection; all ranks call this, and rank 0 gets the picture, the others None.

    The arguments are those of `Collection.render`; `threads`, 1 by default, are those of a rank. A rank that fails ends the
    drawing on all ranks, which then raise RuntimeError with its message.
    """
    comm = _world() if comm is None else comm
    opened = collection if isinstance(collection, Collection) else _together(comm, lambda: Collection(collection))

    def each(order: list[int], look: Look, camera: str, function: str | None) -> np.ndarray | None:
        bounds = [len(order) * rank // comm.size for rank in (comm.rank, comm.rank + 1)]

        def drawn() -> np.ndarray:
            picture = None
            for index in order[bounds[0] : bounds[1]]:
                farther = opened._open.render_brick(index, look, camera, function)
                picture = put_together(picture, farther, look.mode)
            columns, rows = look.size
            return np.zeros((rows, columns, 4), np.float32) if picture is None else picture

        return composited(comm, _together(comm, drawn), look.mode)

    look.setdefault("threads", 1)
    # Rank 0 alone looks for what the function needs of all bricks.
    own = transfer if comm.rank == 0 else None
    renderer = _together(comm, lambda: BrickRenderer(opened, transfer=own, each=each))
    renderer._transfer = comm.bcast(renderer._transfer, root=0)
    picture = renderer.render(*view, **look)
    return picture if comm.rank == 0 else None


def composited(comm: Any, picture: np.ndarray, mode: str) -> np.ndarray | None:
    """Puts the ranks' pictures together, a lower rank's in front; rank 0 gets the result, the others None."""
    rows = picture.shape[0]
    if comm.size & (comm.size - 1) == 0:
        first, last = 0, rows
        for bit in range(comm.size.bit_length() - 1):
            partner = comm.rank ^ (1 << bit)
            middle = (first + last) // 2
            kept, given = ((first, middle), (middle, last))[:: -1 if comm.rank > partner else 1]
            received = np.empty((kept[1] - kept[0], *picture.shape[1:]), np.float32)
            _transfer(comm, [(partner, received)], [(partner, picture[given[0] : given[1]])])
            own = picture[kept[0] : kept[1]]
            pair = [own, received] if comm.rank < partner else [received, own]
            picture[kept[0] : kept[1]] = over(pair[0], pair[1], mode)
            first, last = kept
    else:
        ends = [rows * rank // comm.size for rank in range(comm.size + 1)]
        first, last = ends[comm.rank : comm.rank + 2]
        parts = [np.empty((last - first, *picture.shape[1:]), np.float32) for _ in range(comm.size)]
        _transfer(
            comm, list(enumerate(parts)), [(rank, picture[ends[rank] : ends[rank + 1]]) for rank in range(comm.size)]
        )
        part = parts[0]
        for farther in parts[1:]:
            part = over(part, farther, mode)
        picture[first:last] = part
    spans = comm.allgather((first, last))
    if comm.rank != 0:
        _transfer(comm, [], [(0, picture[first:last])])
        return None
    _transfer(comm, [(rank, picture[slice(*spans[rank])]) for rank in range(1, comm.size)], [])
    return picture


def _transfer(comm: Any, received: list[tuple[int, np.ndarray]], sent: list[tuple[int, np.ndarray]]) -> None:
    """Receives rows of pictures from ranks, and sends rows to ranks, in messages of at most `MOST_NUMBERS`."""

    def pieces(rows: np.ndarray) -> list[np.ndarray]:
        flat = rows.reshape(-1)
        return [flat[at : at + MOST_NUMBERS] for at in range(0, flat.size, MOST_NUMBERS)]

    requests = [comm.Irecv(piece, source=rank) for rank, rows in received for piece in pieces(rows)]
    requests += [comm.Isend(piece, dest=rank) for rank, rows in sent for piece in pieces(rows)]
    for request in requests:
        request.Wait()


def _world() -> Any:
    return needed("mpi4py.MPI", "adjsplat.mpi").COMM_WORLD


def _together(comm: Any, step: Callable[..., Any], *arguments: Any) -> Any:
    """Does a step on every rank; only rank 0 warns. If the step fails on one, all raise what the first of them says.

    A rank with a KeyboardInterrupt or SystemExit tells the others, which would wait for it for ever, and raises it then.
    """
    result, text = None, None
    failure: BaseException | None = None
    try:
        with warnings.catch_warnings():
            if comm.rank != 0:
                warnings.simplefilter("ignore")
            result = step(*arguments)
    except Exception as error:
        failure, text = error, str(error) or type(error).__name__
    except BaseException as error:
        failure, text = error, type(error).__name__
    failures = comm.allgather(text)
    if failure is not None and not isinstance(failure, Exception):
        raise failure
    first = next((rank for rank, text in enumerate(failures) if text is not None), None)
    if first is not None:
        raise RuntimeError(f"rank {first}: {failures[first]}") from failure
    return result


def _range(text: str) -> tuple[float | None, float | None]:
    low, dots, high = text.partition("..")
    try:
        if dots:
            return (float(low) if low else None, float(high) if high else None)
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"{text!r} is no range; an example: 300..3000, 300.. or ..3000")


def _levels(text: str) -> int | str:
    try:
        return text if text == "auto" else int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of levels; an example: 3, or auto") from None


def _size(text: str) -> tuple[int, int]:
    try:
        columns, rows = text.split("x")
        return int(columns), int(rows)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no size in pixels; an example: 800x600") from None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m adjsplat.mpi", description="Builds and draws collections with MPI."
    )
    commands = parser.add_subparsers(dest="command", required=True)
    building = commands.add_parser("build", help="build a collection of a volume")
    building.add_argument(
        "input", metavar="VOLUME", help="a .npy file, or what adj build reads: zarr, a folder of slices ..."
    )
    building.add_argument("-o", "--output", required=True, metavar="OUT.adjs")
    building.add_argument("--slab", type=int, required=True, metavar="SLICES", help="slices of a brick along z")
    visible = building.add_mutually_exclusive_group(required=True)
    visible.add_argument("--visible", type=_range, metavar="LOW..HIGH", help="values to show; an end may be left out")
    visible.add_argument("--transfer", metavar="FILE|PRESET", help="a transfer function")
    building.add_argument("--partition", default="z", choices=["z", "xyz"], help="axes across which slabs are cut")
    building.add_argument(
        "--preview", type=int, metavar="N", help="points along an axis that a voxel of the preview stands for"
    )
    building.add_argument(
        "--levels",
        type=_levels,
        metavar="N|auto",
        help="coarser levels of detail in each brick, for pictures from afar",
    )
    building.add_argument("--lanes", default="xyz", choices=["x", "xy", "xyz"])
    drawing = commands.add_parser("render", help="draw a picture of a collection")
    drawing.add_argument("input", metavar="IN.adjs")
    drawing.add_argument("-o", "--output", required=True, metavar="OUT.png|OUT.exr")
    drawing.add_argument("--size", type=_size, default=(800, 800), metavar="WxH")
    for name in (*ORBIT, "exposure"):
        drawing.add_argument(f"--{name}", type=float)
    drawing.add_argument("--camera", metavar="FILE|JSON", help="the whole view, as adj render takes it")
    drawing.add_argument(
        "--level", type=int, metavar="N", help="the level of detail to draw; 0 for the voxels themselves"
    )
    drawing.add_argument("--quality", default="standard")
    drawing.add_argument("--mode", default="composite")
    drawing.add_argument("--background", metavar="COLOUR")
    drawing.add_argument("--threads", type=int, default=1, help="threads of a rank")
    drawing.add_argument("--partial", action="store_true", help="leave out bricks that cannot be used, and name them")
    for command in (building, drawing):
        command.add_argument("--json", action="store_true", help="print each rank's processor seconds")
    return parser


def _run(arguments: argparse.Namespace, comm: Any) -> str:
    """Does what the command line asks for; returns what rank 0 prints."""
    if arguments.command == "build":
        volume = _together(comm, lambda: _opened(arguments.input))
        chosen = {"visible": arguments.visible} if arguments.visible else {"transfer": arguments.transfer}
        chosen |= {name: getattr(arguments, name) for name in ("slab", "partition", "preview", "lanes", "levels")}
        bricks = build(volume, arguments.output, comm=comm, **chosen)
        return f"{arguments.output}: {len(bricks.bricks)} bricks, {bricks.count} visible voxels"
    _together(comm, picture_path, arguments.output)
    bricks = _together(comm, lambda: Collection(arguments.input, partial=arguments.partial))
    if comm.rank == 0:
        for fault in bricks.faults:
            print(f"adjsplat.mpi: {fault}; it is left out", file=sys.stderr)
    names = ("size", "quality", "mode", "exposure", "level", "background", "threads")
    look = {name: getattr(arguments, name) for name in names}
    look |= {name: getattr(arguments, name) for name in ORBIT if getattr(arguments, name) is not None}
    if arguments.camera is not None:
        look["camera"] = _together(comm, _camera, arguments)
    picture = render(bricks, comm=comm, **look)
    _together(comm, lambda: None if picture is None else save(arguments.output, picture))
    return f"{arguments.output}: {arguments.size[0]}x{arguments.size[1]}, {comm.size} ranks"


def _camera(arguments: argparse.Namespace) -> Any:
    """Returns the camera that `--camera` gives as JSON, or as the path of a JSON file."""
    if given := [f"--{name}" for name in ORBIT if getattr(arguments, name) is not None]:
        raise ValueError(f"--camera is the whole view; leave out {' and '.join(given)}")
    text, name = arguments.camera, "--camera"
    try:
        if not text.lstrip().startswith("{"):
            name = text
            with open(name, encoding="utf-8") as file:
                text = file.read()
        return json.loads(text)
    except ValueError as error:
        raise ValueError(f"{name} is no JSON: {error}") from None


def _opened(path: str) -> Any:
    if path.endswith(".npy"):
        return np.load(path, mmap_mode="r")
    return VolumeFile(path)


def main(words: Sequence[str] | None = None) -> int:
    """Runs the command line on this rank; returns the exit code: 0, or 2 after one line on stderr."""
    arguments = _parser().parse_args(words)
    comm = _world()
    try:
        told = _run(arguments, comm)
    except Exception as error:
        if comm.rank == 0:
            print(f"adjsplat.mpi: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    usage = resource.getrusage(resource.RUSAGE_SELF)
    seconds = comm.gather(round(usage.ru_utime + usage.ru_stime, 3), root=0)
    if comm.rank == 0:
        print(json.dumps({"output": arguments.output, "processor_seconds": seconds}) if arguments.json else told)
    return 0


if __name__ == "__main__":
    sys.exit(main())
