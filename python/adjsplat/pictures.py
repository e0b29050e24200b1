"""Pictures as arrays: colours, files, and how much two differ."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np

from . import _native
from .arguments import path_in_folder, path_text

#: Names of colours, as the program `adj` has them.
NAMED = {"white": (1.0, 1.0, 1.0), "black": (0.0, 0.0, 0.0)}


class Metrics(NamedTuple):
    """How much a picture differs from a reference. `compare` returns it.

    Errors of light count linear premultiplied samples of pixels that are not empty in both pictures; `ssim`, `flip` and the
    `display_` errors count what a display shows.
    """

    #: 10 log10(1 / mean squared error), in decibels; infinite for equal pictures.
    psnr: float
    #: Mean structural similarity, -1 to 1.
    ssim: float
    #: Mean FLIP, 0 to 1; 0 for equal pictures.
    flip: float
    #: Largest difference of a sample.
    max_abs: float
    #: Column and row of the pixel that has it.
    max_at: tuple[int, int]
    #: Root of the mean squared error.
    rmse: float
    #: Light of the picture over that of the reference, minus 1.
    energy: float
    display_psnr: float
    display_rmse: float
    display_max_abs: float


def compare(reference: Any, picture: Any, *, background: Any = "white") -> Metrics:
    """Compares a picture with a reference, by the metrics of `adj compare`.

    Each is an array as `render` returns it (float32 linear premultiplied, or uint8 sRGB), or the path of a PNG or OpenEXR
    file. `background` is the colour behind both for what a display shows.

    >>> a = adj.render(f, size=(64, 64), quality="high")
    >>> adj.compare(a, adj.render(f, size=(64, 64))).psnr > 35
    True
    """
    found = _native.compare(linear_picture(reference), linear_picture(picture), linear_colour(background).tolist())
    found["max_at"] = tuple(found["max_at"])
    return Metrics(**found)


def save(path: str | os.PathLike[str], pictures: Any) -> None:
    """Writes a picture to a PNG or OpenEXR file, or several to an animated PNG (`.apng`) of 12 a second.

    `pictures` is an array as `render` returns it, or an iterable of such. The file appears whole or not at all.
    """
    several = [pictures] if isinstance(pictures, np.ndarray) and pictures.ndim == 3 else list(pictures)
    _native.write_pictures(picture_path(path), [linear_picture(picture) for picture in several])


def picture_path(out: str | os.PathLike[str]) -> str:
    """Returns the absolute path of a picture to write, if its folder is there and its ending is that of a picture."""
    path = path_in_folder(out)
    _native.check_picture_path(path)
    return path


def over(picture: np.ndarray, behind: np.ndarray) -> np.ndarray:
    """Puts a linear premultiplied picture over an opaque linear colour."""
    picture[..., :3] += (1 - picture[..., 3:]) * behind
    picture[..., 3] = 1
    return picture


def to_srgb8(picture: np.ndarray) -> np.ndarray:
    """Turns linear premultiplied numbers into sRGB of 8 bits, not premultiplied."""
    alpha = picture[..., 3:]
    colour = np.divide(picture[..., :3], alpha, out=np.zeros_like(picture[..., :3]), where=alpha > 0).clip(0, 1)
    encoded = np.where(colour <= 0.0031308, colour * 12.92, 1.055 * colour ** (1 / 2.4) - 0.055)
    return (np.concatenate([encoded, alpha.clip(0, 1)], axis=-1) * 255 + 0.5).astype(np.uint8)


def linear_colour(colour: Any) -> np.ndarray:
    """Returns an sRGB colour ("#rrggbb", "white", "black" or three numbers from 0 to 1) in linear light.

    >>> [round(float(part), 3) for part in linear_colour("#ff8000")]
    [1.0, 0.216, 0.0]
    """
    if isinstance(colour, str):
        text = colour.removeprefix("#")
        if colour not in NAMED and (len(text) != 6 or text == colour or not all(sign in _HEX for sign in text)):
            raise ValueError(f'colour is "{colour}", but must be #rrggbb, white, black or three numbers from 0 to 1')
        colour = NAMED.get(colour) or [int(text[at : at + 2], 16) / 255 for at in (0, 2, 4)]
    numbers = np.asarray(colour, dtype=np.float64)
    if numbers.shape != (3,) or not ((numbers >= 0) & (numbers <= 1)).all():
        raise ValueError(f"colour is {colour!r}, but must be #rrggbb, white, black or three numbers from 0 to 1")
    return _decoded(numbers).astype(np.float32)


_HEX = set("0123456789abcdefABCDEF")


def _decoded(encoded: np.ndarray) -> np.ndarray:
    """Turns sRGB from 0 to 1 into linear light."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def linear_picture(picture: Any) -> np.ndarray:
    """Returns a picture as linear premultiplied numbers, contiguous and finite."""
    if isinstance(picture, (str, os.PathLike)):
        picture = _native.read_picture(path_text(picture))
    picture = np.asarray(picture)
    if picture.ndim != 3 or picture.shape[2] != 4:
        raise ValueError(f"a picture has the shape (rows, columns, 4), not {picture.shape}")
    if picture.dtype == np.uint8:
        colours = _decoded(picture[..., :3] / 255)
        alpha = picture[..., 3:] / 255
        picture = np.concatenate([colours * alpha, alpha], axis=-1)
    elif picture.dtype.kind != "f":
        raise TypeError(f"a picture is float32 (linear) or uint8 (sRGB), not {picture.dtype}")
    picture = np.ascontiguousarray(picture, dtype=np.float32)
    if not np.isfinite(picture).all():
        raise ValueError("a picture has samples that are NaN or infinite in float32")
    return picture
