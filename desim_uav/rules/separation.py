"""Separation: when two drones in the air come nearer to each other than a least distance.

Distances are computed only if the scenario has a ``separation_m``. Whenever a leg of a drone begins
or ends, the windows of its pairs end (``part``). At the end of this instant, when all legs are
known, new windows begin (``on_separation``), with the times at which the pairs will come too near
or part.
"""

from __future__ import annotations

import math

from desim_uav.rowcode.compiled_rows import call_for_float, call_for_int
from desim_uav.rowcode.kernels import apart, rule
from desim_uav.rowcode.rows import address
from desim_uav.rules import words
from desim_uav.rules.due import due, key, separation_slot
from desim_uav.rules.note import note
from desim_uav.rules.rows import Constants, Drone, Pair, State
from desim_uav.rules.transits import flight_of, show_leg

TOLERANCE_M = 1e-6
"""A decrease of the distance, in metres, that is ignored: drones may fly side by side."""


@rule
def in_air(drone: Drone) -> bool:
    """Return whether a drone is in the air, where it has to keep its distance."""
    return drone.mode in words.AIRBORNE


@rule
def pair_of(state: State, one: int, other: int) -> Pair:
    """Return the pair of two drones, of which ``one`` has the lower index."""
    return state.pairs[one * (2 * len(state.drones) - one - 1) // 2 + other - one - 1]


@apart
def begin_pairs(state: State) -> None:
    """Forget the previous episode, and look at all pairs at the end of this instant."""
    state.conflicts = state.conflict_us = 0
    state.nearest_m = math.inf
    for k in range(len(state.pairs)):
        pair = state.pairs[k]
        pair.open = pair.near = 0
        pair.since_us = 0
        pair.turns.clear()
    if len(state.pairs) > 0:
        _look_at(state, state.now_us)


@apart
def part(world: Constants, state: State, drone: Drone) -> None:
    """End the windows of a drone whose leg or mode changes now, before it does."""
    for d in range(len(state.drones)):
        if d < drone.index:
            _close(world, state, pair_of(state, d, drone.index))
        elif d > drone.index:
            _close(world, state, pair_of(state, drone.index, d))
    if len(state.pairs) > 0:
        _look_at(state, state.now_us)


@apart
def _close(world: Constants, state: State, pair: Pair) -> None:
    """End the window of a pair, if it has one, with the least distance in it."""
    if pair.open:
        one, other = state.drones[pair.one], state.drones[pair.other]
        nearest_m = _least_m(world, state, one, other, pair.since_us, state.now_us)
        state.nearest_m = min(state.nearest_m, nearest_m)
        pair.open = 0
        pair.turns.clear()


@rule
def _look_at(state: State, t_us: int) -> None:
    """Let pairs be looked at (``on_separation``) at the end of an instant."""
    due(state, separation_slot(state), t_us, key(words.SEPARATION, -1, -1))


@apart
def on_separation(world: Constants, state: State) -> None:
    """Begin windows of pairs whose legs have changed, and let pairs come too near and part."""
    next_us = words.NEVER
    for k in range(len(state.pairs)):
        pair = state.pairs[k]
        if not pair.open:
            _open(world, state, pair)
        turns = pair.turns
        while len(turns) > 0 and turns[len(turns) - 1] <= state.now_us:
            turns.pop()
            _turn(state, pair)
        if len(turns) > 0:
            next_us = min(next_us, turns[len(turns) - 1])
    if next_us < words.NEVER:
        _look_at(state, next_us)


@rule
def _open(world: Constants, state: State, pair: Pair) -> None:
    """Begin the window of a pair in the air; a pair with a drone on the ground becomes clear."""
    one, other = state.drones[pair.one], state.drones[pair.other]
    if in_air(one) and in_air(other):
        pair.open, pair.since_us = 1, state.now_us
        _await_turns(world, state, pair, rests_at(world, state, one, other))
    elif pair.near:
        _turn(state, pair)


@rule
def _await_turns(world: Constants, state: State, pair: Pair, until_us: int) -> None:
    """Write the times at which a pair comes too near or parts into ``turns``, the next time last.

    The first of these times is now if the present state of the pair differs from ``pair.near``.
    """
    one, other, turns = pair.one, pair.other, pair.turns
    show_leg(world, state, state.drones[one])
    show_leg(world, state, state.drones[other])
    places = address(world.scene), address(state.sky)
    count = call_for_int(world.meet, (*places, one, other, pair.near, state.now_us, until_us))
    turns.clear()
    for k in range(count - 1, -1, -1):
        turns.append(state.sky.turns[k].t_us)


@rule
def _least_m(
    world: Constants, state: State, one: Drone, other: Drone, begin_us: int, end_us: int
) -> float:
    """Return the least distance of two drones in a time window of their present legs, in metres."""
    show_leg(world, state, one)
    show_leg(world, state, other)
    places = address(world.scene), address(state.sky)
    return call_for_float(world.least_m, (*places, one.index, other.index, begin_us, end_us))


@rule
def _turn(state: State, pair: Pair) -> None:
    """Let a pair come too near now, or part."""
    pair.near = 1 - pair.near
    if pair.near:
        state.conflicts += 1
        state.conflict_us -= state.now_us
        _note(state, words.ON_CONFLICT, pair)
    else:
        state.conflict_us += state.now_us
        _note(state, words.ON_CLEAR, pair)


@rule
def _note(state: State, kind: int, pair: Pair) -> None:
    """Append an event of two drones to the log; the field of the user has the other drone."""
    note(state, words.SEPARATION, kind, pair.one, pair.other, -1, -1)


@rule
def rests_at(world: Constants, state: State, one: Drone, other: Drone) -> int:
    """Return the time from which two drones in the air both rest, if they get no new command."""
    first = one.since_us + flight_of(world, one).duration_us
    second = other.since_us + flight_of(world, other).duration_us
    return max(first, second, state.now_us)


@apart
def end_pairs(world: Constants, state: State) -> None:
    """Complete the measures of pairs in an episode that ends now."""
    for k in range(len(state.pairs)):
        pair = state.pairs[k]
        _close(world, state, pair)
        if pair.near:
            state.conflict_us += state.now_us


@apart
def must_wait(world: Constants, state: State, drone: Drone, transit: int) -> bool:
    """Return whether a drone at rest must give way and not begin a flight (``to_x``, ``transit``).

    This is so if the flight would bring it nearer than ``separation_m`` to a drone in the air with
    a lower index, and nearer than the two are now. The other drone may have received its command
    in the same instant.
    """
    since_us, rests = drone.since_us, drone.transit
    drone.since_us, drone.transit = state.now_us, transit
    waits = False
    for d in range(drone.index):
        other = state.drones[d]
        if in_air(other) and not waits:
            now_us, until_us = state.now_us, rests_at(world, state, other, drone)
            nearest_m = _least_m(world, state, other, drone, now_us, until_us)
            if nearest_m < world.separation_m:
                now_m = _least_m(world, state, other, drone, now_us, now_us)
                waits = nearest_m < now_m - TOLERANCE_M
    drone.since_us, drone.transit = since_us, rests
    return waits
