"""Volumes of which only the visible voxels are stored: .adj files, read, built, edited and drawn.

>>> import adjsplat as adj
>>> f = adj.build("phantom:gyroid", shape=(64, 64, 64), dtype="u1")
>>> picture = adj.render(f, azimuth=30, elevation=20, background="white", dtype="uint8")

Arrays and positions are ordered (z, y, x); `spacing`, `origin` and `direction` (x, y, z), as in SimpleITK. docs/python.md
goes from a volume to a turntable step by step.
"""

from . import dask
from ._native import DeviceError, FormatError, __version__
from .build import BuildWarning, build
from .collection import BrickPlan, Collection, composite, split
from .edit import Edit
from .export import ExportReport, ExportWarning
from .lanes import Lane
from .level import Level
from .model import Model, open
from .pictures import Metrics, compare, save
from .render import Renderer, devices, render
from .show import show
from .transfer import TransferFunction
from .volume_file import VolumeFile

__all__ = [
    "BrickPlan",
    "BuildWarning",
    "Collection",
    "DeviceError",
    "Edit",
    "ExportReport",
    "ExportWarning",
    "FormatError",
    "Lane",
    "Level",
    "Metrics",
    "Model",
    "Renderer",
    "TransferFunction",
    "VolumeFile",
    "__version__",
    "build",
    "compare",
    "composite",
    "dask",
    "devices",
    "open",
    "render",
    "save",
    "show",
    "split",
]
