"""Copies and pickles of environments and engines: what a copy owns and what copies share."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import fields
from typing import Any, Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Number = TypeVar("Number", bound=np.generic)


class Independent:
    """An object whose copies are independent of it.

    ``copy.copy`` does what ``copy.deepcopy`` does. A copy that shared arrays with its original
    would move the original whenever it was stepped.
    """

    def __copy__(self) -> Self:
        """Return a deep copy."""
        return deepcopy(self)


class Unchanging:
    """A frozen dataclass, which all copies in one process share.

    A pickle holds its fields only. What it has computed from them is computed again when needed.
    """

    def __copy__(self) -> Self:
        """The object itself."""
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """The object itself."""
        return self

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields by name."""
        return {field.name: getattr(self, field.name) for field in fields(cast(Any, self))}


def owned(array: NDArray[Number]) -> NDArray[Number]:
    """Return the array if it owns its memory and is writable, else a copy of it.

    An unpickled array may not own its memory: pickles with out-of-band buffers, which Ray uses,
    give arrays that are read-only or share the memory of the original.
    """
    return np.require(array, requirements=("C", "A", "O", "W"))


def usable(array: NDArray[Number]) -> NDArray[Number]:
    """Return the array if kernels accept it as it is, else a copy of it. It may be shared."""
    return np.require(array, requirements=("C", "A", "W"))
