"""What a least distance of drones does not go with."""

from __future__ import annotations

from collections.abc import Iterator

from desim_uav.scenario.finding import Finding
from desim_uav.scenario.schema import Scenario

MOST_APART = 200
"""The largest number of drones whose distances are looked at: each two of them are a pair."""


def drones_can_keep_apart(scenario: Scenario) -> Iterator[Finding]:
    """Too many pairs of drones, or drones that give way without a least distance."""
    if scenario.separation_m is None:
        if scenario.on_conflict != "log":
            yield Finding(
                ("on_conflict",), "needs separation_m, the least distance", (("separation_m",),)
            )
        return
    if scenario.drone_count > MOST_APART:
        yield Finding(
            ("separation_m",),
            f"for {scenario.drone_count} drones; at most {MOST_APART}",
            tuple((*key, "count") for key in scenario.fleet_keys),
        )
