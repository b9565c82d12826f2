"""Kernels as plain Python, whose lines a coverage tool sees: ``pytest -p tests.interpreted``.

What Numba would compile is called as it stands, a hundred times slower. Floats may differ in the
last bit, and pointers are arrays.
"""

from __future__ import annotations

import ctypes
import signal
from collections.abc import Callable, Generator
from types import FrameType, SimpleNamespace
from typing import Any

import numba
import numba.extending
import numpy as np
import pytest
from hypothesis import settings
from numpy.typing import NDArray

SOME = 1 << 24
"""How far memory is looked at from an address: more than any array of a test."""


def njit(**_: Any) -> Callable[[Any], Any]:
    """In the place of ``numba.njit``: nothing is compiled."""

    def plain(function: Any) -> Any:
        function.get_call_template = None
        function._cache = SimpleNamespace(cache_path=None)
        return function

    return plain


def intrinsic(generator: Any) -> Any:
    """In the place of Numba's: what the generated code would do."""
    return POINTERS[generator.__name__]


def _at(address: int, kind: Any) -> NDArray[Any]:
    memory = ctypes.cast(int(address), ctypes.POINTER(kind))
    return np.ctypeslib.as_array(memory, (SOME,))


POINTERS: dict[str, Callable[..., Any]] = {
    "_pointer": lambda array: _at(array.ctypes.data, np.ctypeslib.as_ctypes_type(array.dtype)),
    "_moved": lambda memory, by: memory[by:],
    "_table": lambda memory, rows, columns: memory[: rows * columns].reshape(rows, columns),
    "_whole_at": lambda address: _at(address, ctypes.c_int64),
    "_real_at": lambda address: _at(address, ctypes.c_double),
    "_small_at": lambda address: _at(address, ctypes.c_int8),
}

numba.njit = njit
numba.extending.intrinsic = intrinsic
np.seterr(all="ignore")

LONGEST_S = 4
"""Of a test; what it has run until then counts."""

settings.register_profile("interpreted", max_examples=20, deadline=None)
settings.load_profile("interpreted")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, Any, Any]:
    """Pass over the rest of what takes too long."""

    def late(_: int, frame: FrameType | None) -> None:
        if frame is not None and "/coverage/" in frame.f_code.co_filename:  # it may hold its lock
            signal.setitimer(signal.ITIMER_REAL, 0.001)
        else:
            pytest.skip(f"longer than {LONGEST_S} s")

    signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, LONGEST_S)
    try:
        return (yield)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
