"""Changes of classes and of levels in the compiled engine, where they are not those of rings."""

from __future__ import annotations

from typing import Any

import numpy as np

from desim_uav.engine.air import MOST_PASSED
from desim_uav.model.mobility.walking import LEG_COLUMNS
from desim_uav.model.radio.air import (
    FOUND,
    FOUND_AT,
    FOUND_COLUMNS,
    FOUND_ROOM,
    class_changes_in_air,
    class_changes_of_all,
    pair_changes,
)
from desim_uav.model.radio.links import LINK_COLUMNS, LINK_WORDS, LOOKED, LOOKED_COLUMNS, LOOKS
from desim_uav.model.radio.marks import (
    CHANGE_COLUMNS as SEEN_COLUMNS,
)
from desim_uav.model.radio.marks import (
    MARK_COLUMNS,
    VISIT_COLUMNS,
    Memory,
    Sight,
    marks_of,
)
from desim_uav.model.radio.scene import (
    LOSS_COLUMNS,
    PLACE_COLUMNS,
    RADIO_COLUMNS,
    SENDER_COLUMNS,
    Air,
)
from desim_uav.model.radio.sight import Buffers, Buildings
from desim_uav.model.radio.tracks import TRACK_COLUMNS, Flight
from desim_uav.rowcode.compiled_rows import as_array, set_word
from desim_uav.rowcode.kernels import kernel, rule
from desim_uav.rules.air import (
    keeps_rings,
    lacks_marks,
    needs_marks,
    note_classes,
    number_in_draws,
    number_of_profile,
    place_drones,
    span_of_marks,
)
from desim_uav.rules.association import known_until_us
from desim_uav.rules.classes import foresee_rings
from desim_uav.rules.rows import Constants, Drone, Path, State, User
from desim_uav.rules.transits import heights_of, way_of
from desim_uav.rules.walks import know_walks
from desim_uav.rules.words import LOST, NEVER
from desim_uav.sky.order import CHANGE_COLUMNS, sort_last_first

PIECE_COLUMNS = 4


@kernel
def foresee_in_air(world: Constants, path: Path, state: State, drone: Drone, span_us: int) -> None:
    """Foresee the changes of class on a drone's leg that are not those of rings."""
    start_us, end_us, ahead = state.now_us, state.now_us + span_us, drone.ahead
    if not _knows_walks(world, path, state, end_us):
        ahead.clear()
        return
    _mark_all(world, path, state, drone, end_us)
    note_classes(state, drone)
    users, found = len(state.users), as_array(ahead, (ahead.buffer, CHANGE_COLUMNS))
    held = as_array(state.look.air.held, (len(state.senders), users))[drone.index]
    air = _air_of(world, path, state)
    count = class_changes_in_air(air, drone.index, (start_us, end_us), held, False, found)
    _keep(drone, count)


@kernel
def foresee_all(world: Constants, path: Path, state: State, span_us: int) -> None:
    """Foresee the changes of class of all drones that serve (see ``rules.classes.retune``)."""
    own, users, senders = state.look.air, len(state.users), len(state.senders)
    span = (state.now_us, state.now_us + span_us)
    known = _knows_walks(world, path, state, span[1])
    found = as_array(own.found, (senders, FOUND_COLUMNS))
    for d in range(senders):
        drone = state.senders[d]
        found[d, FOUND_AT] = 0
        if drone.serving and keeps_rings(world, drone):
            foresee_rings(world, path, state, drone, span_us)
        elif drone.serving:
            drone.ahead.clear()
            _mark_all(world, path, state, drone, span[1])
            note_classes(state, drone)
            changes = as_array(drone.ahead, (drone.ahead.buffer, CHANGE_COLUMNS))
            found[d, FOUND_AT], found[d, FOUND_ROOM] = changes.ctypes.data, len(changes)
    if known:
        held = as_array(own.held, (senders, users))
        class_changes_of_all(_air_of(world, path, state), span, held, found)
        for d in range(senders):
            if found[d, FOUND_AT] != 0:
                _keep(state.senders[d], found[d, FOUND])


