"""Changes of classes and of levels in the compiled engine, where they are not those of rings."""

from __future__ import annotations

from typing import Any

from desim_uav.engine.air import MOST_PASSED
from desim_uav.engine.compiled.looking import CHANGE_COLUMNS, know_walks, sort_last_first
from desim_uav.model.compiled_rows import as_array, call, set_word
from desim_uav.model.kernels import kernel, rule
from desim_uav.model.radio.air import class_changes_in_air, pair_changes
from desim_uav.model.radio.scene import (
    LOSS_COLUMNS,
    PLACE_COLUMNS,
    RADIO_COLUMNS,
    SENDER_COLUMNS,
    Air,
)
from desim_uav.model.radio.search import LINK_COLUMNS, LINK_WORDS
from desim_uav.model.radio.tracks import TRACK_COLUMNS
from desim_uav.model.walking import LEG_COLUMNS
from desim_uav.rules.air import keeps_rings, note_classes, place_drones
from desim_uav.rules.rows import Constants, Drone, Path, State, User
from desim_uav.rules.words import LOST, NEVER

PIECE_COLUMNS, MARK_COLUMNS = 4, 3


@kernel
def foresee_in_air(world: Constants, path: Path, state: State, drone: Drone, span_us: int) -> None:
    """Foresee the changes of class on a drone's leg (see ``rules.classes.foresee``).

    Where the drone keeps its altitude and nothing interferes, they are those of rings.
    """
    if keeps_rings(world, drone):
        call(world.foresee_rings, (world, path, state, drone, span_us))
        return
    start_us, end_us, ahead = state.now_us, state.now_us + span_us, drone.ahead
    if not _knows_walks(world, path, state, end_us):
        ahead.clear()
        return
    note_classes(state, drone)
    found = as_array(ahead, (ahead.buffer, CHANGE_COLUMNS))
    held = as_array(state.look.air.held, (len(state.users),))
    air = _air_of(world, path, state)
    count = class_changes_in_air(air, drone.index, (start_us, end_us), held, False, found)
    if count > ahead.buffer:
        set_word(ahead, 3, 1)
        count = ahead.buffer
    set_word(ahead, 1, count)
    sort_last_first(as_array(ahead, (count, CHANGE_COLUMNS)))


@kernel
def passes_us(
    world: Constants, path: Path, state: State, user: User, one: int, other: int, better: int
) -> int:
    """Return when one drone becomes better than another one (see ``rules.association``)."""
    span_us = (state.now_us, state.known_until_us)
    if not _knows_walks(world, path, state, state.known_until_us):
        return NEVER
    passed = as_array(state.look.air.passed, (MOST_PASSED, 2))
    air = _air_of(world, path, state)
    rows = pair_changes(air, user.index, one, other, world.margin_db, span_us, better, passed)
    return passed[0, 0] if rows > 0 else NEVER


@rule
def _knows_walks(world: Constants, path: Path, state: State, end_us: int) -> bool:
    """Draw the users' walks until a time, if they are not known; return whether they are valid."""
    know_walks(world, path, state, state.now_us, end_us)
    if path.stepwise and state.look.walking.lost:
        state.faults |= LOST
        return False
    return True


@rule
def _air_of(world: Constants, path: Path, state: State) -> Any:
    """Return what kernels know of drones and users."""
    place_drones(world, state)
    own, senders, users = state.look.air, len(state.senders), len(state.users)
    rows, begins = path.legs, path.legs_at
    if path.stepwise:
        rows, begins = state.look.walking.legs, state.look.walking.legs_at
    return Air(
        as_array(own.ways, (senders, PLACE_COLUMNS)),
        as_array(own.senders, (senders, SENDER_COLUMNS)),
        as_array(world.profiles, (len(world.profiles) // PIECE_COLUMNS, PIECE_COLUMNS)),
        as_array(world.profiles_at, (len(world.profiles_at),)),
        as_array(own.losses, (len(world.radios), LOSS_COLUMNS)),
        as_array(own.radios, (len(world.radios), RADIO_COLUMNS)),
        as_array(world.thresholds_db, (len(world.thresholds_db),)),
        as_array(world.thresholds_at, (len(world.thresholds_at),)),
        as_array(rows, (len(rows) // LEG_COLUMNS, LEG_COLUMNS)),
        as_array(begins, (users + 1,)),
        as_array(world.heights_m, (users,)),
        as_array(own.marks, (len(own.marks) // MARK_COLUMNS, MARK_COLUMNS)),
        as_array(own.marks_at, (len(own.marks_at),)),
        as_array(own.tracks, (len(own.tracks) // TRACK_COLUMNS, TRACK_COLUMNS)),
        as_array(own.table, (senders, LINK_COLUMNS)),
        as_array(own.link_words, (senders, LINK_WORDS)),
        as_array(own.bound_db, (1,)),
    )
