"""The seam between the rules and an engine's clock: what is to happen, and when.

Whatever can happen has a slot of its own, so that nothing that was foreseen is ever stale: a slot
is set anew or cleared. Things of one instant happen in the order of their keys.
"""

from __future__ import annotations

from typing import Any

from desim_uav.model.kernels import rule
from desim_uav.rules.rows import State


@rule
def key(phase: int, drone: int, user: int) -> int:
    """Return the place within an instant: by phase, drone and user (-1: none, first)."""
    return phase * (1 << 48) + (drone + 1) * (1 << 24) + user + 1


def due(state: Any, slot: int, t_us: int, key: int) -> None:
    """Let the thing of a slot happen at a time, at its place in that instant."""
    state.clock.due(slot, t_us, key)


def undo(state: Any, slot: int) -> None:
    """Let the thing of a slot not happen."""
    state.clock.undo(slot)


def nothing_before(state: Any, key: int) -> bool:
    """Return whether it is known that nothing else of this instant comes before a place."""
    return bool(state.clock.nothing_before(key))


def nothing_due(state: Any) -> None:
    """Clear all slots."""
    state.clock.clear()


# ---- the slots


@rule
def completion_slot(state: State, user: int) -> int:
    """Return the slot of the completion of a user's request."""
    return user


@rule
def ask_slot(state: State, user: int) -> int:
    """Return the slot of a user's next request."""
    return len(state.users) + user


@rule
def crossing_slot(state: State, drone: int) -> int:
    """Return the slot of the next crossing of a drone's footprint."""
    return 2 * len(state.users) + drone


@rule
def arrival_slot(state: State, drone: int) -> int:
    """Return the slot of the end of a drone's transit, hop or charge."""
    return 2 * len(state.users) + len(state.drones) + drone


@rule
def depletion_slot(state: State, drone: int) -> int:
    """Return the slot of an empty battery."""
    return 2 * len(state.users) + 2 * len(state.drones) + drone


@rule
def settle_slot(state: State) -> int:
    """Return the slot of attachment and admission."""
    return 2 * len(state.users) + 3 * len(state.drones)


def slots(users: int, drones: int) -> int:
    """Return how many slots there are."""
    return 2 * users + 3 * drones + 1
