"""Drawing models: pictures as arrays, from the processor or from a graphics device."""

from __future__ import annotations

import json
import os
import reprlib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from . import _native
from .arguments import byte_count, number, optional_number, text, thread_count, truth, whole, whole_within
from .indices import covered, expanded
from .level import Level
from .model import Model, open
from .pictures import linear_colour, over, to_srgb8


class Look:
    """How a picture is made, checked."""

    def __init__(
        self,
        model: Any,
        size: Sequence[int],
        quality: str,
        mode: str,
        sampling: str | None,
        lighting: bool,
        exposure: float | None,
        sharpness: float | None,
        crop: Any,
        clip: Any,
        level: int | None,
        threads: int | None,
    ):
        try:
            columns, rows = size
        except (TypeError, ValueError) as error:
            raise type(error)(f"size must be (columns, rows), not {reprlib.repr(size)}") from None
        columns, rows = whole("columns", columns), whole("rows", rows)
        if not (1 <= columns <= 16384 and 1 <= rows <= 16384):
            raise ValueError(f"size is {size}, but columns and rows must be 1 to 16384")
        self.size = [columns, rows]
        self.quality, self.mode = text("quality", quality), text("mode", mode)
        self.sampling = None if sampling is None else text("sampling", sampling)
        self.lighting = truth("lighting", lighting)
        self.exposure = optional_number("exposure", exposure)
        if self.exposure is not None and self.mode != "xray":
            raise ValueError(f'exposure is the brightness of mode "xray"; leave it out for "{self.mode}"')
        self.sharpness = optional_number("sharpness", sharpness)
        self.threads = thread_count(threads)
        self.crop = None if crop is None else _crop(model, crop)
        self.clip = None if clip is None else _clip(clip)
        self.level = None if level is None else whole_within("level", level, 0, 15)


def _crop(model: Any, crop: Any) -> list[list[int]]:
    """Returns the lowest and highest coordinates (x, y, z) of an index with steps of 1."""
    low, high = [], []
    for axis, (part, points) in enumerate(zip(expanded(crop), model.shape)):
        first, length, within = covered(part, points, axis)
        if length == 0 or isinstance(within, slice) and within.step not in (1, None):
            raise ValueError("a crop is a box of at least one voxel: slices with steps of 1")
        low.append(first)
        high.append(first + length - 1)
    return [low[::-1], high[::-1]]


def _clip(clip: Any) -> list[list[float]]:
    """Returns a plane's point and normal."""
    plane = np.asarray(clip, dtype=np.float64)
    if plane.shape != (2, 3):
        raise ValueError(f"clip must be a point and a normal, each (x, y, z), not {clip!r}")
    return plane.tolist()


def warn_missing(missing: Sequence[Sequence[float]]) -> None:
    """Warns of the values that a function shows and the build left out."""
    if missing:
        ranges = ", ".join(f"{low:g} to {high:g}" for low, high in missing[:6])
        message = f"values {ranges} are visible, but the model does not store all of them: build it again"
        warnings.warn(message, stacklevel=3)


