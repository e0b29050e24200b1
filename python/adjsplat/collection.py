"""Collections: volumes in several files, for what exceeds one machine's memory or time."""

from __future__ import annotations

import functools
import os
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from . import _native
from .arguments import (
    byte_count,
    function,
    output_path,
    path_in_folder,
    path_text,
    thread_count,
    whole,
    working_memory,
)
from .arrays import Slices, is_array, no_volume
from .build import BuildWarning, Packing, Place, chosen_transfer, placed_volume
from .data_array import in_order, is_of_xarray
from .model import Model, open
from .pictures import linear_picture
from .render import Look, Renderer, warn_missing
from .transfer import as_transfer
from .volume_file import VolumeFile, VolumePart


class Brick(NamedTuple):
    """A brick of a collection: a box of the grid, ordered (z, y, x)."""

    #: Index of the lowest point.
    low: tuple[int, int, int]
    #: Number of points.
    shape: tuple[int, int, int]
    #: Number of visible voxels.
    voxels: int
    #: Name of the file in the collection's folder; None if no voxel is visible.
    file: str | None


class Collection:
    """An open collection `NAME.adjs`: a folder of bricks, each an .adj file of its own, and a manifest.

    Opening reads the manifest and the bricks' headers. It raises `OSError` if there is none, and `ValueError` that names the
    first brick that is missing, cut or of another build. With `partial=True` such bricks are left out of the joined file and
    of pictures, and `faults` names them; `bricks` and `count` still tell of the whole. Damage behind a brick's header is
    found by `verify` and `join`, which read every byte.

    >>> bricks = adj.split(f, "engine.adjs", slab=16)
    >>> bricks.shape, len(bricks.bricks)
    ((64, 64, 64), 4)
    >>> bricks.render(size=(64, 48)).shape
    (48, 64, 4)
    >>> bricks.join("joined.adj")
    <adjsplat.Model 64 x 64 x 64 (z, y, x), 143360 visible voxels, ...joined.adj>
    """

    def __init__(self, path: str | os.PathLike[str], *, partial: bool = False):
        #: The folder's absolute path.
        self.path = os.path.abspath(path_text(path))
        self._partial = bool(partial)
        self._native = _native.Collection.open(self.path, self._partial)

    @property
    def _open(self) -> _native.Collection:
        return self._native

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of grid points of the whole (z, y, x)."""
        x, y, z = self._native.dims
        return z, y, x

    @property
    def count(self) -> int:
        """Number of visible voxels of the whole, those of bricks that cannot be used included."""
        return self._native.count

    @property
    def level_count(self) -> int:
        """Number of coarser levels of detail in every brick; `render` draws those that suit the picture."""
        return self._native.level_count

    @property
    def bricks(self) -> list[Brick]:
        """The bricks, partition after partition, each by ascending z, then y, then x; also those that cannot be used."""
        turned = lambda numbers: (numbers[2], numbers[1], numbers[0])
        return [Brick(turned(low), turned(size), count, file) for low, size, count, file in self._native.bricks]

    @property
    def faults(self) -> list[str]:
        """What opening found wrong with bricks and the preview, a line for each; `verify` checks every byte."""
        return self._native.faults

    @property
    def preview(self) -> Model | None:
        """The whole with fewer grid points, as a model that fits any machine.

        It is one of the levels of detail, if bricks have some; else it has every n-th point along each axis.

        None if there is none: the collection is small, or the preview's file cannot be used (`faults` says so).
        """
        file = self._native.preview
        return None if file is None else open(os.path.join(self.path, file))

    def verify(self) -> list[str]:
        """Checks every byte of every brick and of the preview; returns what is wrong, a line for each."""
        return self.faults + self._native.check()

    def join(
        self,
        out: str | os.PathLike[str],
        *,
        verify: bool = True,
        memory: int | str | None = None,
        threads: int | None = None,
        progress: Callable[[str, int, int], Any] | None = None,
    ) -> Model:
        """Joins the bricks to the .adj file that one build of the whole volume makes, byte for byte, and opens it.

        Raises `FormatError` that names the first brick that is damaged. A collection that was opened with `partial=True`
        leaves out such bricks, too, with a `BuildWarning` for each that is left out. `verify=False` does not check them: it
        is faster, but damage may pass into the file.
        """
        path = output_path(out, self._native.files)
        limits = working_memory(memory), thread_count(threads)
        checks = bool(verify), self._partial
        model, faults = self._native.join(path, checks, *limits, function("progress", progress))
        for fault in faults:
            warnings.warn(f"left out: {fault}", BuildWarning, stacklevel=2)
        return Model(model, path)

    def render(self, *view: Any, transfer: Any = None, **look: Any) -> np.ndarray:
        """Draws a picture brick by brick; the arguments are those of `Renderer.render`.

        Nothing is joined, so that the whole need not fit into memory. docs/clusters.md says by how much the picture differs
        from that of the joined file. Not in the maximum modes, nor with `max_error`; "xray" needs an `exposure`.
        """
        return BrickRenderer(self, transfer=transfer).render(*view, **look)

    def __repr__(self) -> str:
        z, y, x = self.shape
        return f"<adjsplat.Collection {z} x {y} x {x} (z, y, x), {len(self.bricks)} bricks, {self.path}>"

    def __reduce__(self) -> Any:
        return functools.partial(Collection, partial=self._partial), (self.path,)


class BrickRenderer(Renderer):
    """Draws pictures of a collection brick by brick. `each` maps a function over the bricks' indices, nearest first."""

    def __init__(self, collection: Collection, *, transfer: Any = None, each: Callable[..., Any] | None = None):
        self.model: Any = collection
        self._device = None
        self._transfer: str | None = None
        if transfer is not None:
            # Of the whole: where the colours of an open range end, for example, follows from all bricks.
            self._transfer, missing = collection._open.drawable(as_transfer(transfer).to_json())
            warn_missing(missing)
        self._each = each

    def _framed(
        self, look: Look, angles: list[tuple[float, float]], zoom: float, perspective: float | None, up: str
    ) -> list[str]:
        return self.model._open.cameras(look, angles, zoom, perspective, up)

    def _draw(self, look: Look, view: str, max_error: float | None) -> np.ndarray:
        check_mode(look, max_error)
        native = self.model._open
        order = native.front_to_back(look, view)
        if self._each is None:
            pictures = (native.render_brick(index, look, view, self._transfer) for index in order)
            picture = None
            for farther in pictures:
                picture = put_together(picture, farther, look.mode)
        else:
            picture = self._each(order, look, view, self._transfer)
        columns, rows = look.size
        return np.zeros((rows, columns, 4), np.float32) if picture is None else picture


