"""What drones that are asked when they are free have decided, from the log of the engine."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from desim_uav.engine.base import EpisodeLog, Step
from desim_uav.model.rules import Mode
from tests.reference.inputs import US, Decision, Inputs, Result


def decided_us(log: EpisodeLog, drone: int) -> list[int]:
    """The times at which a drone has been asked."""
    return [event[0] for event in log.events if event[2] == "decide" and event[3] == drone]


def commands_of(log: EpisodeLog, commands: list[list[Any]]) -> list[list[Any]]:
    """The commands that each drone has followed, from those of all drones at each epoch."""
    epochs = {t_us: k for k, t_us in enumerate(sorted({0, *(step.t_us for step in log.steps)}))}
    drones = range(len(commands[0]))
    return [[commands[epochs[us]][d] for us in decided_us(log, d)] for d in drones]


def decisions_of(log: EpisodeLog, inputs: Inputs) -> tuple[list[list[Decision]], list[float]]:
    """Each drone's decisions, and what it has gained after the last one.

    A drone that replaces a crashed one is recorded as the crashed one: of the moment before,
    nothing is known but its full battery.
    """
    decisions, rest = [], []
    for drone in range(len(inputs.starts)):
        rows = [step for step in log.steps if step.drone == drone]
        asked_us = decided_us(log, drone)
        spans = pairwise([*asked_us, inputs.steps * inputs.step_us + 1])
        gained = [_gained(rows, since, until, inputs) for since, until in spans]
        before = {row.t_us: row for row in rows}
        found = []
        for t_us, gain in zip(asked_us, [0.0, *gained], strict=False):
            after = next(row for row in rows if row.t_us > t_us)
            found.append(_decision(before.get(t_us), after, t_us, gain, inputs.capacity))
        decisions.append(found)
        rest.append(gained[-1])
    return decisions, rest


def _decision(
    before: Step | None, after: Step, t_us: int, gained: float, full: int | None
) -> Decision:
    took = after.action_taken.name.lower()
    if before is None or before.mode is Mode.CRASHED:
        return Decision(t_us, took, None, full, (), None, gained)
    held = tuple(range(before.attached_users))  # how many, not who
    here = (before.x_m, before.y_m, before.z_m)
    return Decision(t_us, took, here, before.charge, held, before.return_drain, gained)


def _gained(rows: list[Step], since_us: int, until_us: int, inputs: Inputs) -> float:
    """The rewards of the epochs after one decision up to the next, discounted to the former."""
    gained, before_us = 0.0, since_us
    for row in rows:
        if since_us < row.t_us <= until_us:
            discount = inputs.gamma ** ((before_us - since_us) / inputs.step_us)
            gained += discount * row.reward
            before_us = row.t_us
    return gained


def totals(decisions: list[list[Decision]], rest: list[float]) -> dict[str, float]:
    """Sums over all decisions: what converges as ``dt`` goes to 0."""
    every = [decision for own in decisions for decision in own]
    return {
        "decided_s": sum(decision.t_us for decision in every) / US,
        "battery_s": sum(decision.charge or 0 for decision in every) / US,
        "gained": sum(decision.gained for decision in every) + sum(rest),
    }


def totals_of(result: Result) -> dict[str, float]:
    """The same of the fixed-step simulator."""
    return totals(result.decisions, result.rest)
