"""The event queue as the rules see it; each engine has an implementation of its own.

Each thing that can happen (for instance the next arrival of drone 2) has a slot, which holds at
most one event. A new time replaces the old one, so the queue never contains an outdated event.
Events of one instant happen in the order of their keys.
"""

from __future__ import annotations

from typing import Any

from desim_uav.rowcode.kernels import rule
from desim_uav.rules.rows import State


@rule
def key(phase: int, drone: int, user: int) -> int:
    """Return the rank of an event in its instant: by phase, drone and user (-1, none, is first)."""
    return phase * (1 << 48) + (drone + 1) * (1 << 24) + user + 1


def due(state: Any, slot: int, t_us: int, key: int) -> None:
    """Schedule the event of a slot for a time; ``key`` is its rank in that instant."""
    state.clock.due(slot, t_us, key)


def undo(state: Any, slot: int) -> None:
    """Cancel the event of a slot, if one is scheduled."""
    state.clock.undo(slot)


def nothing_before(state: Any, key: int) -> bool:
    """Return True only if no event of this instant precedes ``key``; False may be over-cautious."""
    return bool(state.clock.nothing_before(key))


def run_until(state: Any, t_us: int, key: int) -> None:
    """Let the engine run until a place in an instant, which replaces the one that it had.

    The compiled engine reads ``State.next_us`` instead.
    """
    state.clock.run_until(t_us, key)


def nothing_due(state: Any) -> None:
    """Cancel all scheduled events."""
    state.clock.clear()


# ---- the slots


@rule
def completion_slot(state: State, user: int) -> int:
    """Return the slot for the completion of a user's request."""
    return user


@rule
def ask_slot(state: State, user: int) -> int:
    """Return the slot for a user's next request."""
    return len(state.users) + user


@rule
def crossing_slot(state: State, drone: int) -> int:
    """Return the slot for the next user who enters or leaves the footprint of a sender."""
    return 2 * len(state.users) + drone


@rule
def arrival_slot(state: State, drone: int) -> int:
    """Return the slot for the end of a drone's transit, hop or charge."""
    return 2 * len(state.users) + len(state.senders) + drone


@rule
def depletion_slot(state: State, drone: int) -> int:
    """Return the slot for the depletion of a drone's battery."""
    return 2 * len(state.users) + len(state.senders) + len(state.drones) + drone


@rule
def settle_slot(state: State) -> int:
    """Return the slot for attachment and admission, which all drones share."""
    return 2 * len(state.users) + len(state.senders) + 2 * len(state.drones)


@rule
def association_slot(state: State, user: int) -> int:
    """Return the slot for the next drone that a user receives better, or no longer so."""
    return settle_slot(state) + 1 + user


@rule
def separation_slot(state: State) -> int:
    """Return the slot for the next pair of drones to look at."""
    return settle_slot(state) + 1 + (len(state.users) if state.by_level else 0)


@rule
def renewal_slot(state: State) -> int:
    """Return the slot for the next look at access points between two decision epochs."""
    return separation_slot(state) + 1


@rule
def deadline_slot(state: State, user: int) -> int:
    """Return the slot for the instant at which a user's task is late."""
    return renewal_slot(state) + 1 + user


@rule
def own_slot(state: State, user: int) -> int:
    """Return the slot for the instant at which a user's own processor is done."""
    return deadline_slot(state, len(state.users)) + user


@rule
def upload_slot(state: State, sender: int) -> int:
    """Return the slot for the delivery of the first update in a sender's store by its backhaul."""
    return own_slot(state, len(state.users)) + sender


def slots(state: State) -> int:
    """Return the number of slots for a state.

    Only if users are associated ``by_level`` there are those of ``association_slot``, only if there
    are pairs of drones that of ``separation_slot``, only if access points are looked at between
    two epochs that of ``renewal_slot``, only if there are tasks those of ``deadline_slot`` and
    ``own_slot``, and only if stored updates go over backhauls those of ``upload_slot``.
    Those before the last ones that are needed are there too.
    """
    if state.uploads:
        return upload_slot(state, len(state.senders))
    if state.keeps_tasks:
        return own_slot(state, len(state.users))
    if state.renews:
        return renewal_slot(state) + 1
    return separation_slot(state) + (1 if len(state.pairs) > 0 else 0)
