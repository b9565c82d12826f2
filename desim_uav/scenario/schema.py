"""What a scenario says: frozen models whose attribute names are the keys of the file."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, cast

from pydantic import (
    BeforeValidator,
    Field,
    model_validator,
)

from desim_uav.errors import ScenarioError
from desim_uav.model.association import Association, EnteredFirst
from desim_uav.model.backhaul import Backhaul
from desim_uav.model.decisions import ByClock, Decisions
from desim_uav.model.demand.demand import Demand, Dynamic
from desim_uav.model.energy.charging import Charging, Constant
from desim_uav.model.mobility.mobility import Static
from desim_uav.model.motion.limits import CALM
from desim_uav.model.observations import Encoding
from desim_uav.model.offloading import RowOffloading
from desim_uav.model.radio.radio import LinkClasses, Radio
from desim_uav.model.rewards import Reward
from desim_uav.model.services import PAPER, Service
from desim_uav.rules.observations import Position
from desim_uav.rules.offloading import Always
from desim_uav.rules.qoe_reward import QoE
from desim_uav.scenario.components import errors
from desim_uav.scenario.drones import Drones, Types, as_fleet, flies_freely
from desim_uav.scenario.fields import (
    Height,
    Index,
    Length,
    Metres,
    Name,
    Point,
    Seed,
    Velocity,
)
from desim_uav.scenario.learning import Learning
from desim_uav.scenario.map import SIDE_M, Map
from desim_uav.scenario.processor import Processor
from desim_uav.scenario.section import Fraction, Section
from desim_uav.scenario.slots import (
    ASSOCIATION,
    BACKHAUL,
    CHARGING,
    DECISIONS,
    DEMAND,
    LINKS,
    OBSERVATION,
    OFFLOADING,
    REWARD,
    SERVICE,
)
from desim_uav.scenario.users import Asking, Groups, Users, as_groups
from desim_uav.scenario.yaml12 import KeyPath

ON_CIRCLE = ("count", "radius_m", "placement")
"""The keys of stations that say where they stand on a circle."""


class Stations(Section):
    """The charging stations, on a circle around the middle of the map or at given cells."""

    later: ClassVar = ("charging", "cells")

    count: Annotated[int, Field(ge=0, le=1000)] = 3
    """The number of charging stations; 0: none."""
    radius_m: Length = 960.0
    """The radius of the circle around the middle of the map on which they stand, in metres. The
    default is for a map of 2400 m; it is scaled with the shorter side of the map.
    """
    placement: Literal["nearest", "equidistant"] = "nearest"
    """`nearest`: each stands on the cell that contains its point of the circle. `equidistant`: on
    cells whose centres are all equally far from the middle of the map.
    """
    cells: (
        Annotated[tuple[tuple[Index, Index], ...], Field(min_length=1, max_length=1000)] | None
    ) = None
    """The cell [x, y] of each station, instead of `count`, `radius_m` and `placement`; null means
    on the circle.
    """
    pads: Annotated[int, Field(ge=1, le=10_000)] = 1
    """The number of drones that a station can charge at the same time."""
    full_charge_min: Annotated[float, Field(ge=1e-6, le=1e6)] = 5.0
    """How long it takes to charge an empty battery, in minutes, at a constant rate."""
    charging: Annotated[Charging, CHARGING] | None = None
    """How batteries are charged, instead of `full_charge_min`; null means at a constant rate."""

    @model_validator(mode="after")
    def _charging_decides(self) -> Stations:
        if self.charging is not None and "full_charge_min" in self.model_fields_set:
            problem = "not beside stations.charging, which says how long it takes"
            raise errors([(("full_charge_min",), problem, self.full_charge_min)])
        return self

    @model_validator(mode="after")
    def _cells_are_counted(self) -> Stations:
        if self.cells is not None:
            problem = "not beside stations.cells, which says where they stand"
            beside = [name for name in ON_CIRCLE if name in self.model_fields_set]
            if beside:
                raise errors([((name,), problem, getattr(self, name)) for name in beside])
            self._settle(count=len(self.cells))
        return self


class PositionNoise(Section):
    """How often a drone is wrong about each coordinate at a decision epoch, and by how much."""

    probability: Fraction = 0.1
    """How likely it is that a coordinate is wrong at a decision epoch."""
    sigma_cells: Annotated[float, Field(ge=0, le=1000)] = 1.0
    """The standard deviation of the error, in cells."""


class EpisodeKeys(Section):
    """How long an episode is; ``carry_over``: drones begin it as they ended the one before."""

    steps: Annotated[int, Field(ge=1, le=1_000_000)] = 30
    """The number of steps in an episode."""
    step_s: Annotated[float, Field(ge=1, le=86_400)] = 60.0
    """The length of a step, in seconds."""
    carry_over: bool = False
    """Whether drones begin an episode in the state in which the one before has left them."""


class AccessPoint(Section):
    """A mast on the ground that serves users as a drone does, at one place and for ever."""

    later: ClassVar = ("processor", "backhaul")

    at_m: Point
    """Where it stands: [x, y], in metres."""
    height_m: Height
    """The height of its antenna above the ground, in metres."""
    radio: Annotated[
        Radio, LINKS, Field(json_schema_extra={"default": {"kind": "link_classes"}})
    ] = cast(Radio, LinkClasses())
    """How it reaches users: `kind: link_classes`, which is the default here."""
    counts_in_reward: bool = False
    """Whether it counts as one more drone where rewards divide the users among the drones."""
    processor: Processor | None = None
    """What computes tasks at it; null means nothing does."""
    backhaul: Annotated[Backhaul, BACKHAUL] | None = None
    """What connects it to the network; null means that it limits no rate."""


class Scenario(Section):
    """A scenario, fully resolved: every key has its value, the preset's among them."""

    later: ClassVar = ("decisions", "wind_mps", "separation_m", "on_conflict", "offloading")

    name: Name = "scenario"
    """The name of the scenario. Run folders are named after it."""
    seed: Seed = 0
    """The seed of everything that is drawn."""
    world_seed: Seed | None = None
    """The seed of the world (buildings, clusters, homes); null means `seed`."""
    preset: Literal["paper"] | None = None
    """`paper`: the defaults of the paper's code instead of the simulator's."""
    map: Map = Map()
    """The map: its size, its cells, and in 3D its levels and buildings."""
    drones: Annotated[Drones | Types, BeforeValidator(as_fleet)] = Drones()
    """The drones: how many there are, what they cover, and how they fly; or a list of types, each
    with a name and keys of its own.
    """
    stations: Stations = Stations()
    """The charging stations."""
    users: Annotated[Users | Groups, BeforeValidator(as_groups)] = Users()
    """The users: where they live and how they move; or a list of groups, each with a name, keys and
    a demand of its own.
    """
    association: Annotated[Association, ASSOCIATION] = cast(Association, EnteredFirst())
    """Which of the drones that cover a user serves it."""
    access_points: Annotated[tuple[AccessPoint, ...], Field(max_length=1000)] = ()
    """Masts on the ground, which serve users as drones do."""
    demand: Annotated[Demand, DEMAND] = Dynamic()
    """When users make requests, and for which services."""
    services: Annotated[
        dict[Name, Annotated[Service, SERVICE]], Field(min_length=1, max_length=1000)
    ] = Field(default_factory=lambda: dict(PAPER))
    """The services by name: how long a request takes and what bandwidth it occupies."""
    offloading: Annotated[RowOffloading, OFFLOADING] = Always()
    """What part of a task drones compute for users: always, never, shortest, or split."""
    wind_mps: Velocity = CALM
    """The velocity of the wind over the ground [to the east, to the north], in m/s. It is the same
    everywhere and always. The highest speed of drones is then one through the air.
    """
    separation_m: Metres | None = None
    """The least distance that two drones in the air should keep, in metres; null means that it is
    not looked at. Each time at which two come nearer, or part again, is an event.
    """
    on_conflict: Literal["log", "hover_higher_index"] = "log"
    """What follows if two drones would come nearer than `separation_m`: nothing (`log`), or a move
    that would lead a drone nearer to one with a lower index is blocked (`hover_higher_index`).
    """
    position_noise: PositionNoise | None = None
    """How often a drone is wrong about its position; null means never."""
    decisions: Annotated[Decisions, DECISIONS] = cast(Decisions, ByClock())
    """When drones are asked what to do next: `clock`, at each step, or `event`, when each is free.
    """
    episode: EpisodeKeys = EpisodeKeys()
    """The length of an episode, and how the next one begins."""
    reward: Annotated[Reward, REWARD] = QoE()
    """What a drone is rewarded for at the end of each step."""
    observation: Annotated[Encoding, OBSERVATION] = Position()
    """What a learner sees of its drone."""
    learning: Learning = Learning()
    """How drones learn."""

    def __repr__(self) -> str:
        from desim_uav.scenario.facts import as_text, scenario_facts

        name, *facts = scenario_facts(self)
        return as_text(f"Scenario {name[1]}", facts)

    __str__ = __repr__

    def _repr_html_(self) -> str:
        from desim_uav.scenario.facts import as_html, scenario_facts

        name, *facts = scenario_facts(self)
        return as_html(f"Scenario {name[1]}", facts)

    @model_validator(mode="after")
    def _circles_follow_the_map(self) -> Scenario:
        share = min(self.map.size_m) / SIDE_M
        stations = self.stations
        if "radius_m" not in stations.model_fields_set:
            self._settle(stations=stations._with(radius_m=share * stations.radius_m))
        groups = tuple(users.on_map(share) for users in self.user_groups)
        self._settle(users=groups[0] if isinstance(self.users, Users) else groups)
        return self

    @property
    def three_d(self) -> bool:
        """Do drones change altitude?"""
        return self.map.dimensions == 3

    @property
    def fleet(self) -> tuple[Drones, ...]:
        """The types of drones, whichever form the file has."""
        return (self.drones,) if isinstance(self.drones, Drones) else self.drones

    @property
    def fleet_keys(self) -> tuple[KeyPath, ...]:
        """The key of each type of drones."""
        if isinstance(self.drones, Drones):
            return (("drones",),)
        return tuple(("drones", number) for number in range(len(self.drones)))

    @property
    def type_names(self) -> tuple[str, ...]:
        """The name of each type of drones; ``drones`` if the file has no list of types."""
        return tuple(getattr(drones, "name", "drones") for drones in self.fleet)

    @property
    def user_groups(self) -> tuple[Users, ...]:
        """The groups of users, whichever form the file has."""
        return (self.users,) if isinstance(self.users, Users) else self.users

    @property
    def user_keys(self) -> tuple[KeyPath, ...]:
        """The key of each group of users."""
        if isinstance(self.users, Users):
            return (("users",),)
        return tuple(("users", number) for number in range(len(self.users)))

    @property
    def group_names(self) -> tuple[str, ...]:
        """The name of each group of users; there is none if the file has no list of groups."""
        return () if isinstance(self.users, Users) else tuple(one.name for one in self.users)

    @property
    def group_numbers(self) -> tuple[int, ...]:
        """The number of each user's group."""
        return tuple(k for k, users in enumerate(self.user_groups) for _ in range(users.count))

    @property
    def user_count(self) -> int:
        """The number of users of all groups."""
        return sum(users.count for users in self.user_groups)

    @property
    def users_stay(self) -> bool:
        """Do all users stay at home, by the mobility ``static``?"""
        return all(type(users.mobility) is Static for users in self.user_groups)

    @property
    def demands(self) -> tuple[Demand, ...]:
        """The demand of each group of users."""
        return tuple(getattr(users, "demand", None) or self.demand for users in self.user_groups)

    @property
    def asking(self) -> tuple[Asking, ...]:
        """The demands by which users ask, which may be one for several groups."""
        counts: dict[KeyPath, list[int]] = {}
        demands: dict[KeyPath, Demand] = {}
        for path, users, demand in zip(self.user_keys, self.user_groups, self.demands, strict=True):
            own = getattr(users, "demand", None) is not None
            key = (*path, "demand") if own else ("demand",)
            demands[key] = demand
            counts.setdefault(key, []).append(users.count)
        return tuple(Asking(key, demands[key], tuple(counts[key])) for key in demands)

    @property
    def has_common_demand(self) -> bool:
        """Whether any group of users asks by the ``demand`` of the scenario."""
        return any(getattr(users, "demand", None) is None for users in self.user_groups)

    @property
    def differing(self) -> tuple[str, ...]:
        """The keys in which types of drones differ, besides their numbers and where they start."""
        own = ("name", "count", "start_cells")
        first, *others = self.fleet
        return tuple(
            key
            for key in Drones.model_fields
            if key not in own and any(getattr(one, key) != getattr(first, key) for one in others)
        )

    def require_one_type(self, what: str) -> Drones:
        """Return the type of all drones.

        Raises ScenarioError, which says that ``what`` needs it, if there are types that differ.
        """
        if self.differing:
            raise ScenarioError(
                f"drones: the types {', '.join(self.type_names)} differ in "
                f"{', '.join(self.differing)}; {what} needs drones of one type"
            )
        return self.fleet[0]

    def require_clock(self, what: str) -> None:
        """Raise ScenarioError, which says that ``what`` needs it, unless drones decide by clock."""
        if self.decisions.by_event:
            raise ScenarioError(f"decisions: event: {what} needs decisions: clock")

    def require_one_discount(self, library: str) -> None:
        """Raise ScenarioError for a library with one discount, unless drones decide by clock."""
        self.require_clock(f"{library}, which has one discount for transitions of any duration,")

    @property
    def free(self) -> bool:
        """Do drones, or some types of them, fly freely and not from cell to cell?"""
        return any(flies_freely(drones) for drones in self.fleet)

    @property
    def mixed(self) -> bool:
        """Do some types of drones fly freely and others from cell to cell?"""
        return self.free and not all(flies_freely(drones) for drones in self.fleet)

    def require_cells(self, what: str) -> None:
        """Raise ScenarioError, which says that ``what`` needs it, unless drones fly by cells."""
        if self.free:
            raise ScenarioError(
                f"drones.motion: space: free: {what} needs drones that fly from cell to cell "
                f"(space: cells)"
            )

    def require_one_space(self, what: str) -> None:
        """Raise ScenarioError, which says that ``what`` needs it, unless all drones fly alike.

        They do if all types of drones fly freely, or all from cell to cell.
        """
        if self.mixed:
            types = list(zip(self.type_names, self.fleet, strict=True))
            free = ", ".join(name for name, drones in types if flies_freely(drones))
            cells = ", ".join(name for name, drones in types if not flies_freely(drones))
            raise ScenarioError(
                f"drones: the types {free} fly freely (motion: space: free) and the types {cells} "
                f"from cell to cell; {what} needs drones of one of the two kinds"
            )

    @property
    def drone_count(self) -> int:
        """The number of drones of all types."""
        return sum(drones.count for drones in self.fleet)

    @property
    def type_numbers(self) -> tuple[int, ...]:
        """The number of each drone's type."""
        return tuple(k for k, drones in enumerate(self.fleet) for _ in range(drones.count))

    @property
    def charging(self) -> Charging | None:
        """How the stations charge; None if batteries are unlimited."""
        if not self.limited_battery:
            return None
        return self.stations.charging or Constant(self.stations.full_charge_min)

    @property
    def most_bps(self) -> int:
        """The highest rate of a request of a drone or an access point, in bit/s; 0 if unknown.

        It is unknown if bandwidth is unlimited, and for radio or sharing of one's own.
        """
        radios: list[tuple[Any, float | None, Backhaul | None]] = [
            (drones.radio, drones.bandwidth_kbps, drones.backhaul) for drones in self.fleet
        ]
        radios += [(point.radio, None, point.backhaul) for point in self.access_points]
        most = 0.0
        for radio, kbps, backhaul in radios:
            if not all(
                type(one).__module__.startswith("desim_uav.") for one in (radio, radio.sharing)
            ):
                return 0
            widest_hz = max(radio.bandwidth_hz(kbps), getattr(radio, "uplink_hz", None) or 0)
            rate = widest_hz * max(radio.efficiencies()) / 1e6
            most = max(most, rate if backhaul is None else min(rate, backhaul.capacity_bps))
        return 0 if math.isinf(most) else math.ceil(most)

    @property
    def most_clock(self) -> int:
        """What the fastest core does in a microsecond, in thousandths of a cycle; 0: no core."""
        processors = [one.processor for one in self.fleet]
        processors += [one.processor for one in self.access_points]
        return max((one.clock for one in processors if one is not None), default=0)

    @property
    def limited_battery(self) -> bool:
        """Do some drones have to charge?"""
        return any(drones.battery is not None for drones in self.fleet)

    @property
    def effective_world_seed(self) -> int:
        """The seed the world is drawn from."""
        return self.seed if self.world_seed is None else self.world_seed