def check_mode(look: Look, max_error: float | None) -> None:
    """Refuses what cannot be drawn brick by brick."""
    if max_error is not None:
        raise ValueError("max_error is not for pictures brick by brick; join the collection first")
    if look.mode in ("maximum", "maximum-grey"):
        raise ValueError(f"mode {look.mode} interpolates between bricks; join the collection first")
    if look.mode == "xray" and look.exposure is None:
        raise ValueError("exposure must be given to draw xray brick by brick: by default each brick would have its own")


def over(nearer: np.ndarray, farther: np.ndarray, mode: str) -> np.ndarray:
    """Returns the picture of what both show, `nearer` in front: colours are seen through what is clear; depths add up."""
    clear = 1 - (nearer if mode == "xray" else nearer[..., 3:])
    return nearer + clear * farther


def composite(pictures: Iterable[Any], mode: str = "composite") -> np.ndarray:
    """Puts pictures of bricks together, the nearest first; returns the picture of what all show.

    Each picture is an array as `render` returns it, transparent where nothing is, or the path of a PNG or OpenEXR file.
    `mode` is the one that they were drawn in, "composite" or "xray".

    >>> near, far = np.zeros((2, 3, 4), np.float32), np.ones((2, 3, 4), np.float32)
    >>> near[..., 3] = 0.25
    >>> adj.composite([near, far])[0, 0].tolist()
    [0.75, 0.75, 0.75, 1.0]
    """
    if mode not in ("composite", "xray"):
        raise ValueError(f'mode is "{mode}", but pictures can be put together in composite and xray')
    picture = None
    for farther in map(linear_picture, pictures):
        if picture is not None and picture.shape != farther.shape:
            raise ValueError(
                f"pictures have different sizes: {picture.shape[:2]} and {farther.shape[:2]} (rows, columns)"
            )
        picture = put_together(picture, farther, mode)
    if picture is None:
        raise ValueError("there are no pictures; give at least one")
    return picture


