"""Changes of links that are not those of rings: what the sky has to know of senders, and calls."""

from __future__ import annotations

from desim_uav.rowcode.compiled_rows import call_for_int
from desim_uav.rowcode.kernels import apart, rare_rule, rule
from desim_uav.rowcode.rows import address
from desim_uav.rules.recurring import recall_leg, recurs, remember_leg
from desim_uav.rules.rows import Constants, Drone, Path, State, User
from desim_uav.rules.transits import show_leg
from desim_uav.rules.walks import know_walks, walks_of
from desim_uav.rules.words import LOST, NEVER, REST


@rule
def keeps_rings(world: Constants, drone: Drone) -> bool:
    """Return whether the changes of class on a drone's leg are those of rings.

    They are if the drone keeps its altitude, or rings are the same at all altitudes or known
    between two levels, if nothing interferes, and if all links have the mean loss.
    """
    radio = world.radios[drone.radio]
    has_rings = drone.level == drone.to_level or goes_between(world, drone)
    if drone.off_grid and drone.point < 0:  # at any altitude
        has_rings = world.levels == 1
    return bool(radio.flat) or (world.reuse == 0 and has_rings and not radio.marked)


@rule
def goes_between(world: Constants, drone: Drone) -> bool:
    """Return whether a drone passes between neighbouring levels, where the rings are known."""
    has_terms = len(world.scene.radios[drone.radio].terms) > 0
    return has_terms and abs(drone.to_level - drone.level) == 1


@rule
def lacks_marks(world: Constants, state: State, one: Drone, other: Drone, until_us: int) -> bool:
    """Return whether marks of links to another drone have to be made, for the time until another.

    They have if classes of links to drone ``one`` depend on them, and if they are not there yet.
    """
    matters = one.index == other.index or (world.reuse > 0 and other.serving)
    return bool(matters and needs_marks(world, state, other, until_us))


@rule
def needs_marks(world: Constants, state: State, drone: Drone, until_us: int) -> bool:
    """Return whether a drone's links have marks that are not in memory until a time.

    They are not if they are not known yet, or if the state has been restored since then.
    """
    if not world.radios[drone.radio].marked:
        return False
    marks_at, first = state.sky.air.marks_at, drone.index * (len(state.users) + 1)
    return bool(
        drone.marked_until_us < until_us or marks_at[first] == marks_at[first + len(state.users)]
    )


@rule
def span_of_marks(state: State, drone: Drone, until_us: int) -> tuple[int, int]:
    """Return the span in which the marks of a drone's links have to be made.

    It is from now until a time. Marks that are known already, but not in memory, are made anew for
    the span for which they were made first, so that they are the same.
    """
    if drone.marked_until_us < until_us:
        return state.now_us, until_us
    return drone.marked_us, drone.marked_until_us


@rule
def number_in_draws(drone: Drone) -> int:
    """Return the number of a drone in the draws of its links: below 0 for an access point."""
    return -1 - drone.point if drone.point >= 0 else drone.index


@rule
def note_classes(state: State, drone: Drone) -> None:
    """Write the classes of all users' links to a drone to the sky."""
    held, first = state.sky.held, drone.index * len(state.users)
    for u in range(len(state.users)):
        held[first + u] = state.users[u].classes[drone.index]


@rule
def show_air(world: Constants, path: Path, state: State, end_us: int) -> bool:
    """Write the legs of all senders to the sky, and draw the users' walks until a time.

    Returns whether the walks are valid. If there was no memory for some legs, the step is repeated
    in more of it.
    """
    know_walks(world, path, state, state.now_us, end_us)
    if path.stepwise:
        walking = state.look.walking
        if walking.lost:
            state.faults |= LOST
        if walking.lost or walking.count > len(walking.legs):
            return False
    for d in range(len(state.senders)):
        show_leg(world, state, state.senders[d])
    return True


