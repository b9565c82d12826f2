"""Association by level: users are handed over to drones that they receive better.

A level is the received power of a drone, without interference. A rival is a drone that covers a
user who is attached to another one. It is better if its level exceeds that of the user's drone by
more than ``Constants.margin_db``; if it has been so for ``Constants.trigger_us`` without a break,
the user is handed over to it. If both are 0, the user is always attached to the drone with the
highest level, of several the one with the lowest index. Levels that differ by rounding count
as equal (``model.radio.links.EQUAL_DB``).
"""

from __future__ import annotations

from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rules import words
from desim_uav.rules.air import known_until_us, passes_us
from desim_uav.rules.attachment import attach, detach
from desim_uav.rules.due import association_slot, due, key, undo
from desim_uav.rules.rows import Constants, Path, State, User


@rare_rule
def settle_levels(world: Constants, path: Path, state: State, phase: int) -> None:
    """Attach loose users to the drones that they receive best, and hand others over.

    All of them are ``unsettled``: their drones have changed, or something is due for them now.
    """
    for k in range(len(state.unsettled)):
        user, taken = state.users[state.unsettled[k]], False
        links = state.links[user.index]
        if user.holder < 0 and user.covered > 0:
            _take(world, state, strongest(world, path, state, user, False), user, phase)
            taken = True
        elif user.holder >= 0 and links.turns_us == state.now_us:
            taken = _turn(world, path, state, user, phase)
        _await_better(world, path, state, user, taken, phase)
        links.unsettled = 0
    state.unsettled.clear()


@rule
def strongest(world: Constants, path: Path, state: State, user: User, rivals: bool) -> int:
    """Return the covering drone with the highest level now (ties: the lowest index), or -1.

    Of ``rivals``, only those count that have been better for long enough to take the user over.
    """
    best = -1
    for d in range(len(state.senders)):
        if (
            user.covering[d] >= 0
            and (not rivals or _may_take(world, state, user, d))
            and (best < 0 or passes_us(world, path, state, user, best, d, 0, 0.0) > state.now_us)
        ):
            best = d
    return best


@rule
def _may_take(world: Constants, state: State, user: User, rival: int) -> bool:
    """Return whether a rival has been better for long enough to take a user over now."""
    since_us = state.links[user.index].better_since[rival]
    long = since_us >= 0 and since_us + world.trigger_us <= state.now_us
    return rival != user.holder and (world.trigger_us == 0 or long)


@rule
def _await_better(
    world: Constants, path: Path, state: State, user: User, taken: bool, phase: int
) -> None:
    """Schedule what happens next to the levels that a user receives.

    What is due at this very instant happens immediately, and is logged under ``phase``. But a user
    who has been ``taken`` by a drone in this phase stays there for a microsecond.
    """
    for _ in range(2 * len(state.senders)):
        next_us = _foresee(world, path, state, user)
        if next_us != state.now_us or (taken and _takes_over(world, state, user)):
            break
        taken = _turn(world, path, state, user, phase) or taken
    links = state.links[user.index]
    if links.turns_us < words.NEVER:
        turns_us = max(links.turns_us, state.now_us + 1)
        place = key(words.ATTACHMENT, links.rival, user.index)
        due(state, association_slot(state, user.index), turns_us, place)


@rule
def _foresee(world: Constants, path: Path, state: State, user: User) -> int:
    """Write which rival becomes better, ceases to be so or takes over next, and return the time."""
    undo(state, association_slot(state, user.index))
    links = state.links[user.index]
    links.turns_us, links.rival = words.NEVER, -1
    for d in range(len(state.senders)):
        if user.covering[d] < 0 or user.holder < 0 or d == user.holder:
            links.better_since[d] = -1
            continue
        # The first of two drones is preferred if their levels are equal.
        since_us, one, other = links.better_since[d], user.holder, d
        preferred = int(since_us < 0)
        if not _lasts(world):
            one, other = min(d, user.holder), max(d, user.holder)
            preferred = int(one == user.holder)
        at_us = passes_us(world, path, state, user, one, other, preferred, -world.margin_db)
        if since_us >= 0 and since_us + world.trigger_us < at_us:
            at_us = since_us + world.trigger_us
        if at_us < links.turns_us and at_us <= known_until_us(state, d, user.holder):
            links.turns_us, links.rival = at_us, d
    return links.turns_us


@rule
def _lasts(world: Constants) -> bool:
    """Return whether rivals have to be better by a margin or for a time."""
    return bool(world.margin_db > 0.0 or world.trigger_us > 0)


@rule
def _takes_over(world: Constants, state: State, user: User) -> bool:
    """Return whether a user's rival, for which something is due now, takes the user over."""
    links = state.links[user.index]
    since_us = links.better_since[links.rival]
    return not _lasts(world) or (since_us >= 0 and state.now_us >= since_us + world.trigger_us)


@rare_rule
def _turn(world: Constants, path: Path, state: State, user: User, phase: int) -> bool:
    """Let a user's rival become better now, cease to be so, or take the user over.

    Of several that may take it over now, the strongest does. Returns whether the user has changed
    drones. Nothing happens if the rival no longer covers the user.
    """
    links = state.links[user.index]
    if user.covering[links.rival] < 0:
        return False
    if not _takes_over(world, state, user):
        since_us = links.better_since[links.rival]
        links.better_since[links.rival] = state.now_us if since_us < 0 else -1
        return False
    rival = strongest(world, path, state, user, True)
    detach(state, state.senders[user.holder], user, phase)
    _take(world, state, rival, user, phase)
    return True


@rule
def _take(world: Constants, state: State, drone: int, user: User, phase: int) -> None:
    """Attach a user to a drone; all times to trigger begin anew, because the drone has changed."""
    attach(world, state, state.senders[drone], user, phase)
    links = state.links[user.index]
    for d in range(len(state.senders)):
        links.better_since[d] = -1
