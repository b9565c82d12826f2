"""The rows and tables at the addresses that the kernels of the sky are given."""

from __future__ import annotations

from typing import Any

from desim_uav.model.geometry.coverage import WalkLeg
from desim_uav.rowcode.compiled_rows import entries_at, pointer_to
from desim_uav.rowcode.kernels import rule
from desim_uav.sky.rows import Scene, Sky

scene_at: Any = pointer_to(Scene)
sky_at: Any = pointer_to(Sky)
_legs_at, _ints_at = entries_at(WalkLeg), entries_at(int)


@rule
def walks_at(walks: int, legs: int, begins: int, users: int) -> Any:
    """Return the legs of the walks of so many users, and the offsets of each user's legs.

    There are so many ``legs`` at the address ``walks``, and the offsets are at ``begins``.
    """
    return _legs_at(walks, legs), _ints_at(begins, users + 1)
