"""What a planner sees of links whose line of sight or shadowing is drawn."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.episode import Engine
from desim_uav.engine.sky import buildings_of
from desim_uav.model.geometry.grid import cell_index
from desim_uav.model.radio.buildings import Buildings, buffers_for
from desim_uav.model.radio.draws import UNSEEN
from desim_uav.model.radio.functions import elevation_deg
from desim_uav.model.radio.sight import CLEAR, state_at
from desim_uav.model.radio.tracks import TrackRow
from desim_uav.rowcode.views import zeros
from desim_uav.rules.air import number_in_draws
from desim_uav.rules.flight import position
from desim_uav.world import World


class SeenLinks(NamedTuple):
    """The cells of transmitters, and the chances of links (see ``model.radio.draws``)."""

    cells: NDArray[np.int64]
    chances: NDArray[np.float64]


def seen_links(engine: Engine) -> SeenLinks | None:
    """Return what is seen of all links now; None if nothing about links is drawn in this world."""
    world = engine.world
    if not any(_is_drawn(links.radio) for links in world.links):
        return None
    senders, users_m = engine.state.senders, engine.positions_m()[1].tolist()
    cells = np.full(len(senders), UNSEEN, np.int64)
    chances = np.zeros((len(senders), len(users_m)))
    buildings = buildings_of(world)
    for sender in senders:
        radio = world.links[sender.radio].radio
        if sender.serving and _is_drawn(radio):
            place, row = position(engine.constants, engine.state, sender), number_in_draws(sender)
            cells[row] = _cell(world, *place[:2])
            chances[row] = [_chance(radio, buildings, place, user) for user in users_m]
    return SeenLinks(cells, chances)


def _is_drawn(radio: Any) -> bool:
    """Return whether anything about the links of a radio is drawn."""
    return bool(radio.marked and (radio.sight == "drawn" or radio.shadowing is not None))


def _cell(world: World, x: float, y: float) -> int:
    """Return the number of the cell in which a transmitter is, as the draws of links count them."""
    (nx, ny), (dx, dy) = world.grid.cells, world.grid.cell_m
    return int(cell_index(x, dx, nx) * ny + cell_index(y, dy, ny))


def _chance(radio: Any, buildings: Buildings, place: Any, user: Any) -> float:
    """Return how probable line of sight is: 1 or 0 if buildings decide."""
    if radio.sight == "buildings":
        return float(_is_clear(buildings, place, user))
    away_m = math.hypot(place[0] - user[0], place[1] - user[1])
    return float(radio.loss.p_los(elevation_deg(away_m, place[2] - user[2])))


def _is_clear(buildings: Buildings, place: Any, user: Any) -> bool:
    """Return whether no building is between a transmitter and a user, who are where they are."""
    tracks = zeros(TrackRow, 2)
    for track, at_m in zip(tracks, (user, place), strict=True):
        track["x_m"], track["y_m"], track["z_m"] = at_m
    buffers = buffers_for(buildings.offsets, 1)
    return bool(state_at(tracks[0], tracks[1], 0.0, buildings, buffers) == CLEAR)