@rule
def _keep(drone: Drone, count: int) -> None:
    """Keep the changes that have been written to ``drone.ahead``, the next one last."""
    ahead = drone.ahead
    if count > ahead.buffer:
        set_word(ahead, 3, 1)
        count = ahead.buffer
    set_word(ahead, 1, count)
    sort_last_first(as_array(ahead, (count, CHANGE_COLUMNS)))


@kernel
def passes_us(
    world: Constants,
    path: Path,
    state: State,
    user: User,
    one: int,
    other: int,
    better: int,
    margin_db: float,
) -> int:
    """Return when one drone becomes better than another one (see ``rules.association``)."""
    span_us = (state.now_us, known_until_us(state, one, other))
    if not _knows_walks(world, path, state, span_us[1]):
        return NEVER
    if needs_marks(world, state, state.senders[one], span_us[1]):
        _mark(world, path, state, state.senders[one], span_us[1])
    if needs_marks(world, state, state.senders[other], span_us[1]):
        _mark(world, path, state, state.senders[other], span_us[1])
    passed = as_array(state.look.air.passed, (MOST_PASSED, 2))
    air = _air_of(world, path, state)
    rows = pair_changes(air, user.index, one, other, margin_db, span_us, better, passed)
    return passed[0, 0] if rows > 0 else NEVER


@rule
def _knows_walks(world: Constants, path: Path, state: State, end_us: int) -> bool:
    """Draw the users' walks until a time, if they are not known; return whether they are valid.

    If there was no memory for some legs, the step is repeated in more of it.
    """
    know_walks(world, path, state, state.now_us, end_us)
    if not path.stepwise:
        return True
    walking = state.look.walking
    if walking.lost:
        state.faults |= LOST
    return walking.lost == 0 and walking.count * LEG_COLUMNS <= len(walking.legs)


@rule
def _mark_all(world: Constants, path: Path, state: State, drone: Drone, end_us: int) -> None:
    """Make all marks on which the classes of links to a drone depend until a time."""
    if world.radios[drone.radio].marked or world.reuse > 0:
        for d in range(len(state.senders)):
            if lacks_marks(world, state, drone, state.senders[d], end_us):
                _mark(world, path, state, state.senders[d], end_us)