def put_together(nearer: np.ndarray | None, farther: np.ndarray | None, mode: str) -> np.ndarray | None:
    """Returns the picture of what both show, `nearer` in front; None is a picture of nothing."""
    if nearer is None or farther is None:
        return farther if nearer is None else nearer
    return over(nearer, farther, mode)


def split(
    f: Model | str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    slab: int | None = None,
    brick: Sequence[int] | None = None,
    partition: str = "z",
    preview: int | None = None,
    verify: bool = True,
    memory: int | str | None = None,
    threads: int | None = None,
) -> Collection:
    """Splits a model into a collection in the new folder `out`.

    `slab` is the number of slices of a brick along z; or `brick` its number of points (z, y, x), 0 where an axis is not
    cut. With `partition="xyz"` every voxel is stored three times, in slabs across z, y and x, and pictures brick by brick
    are exact from every side, if voxels are not smaller than pixels. The collection's preview has every `preview`-th point
    along each axis; 1: it has none. By default it has at most 16 million voxels, and none if the whole has no more. Bricks
    keep the levels of detail whose blocks no border divides: with borders at multiples of 8 points, three or more. If these
    are all that the file has, `Collection.join` makes the same file of it again, byte for byte.

    Bricks keep the transfer function that the model was built with: raises `ValueError` for a model of `with_transfer`.
    Raises `FormatError` if the model is damaged. `verify=False` does not check it: it is faster, but damage may pass into
    the bricks.

    >>> adj.split(f, "cubes.adjs", brick=(32, 32, 32)).count == f.count
    True
    """
    model = f if isinstance(f, Model) else open(f)
    sizes = brick_sizes(slab, brick, partition)
    path, step = collection_path(out), preview_step(preview)
    limits = (working_memory(memory), thread_count(threads))
    _refuse_existing(path)
    if verify:
        model.verify()
    _native.split(model._open, path, sizes, step, *limits)
    return Collection(out)


def collection_path(out: str | os.PathLike[str]) -> str:
    """Returns the absolute path of the collection to write, if its folder is there and its name is not that of a file."""
    path = path_in_folder(out)
    if path.endswith(".adj"):
        raise ValueError(f"{path} ends in .adj, but a collection is a folder; end it in .adjs")
    return path


def preview_step(preview: int | None) -> int | None:
    """Returns how many grid points along an axis a voxel of the preview stands for; None stays."""
    if preview is not None and not 1 <= whole("preview", preview) <= 65535:
        raise ValueError(f"preview is {preview}, but must be 1 to 65535 points, or None")
    return preview


def brick_sizes(slab: int | None, brick: Sequence[int] | None, partition: str) -> list[list[int]]:
    """Returns the most points of a brick along x, y, z, for each partition."""
    if (slab is None) == (brick is None):
        raise ValueError("give slab, the slices of a brick along z, or brick, its points (z, y, x)")
    if partition not in ("z", "xyz") or partition == "xyz" and slab is None:
        raise ValueError(f'partition is "{partition}", but must be z, or xyz with slab')
    sizes = [slab, 0, 0] if brick is None else list(brick)
    sizes = [whole("points of a brick", size) for size in sizes]
    if len(sizes) != 3 or min(sizes) < 0 or max(sizes) > 65535 or slab == 0:
        raise ValueError(f"a brick has 1 to 65535 points (z, y, x), or 0 where an axis is not cut, not {sizes}")
    if partition == "z":
        return [sizes[::-1]]
    return [[0, 0, sizes[0]], [0, sizes[0], 0], [sizes[0], 0, 0]]