class Renderer:
    """Draws many pictures of one model. On a graphics device, the model stays there from picture to picture.

    `device` is "cpu"; "gpu" for the best graphics device; a part of a device's name (`devices` lists them); or "auto": a
    graphics device if there is one that is not software, else the processor. `vram` bounds the device's memory in bytes.

    >>> renderer = adj.Renderer(f, device="cpu")
    >>> renderer.render(size=(64, 48)).shape
    (48, 64, 4)
    """

    def __init__(
        self, f: Model | str | os.PathLike[str], *, transfer: Any = None, device: str = "auto", vram: int | None = None
    ):
        if isinstance(f, Level):
            raise TypeError(f"a level of detail is drawn from its model; give the model, and level={f.level}")
        model = f if isinstance(f, Model) else open(f)
        #: The model that is drawn.
        self.model = model if transfer is None else model.with_transfer(transfer)
        if transfer is not None:
            warn_missing(self.model.missing_values(self.model.transfer))
        self._device = _opened(self.model, device, vram)

    @property
    def device(self) -> str:
        """The name of the graphics device, or "cpu"."""
        return "cpu" if self._device is None else self._device.name

    def camera(
        self,
        azimuth: float = 0.0,
        elevation: float = 0.0,
        *,
        size: Sequence[int] = (800, 800),
        zoom: float = 1.0,
        perspective: float | None = None,
        up: str = "z",
        crop: Any = None,
    ) -> dict[str, Any]:
        """Returns the camera of an orbit as a dict: position, target and up in the world, and fov or height."""
        return self.cameras([(azimuth, elevation)], size=size, zoom=zoom, perspective=perspective, up=up, crop=crop)[0]

    def cameras(
        self,
        orbits: Sequence[tuple[float, float]],
        *,
        size: Sequence[int] = (800, 800),
        zoom: float = 1.0,
        perspective: float | None = None,
        up: str = "z",
        crop: Any = None,
    ) -> list[dict[str, Any]]:
        """Returns the cameras of several orbits (azimuth, elevation), which look at one point and have one scale."""
        look = Look(self.model, size, "standard", "composite", None, True, None, None, crop, None, None, None)
        return [json.loads(camera) for camera in self._views(look, orbits, zoom, perspective, up)]

    def _views(
        self,
        look: Look,
        orbits: Sequence[tuple[float, float]],
        zoom: float,
        perspective: float | None,
        up: str,
    ) -> list[str]:
        """Returns the cameras of orbits as JSON."""
        angles = [(number("azimuth", azimuth), number("elevation", elevation)) for azimuth, elevation in orbits]
        zoom, perspective = number("zoom", zoom), optional_number("perspective", perspective)
        return self._framed(look, angles, zoom, perspective, text("up", up))

    def _framed(
        self, look: Look, angles: list[tuple[float, float]], zoom: float, perspective: float | None, up: str
    ) -> list[str]:
        return _native.cameras(self.model._open, look, angles, zoom, perspective, up)

    def _draw(self, look: Look, view: str, max_error: float | None) -> np.ndarray:
        if self._device is None:
            return _native.render(self.model._open, look, view, max_error)
        return self._device.render(self.model._open, look, view, max_error)

    def render(
        self,
        size: Sequence[int] = (800, 800),
        azimuth: float = 0.0,
        elevation: float = 0.0,
        *,
        zoom: float = 1.0,
        perspective: float | None = None,
        up: str = "z",
        camera: Mapping[str, Any] | None = None,
        quality: str = "standard",
        max_error: float | None = None,
        mode: str = "composite",
        sampling: str | None = None,
        lighting: bool = True,
        exposure: float | None = None,
        sharpness: float | None = None,
        crop: Any = None,
        clip: Any = None,
        level: int | None = None,
        background: Any = None,
        dtype: Any = np.float32,
        threads: int | None = None,
    ) -> np.ndarray:
        """Draws a picture: see `render`, which has the same arguments."""
        _ = self.model._open
        if max_error is not None and (quality, sampling) != ("standard", None):
            raise ValueError("max_error chooses quality and sampling; leave these out")
        if max_error is not None and level:
            raise ValueError("max_error chooses the level; leave it out, or give 0 for the voxels themselves")
        max_error = optional_number("max_error", max_error)
        dtype = np.dtype(dtype)
        if dtype not in (np.dtype(np.float32), np.dtype(np.uint8)):
            raise ValueError(f"dtype is {dtype}, but a picture is float32 (linear) or uint8 (sRGB)")
        behind = None if background is None else linear_colour(background)
        look = Look(
            self.model, size, quality, mode, sampling, lighting, exposure, sharpness, crop, clip, level, threads
        )
        if camera is None:
            view = self._views(look, [(azimuth, elevation)], zoom, perspective, up)[0]
        elif (azimuth, elevation, zoom, perspective, up) != (0.0, 0.0, 1.0, None, "z"):
            raise ValueError("camera is the whole view; leave out azimuth, elevation, zoom, perspective and up")
        else:
            view = _camera_json(camera)
        picture = self._draw(look, view, max_error)
        if behind is not None:
            picture = over(picture, behind)
        return picture if dtype == np.float32 else to_srgb8(picture)

    def turn(
        self, frames: int = 36, *, azimuth: float = 0.0, elevation: float = 0.0, **options: Any
    ) -> Iterator[np.ndarray]:
        """Yields the pictures of a full turn around the vertical; `options` are those of `render`.

        >>> pictures = list(adj.Renderer(f, device="cpu").turn(4, size=(32, 32)))
        >>> len(pictures)
        4
        """
        if whole("frames", frames) < 1:
            raise ValueError(f"frames are {frames}, but must be at least 1")
        if "camera" in options:
            raise TypeError("camera is not for turn, which makes its own; leave it out")
        azimuth = number("azimuth", azimuth)
        view = {name: options.pop(name) for name in ("zoom", "perspective", "up") if name in options}
        size, crop = options.get("size", (800, 800)), options.get("crop")
        orbits = [(azimuth + 360 * frame / frames, elevation) for frame in range(frames)]
        for camera in self.cameras(orbits, size=size, crop=crop, **view):
            yield self.render(camera=camera, **options)

    def __reduce__(self) -> Any:
        raise TypeError("a renderer cannot be pickled: its device belongs to this process; pickle the model")