@rule
def _mark(world: Constants, path: Path, state: State, drone: Drone, end_us: int) -> None:
    """Make the marks of all links to a drone until a time; say so if there is no room for them."""
    own, users = state.look.air, len(state.users)
    first = drone.index * own.mark_rows
    out = as_array(own.marks, (len(own.marks) // MARK_COLUMNS, MARK_COLUMNS))
    out = out[: first + own.mark_rows]
    begins = drone.index * (users + 1)
    out_at = as_array(own.marks_at, (len(own.marks_at),))[begins : begins + users + 1]
    out_at[0] = first
    span_us = span_of_marks(state, drone, end_us)
    end = marks_of(
        _sight_of(world, path, state, drone), number_in_draws(drone), span_us, out, out_at
    )
    if end < 0 or end > len(out):
        own.marks_lost = 1
        out_at[:] = first
    drone.marked_us, drone.marked_until_us = span_us


@rule
def _sight_of(world: Constants, path: Path, state: State, drone: Drone) -> Any:
    """Return what decides on the marks of links to a drone."""
    own, radio, users = state.look.air, world.radios[drone.radio], len(state.users)
    legs, legs_at = _walks_of(path, state)
    (x0, y0, x1, y1), (z0, z1) = way_of(world, drone), heights_of(world, drone)
    pieces, pieces_at = _profiles_of(world, state)
    number = number_of_profile(state, drone)
    begins, after = pieces_at[number], pieces_at[number + 1]
    cells, cell_m = (world.nx, world.ny), (world.cell_x_m, world.cell_y_m)
    return Sight(
        radio.sight,
        as_array(path.link_key, (len(path.link_key),)).view(np.uint64),
        (radio.los_shadow_db, radio.nlos_shadow_db),
        cell_m,
        cells,
        legs,
        legs_at,
        as_array(world.heights_m, (users,)),
        Flight(pieces[begins:after], (x0, y0, z0, x1, y1, z1), drone.since_us),
        radio.p_los,
        radio.loss_values,
        Buildings(
            as_array(world.corners_m, (len(world.corners_m) // 2, 2)),
            as_array(world.corners_at, (len(world.corners_at),)),
            as_array(world.roofs_m, (len(world.roofs_m),)),
            cells,
            cell_m,
            as_array(world.built_at, (len(world.built_at),)),
            as_array(world.built, (len(world.built),)),
            world.tallest_m,
        ),
        Memory(
            as_array(own.flown, (len(own.flown) // TRACK_COLUMNS, TRACK_COLUMNS)),
            as_array(own.borders_s, (len(own.borders_s),)),
            as_array(own.visits, (len(own.visits) // VISIT_COLUMNS, VISIT_COLUMNS)),
            as_array(own.seen, (len(own.seen) // SEEN_COLUMNS, SEEN_COLUMNS)),
            Buffers(
                as_array(own.times, (len(own.times),)),
                as_array(own.stretches, (len(own.stretches) // 2, 2)),
                as_array(own.visited, (len(own.visited),)),
            ),
        ),
    )


@rule
def _walks_of(path: Path, state: State) -> Any:
    """Return the legs of the users' walks, and the first one of each user."""
    rows, begins = path.legs, path.legs_at
    if path.stepwise:
        rows, begins = state.look.walking.legs, state.look.walking.legs_at
    legs = as_array(rows, (len(rows) // LEG_COLUMNS, LEG_COLUMNS))
    return legs, as_array(begins, (len(state.users) + 1,))


@rule
def _profiles_of(world: Constants, state: State) -> Any:
    """Return the profiles of all transits, and the first row of each."""
    rows, begins = world.profiles, world.profiles_at
    if len(state.look.air.pieces) > 0:
        rows, begins = state.look.air.pieces, state.look.air.pieces_at
    pieces = as_array(rows, (len(rows) // PIECE_COLUMNS, PIECE_COLUMNS))
    return pieces, as_array(begins, (len(begins),))


@rule
def _air_of(world: Constants, path: Path, state: State) -> Any:
    """Return what kernels know of drones and users."""
    place_drones(world, state)
    own, senders, users = state.look.air, len(state.senders), len(state.users)
    legs, legs_at = _walks_of(path, state)
    pieces, pieces_at = _profiles_of(world, state)
    return Air(
        as_array(own.ways, (senders, PLACE_COLUMNS)),
        as_array(own.senders, (senders, SENDER_COLUMNS)),
        pieces,
        pieces_at,
        as_array(own.losses, (len(world.radios), LOSS_COLUMNS)),
        as_array(own.radios, (len(world.radios), RADIO_COLUMNS)),
        as_array(world.thresholds_db, (len(world.thresholds_db),)),
        as_array(world.thresholds_at, (len(world.thresholds_at),)),
        legs,
        legs_at,
        as_array(world.heights_m, (users,)),
        as_array(own.marks, (len(own.marks) // MARK_COLUMNS, MARK_COLUMNS)),
        as_array(own.marks_at, (len(own.marks_at),)),
        as_array(own.tracks, (len(own.tracks) // TRACK_COLUMNS, TRACK_COLUMNS)),
        as_array(own.table, (senders, LINK_COLUMNS)),
        as_array(own.link_words, (senders, LINK_WORDS)),
        as_array(own.looks, (LOOKS, LOOKED + LOOKED_COLUMNS * senders)),
        as_array(own.bound_db, (1,)),
    )
