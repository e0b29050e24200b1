"""Packages that only some functions need: imported when called."""

from __future__ import annotations

import importlib
from typing import Any


def needed(package: str, what: str) -> Any:
    """Imports an optional package, or says what needs it."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        name = package.split(".")[0]
        raise ImportError(f"{what} needs the package {name}, which is not installed: pip install {name}") from error