class BrickPlan:
    """The plan of a collection that is built brick by brick, anywhere; every step is a function of its arguments alone.

    `levels` is the number of coarser levels of detail in each brick, or "auto": as many as are of use and no brick's border
    divides, which needs borders at multiples of 2, 4, 8 ... points. `level_count` tells how many these are.

    The plan knows the shape and type of the array, or of a volume in files (`VolumeFile`). It is scanned until all is known
    that codes depend on, then bricks are built, in any order, by any process. A step that failed is simply done again.

    >>> array = np.arange(4096, dtype=np.uint16).reshape(16, 16, 16)
    >>> plan = adj.BrickPlan(array, visible=(2000, None), slab=4)
    >>> while not plan.is_agreed:
    ...     plan = plan.agree([plan.scan(k, array[plan.samples_of(k)]) for k in range(plan.scans)])
    >>> os.mkdir("ramp.adjs")
    >>> sum(plan.build(k, array[plan.samples_of(k)], "ramp.adjs") for k in range(plan.count))
    2096
    >>> plan.finish("ramp.adjs").count
    2096
    """

    def __init__(
        self,
        array: Any,
        *,
        slab: int | None = None,
        brick: Sequence[int] | None = None,
        partition: str = "z",
        preview: int | None = None,
        visible: tuple[float | None, float | None] | None = None,
        transfer: Any = None,
        labels: Any = None,
        spacing: Sequence[float] | None = None,
        origin: Sequence[float] | None = None,
        direction: Any = None,
        frame: str | None = None,
        unit: str | None = None,
        lanes: str = "xyz",
        value_bits: int | None = None,
        normal_bits: int | None = None,
        levels: int | str | None = None,
    ):
        chosen = chosen_transfer(visible, transfer, labels)
        if chosen is None or chosen == "file":
            raise ValueError("say what is visible: visible=(low, high), transfer= or labels= (but not of the file)")
        is_raw = isinstance(array, VolumeFile) and array._is_raw
        ordered, place = placed_volume(array, spacing, origin, direction, frame, unit, is_raw=is_raw)
        if is_of_xarray(array) and ordered.dims != array.dims:
            # The caller cuts bricks out of it by position.
            raise ValueError('the array has its dimensions in another order; give array.transpose("z", "y", "x")')
        packing = Packing(lanes, value_bits, normal_bits, None, None, levels)
        self._native = _native.Plan(
            _source(ordered, place), chosen, packing, brick_sizes(slab, brick, partition), preview_step(preview)
        )

    @classmethod
    def _of(cls, native: _native.Plan) -> BrickPlan:
        plan = cls.__new__(cls)
        plan._native = native
        return plan

    @classmethod
    def from_json(cls, text: str) -> BrickPlan:
        """Reads what `to_json` wrote."""
        return cls._of(_native.Plan.from_json(text))

    def to_json(self) -> str:
        """Returns the plan as text."""
        return self._native.to_json()

    def __reduce__(self) -> Any:
        return BrickPlan.from_json, (self.to_json(),)

    @property
    def count(self) -> int:
        """Number of bricks to build, in all partitions."""
        return sum(self._native.counts)

    @property
    def level_count(self) -> int:
        """Number of coarser levels of detail that each brick will hold."""
        return self._native.level_count

    @property
    def scans(self) -> int:
        """Number of bricks to scan: those of the first partition, which come first."""
        return self._native.counts[0]

    @property
    def is_agreed(self) -> bool:
        """Whether scans have found all that codes depend on, so that bricks can be built."""
        return self._native.is_agreed()

    def samples_of(self, index: int) -> tuple[slice, slice, slice]:
        """Returns the part of the array that a brick is built from: its own, and what gradients need around it."""
        low, size = self._native.samples_of(self._index(index))
        z, y, x = (slice(first, first + points) for first, points in zip(low[::-1], size[::-1]))
        return z, y, x

    def scan(self, index: int, samples: Any, *, memory: int | str | None = None, threads: int | None = None) -> str:
        """Scans a brick's samples; returns what was found, as text."""
        return self._native.scan(self._index(index), _source(samples), byte_count(memory), thread_count(threads))

    def agree(self, findings: Sequence[str]) -> BrickPlan:
        """Returns the plan with what scans of all bricks found."""
        return BrickPlan._of(self._native.agree(list(findings)))

    def build(
        self,
        index: int,
        samples: Any,
        folder: str | os.PathLike[str],
        *,
        memory: int | str | None = None,
        threads: int | None = None,
    ) -> int:
        """Builds a brick as a file in `folder`, if it has visible voxels; returns their number."""
        path, limits = os.path.abspath(path_text(folder)), (byte_count(memory), thread_count(threads))
        return self._native.build(self._index(index), _source(samples), path, *limits)

    def _index(self, index: int) -> int:
        """Returns the index of a brick, if the plan has such a brick."""
        if not 0 <= (index := whole("index", index)) < self.count:
            raise ValueError(f"brick: {index} does not exist; there are {self.count}")
        return index

    def finish(self, folder: str | os.PathLike[str]) -> Collection:
        """Writes the manifest of the bricks in `folder`, which is then a collection."""
        self._native.finish(os.path.abspath(path_text(folder)))
        return Collection(folder)

    @property
    def warnings(self) -> list[str]:
        """What a user should know of the samples, a line each: NaN, labels without a name, rounded labels."""
        return self._native.warnings()


