"""Access points serve all the time: what happens to their links is computed for a step ahead.

By clock, a step begins with each decision epoch. By event, it may end between two of them; an event
of its own then computes the next step.
"""

from __future__ import annotations

from desim_uav.rowcode.kernels import apart, rare_rule
from desim_uav.rules import words
from desim_uav.rules.coverage import track
from desim_uav.rules.due import due, key, renewal_slot
from desim_uav.rules.rows import Constants, Path, State
from desim_uav.rules.settle import settle


@apart
def serve_from_points(world: Constants, path: Path, state: State, span_us: int, phase: int) -> None:
    """Let the access points serve users in the next ``span_us``."""
    for d in range(len(state.drones), len(state.senders)):
        track(world, path, state, state.senders[d], span_us, phase)


@rare_rule
def serve_on(world: Constants, path: Path, state: State) -> None:
    """Let the access points serve for another step, if their present one ends now."""
    if state.senders[len(state.drones)].until_us > state.now_us:
        return
    serve_from_points(world, path, state, world.step_us, words.COVERAGE)
    if state.renews:
        # An epoch at that time comes first, and schedules another time.
        next_us = state.now_us + world.step_us
        due(state, renewal_slot(state), next_us, key(words.COVERAGE, -1, -1))


@rare_rule
def on_renewal(world: Constants, path: Path, state: State) -> None:
    """Let the access points serve on between two decision epochs."""
    serve_on(world, path, state)
    settle(world, path, state, words.COVERAGE, words.ADMISSION)
