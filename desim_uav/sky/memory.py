"""The rows and tables at the addresses that the kernels of the sky are given."""

from __future__ import annotations

from typing import Any

from desim_uav.model.mobility.walks import LEG_COLUMNS
from desim_uav.rowcode.compiled_rows import as_array, entries_at, pointer_to
from desim_uav.rowcode.kernels import rule
from desim_uav.sky.rows import Scene, Sky

scene_at: Any = pointer_to(Scene)
sky_at: Any = pointer_to(Sky)
floats_at, ints_at = entries_at(float), entries_at(int)


@rule
def walks_at(walks: int, numbers: int, begins: int, users: int) -> Any:
    """Return the legs of the walks of so many users, and the offsets of each user's legs.

    The legs (``model.geometry.coverage``) are so many ``numbers`` at the address ``walks``, and the
    offsets are at ``begins``.
    """
    legs = as_array(floats_at(walks, numbers), (numbers // LEG_COLUMNS, LEG_COLUMNS))
    return legs, ints_at(begins, users + 1)
