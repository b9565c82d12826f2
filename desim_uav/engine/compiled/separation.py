"""When drones come too near to each other and part again, in the compiled engine."""

from __future__ import annotations

from typing import Any

from desim_uav.model.geometry.separation import approach, conflicts
from desim_uav.model.radio.tracks import TRACK_COLUMNS, Flight, fly
from desim_uav.rowcode.compiled_rows import as_array
from desim_uav.rowcode.kernels import kernel, rule, stands_in_for
from desim_uav.rules import separation as seam
from desim_uav.rules.rows import Constants, Drone, Pair, State
from desim_uav.rules.separation import MOST_TRACK_ROWS, MOST_TURNS
from desim_uav.rules.transits import flight_of

PIECE_COLUMNS = 4


@kernel
def part(world: Constants, state: State, drone: Drone) -> None:
    """End the windows of a drone (see ``rules.separation``)."""
    seam.part(world, state, drone)


@kernel
def on_separation(world: Constants, state: State) -> None:
    """Look at the pairs of drones (see ``rules.separation``)."""
    seam.on_separation(world, state)


@kernel
def tally(world: Constants, state: State, what: int) -> None:
    """Begin or complete the measures of an episode (see ``rules.separation``)."""
    seam.tally(world, state, what)


@kernel
def must_wait(world: Constants, state: State, drone: Drone, transit: int) -> int:
    """Return whether a drone must not begin a flight (see ``rules.separation``)."""
    return int(seam.must_wait(world, state, drone, transit))


@stands_in_for(seam.meet)
def _meet(world: Any, state: Any, pair: Any, until_us: Any) -> Any:
    def meeting(world: Any, state: Any, pair: Any, until_us: Any) -> None:
        meet(world, state, pair, until_us)

    return meeting


@stands_in_for(seam.least_m)
def _least_m(world: Any, state: Any, one: Any, other: Any, begin_us: Any, end_us: Any) -> Any:
    def least(world: Any, state: Any, one: Any, other: Any, begin_us: Any, end_us: Any) -> Any:
        return least_m(world, state, one, other, begin_us, end_us)

    return least


@rule
def meet(world: Constants, state: State, pair: Pair, until_us: int) -> None:
    """Write the times at which a pair comes too near and parts, the next one last."""
    span = (state.now_us, until_us)
    tracks = as_array(state.look.apart, (MOST_TRACK_ROWS, TRACK_COLUMNS))
    found = as_array(state.look.turns, (MOST_TURNS, 2))
    one = (0, fly(_flight(world, state.drones[pair.one]), span, tracks, 0))
    other = (one[1], fly(_flight(world, state.drones[pair.other]), span, tracks, one[1]))
    count = conflicts(tracks, one, other, world.separation_m, span, pair.near, found)
    pair.turns.clear()
    for k in range(count - 1, -1, -1):
        pair.turns.append(found[k, 0])


@rule
def least_m(
    world: Constants, state: State, one: Drone, other: Drone, begin_us: int, end_us: int
) -> float:
    """Return the least distance of two drones in a part of their present legs, in metres."""
    span = (begin_us, end_us)
    tracks = as_array(state.look.apart, (MOST_TRACK_ROWS, TRACK_COLUMNS))
    mine = (0, fly(_flight(world, one), span, tracks, 0))
    theirs = (mine[1], fly(_flight(world, other), span, tracks, mine[1]))
    return approach(tracks, mine, theirs, 0.0, (end_us - begin_us) * 1e-6).distance_m


@rule
def _flight(world: Constants, drone: Drone) -> Flight:
    """Return the leg of a drone."""
    pieces = flight_of(world, drone).pieces
    profile = as_array(pieces, (len(pieces), PIECE_COLUMNS))
    return Flight(profile, seam.route_of(world, drone), drone.since_us)
