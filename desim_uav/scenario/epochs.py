"""Decision epochs of a scenario: how many there can be, and what cannot be decided by event."""

from __future__ import annotations

from collections.abc import Iterator

from desim_uav.model.motion.motion import transits_over
from desim_uav.model.motion.planner import HOPS
from desim_uav.model.motion.wind import motion_in
from desim_uav.model.rules import US
from desim_uav.scenario.drones import Drones, flies_freely
from desim_uav.scenario.finding import Finding
from desim_uav.scenario.schema import Scenario
from desim_uav.scenario.yaml12 import KeyPath


def most_epochs(scenario: Scenario) -> int:
    """Return the largest number of decision epochs in an episode after the first one.

    If drones are asked by event, a drone is asked at most twice per shortest leg: after it, and
    after a charge. It is not replaced sooner than that after a crash. A leg that an episode takes
    over from the one before may end at once; it is the one more that is counted.
    """
    if not scenario.decisions.by_event:
        return scenario.episode.steps
    horizon_s, epochs = scenario.episode.steps * scenario.episode.step_s, 1
    for drones in scenario.fleet:
        legs = int(horizon_s / min(shortest_leg_s(scenario, drones), horizon_s)) + 1
        epochs += 2 * drones.count * legs
    return epochs


def shortest_leg_s(scenario: Scenario, drones: Drones) -> float:
    """Return the shortest time from a command to the next one in serving flight, in seconds."""
    if flies_freely(drones):  # a leg may be short, but then the drone hovers
        return scenario.decisions.patience_s
    sizes = zip(scenario.map.cell_m, scenario.map.cells, strict=True)
    hops_m = [size_m if count > 1 else 0.0 for size_m, count in sizes]
    hops_m.append(scenario.map.levels.step_m if scenario.three_d else 0.0)
    step_s = scenario.episode.step_s
    moves_s = [
        transits_over(motion_in(drones.motion, scenario.wind_mps, way), hop_m, step_s)[
            -1
        ].duration_us
        / US
        for way in HOPS
        if (hop_m := sum(abs(d) * size_m for d, size_m in zip(way, hops_m, strict=True))) > 0.0
    ]
    return min(scenario.decisions.patience_s, *moves_s, step_s)


def decisions_by_event_fit_the_scenario(scenario: Scenario) -> Iterator[Finding]:
    """Yield a finding for each thing that is refused beside decisions by event."""
    if not scenario.decisions.by_event:
        return
    for drones, path in zip(scenario.fleet, scenario.fleet_keys, strict=True):
        yield from _replaced_too_early(scenario, drones, path)


def _replaced_too_early(scenario: Scenario, drones: Drones, path: KeyPath) -> Iterator[Finding]:
    """Drones that are replaced before others have lost their patience, and could be without end."""
    battery, patience_s = drones.battery, scenario.decisions.patience_s
    if battery is None or battery.on_crash != "respawn":
        return
    if battery.respawn_after_min * 60.0 < patience_s:
        yield Finding(
            (*path, "battery", "respawn_after_min"),
            f"must be at least decisions.patience_s, {patience_s:g} s, beside decisions: event",
            (("decisions",),),
        )