def _camera_json(camera: Mapping[str, Any]) -> str:
    if not isinstance(camera, Mapping):
        raise TypeError(f"camera must be a dict, as Renderer.camera returns, not {reprlib.repr(camera)}")

    def plain(numbers: Any) -> Any:
        array = np.asarray(numbers)
        if array.dtype.kind not in "uif":
            raise TypeError(f"a camera has real numbers, not {numbers!r}")
        return array.tolist()

    try:
        document = json.dumps(dict(camera), default=plain, allow_nan=False)
    except ValueError:
        raise ValueError("the numbers of a camera must be finite") from None
    for name in ("position", "target", "up"):
        if name in camera and np.shape(camera[name]) != (3,):
            raise ValueError(f"camera {name} must be three numbers (x, y, z), not {reprlib.repr(camera[name])}")
    return document


def _opened(model: Model, device: str, vram: int | None) -> _native.Device | None:
    """Returns the graphics device that `device` asks for; None for the processor."""
    text("device", device)
    vram = byte_count(vram, "vram")
    if not device:
        raise ValueError('device is empty, but must be "cpu", "gpu", "auto" or a part of a device\'s name')
    if device == "cpu":
        if vram is not None:
            raise ValueError('vram is the memory of a graphics device; leave it out for device="cpu"')
        return None
    if device != "auto":
        return _native.Device(model._open, None if device == "gpu" else device, vram)
    if not any(kind != "software" for _, kind, _, _ in _native.devices()):
        return None
    try:
        return _native.Device(model._open, None, vram)
    except _native.DeviceError as error:
        warnings.warn(f"{error}; the processor draws instead", stacklevel=3)
        return None


def render(
    f: Model | str | os.PathLike[str],
    size: Sequence[int] = (800, 800),
    azimuth: float = 0.0,
    elevation: float = 0.0,
    *,
    zoom: float = 1.0,
    perspective: float | None = None,
    up: str = "z",
    camera: Mapping[str, Any] | None = None,
    transfer: Any = None,
    quality: str = "standard",
    max_error: float | None = None,
    mode: str = "composite",
    sampling: str | None = None,
    lighting: bool = True,
    exposure: float | None = None,
    sharpness: float | None = None,
    crop: Any = None,
    clip: Any = None,
    level: int | None = None,
    background: Any = None,
    dtype: Any = np.float32,
    threads: int | None = None,
    device: str = "cpu",
) -> np.ndarray:
    """Draws a picture of a model, or of an .adj file, as an array (rows, columns, 4) of red, green, blue and alpha.

    `dtype` is float32 for linear light, premultiplied by alpha; or uint8 for sRGB, not premultiplied, as picture files
    have it. `size` is (columns, rows).

    The view: `azimuth` and `elevation` in degrees around everything visible; 0, 0 looks from the front (+y) with `up`, a
    world axis such as "z" or "-y", upright. `zoom` is the magnification; `perspective` is a vertical angle of view in
    degrees, without it rays are parallel. Or `camera`, a dict with `position`, `target`, `up` in the world, and `fov` in
    degrees or `height` in world length.

    The look: `transfer` in place of the model's own; `mode` is "composite", "maximum", "maximum-grey" or "xray"; `quality`
    is "draft", "standard", "high" or "reference", and `sampling` "fewest", "enough", "every" or "finer"; `max_error`
    chooses both, and the level: the first of the file's levels that suit the picture, then of nine settings from fast to
    slow, whose measured error (of a linear sample from 0 to 1) is within it. Choosing may take longer than drawing.
    `lighting=False` leaves out the light; `exposure` is the brightness of "xray"; `sharpness` is from 0 to 1.
    `crop` is an index such as `np.s_[10:50]`; `clip` a point and a normal in the world, ((x, y, z), (x, y, z)), of the plane
    in front of which voxels are drawn. `level` is the level of detail to draw, 0 for the voxels themselves; without, "draft"
    and "standard" draw the coarsest levels of the file that suit the picture. `background` is a colour; without one the
    picture is transparent.

    `device` is as for `Renderer`, which saves time for many pictures on a graphics device. Other threads of Python run
    meanwhile. The processor gives the same bits for any number of `threads`.

    >>> picture = adj.render(f, size=(64, 48), azimuth=30, elevation=20)
    >>> picture.shape, picture.dtype
    ((48, 64, 4), dtype('float32'))
    >>> adj.render(f, size=(64, 48), background="white", dtype=np.uint8)[0, 0].tolist()
    [255, 255, 255, 255]
    """
    options = dict(locals())
    renderer = Renderer(options.pop("f"), transfer=options.pop("transfer"), device=options.pop("device"))
    return renderer.render(**options)


def devices() -> list[dict[str, str]]:
    """Returns the graphics devices that can draw, best first: name, kind, interface and driver of each."""
    return [dict(zip(("name", "kind", "interface", "driver"), facts)) for facts in _native.devices()]