@rule
def mark_all(world: Constants, path: Path, state: State, drone: Drone, end_us: int) -> None:
    """Make all marks on which the classes of links to a drone depend until a time."""
    if world.radios[drone.radio].marked or world.reuse > 0:
        for d in range(len(state.senders)):
            if lacks_marks(world, state, drone, state.senders[d], end_us):
                _mark(world, path, state, state.senders[d], end_us)


@rare_rule
def _mark(world: Constants, path: Path, state: State, drone: Drone, end_us: int) -> None:
    """Make the marks of all links to a drone until a time; say so if there is no room for them."""
    span = span_of_marks(state, drone, end_us)
    places = address(world.scene), address(state.sky), *walks_of(path, state)
    of_drone = address(path.link_key), len(path.link_key), drone.index, number_in_draws(drone)
    if call_for_int(world.mark, (*places, *of_drone, *span)) != 0:
        state.sky.marks_lost = 1
    drone.marked_us, drone.marked_until_us = span
    state.sky.legs[drone.index].marked_us = drone.marked_us


@rule
def _omit_marks(world: Constants, state: State, drone: Drone, end_us: int) -> None:
    """Take the marks of a drone's links as made from now on, though they are not in memory."""
    if world.radios[drone.radio].marked:
        marks_at, first = state.sky.air.marks_at, drone.index * (len(state.users) + 1)
        marks_at[first + len(state.users)] = marks_at[first]
        drone.marked_us, drone.marked_until_us = state.now_us, end_us


@apart
def foresee_in_air(world: Constants, path: Path, state: State, drone: Drone, span_us: int) -> None:
    """Write the changes on a leg to ``drone.ahead``, where they are not those of rings.

    There are none if a drone hovers on, no user walks, and no class changed after the start of its
    leg before. Marks, which are then alike at all times, are made only if ``passes_us`` needs them.
    Nor are they made if changes are known because the leg was flown before (``recurring``).
    """
    if drone.serving and drone.steady and drone.transit == REST:
        drone.ahead.clear()
        return
    drone.steady, end_us = 0, state.now_us + span_us
    if not show_air(world, path, state, end_us):
        drone.ahead.clear()
        return
    note_classes(state, drone)
    again, count = recurs(world, state, drone, end_us), -1
    if again:
        count = recall_leg(world, state, drone, end_us)
    if count >= 0:
        _omit_marks(world, state, drone, end_us)
    else:
        mark_all(world, path, state, drone, end_us)
        places = address(world.scene), address(state.sky), *drone.ahead.space(state.sky.changes)
        of_leg = *walks_of(path, state), drone.index, state.now_us, end_us
        count = call_for_int(world.foresee_in_air, (*places, *of_leg))
        if again:
            remember_leg(world, state, drone, count)
    drone.ahead.fill(state.sky.changes, count)
    if state.look.still and drone.transit == REST:
        drone.steady = int(len(drone.ahead) == 0 or drone.ahead[0].t_us == state.now_us)


@rare_rule
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
    """Return when the level of ``one`` reaches that of ``other`` plus a margin, or falls below it.

    ``better`` says whether it has reached it so far; the levels at this very instant may already
    say otherwise. The time is NEVER if nothing changes while both drones' legs are known
    (``known_until_us``).
    """
    end_us = known_until_us(state, one, other)
    if not show_air(world, path, state, end_us):
        return NEVER
    if needs_marks(world, state, state.senders[one], end_us):
        _mark(world, path, state, state.senders[one], end_us)
    if needs_marks(world, state, state.senders[other], end_us):
        _mark(world, path, state, state.senders[other], end_us)
    places = address(world.scene), address(state.sky), *walks_of(path, state)
    pair = user.index, one, other, state.now_us, end_us, better
    return call_for_int(world.better_us, (*places, *pair, margin_db))


@rule
def known_until_us(state: State, one: int, other: int) -> int:
    """Return until when the legs of two drones are known, and so the levels received from them."""
    return min(state.senders[one].until_us, state.senders[other].until_us)
