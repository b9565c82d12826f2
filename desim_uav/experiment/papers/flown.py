"""A flight of a paper, flown in the simulator: free flight from place to place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from desim_uav.experiment.run import Results, run
from desim_uav.model.state import Observation
from desim_uav.policies.function import FunctionPolicy
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world

SPEED_MPS, ACCELERATION_MPS2 = 50.0, 10_000.0
"""The papers' drones turn and stop at once. Here, a stop takes 5 ms."""

STOP_S = SPEED_MPS / ACCELERATION_MPS2

Place = tuple[float, float]


def flown(
    scenario: Mapping[str, Any],
    side_m: float,
    stops: Sequence[tuple[Place, int]],
    speed_mps: float = SPEED_MPS,
) -> Results:
    """Return the tables of a flight of one drone on a square map.

    Args:
        scenario: The keys of the scenario, without the map's size and how the drone flies.
        side_m: The side of the map in metres.
        stops: The places that the drone flies to, and for how many seconds it hovers at each. After
            the last one it hovers until the end of the episode.
        speed_mps: How fast it flies.
    """
    motion = {
        "space": "free",
        "reach": "map",
        "max_speed_mps": speed_mps,
        "max_acceleration_mps2": ACCELERATION_MPS2,
    }
    changes = {
        "map": {**scenario["map"], "size_m": [side_m, side_m], "dimensions": 2},
        "drones": {"battery": None, **scenario["drones"], "count": 1, "motion": motion},
        "stations": {"count": 1 if "battery" in scenario["drones"] else 0},
        "decisions": {"kind": "event", "patience_s": 1},
    }
    world = build_world(from_mapping({**scenario, **changes}), 0)
    wishes = [-1.0] * (world.scenario.fleet[0].battery is not None)
    commands = _commands(side_m, stops, wishes)

    def choose(observation: Observation, mask: Sequence[bool]) -> str | list[float]:
        return next(commands, "hover")

    return run(world, FunctionPolicy(choose), "flown", 0, keep_events=True)


def _commands(
    side_m: float, stops: Sequence[tuple[Place, int]], wishes: Sequence[float]
) -> Iterator[str | list[float]]:
    for place, lasts_s in stops:
        yield [*(2.0 * along_m / side_m - 1.0 for along_m in place), *wishes]
        for _ in range(lasts_s):
            yield "hover"