def as_volume(volume: Any) -> Any:
    """Returns an array in the order z, y, x, and a path or a list of paths as a volume in files."""
    if is_of_xarray(volume):
        return in_order(volume)
    if is_array(volume) or isinstance(volume, VolumeFile):
        return volume
    if isinstance(volume, (str, bytes, os.PathLike, list, tuple)):
        return VolumeFile(volume)
    raise no_volume("an array (z, y, x), a path, a list of paths or a VolumeFile", volume)


def _source(array: Any, place: Place | None = None) -> _native.Source:
    if isinstance(array, VolumeFile):
        return array._source(place)
    if isinstance(array, VolumePart):
        return array.volume._source(box=array.box)
    if not is_array(array):
        raise TypeError(f"samples are an array (z, y, x) or a part of a VolumeFile, not {type(array).__name__}")
    slices = Slices(array, None)
    where = Place(None, None, None, "RAS", None) if place is None else place
    return _native.array_source(slices.read, slices.dims, slices.sample_type, slices.name, where, slices.buffer_bytes)


def _refuse_existing(out: str) -> None:
    if os.path.lexists(out):
        raise FileExistsError(17, "is there already; remove it first, or give another name", out)


def building_folder(out: str) -> str:
    """Creates the folder in which the bricks of the collection `out` are built, beside it."""
    _refuse_existing(out)
    return tempfile.mkdtemp(prefix=f".{os.path.basename(out)}.", suffix=".building", dir=os.path.dirname(out))


def finished(plan: BrickPlan, building: str, out: str) -> Collection:
    """Makes a collection of the bricks in `building` and gives it its name; what killed workers left there goes."""
    built = plan.finish(building)
    kept = {file.name for file in built._native.files}
    for name in set(os.listdir(building)) - kept:
        path = os.path.join(building, name)
        shutil.rmtree(path) if os.path.isdir(path) else os.remove(path)
    mask = os.umask(0)
    os.umask(mask)
    os.chmod(building, 0o777 & ~mask)
    try:
        os.rename(building, out)
    except OSError:
        # Another build was faster.
        _refuse_existing(out)
        raise
    return Collection(out)
