"""Kernels as plain Python, whose lines a coverage tool sees: ``pytest -p tests.interpreted``.

What Numba would compile is called as it stands, a hundred times slower. Floats may differ in the
last bit. The rules of ``desim_uav/rules`` need none of this, because the SimPy engine calls them as
they stand. The compiled engine reads rows in memory by their addresses, which plain Python cannot:
its tests are skipped.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Generator
from types import FrameType, SimpleNamespace
from typing import Any

import numba
import numba.extending
import numpy as np
import pytest
from hypothesis import settings

from desim_uav.rowcode import numba_parts


def njit(**_: Any) -> Callable[[Any], Any]:
    """In the place of ``numba.njit``: nothing is compiled."""

    def plain(function: Any) -> Any:
        function.get_call_template = None
        function._cache = SimpleNamespace(cache_path=None)
        return function

    return plain


def only_compiled(*_: Any, **__: Any) -> Any:
    """In the place of what gives or takes addresses: the test is skipped."""
    pytest.skip("rows in memory are for compiled code only")


def intrinsic(*functions: Any, **_: Any) -> Any:
    """In the place of Numba's, with or without options."""
    return only_compiled if functions else intrinsic


numba.njit = njit
numba.extending.intrinsic = intrinsic
numba_parts.address_of = only_compiled
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
