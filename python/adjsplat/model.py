"""Models: the visible voxels of a volume, in an .adj file or in memory."""

from __future__ import annotations

import builtins
import json
import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from . import _native, export
from .arguments import output_path, path_text
from .export import ExportReport
from .level import Level
from .transfer import TransferFunction, as_transfer
from .voxels import Voxels

if TYPE_CHECKING:
    from .edit import Edit


def open(path: str | os.PathLike[str], *, mapped: bool = True) -> Model:
    """Opens an .adj file. It is mapped, not read: this takes microseconds, whatever its size.

    Raises `OSError` if there is no such file, and `FormatError` (with `offset` and `rule`) if its header is damaged;
    `Model.verify` checks every byte. Nobody may shorten or change a mapped file in place; replacing it by another of its
    name is safe. `mapped=False` reads the file into memory instead, for places where that cannot be promised.

    A collection (`NAME.adjs`) is verified and joined in memory, which reads every byte of its bricks.

    >>> with adj.open("engine.adj") as f:
    ...     print(f.shape, f.count)
    (64, 64, 64) 143360
    """
    path = os.path.abspath(path_text(path))
    if mapped:
        return Model(_native.Model.open(path), path)
    # Opened as a map first: it refuses pipes and names the file in its errors. A collection is in memory then.
    native = _native.Model.open(path)
    if os.path.isdir(path):
        return Model(native, path)
    with builtins.open(path, "rb") as file:
        return Model(_native.Model.from_bytes(file.read()), path, mapped=False)


class Model(Voxels):
    """The visible voxels of a volume, and the transfer function that they are drawn with.

    `open` and `build` return models. Arrays, `shape`, slices and positions are ordered (z, y, x), as in tifffile, zarr
    and napari. `spacing`, `origin` and `direction` are ordered (x, y, z), as in SimpleITK; where the volume's file names
    an anatomical frame, the world's axes are R, A, S, as in NIfTI (SimpleITK's are L, P, S: `to_sitk` converts).

    A model never changes. Threads may share it, and copies by the module `copy` are the model itself; another process that
    unpickles it opens the file by itself. After `close`, everything raises `ValueError`, except that arrays which were
    handed out stay valid.
    """

    def __init__(self, native: _native.Model, path: str | None, *, mapped: bool = True):
        self._native: _native.Model | None = native
        self._path = path
        self._mapped = mapped
        self._parsed: dict[str, Any] | None = None

    @property
    def _open(self) -> _native.Model:
        if self._native is None:
            raise ValueError(f"{self._path or 'the model'} is closed")
        return self._native

    # --- The file

    @property
    def path(self) -> str | None:
        """The file's absolute path; None for a model in memory."""
        return self._path

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._native is None

    def close(self) -> None:
        """Lets go of the file. The map itself goes with the last array that came from it."""
        self._native = None

    def __enter__(self) -> Model:
        _ = self._open
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _description(self) -> dict[str, Any]:
        native = self._open
        if self._parsed is None:
            found = json.loads(native.description or "{}")
            self._parsed = found if isinstance(found, dict) else {}
        return self._parsed

    def verify(self) -> None:
        """Checks every rule of the format, checksums included; raises `FormatError` at the first broken one."""
        self._open.verify(self._path or "memory")

    def save(self, path: str | os.PathLike[str], *, verify: bool = True) -> Model:
        """Writes the model to a file, whole or not at all, and opens it.

        Raises `FormatError` if the model is damaged. `verify=False` does not check it: it is faster, but copies damage.
        The file says which values the build stored, and so it keeps the transfer function of the build. The model that is
        returned is drawn with the same function as this one.
        """
        path = output_path(path)
        if verify:
            self.verify()
        native = self._open
        native.save(path)
        return with_look(open(path), native.transfer)

    # --- Levels of detail

    @property
    def levels(self) -> tuple[Model | Level, ...]:
        """The levels of detail, the finest first: `f.levels[0]` is the model itself, `f.levels[n]` level n.

        Each stands for fewer points than the one before. A file has coarser levels if it was built with `levels=`.

        >>> [level.shape for level in g.levels]
        [(64, 64, 64), (32, 32, 32), (16, 16, 16)]
        >>> g.levels[1]
        <adjsplat.Level 1, 32 x 32 x 32 (z, y, x), 22784 visible voxels, of pyramid.adj>
        """
        return (self, *(Level(self, number) for number in range(1, self._open.level_count + 1)))

    # --- The look

    @property
    def transfer(self) -> TransferFunction:
        """The transfer function that pictures are drawn with."""
        return TransferFunction(self._open.transfer)

    def with_transfer(self, transfer: Any) -> Model:
        """Returns the same voxels, drawn with another transfer function.

        What the build left out stays invisible: `missing_values` tells which values these are.

        >>> f.with_transfer(adj.TransferFunction.range(150)).transfer.kind
        'range'
        """
        return Model(self._open.with_transfer(as_transfer(transfer).to_json()), self._path, mapped=self._mapped)

    def missing_values(self, transfer: Any) -> list[tuple[float, float]]:
        """Returns the ranges (lowest, highest) of values that `transfer` shows and the build left out.

        >>> f.missing_values(adj.TransferFunction.range(150))
        []
        """
        return [(low, high) for low, high in self._open.missing_values(as_transfer(transfer).to_json())]

    # --- Files of other formats

    def export(
        self,
        path: str | os.PathLike[str],
        *,
        fill: float | None = None,
        verify: bool = True,
        progress: Callable[[str, int, int], Any] | None = None,
    ) -> ExportReport:
        """Writes the visible voxels for other tools: a file, or a folder for .zarr, whole or not at all.

        The ending of `path` chooses the format: .nrrd, .nii, .nii.gz, .mha, .vti, .raw, .npz, .zarr (dense volumes), .csv,
        .vdb (sparse), .ply, .spz (3-D Gaussians). `fill` is the sample of points that are not visible, in dense formats; by
        default a value that the transfer function hides. Memory holds a few slices. docs/export.md says what each format
        keeps and loses.

        Raises `ValueError` if the ending is unknown or the format cannot hold the voxels, `OSError` if writing fails, and
        `FormatError` if the model is damaged. `verify=False` does not check it: it is faster, but damage may pass into the
        file.

        >>> f.export("engine.nii.gz").dtype
        dtype('uint8')
        """
        return export.write(self, path, fill, verify, progress)

    # --- Editing

    def edit(self) -> Edit:
        """Starts an edit: `f.edit().add(coordinates, values).remove(mask).save(path)`."""
        from .edit import Edit

        return Edit(self)

    def __copy__(self) -> Model:
        return self

    def __deepcopy__(self, _: Any) -> Model:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        if self._path is not None:
            return _reopened, (self._path, self._open.transfer, self._mapped)
        return _loaded, (self._open.to_bytes(), self._open.transfer)

    def __repr__(self) -> str:
        where = self._path or "in memory"
        if self.closed:
            return f"<adjsplat.Model closed, {where}>"
        z, y, x = self.shape
        return f"<adjsplat.Model {z} x {y} x {x} (z, y, x), {self.count} visible voxels, {where}>"


def _reopened(path: str, transfer: str, mapped: bool) -> Model:
    return with_look(open(path, mapped=mapped), transfer)


def _loaded(data: bytes, transfer: str) -> Model:
    return with_look(Model(_native.Model.from_bytes(data), None), transfer)


def with_look(model: Model, transfer: str) -> Model:
    """Returns the voxels of `model`, drawn with the transfer function of this JSON."""
    return model if model._open.transfer == transfer else model.with_transfer(TransferFunction(transfer))
