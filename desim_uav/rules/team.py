"""The observation ``team``: what a drone finds around it, and what the other drones report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from desim_uav.model.observations import Feature, RowObservation
from desim_uav.model.rules import US, Mode
from desim_uav.model.state import Facts
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rule
from desim_uav.rules.battery import capacity_of, is_limited
from desim_uav.rules.observations import Local, clear_from, write_local
from desim_uav.rules.rows import Constants, Drone, State

MOST_OTHERS = 100
"""The largest number of other drones that an observation can show."""

MODES = tuple(mode.name.lower() for mode in Mode)


@register("observation", "team")
@dataclass(frozen=True)
class Team(RowObservation):
    """The features of ``local``, and those of other drones: places, modes and batteries.

    Of each other drone it shows how far it is to the east and to the north (from -1 to 1, over the
    size of the map), in 3D how far above (over the number of levels), its mode (1 for the one that
    it is in, 0 for the others) and its charge (over the capacity); without a battery only whether
    it flies. Places are where drones believe themselves to be.
    """

    others: Annotated[int, Ge(0), Le(MOST_OTHERS)] = 0
    """How many other drones are shown; 0: all. If there are fewer, the rest of the features are 0.
    """
    nearest_first: bool = True
    """Whether they are ordered by their distance on the map (ties: the lower index first), or else
    by their indices. If there are more than are shown, the first are."""

    information = "team"

    def features(self, facts: Facts) -> tuple[Feature, ...]:
        """Return the features, all real numbers."""
        modes = MODES if facts.some_charge else MODES[:1]
        away = ["east", "north"] + ["up"] * facts.three_d
        rest = [*modes, *["battery"] * facts.some_charge]
        of_others = [
            Feature(f"other{k}_{name}", -1.0 if name in away else 0.0, 1.0, False)
            for k in range(self.others or facts.drones - 1)
            for name in (*away, *rest)
        ]
        return (*Local().features(facts), *of_others)

    def write(self, world: Constants, state: State, drone: Drone) -> None:
        """Write the features, all real numbers, into ``drone.features``."""
        k = write_local(world, state, drone)
        clear_from(drone.features, k)
        far_2, other = -1.0, -1
        for _ in range(min(self.others or len(state.drones) - 1, len(state.drones) - 1)):
            far_2, other = _next(world, state, drone, self.nearest_first, far_2, other)
            k = _write_other(world, state, drone, state.drones[other], k)

    def expected_features(self, drones: int, services: int) -> int:
        """Return a bound on the number of features of a drone."""
        return super().expected_features(drones, services) + 10 * (self.others or drones - 1)


@rule
def _next(
    world: Constants, state: State, drone: Drone, nearest: bool, far_2: float, last: int
) -> tuple[float, int]:
    """Return the drone that follows another one in the order, and its squared distance in metres.

    The other one is drone ``last`` at the squared distance ``far_2``. If the order is not that of
    distances (``nearest``), all of them are 0.
    """
    own, found_2, follower = state.observations[drone.index], -1.0, -1
    for d in range(len(state.drones)):
        observation, away_2 = state.observations[d], 0.0
        if nearest:
            east_m = (observation.x - own.x) * world.cell_x_m
            north_m = (observation.y - own.y) * world.cell_y_m
            away_2 = east_m * east_m + north_m * north_m
        follows = away_2 > far_2 or (away_2 == far_2 and d > last)
        if d != drone.index and follows and (follower < 0 or away_2 < found_2):
            found_2, follower = away_2, d
    return found_2, follower


@rule
def _write_other(world: Constants, state: State, drone: Drone, other: Drone, k: int) -> int:
    """Write the features of another drone from ``k`` on; return where the next ones begin."""
    own, observation, out = (
        state.observations[drone.index],
        state.observations[other.index],
        drone.features,
    )
    out[k] = (observation.x - own.x) / world.nx
    out[k + 1] = (observation.y - own.y) / world.ny
    k += 2
    if world.three_d:
        out[k] = (observation.level - own.level) / world.levels_under_ceiling
        k += 1
    out[k + observation.mode] = 1.0
    if not world.limited:
        return k + 1
    out[k + len(MODES)] = 1.0
    if is_limited(world, other):
        out[k + len(MODES)] = (observation.charge / US) / (capacity_of(world, other) / US)
    return k + len(MODES) + 1
