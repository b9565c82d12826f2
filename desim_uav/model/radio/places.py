"""Losses at many places, and where buildings block the line to a transmitter."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.radio.buildings import Buffers, Buildings, buffers_for
from desim_uav.model.radio.levels import LEVEL
from desim_uav.model.radio.path_loss import LOS, NLOS, RowPathLoss
from desim_uav.model.radio.sight import BLOCKED, state_at
from desim_uav.model.radio.tracks import TrackRow
from desim_uav.rowcode.compiled_rows import call_for_float
from desim_uav.rowcode.components import compiled_or_none
from desim_uav.rowcode.kernels import kernel
from desim_uav.rowcode.rows import Floats, Ints, Table
from desim_uav.rowcode.views import zeros


def losses_db(
    path_loss: RowPathLoss,
    carrier_ghz: float,
    branches: NDArray[np.int64],
    distances_m: NDArray[np.float64],
    heights_m: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the loss at each of some distances and heights (n,), each of a branch, in dB.

    They are the numbers that the engines compute, compiled if the path loss can be compiled.
    """
    out = np.empty(len(distances_m))
    code = compiled_or_none("path_loss", path_loss, (LEVEL,))
    if code is None:
        of = (path_loss.mean_db, path_loss.los_db, path_loss.nlos_db)
        places = zip(branches.tolist(), distances_m.tolist(), heights_m.tolist(), strict=True)
        out[:] = [of[branch](away_m, up_m, carrier_ghz) for branch, away_m, up_m in places]
    else:
        values = code.values.ctypes.data
        _write_losses(
            *(code.functions["level"], values, carrier_ghz, branches, distances_m, heights_m, out)
        )
    return out


@kernel
def _write_losses(
    level: int,
    values: int,
    carrier_ghz: float,
    branches: Ints,
    distances_m: Floats,
    heights_m: Floats,
    out: Floats,
) -> None:
    for k in range(len(out)):
        place = values, carrier_ghz, branches[k], distances_m[k], heights_m[k]
        out[k] = call_for_float(level, place)


def branches_at(
    buildings: Buildings, sender_m: NDArray[np.float64], places_m: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return the branch of the path loss from a transmitter (3,) to each of some places (n, 3).

    It is NLOS where the line passes through a building, and else LOS.
    """
    tracks, out = zeros(TrackRow, 2), np.empty(len(places_m), np.int64)
    tracks["x_m"][0], tracks["y_m"][0], tracks["z_m"][0] = sender_m
    _write_branches(tracks, places_m, buildings, buffers_for(buildings.offsets, 1), out)
    return out


@kernel
def _write_branches(
    tracks: Table[TrackRow], places_m: Any, buildings: Buildings, buffers: Buffers, out: Ints
) -> None:
    place = tracks[1]
    for k in range(len(out)):
        place.x_m, place.y_m, place.z_m = places_m[k, 0], places_m[k, 1], places_m[k, 2]
        blocked = state_at(place, tracks[0], 0.0, buildings, buffers) == BLOCKED
        out[k] = NLOS if blocked else LOS
