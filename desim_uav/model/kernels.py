"""The one decorator under which the model's numbers are compiled.

A kernel is scalar code over flat arrays, compiled with strict IEEE arithmetic (no reassociation,
no contraction) and cached on disk.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])

MAKER: dict[str, Any] = {"nogil": True, "fastmath": False, "error_model": "numpy"}

OPTIONS: dict[str, Any] = {**MAKER, "_nrt": False}
"""``_nrt``: what makes no arrays need not count references to those it is given. Said of each
kernel: on disk it is the same whether Python has called it first, or another kernel."""

SOURCES = ("model", "engine/batch", "learning")
"""The folders that hold kernels."""


def kernel(function: F) -> F:
    """A kernel that Python can call; it makes no arrays."""
    return cached(function, OPTIONS)


def maker(function: F) -> F:
    """A kernel that Python can call, and that makes arrays or lists."""
    return cached(function, MAKER)


def part(function: F) -> F:
    """A kernel that becomes part of the machine code of those that call it."""
    return cached(function, {**OPTIONS, "forceinline": True})


def cached(function: F, options: Mapping[str, Any]) -> F:
    """Compile with these options, cached on disk with all that it calls.

    Numba looks at the time of a function's own file to see whether machine code on disk is stale,
    which is not enough: it is, when that file or any source of our kernels says something else.
    """
    compiled: Any = numba.njit(cache=True, **options)(function)
    compiled._cache._cache_file._source_stamp = digest() + _said(function.__code__.co_filename)
    return cast(F, compiled)


@cache
def digest() -> str:
    """What all sources of our kernels say."""
    package = Path(__file__).parents[1]
    files = (file for folder in SOURCES for file in sorted((package / folder).glob("*.py")))
    return hashlib.sha256("".join(map(_said, map(str, files))).encode()).hexdigest()


@cache
def _said(file: str) -> str:
    path = Path(file)
    said = path.read_bytes() if path.is_file() else b""  # a notebook's cell is no file
    return hashlib.sha256(said).hexdigest()


def compiled_before(function: Any) -> bool:
    """Is there machine code of a kernel on disk, of these very sources?"""
    return bool(function._cache._cache_file._load_index())
