"""Arguments that several functions take: outputs, memory, threads, numbers."""

from __future__ import annotations

import errno
import operator
import os
import reprlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np


def path_text(path: Any) -> str:
    """Returns a path as text.

    >>> path_text(b"a.adj")
    'a.adj'
    """
    if not isinstance(path, (str, bytes, os.PathLike)):
        raise TypeError(f"a path must be a string, bytes or an os.PathLike, not {type(path).__name__}")
    text = os.fsdecode(path)
    if "\0" in text:
        raise ValueError(f"a path cannot have the character NUL: {text!r}")
    return text


def path_in_folder(out: str | os.PathLike[str]) -> str:
    """Returns the absolute path of an output, if its folder is there."""
    path = os.path.abspath(path_text(out))
    folder = os.path.dirname(path)
    if not os.path.isdir(folder):
        raise FileNotFoundError(errno.ENOENT, "there is no such folder", folder)
    return path


def output_path(out: str | os.PathLike[str], files: Sequence[str | os.PathLike[str]] = ()) -> str:
    """Returns the absolute path of the output, if it would replace nothing but an .adj file that is none of `files`."""
    path = path_in_folder(out)
    if path_text(out).endswith(("/", os.sep)):
        raise ValueError(f"{path_text(out)} names a folder; give a file name")
    if os.path.isfile(path) and os.path.getsize(path):
        if any(os.path.exists(file) and os.path.samefile(file, path) for file in files):
            raise ValueError(f"{path} is one of the files that this call reads; give another name")
        with open(path, "rb") as file:
            is_adj = file.read(8) == b"\x89ADJ\r\n\x1a\n"
        if not is_adj and not path.endswith(".adj"):
            raise ValueError(f"{path} is there already and is no .adj file; give a name that ends in .adj")
    return path


def byte_count(memory: int | str | None, name: str = "memory") -> int | None:
    """Returns a number of bytes: 1000000, "500MB", "2GiB".

    >>> byte_count("64MiB")
    67108864
    """
    if memory is None:
        return None
    if isinstance(memory, str):
        units = {"": 1, "b": 1, "kib": 2**10, "mib": 2**20, "gib": 2**30, "kb": 10**3, "mb": 10**6, "gb": 10**9}
        text = memory.strip().lower()
        number = text.rstrip("kmgib ")
        try:
            memory = int(float(number) * units[text[len(number) :].strip()])
        except (KeyError, ValueError, OverflowError):
            raise ValueError(f'{name} is "{memory}", but must be a size such as 64MiB, 1.5GiB or 500MB') from None
    memory = whole(name, memory)
    if not 0 < memory < 2**63:
        raise ValueError(f"{name} is {memory}, but must be a number of bytes above 0")
    return memory


def working_memory(memory: int | str | None) -> int | None:
    """Returns the most bytes that a step may take, which needs 64 MiB whatever its files.

    >>> working_memory(1)
    Traceback (most recent call last):
    ValueError: memory is 1, but must be at least 64MiB
    """
    found = byte_count(memory)
    if found is not None and found < 64 << 20:
        raise ValueError(f"memory is {reprlib.repr(memory)}, but must be at least 64MiB")
    return found


def level_count(levels: int | str | None) -> int | str:
    """Returns a number of coarser levels of detail, or "auto".

    >>> level_count(None), level_count(3), level_count("auto")
    (0, 3, 'auto')
    """
    if levels is None or isinstance(levels, str) and levels == "none":
        return 0
    if isinstance(levels, str) and levels == "auto":
        return "auto"
    if isinstance(levels, str) or not 0 <= (count := whole("levels", levels)) <= 15:
        raise ValueError(f'levels are {levels!r}, but must be 0 to 15 or "auto"')
    return count


def thread_count(threads: int | None) -> int | None:
    """Returns a number of threads from 1 to 1024, or None for all processors."""
    if threads is None:
        return None
    threads = whole("threads", threads)
    if not 1 <= threads <= 1024:
        raise ValueError(f"threads are {threads}, but must be 1 to 1024")
    return threads


def whole(name: str, number: Any) -> int:
    """Returns a whole number of any integer type.

    >>> whole("threads", 1.5)
    Traceback (most recent call last):
    TypeError: threads must be a whole number, not 1.5
    """
    if isinstance(number, bool):
        raise TypeError(f"{name} must be a whole number, not {number}")
    try:
        return operator.index(number)
    except TypeError:
        raise TypeError(f"{name} must be a whole number, not {number!r}") from None


def whole_within(name: str, number: Any, low: int, high: int) -> int:
    """Returns a whole number from `low` to `high`.

    >>> whole_within("skip", -1, 0, 9)
    Traceback (most recent call last):
    ValueError: skip is -1, but must be 0 to 9
    """
    found = whole(name, number)
    if not low <= found <= high:
        raise ValueError(f"{name} is {reprlib.repr(found)}, but must be {low} to {high}")
    return found


def truth(name: str, value: Any) -> bool:
    """Returns a truth value."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} must be True or False, not {reprlib.repr(value)}")
    return bool(value)


def number(name: str, value: Any) -> float:
    """Returns a real number of any type as a float.

    >>> number("zoom", "a")
    Traceback (most recent call last):
    TypeError: zoom must be a number, not 'a'
    """
    shown = reprlib.repr(value)
    try:
        if not isinstance(value, (bool, str, bytes)):
            return float(value)
    except OverflowError:
        raise ValueError(f"{name} is {shown}, but floating point has no number as large") from None
    except (TypeError, ValueError):
        pass
    raise TypeError(f"{name} must be a number, not {shown}") from None


def optional_number(name: str, value: Any) -> float | None:
    """Returns a real number of any type as a float; None stays."""
    return None if value is None else number(name, value)


def function(name: str, value: Any) -> Callable[..., Any] | None:
    """Returns a function; None stays."""
    if value is not None and not callable(value):
        raise TypeError(f"{name} must be a function, not {reprlib.repr(value)}")
    return value


def text(name: str, value: Any) -> str:
    """Returns a string."""
    if not isinstance(value, str):
        raise TypeError(f"{name} must be a string, not {value!r}")
    if not value.isascii() and any("\ud800" <= sign <= "\udfff" for sign in value):
        raise ValueError(f"{name} is {value!r}, but must be text without lone surrogates")
    return value
