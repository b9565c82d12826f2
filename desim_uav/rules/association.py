"""Association by level: users are handed over to drones that they receive better.

A level is the received power of a drone, without interference. A rival is a drone that covers a
user who is attached to another one. It is better if its level exceeds that of the user's drone by
``Constants.margin_db`` or more; if it has been so for ``Constants.trigger_us`` without a break, the
user is handed over to it. If both are 0, the user is always attached to the drone with the highest
level, of several the one with the lowest index.
"""

from __future__ import annotations

from desim_uav.model.compiled_rows import call_for_int
from desim_uav.model.kernels import rare_rule, rule
from desim_uav.rules import words
from desim_uav.rules.attachment import attach, detach
from desim_uav.rules.due import association_slot, due, key, undo
from desim_uav.rules.rows import Constants, Path, State, User


@rare_rule
def settle_levels(world: Constants, path: Path, state: State, phase: int) -> None:
    """Attach loose users to the drones that they receive best, and look at all unsettled users."""
    for k in range(len(state.loose)):
        user = state.users[state.loose[k]]
        if user.holder < 0 and user.covered > 0:
            _take(world, state, strongest(world, path, state, user, False), user, phase)
    for k in range(len(state.unsettled)):
        user = state.users[state.unsettled[k]]
        await_better(world, path, state, user, phase)
        user.unsettled = 0
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
    """Return whether a drone may take a user over now, if it is as good as one that does."""
    since_us = user.better_since[rival]
    long = since_us >= 0 and since_us + world.trigger_us <= state.now_us
    return rival != user.holder and (world.trigger_us == 0 or long)


@rule
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
    """Return when the level of drone ``one`` exceeds that of ``other`` by a margin, or ceases to.

    ``better`` says that it does until now, with which the levels at this very instant may already
    disagree. The time is NEVER if nothing changes while both drones' legs are known
    (``known_until_us``).
    """
    own = (world, path, state, user, one, other, better, margin_db)
    return call_for_int(world.passes_us, own)


@rule
def known_until_us(state: State, one: int, other: int) -> int:
    """Return until when the legs of two drones are known, and so the levels received from them."""
    return min(state.senders[one].until_us, state.senders[other].until_us)


@rule
def await_better(world: Constants, path: Path, state: State, user: User, phase: int) -> None:
    """Schedule what happens next to the levels that a user receives.

    What is due at this very instant happens immediately, and is logged under ``phase``.
    """
    for _ in range(2 * len(state.senders)):
        next_us = _foresee(world, path, state, user)
        if next_us != state.now_us:
            break
        turn(world, path, state, user, phase)
    if user.turns_us < words.NEVER:
        # Rounding may put drones of equal levels into no order: a user waits for a microsecond.
        turns_us = max(user.turns_us, state.now_us + 1)
        place = key(words.ATTACHMENT, user.rival, user.index)
        due(state, association_slot(state, user.index), turns_us, place)


@rule
def _foresee(world: Constants, path: Path, state: State, user: User) -> int:
    """Write which rival becomes better, ceases to be or takes over next, and when; return this."""
    undo(state, association_slot(state, user.index))
    user.turns_us, user.rival = words.NEVER, -1
    for d in range(len(state.senders)):
        if user.covering[d] < 0 or user.holder < 0 or d == user.holder:
            user.better_since[d] = -1
            continue
        if world.margin_db > 0.0 or world.trigger_us > 0:
            since_us = user.better_since[d]
            better, margin_db = int(since_us >= 0), world.margin_db
            at_us = passes_us(world, path, state, user, d, user.holder, better, margin_db)
            if since_us >= 0 and since_us + world.trigger_us < at_us:
                at_us = since_us + world.trigger_us
        else:  # of two equal levels, that of the drone with the lower index counts as higher
            low, high = min(d, user.holder), max(d, user.holder)
            held = int(low == user.holder)
            at_us = passes_us(world, path, state, user, low, high, held, 0.0)
        if at_us < user.turns_us and at_us <= known_until_us(state, d, user.holder):
            user.turns_us, user.rival = at_us, d
    return user.turns_us


@rare_rule
def turn(world: Constants, path: Path, state: State, user: User, phase: int) -> None:
    """Let a user's rival become better now, cease to be, or take the user over.

    Of several that may take it over now, the strongest does.
    """
    rival, lasts = user.rival, world.margin_db > 0.0 or world.trigger_us > 0
    since_us = user.better_since[rival]
    if lasts and since_us < 0:
        user.better_since[rival] = state.now_us
    elif lasts and state.now_us < since_us + world.trigger_us:
        user.better_since[rival] = -1
    else:
        rival = strongest(world, path, state, user, True)
        detach(state, state.senders[user.holder], user, phase)
        _take(world, state, rival, user, phase)


@rule
def _take(world: Constants, state: State, drone: int, user: User, phase: int) -> None:
    """Attach a user to a drone; all times to trigger begin anew, because they are against it."""
    attach(world, state, state.senders[drone], user, phase)
    for d in range(len(state.senders)):
        user.better_since[d] = -1
