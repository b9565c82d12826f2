"""The one decorator under which the model's numbers are compiled.

A kernel is scalar code over flat arrays. It calls only kernels of its own file: Numba's disk cache
looks at that file alone when it decides whether the machine code is stale.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile with strict IEEE arithmetic (no reassociation, no fused contraction), cached on disk."""
    compiled: F = numba.njit(cache=True, nogil=True, fastmath=False, error_model="numpy")(function)
    return compiled
