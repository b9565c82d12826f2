"""The charge of drones' batteries at any time of an episode."""

from __future__ import annotations

from collections.abc import Sequence

from desim_uav.errors import PolicyError
from desim_uav.model.battery import charged_us
from desim_uav.model.rules import US
from desim_uav.report.run import Run

Knot = tuple[int, int]
"""A time and the charge at that time, both in microseconds; the charge is linear in between."""


def batteries_before_us(run: Run, episode: int) -> list[int]:
    """Return each drone's charge at the start of an episode: full, or that of the episode before.

    Raises PolicyError if the table of steps lacks it.
    """
    drones, battery = run.scenario.drones.count, run.scenario.drones.battery
    assert battery is not None
    steps = run.of("steps", episode - 1)
    ends = steps[steps["step"] == run.scenario.episode.steps - 1].sort_values("drone")
    ended = battery.on_crash == "end_episode" and ends["crashed"].any()
    if not run.settings.carry_over or len(ends) != drones or ended:
        return [run.world.capacity_us] * drones
    if ends["battery_s"].isna().any():
        raise PolicyError(f"{run.folder / 'steps.parquet'}: battery_s: a value is missing")
    return [round(battery_s * US) for battery_s in ends["battery_s"]]


def battery_knots(
    begins_with_us: int,
    records: Sequence[Knot],
    events: Sequence[tuple[int, str]],
    capacity_us: int,
    full_charge_us: int,
) -> list[Knot]:
    """Return the charge of a battery: its records, and exact values at events between them.

    ``events`` are times and kinds of a drone's events, in order. A battery is empty at a crash, and
    full after charging and in a replacement. The charge at landing is computed backwards from the
    charging that follows, so it does not depend on the energy model.
    """
    knots = [(0, begins_with_us), *records]
    for k, (t_us, kind) in enumerate(events):
        if kind == "crash":
            knots.append((t_us, 0))
        elif kind == "respawn":
            knots += [(t_us, 0), (t_us, capacity_us)]
        elif kind == "charged":
            knots.append((t_us, capacity_us))
        elif kind in ("land", "charge"):
            held_us = _on_landing(events[k:], records, capacity_us, full_charge_us)
            knots.append((t_us, held_us))
    # The sort is stable: jumps keep their order, and a replacement at a record comes after it.
    return sorted(knots, key=lambda knot: knot[0])


def _on_landing(
    events: Sequence[tuple[int, str]],
    records: Sequence[Knot],
    capacity_us: int,
    full_charge_us: int,
) -> int:
    """Return the charge of a drone that lands or begins to charge at the first of these events."""
    charge_us = next((t_us for t_us, kind in events if kind == "charge"), None)
    if charge_us is None:  # it waits for a pad until the end
        return records[-1][1]
    full_at_us = next((t_us for t_us, kind in events if kind == "charged"), None)
    held_us, when_us = records[-1][1], records[-1][0]
    if full_at_us is not None:
        held_us, when_us = capacity_us, full_at_us
    gained_us = charged_us(0, when_us - charge_us, capacity_us, full_charge_us)
    return min(capacity_us, max(0, held_us - gained_us))
