"""The world of a run, which never changes: map, buildings, stations, clusters, homes, physics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.commands import Commands, commands_for
from desim_uav.copies import Unchanging
from desim_uav.drone_type import DroneType
from desim_uav.errors import ScenarioError
from desim_uav.geodata.attribution import together
from desim_uav.links import Links, links_of
from desim_uav.model.backhaul import Backhaul
from desim_uav.model.catalogue import Catalogue
from desim_uav.model.demand.requests import Requests, joined_episodes
from desim_uav.model.energy.charging import Charging
from desim_uav.model.geometry.grid import Cell, Grid, altitudes
from desim_uav.model.mobility.walking import ManyRowWalks, RowMobility, RowWalks, compiled_walk
from desim_uav.model.mobility.walks import Area, Walks, joined_walks
from desim_uav.model.motion.motion import Transit
from desim_uav.model.motion.planner import Planner
from desim_uav.model.motion.space import require_free
from desim_uav.model.observations import Feature
from desim_uav.model.random.streams import Purpose, Seeds
from desim_uav.model.rules import US, Choice
from desim_uav.model.state import Facts
from desim_uav.placement import draw_city, draw_clusters, draw_homes
from desim_uav.registry import naming_plug_ins
from desim_uav.scenario import cost, layout
from desim_uav.scenario.epochs import most_epochs
from desim_uav.scenario.facts import Pairs, as_html, as_text
from desim_uav.scenario.processor import Processor
from desim_uav.scenario.schema import Scenario
from desim_uav.user_group import UserGroup, groups_of, shared_mobility, whose_streets


@dataclass(frozen=True, eq=False)
class World(Unchanging):
    """A drawn world, which copies of environments and engines share.

    Cells are (ix, iy). ``clusters`` has rows of x, y and radius, and ``homes`` rows of x, y and z,
    all in metres.
    """

    scenario: Scenario
    seed: int
    grid: Grid
    stations: tuple[Cell, ...]
    starts: tuple[Cell, ...]
    clusters: NDArray[np.float64]
    homes: NDArray[np.float64]

    def __repr__(self) -> str:
        return as_text(f"World {self.seed} of {self.scenario.name}", self._facts())

    def _repr_html_(self) -> str:
        return as_html(f"World {self.seed} of {self.scenario.name}", self._facts())

    def _facts(self) -> Pairs:
        """Return what was drawn, in words."""
        clusters = f", in {len(self.clusters)} cluster(s)" if len(self.clusters) else ""
        return [
            ("map", f"{self.grid.width_m:g} × {self.grid.depth_m:g} m"),
            ("cells", " × ".join(map(str, self.grid.height_m.shape))),
            ("levels", ", ".join(f"{level:g}" for level in self.grid.levels_m) + " m"),
            ("buildings", self.grid.buildings),
            ("stations", _cells(self.stations)),
            ("drones", _cells(self.starts)),
            ("users", f"{len(self.homes)}" + clusters),
        ]

    @cached_property
    def area(self) -> Area:
        """The size of the map in metres."""
        return Area(self.grid.width_m, self.grid.depth_m)

    @cached_property
    def actions(self) -> tuple[Choice, ...]:
        """The actions of all drones. A command is an index into this tuple.

        A drone whose battery is unlimited takes none of those of charging, which are the last ones.
        If only some types fly freely, the actions are those of flight from cell to cell and then
        ``FLY``. A mask allows a drone only what its own type has (``DroneType.actions``).
        """
        return self.commands.actions

    @cached_property
    def commands(self) -> Commands:
        """The commands that the drones can be given."""
        return commands_for(self.scenario, self.types)

    @cached_property
    def _flying_by_cells(self) -> DroneType | None:
        """The first type that flies from cell to cell, with whose moves those of others agree."""
        return next((own for own in self.types if not own.free), None)

    @cached_property
    def free(self) -> bool:
        """Whether drones, or some types of them, fly freely and not from cell to cell."""
        return self.scenario.free

    @cached_property
    def mixed(self) -> bool:
        """Whether some types of drones fly freely and others from cell to cell."""
        return self.scenario.mixed

    @cached_property
    def epoch_moves(self) -> dict[Choice, Transit]:
        """The transits of a type's moves: those of the first type that flies from cell to cell.

        Other such types have as many, in the same order. There are none if all drones fly freely.
        """
        return self._flying_by_cells.epoch_transits if self._flying_by_cells is not None else {}

    @property
    def dimensions(self) -> int:
        """The number of dimensions of the map: 2 or 3."""
        return self.scenario.map.dimensions

    @cached_property
    def types(self) -> tuple[DroneType, ...]:
        """The types of drones, in the order of the scenario."""
        return tuple(
            DroneType(drones, self.scenario, self.grid, self.stations)
            for drones in self.scenario.fleet
        )

    @cached_property
    def type_numbers(self) -> tuple[int, ...]:
        """The number of each drone's type."""
        return self.scenario.type_numbers

    def type_of(self, drone: int) -> DroneType:
        """Return the type of a drone."""
        return self.types[self.type_numbers[drone]]

    @cached_property
    def only_type(self) -> DroneType:
        """The type of all drones. Raises ScenarioError if there are types that differ."""
        return self.require_one_type("what was asked for")

    def require_one_type(self, what: str) -> DroneType:
        """Return the type of all drones.

        Raises ScenarioError, which says that ``what`` needs it, if there are types that differ.
        """
        self.scenario.require_one_type(what)
        return self.types[0]

    @cached_property
    def planners(self) -> tuple[Planner, ...]:
        """The planners of returns, each of one or more types of drones."""
        planners: list[Planner] = []
        for planner in (each.planner for each in self.types if each.limited and not each.free):
            if not any(planner.plans_as(other) for other in planners):
                planners.append(planner)
        return tuple(planners)

    def planner_number(self, number: int) -> int:
        """Return the number of the planner of a type of drones; 0 if it never returns."""
        own = self.types[number]
        if not own.limited or own.free:
            return 0
        return next(k for k, each in enumerate(self.planners) if each.plans_as(own.planner))

    @cached_property
    def user_groups(self) -> tuple[UserGroup, ...]:
        """The groups of users, in the order of the scenario."""
        return groups_of(self.scenario)

    @cached_property
    def stream_numbers(self) -> NDArray[np.int64]:
        """The number (users,) of each user's random streams, and in the draws of its links."""
        own = [group.first_stream + np.arange(group.count) for group in self.user_groups]
        return np.concatenate(own)

    @property
    def services(self) -> Catalogue:
        """The services as arrays, with the probabilities of the mix of the first group of users."""
        return self.user_groups[0].services

    @cached_property
    def senses(self) -> tuple[int, ...]:
        """The number of the service whose updates each user sends as a sensor; -1 for others.

        It is empty if nobody is a sensor.
        """
        own = [group.senses for group in self.user_groups for _ in range(group.count)]
        return tuple(own) if max(own) >= 0 else ()

    def walks(self, seed: int, episode: int) -> Walks:
        """Draw the users' walks in an episode."""
        return self.walks_of(seed, [episode])[0].drawn()

    def walks_of(self, seed: Seeds, episodes: Sequence[int]) -> Sequence[Walks | RowWalks]:
        """Draw the users' walks in several episodes; compiled ones over rows are drawn later.

        ``seed`` is that of all episodes, or a sequence with that of each.
        """
        groups, homes, mobility = self.user_groups, self._homes_on_map, self.row_mobility
        if mobility is not None:
            own = [group.states(Purpose.MOBILITY, seed, episodes) for group in groups]
            states = np.concatenate(own, axis=1)
            return ManyRowWalks(mobility, homes, states, self.area, self.horizon_us)
        walks = (group.walks_of(homes, seed, episodes) for group in groups)
        return [joined_walks(parts) for parts in zip(*walks, strict=True)]

    @cached_property
    def row_mobility(self) -> RowMobility | None:
        """The mobility model if compiled code walks by it step by step, else None.

        If drones are asked by event, their legs overlap, and walks are drawn for whole episodes, as
        they are if groups of users walk by different models.
        """
        mobility: Any = shared_mobility(self.user_groups)
        return mobility if compiled_walk(mobility) and not self.by_event else None

    def requests(self, seed: int, episode: int) -> Requests:
        """Draw the users' requests in an episode."""
        return self.requests_of(seed, [episode])[0]

    def requests_of(self, seed: Seeds, episodes: Sequence[int]) -> Sequence[Requests]:
        """Draw the users' requests in several episodes at once."""
        return joined_episodes([own.requests_of(seed, episodes) for own in self.user_groups])

    @cached_property
    def _homes_on_map(self) -> NDArray[np.float64]:
        return np.ascontiguousarray(self.homes[:, :2])

    @cached_property
    def fixed_walks(self) -> Walks | None:
        """The walks of every episode if they are not random, else None."""
        drawn = any(getattr(group.mobility, "draws", True) for group in self.user_groups)
        return None if drawn else self.walks(0, 0)

    @cached_property
    def fixed_requests(self) -> Requests | None:
        """The requests of every episode if they are not random, else None."""
        drawn = any(getattr(group.law, "draws", True) for group in self.user_groups)
        return None if drawn else self.requests(0, 0)

    @property
    def facts(self) -> Facts:
        """The constants that rewards, observations and learners may use, of the drones' type."""
        number = self.types.index(self.only_type)
        return self.facts_of_types[number]

    def facts_of(self, drone: int) -> Facts:
        """Return the constants that a drone's rewards, observations and learners may use."""
        return self.facts_of_types[self.type_numbers[drone]]

    @cached_property
    def facts_of_types(self) -> tuple[Facts, ...]:
        """The constants that rewards, observations and learners may use, by type of drones."""
        scenario = self.scenario
        return tuple(
            Facts(
                self.grid,
                self.stations,
                self.clusters,
                scenario.drone_count,
                len(self.homes),
                self.services.names,
                scenario.episode.steps,
                self.step_us / US,
                scenario.three_d,
                each.capacity / each.drain_per_s if each.limited else None,
                links.both_hz / 1000,
                bool(links.radio.graded),
                scenario.limited_battery,
            )
            for each, links in zip(self.types, self.links, strict=False)
        )

    @cached_property
    def features_of_types(self) -> tuple[tuple[Feature, ...], ...]:
        """The features that learners observe of a drone, by its type."""
        return tuple(self.scenario.observation.features(facts) for facts in self.facts_of_types)

    def features_of(self, drone: int) -> tuple[Feature, ...]:
        """Return the features that learners observe of a drone."""
        return self.features_of_types[self.type_numbers[drone]]

    @property
    def most_features(self) -> int:
        """The number of features of drones that have the most of them."""
        return max(map(len, self.features_of_types))

    @cached_property
    def step_us(self) -> int:
        """The time between decision epochs, in microseconds."""
        return round(self.scenario.episode.step_s * US)

    @cached_property
    def horizon_us(self) -> int:
        """The length of an episode, in microseconds."""
        return self.step_us * self.scenario.episode.steps

    @cached_property
    def by_event(self) -> bool:
        """Whether a drone is asked when it is free, and not at each step."""
        return self.scenario.decisions.by_event

    @cached_property
    def patience_us(self) -> int:
        """How long a drone hovers until it is asked again, in microseconds."""
        return round(self.scenario.decisions.patience_s * US) if self.by_event else self.step_us

    @cached_property
    def most_epochs(self) -> int:
        """The largest number of decision epochs in an episode after the first one."""
        return most_epochs(self.scenario)

    @property
    def processors(self) -> tuple[Processor | None, ...]:
        """The processors of each type of drones, and then those of each access point."""
        types = [own.drones.processor for own in self.types]
        return (*types, *(point.processor for point in self.scenario.access_points))

    @property
    def backhauls(self) -> tuple[Backhaul | None, ...]:
        """The backhauls of each type of drones, and then those of each access point."""
        types = [own.drones.backhaul for own in self.types]
        return (*types, *(point.backhaul for point in self.scenario.access_points))

    @cached_property
    def links(self) -> tuple[Links, ...]:
        """The links of each type of drones, and then those of each access point."""
        return links_of(self.scenario, self.types, self.grid.levels_m, self.heights_m)

    @property
    def groups(self) -> NDArray[np.int64]:
        """The group (users,) of each user: users of one height are a group, with the same rings."""
        return self._groups[1]

    @property
    def heights_m(self) -> list[float]:
        """The height of each group of users, in metres."""
        return self._groups[0]

    @cached_property
    def _groups(self) -> tuple[list[float], NDArray[np.int64]]:
        """The height of each group of users in metres, and the group of each user."""
        heights_m, groups = np.unique(self.homes[:, 2], return_inverse=True)
        if not self.graded:
            heights_m, groups = heights_m[:1], np.zeros(len(self.homes), np.int64)
        return heights_m.tolist(), groups.reshape(-1).astype(np.int64)

    @cached_property
    def bandwidth_of_all_hz(self) -> float:
        """The bandwidth of all drones and access points together, in Hz; inf if it is unlimited."""
        counts = [drones.count for drones in self.scenario.fleet]
        counts += [1] * len(self.scenario.access_points)
        return sum(count * links.both_hz for count, links in zip(counts, self.links, strict=True))

    @cached_property
    def graded(self) -> bool:
        """Whether links of drones or access points have classes other than the paper's disc."""
        scenario = self.scenario
        any_graded = any(drones.radio.graded for drones in scenario.fleet)
        return bool(any_graded or scenario.access_points)

    @cached_property
    def in_air(self) -> bool:
        """Whether classes or levels have to be sought for in other ways than as rings."""
        return any(links.in_air for links in self.links)

    @cached_property
    def marked(self) -> bool:
        """Whether line of sight, or shadowing, of some links changes."""
        return any(links.radio.marked for links in self.links)

    @cached_property
    def reach_m(self) -> float:
        """The radius of the drones' widest class in metres; a micrometre if none holds anywhere."""
        return max(links.reach_m for links in self.links[: len(self.types)])

    @property
    def charging(self) -> Charging | None:
        """How the stations charge; None if batteries are unlimited."""
        return self.scenario.charging

    @property
    def attribution(self) -> str:
        """Whose data the buildings and the streets of the map are; "" if no file says so."""
        return together([self.grid.city.attribution, *whose_streets(self.scenario)])

    @property
    def in_joules(self) -> bool:
        """Whether some batteries are measured in microjoules, and not in time."""
        return any(each.in_joules for each in self.types)

    @property
    def all_in_joules(self) -> bool:
        """Whether the batteries of all drones are measured in microjoules."""
        return all(each.in_joules for each in self.types)


