"""The one decorator under which the model's numbers are compiled.

A kernel is scalar code over flat arrays. It calls only kernels of its own file: Numba's disk cache
looks at that file alone when it decides whether the machine code is stale.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile with strict IEEE arithmetic (no reassociation, no contraction), cached on disk."""
    compiled = numba.njit(cache=True, nogil=True, fastmath=False, error_model="numpy")(function)
    return cast(F, compiled)


def compiled_before(function: Any) -> bool:
    """Is there machine code of a kernel on disk, so that its first call will not compile it?"""
    name = f"{function.__module__.rpartition('.')[2]}.{function.__name__}-*.nbi"
    return any(Path(function.stats.cache_path).glob(name))