def _cells(cells: Sequence[Cell], most: int = 8) -> str:
    """Return how many cells there are, and which; the first ones of many."""
    more = ", …" if len(cells) > most else ""
    return f"{len(cells)}, in " + ", ".join(map(str, cells[:most])) + more if cells else "0"


@naming_plug_ins()
def build_world(scenario: Scenario, seed: int) -> World:
    """Draw the world of a scenario; ``seed`` is the world seed.

    Raises ScenarioError if an episode would cost more than any engine has on this machine, if no
    drawn map leaves the free cells connected, or if a cluster does not fit on the map.
    """
    cost.check_cost(scenario)
    stations, starts = layout.station_cells(scenario), layout.start_cells(scenario)
    city, height_m = draw_city(scenario, seed, {*stations, *starts})
    levels = scenario.map.levels
    levels_m: tuple[float, ...] = (levels.min_altitude_m,)
    under_ceiling, tallest_m = 1, max(height_m.max(), city.tallest_m)
    if scenario.three_d:
        levels_m, under_ceiling = altitudes(
            levels.min_altitude_m, levels.step_m, tallest_m, levels.max_altitude_m
        )
    width_m, depth_m = scenario.map.size_m
    grid = Grid(width_m, depth_m, height_m, levels_m, levels.step_m, under_ceiling, city)
    of_groups = draw_clusters(scenario, seed)
    homes, clusters = draw_homes(scenario, seed, grid, of_groups), np.concatenate(of_groups)
    world = World(scenario, seed, grid, tuple(stations), tuple(starts), clusters, homes)
    _check_spaces(world)
    return world


def _check_spaces(world: World) -> None:
    """Raise ScenarioError if drones that fly freely start, or charge, in an obstacle."""
    for key, own in zip(world.scenario.fleet_keys, world.types, strict=True):
        if not own.free:
            continue
        try:
            prisms = own.space.prisms
            for drone, cell in enumerate(world.starts):
                if world.type_of(drone) is own:
                    at = (*world.grid.centre(*cell), world.grid.levels_m[0])
                    require_free(prisms, at, f"the start of drone {drone}")
        except ValueError as error:
            where = ".".join(map(str, key))
            raise ScenarioError(f"{where}.motion: space: free: {error}") from error
