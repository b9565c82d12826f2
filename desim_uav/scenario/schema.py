"""What a scenario says: frozen models whose attribute names are the keys of the file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, cast

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    StringConstraints,
    ValidationInfo,
    field_validator,
    model_validator,
)

import desim_uav.model
import desim_uav.rules
from desim_uav import registry
from desim_uav.errors import ScenarioError
from desim_uav.model.admission import Admission
from desim_uav.model.association import Association, EnteredFirst
from desim_uav.model.decisions import ByClock, Decisions
from desim_uav.model.demand.demand import Demand, Dynamic
from desim_uav.model.energy.battery import Endurance, Energy
from desim_uav.model.energy.charging import Charging, Constant
from desim_uav.model.geometry.polygons import MOST_CORNERS, checked
from desim_uav.model.mobility.mobility import Mobility, RandomWalk
from desim_uav.model.motion.limits import CALM
from desim_uav.model.motion.motion import BangCoastBang, Motion
from desim_uav.model.observations import Encoding
from desim_uav.model.radio.radio import Disc, LinkClasses, Radio
from desim_uav.model.rewards import Reward
from desim_uav.model.services import PAPER, Service
from desim_uav.rules.admission import FirstCome
from desim_uav.rules.observations import Position
from desim_uav.rules.rewards import MultiService
from desim_uav.scenario.components import Slot, errors, strictly
from desim_uav.scenario.learning import PAPER_LEARNING, Learning
from desim_uav.scenario.section import Fraction, Section
from desim_uav.scenario.yaml12 import KeyPath

registry.discover(desim_uav.model, deep=True)
registry.discover(desim_uav.rules)

MOTION = Slot("motion", "bang_coast_bang", Motion)
BATTERY = Slot("battery", "endurance", Energy)
CHARGING = Slot("charging", "constant", Charging)
ADMISSION = Slot("admission", "first_come", Admission)
MOBILITY = Slot("mobility", "random_walk", Mobility)
DEMAND = Slot("demand", "dynamic", Demand)
REWARD = Slot("reward", "multi_service", Reward)
OBSERVATION = Slot("observation", "position", Encoding)
RADIO = Slot("radio", "disc", Radio)
LINKS = Slot("radio", "link_classes", Radio)
ASSOCIATION = Slot("association", "entered_first", Association, by_name=True)
DECISIONS = Slot("decisions", "clock", Decisions, by_name=True)
SERVICE = Slot("service", "uniform_choice", Service)


def _ascending(values: tuple[float, float]) -> tuple[float, float]:
    low, high = values
    if low > high:
        raise ValueError(f"must be [low, high] with low <= high; {low:g} is above {high:g}")
    return values


def _rising(values: tuple[float, float]) -> tuple[float, float]:
    low, high = values
    if low >= high:
        raise ValueError(f"must be [low, high] with low < high; {low:g} is not below {high:g}")
    return values


Metres = Annotated[float, Field(ge=0.001, le=1e6)]
Length = Annotated[float, Field(ge=0, le=1e6)]
Height = Annotated[float, Field(ge=0.001, le=1e4)]
Point = tuple[Length, Length]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
Index = Annotated[int, Field(ge=0, lt=1000)]
CellCount = Annotated[int, Field(ge=1, le=1000)]
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}$")]

Side = Annotated[float, Field(ge=1, le=1e6)]
Speed = Annotated[float, Field(ge=-1000, le=1000)]
Velocity = tuple[Speed, Speed]

FractionRange = Annotated[tuple[Fraction, Fraction], AfterValidator(_ascending)]
HeightRange = Annotated[tuple[Height, Height], AfterValidator(_ascending)]
RadiusRange = Annotated[tuple[Metres, Metres], AfterValidator(_ascending)]


SIDE_M = 2400.0
"""The side of the paper's map: radii that are not given are scaled to the shorter side of a map."""


class Levels(Section):
    """The altitudes drones fly at: the lowest, and the step between levels (3D)."""

    later: ClassVar = ("max_altitude_m",)

    min_altitude_m: Height = 20.0
    """The lowest level, in metres. In 2D it is the only one."""
    step_m: Height = 20.0
    """The vertical distance between two levels, in metres."""
    max_altitude_m: Height | None = None
    """The altitude up to which there are levels, in metres (3D only): also where buildings are
    lower or where there are none. null means up to the tallest building. Drones that may fly above
    the tallest building have one level above it in any case.
    """


class DrawnObstacles(Section):
    """Buildings to be drawn: covered fraction, heights, the side of a square (null: the cell)."""

    coverage: FractionRange = (0.05, 0.15)
    """The range from which the covered fraction of the map is drawn."""
    height_m: HeightRange = (20.0, 60.0)
    """The range from which the height of each building is drawn, in metres."""
    square_m: Metres | None = None
    """The side of a building's square, in metres; null means the size of a cell."""


class ListedObstacles(Section):
    """Buildings one by one: [cell x, cell y, height in metres]."""

    cells: tuple[tuple[Index, Index, Height], ...]
    """The buildings one by one: [cell x, cell y, height in metres]."""


def _obstacles(value: Any) -> Any:
    if isinstance(value, DrawnObstacles | ListedObstacles):
        return value
    if not isinstance(value, Mapping):
        raise ValueError("must be a mapping, or null for none")
    return strictly(ListedObstacles if "cells" in value else DrawnObstacles, dict(value))


Obstacles = Annotated[DrawnObstacles | ListedObstacles, BeforeValidator(_obstacles)]

Altitude = Annotated[float, Field(ge=0, le=1e4)]


class NoFly(Section):
    """A zone in which no drone may fly: a polygon, from one altitude to another."""

    polygon_m: Annotated[tuple[Point, ...], Field(min_length=3, max_length=MOST_CORNERS)]
    """The corners [x, y] of the polygon, in metres, in either direction. Its edges must meet only
    at the corners between neighbours.
    """
    altitude_m: Annotated[tuple[Altitude, Altitude], AfterValidator(_rising)] = (0.0, 10_000.0)
    """The lowest and the highest altitude of the zone, in metres."""

    @field_validator("polygon_m")
    @classmethod
    def _is_simple(cls, corners: tuple[Point, ...]) -> tuple[Point, ...]:
        checked(corners)
        return corners


class Map(Section):
    """The map: its size, its cells, and in 3D its levels and obstacles."""

    later: ClassVar = ("no_fly",)

    size_m: tuple[Side, Side] = (SIDE_M, SIDE_M)
    """The width (to the east) and depth (to the north) of the map, in metres."""
    cells: tuple[CellCount, CellCount] = (10, 10)
    """The number of cells along x and along y. Drones fly from cell centre to cell centre."""
    dimensions: Literal[2, 3] = 3
    """3: drones change altitude between buildings. 2: they fly above everything."""
    levels: Levels = Levels()
    """The altitudes at which drones fly."""
    obstacles: Obstacles | None = DrawnObstacles()
    """The buildings (3D only): drawn, or listed under `cells`; null means none."""
    no_fly: Annotated[tuple[NoFly, ...], Field(max_length=1000)] = ()
    """The zones in which no drone may fly. They need `motion: {space: free}` of all drones."""

    @model_validator(mode="after")
    def _nothing_stands_in_the_way_in_2d(self) -> Map:
        if self.dimensions == 2 and "obstacles" not in self.model_fields_set:
            self._settle(obstacles=None)
        return self

    @property
    def tallest_m(self) -> float:
        """The height of the tallest building that there can be, in metres; 0 without any."""
        if self.dimensions == 2 or self.obstacles is None:
            return 0.0
        if isinstance(self.obstacles, DrawnObstacles):
            return self.obstacles.height_m[1]
        return max((height for *_, height in self.obstacles.cells), default=0.0)

    @property
    def most_levels(self) -> int:
        """The largest number of levels that there can be (see ``grid.altitudes``)."""
        lowest_m, step_m = self.levels.min_altitude_m, self.levels.step_m
        if self.dimensions == 2:
            return 1
        above = int(max(self.tallest_m - lowest_m, -step_m) // step_m) + 2
        most_m = max(self.levels.max_altitude_m or 0.0, lowest_m)
        return max(above, int((most_m - lowest_m) // step_m) + 1)

    @property
    def cell_m(self) -> tuple[float, float]:
        """The size of a cell along x and y."""
        return self.size_m[0] / self.cells[0], self.size_m[1] / self.cells[1]


MOST_DRONES, MOST_TYPES = 10_000, 100
"""The largest number of drones, and of their types."""


class Drones(Section):
    """The drones: how many, what they cover and carry, how they fly."""

    count: Annotated[int, Field(ge=1, le=MOST_DRONES)] = 3
    """The number of drones."""
    start_cells: tuple[tuple[Index, Index], ...] | None = None
    """The cell [x, y] in which each drone starts; null means on the charging stations in turn,
    or on a circle if there are none.
    """
    footprint_radius_m: Metres = 600.0
    """The radius of the disc on the ground that a drone covers, in metres."""
    bandwidth_kbps: Annotated[float, Field(ge=0.001, le=1e9)] | None = 5000.0
    """The bandwidth of each drone, in kbit/s; null means unlimited."""
    radio: Annotated[Radio, RADIO] = cast(Radio, Disc())
    """How drones reach users: the paper's disc, or links whose classes follow from path loss."""
    motion: Annotated[Motion, MOTION] = BangCoastBang()
    """How drones fly from one cell to the next."""
    battery: Annotated[Energy, BATTERY] | None = cast(Energy, Endurance())
    """The battery and its energy model; null means an unlimited battery."""
    admission: Annotated[Admission, ADMISSION] = FirstCome()
    """Which of the waiting requests a drone serves."""

    @model_validator(mode="after")
    def _radio_decides(self) -> Drones:
        if self.radio.graded:
            replaced = {
                "footprint_radius_m": "its path loss says how far links reach",
                "bandwidth_kbps": "give radio.bandwidth_mhz",
            }
            problems: list[tuple[KeyPath, str, object]] = [
                ((key,), f"not beside radio: {{kind: link_classes}}; {instead}", getattr(self, key))
                for key, instead in replaced.items()
                if key in self.model_fields_set
            ]
            if problems:
                raise errors(problems)
        return self


class DroneType(Drones):
    """A type of drones, if there are several of them: its name, and the keys of `drones`."""

    name: Name
    """The name of the type, which no other type has."""


def flies_freely(drones: Drones) -> bool:
    """Return whether drones fly freely, and not from cell to cell."""
    motion = drones.motion
    return isinstance(motion, BangCoastBang) and motion.space == "free"


Types = Annotated[tuple[DroneType, ...], Field(min_length=1, max_length=MOST_TYPES)]


def _fleet(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, Drones | tuple):
        return value
    if isinstance(value, Mapping):
        return strictly(Drones, dict(value), info.context)
    if not isinstance(value, list):
        raise ValueError("must be a mapping, or a list of mappings, one for each type of drones")
    types: tuple[DroneType, ...] = strictly(cast(type, Types), value, info.context)
    problems: list[tuple[KeyPath, str, object]] = []
    first: dict[str, int] = {}
    for number, one in enumerate(types):
        if one.name in first:
            message = f"is the name of drones.{first[one.name]} too; names must differ"
            problems.append(((number, "name"), message, one.name))
        first.setdefault(one.name, number)
    if problems:
        raise errors(problems)
    drones = sum(one.count for one in types)
    if drones > MOST_DRONES:
        raise ValueError(f"has {drones} drones in all; at most {MOST_DRONES}")
    return types


class Stations(Section):
    """The charging stations, on a circle around the middle of the map; count 0: none."""

    later: ClassVar = ("charging",)

    count: Annotated[int, Field(ge=0, le=1000)] = 3
    """The number of charging stations."""
    radius_m: Length = 960.0
    """The radius of the circle around the middle of the map on which they stand, in metres. The
    default is for a map of 2400 m; it is scaled with the shorter side of the map.
    """
    placement: Literal["nearest", "equidistant"] = "nearest"
    """`nearest`: each stands on the cell that contains its point of the circle. `equidistant`: on
    cells whose centres are all equally far from the middle of the map.
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


class Clusters(Section):
    """Where users live: how many clusters, and the range of their radii."""

    count: Annotated[int, Field(ge=1, le=10_000)] = 4
    """The number of clusters."""
    radius_m: RadiusRange = (240.0, 480.0)
    """The range from which the radius of each cluster is drawn, in metres. The default is for a
    map of 2400 m; it is scaled with the shorter side of the map.
    """


class Users(Section):
    """The users: drawn around clusters, or at given positions, and how they move."""

    count: Annotated[int, Field(ge=1, le=1_000_000)] = 48
    """The number of users."""
    clusters: Clusters | None = Clusters()
    """The clusters around which users live; null only beside `positions_m`."""
    positions_m: Annotated[tuple[Point, ...], Field(min_length=1)] | None = None
    """The home [x, y] of each user, in metres. It replaces `count` and `clusters`."""
    max_height_m: Annotated[float, Field(ge=0, le=1e4)] = 9.0
    """The greatest height of a user in a cell with a building, in metres."""
    mobility: Annotated[Mobility, MOBILITY] = RandomWalk()
    """How users move."""

    @model_validator(mode="after")
    def _positions_decide(self) -> Users:
        if self.positions_m is None:
            if self.clusters is None:
                raise errors([(("clusters",), "may be null only beside users.positions_m", None)])
            return self
        problems: list[tuple[KeyPath, str, object]] = []
        if "count" in self.model_fields_set:
            problems.append((("count",), "not beside users.positions_m, which counts", self.count))
        if "clusters" in self.model_fields_set and self.clusters is not None:
            problems.append((("clusters",), "not beside users.positions_m", self.clusters))
        if problems:
            raise errors(problems)
        self._settle(count=len(self.positions_m), clusters=None)
        return self


class PositionNoise(Section):
    """How often a drone is wrong about each coordinate at a decision epoch, and by how much."""

    probability: Fraction = 0.1
    """How likely it is that a coordinate is wrong at a decision epoch."""
    sigma_cells: Annotated[float, Field(ge=0, le=1000)] = 1.0
    """The standard deviation of the error, in cells."""


class Episode(Section):
    """How long an episode is; ``carry_over``: drones begin it as they ended the one before."""

    steps: Annotated[int, Field(ge=1, le=1_000_000)] = 30
    """The number of steps in an episode."""
    step_s: Annotated[float, Field(ge=1, le=86_400)] = 60.0
    """The length of a step, in seconds."""
    carry_over: bool = False
    """Whether drones begin an episode in the state in which the one before has left them."""


class AccessPoint(Section):
    """A mast on the ground that serves users as a drone does, at one place and for ever."""

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


class Scenario(Section):
    """A scenario, fully resolved: every key has its value, the preset's among them."""

    later: ClassVar = ("decisions", "wind_mps", "separation_m", "on_conflict")

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
    drones: Annotated[Drones | Types, BeforeValidator(_fleet)] = Drones()
    """The drones: how many there are, what they cover, and how they fly; or a list of types, each
    with a name and keys of its own.
    """
    stations: Stations = Stations()
    """The charging stations."""
    users: Users = Users()
    """The users: where they live and how they move."""
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
    episode: Episode = Episode()
    """The length of an episode, and how the next one begins."""
    reward: Annotated[Reward, REWARD] = MultiService()
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
        stations, clusters = self.stations, self.users.clusters
        if "radius_m" not in stations.model_fields_set:
            self._settle(stations=stations._with(radius_m=share * stations.radius_m))
        if clusters is not None and "radius_m" not in clusters.model_fields_set:
            low, high = clusters.radius_m
            scaled = clusters._with(radius_m=(share * low, share * high))
            self._settle(users=self.users._with(clusters=scaled))
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
            named = list(zip(self.type_names, self.fleet, strict=True))
            free = ", ".join(name for name, drones in named if flies_freely(drones))
            cells = ", ".join(name for name, drones in named if not flies_freely(drones))
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
        radios: list[tuple[Any, float | None]] = [
            (drones.radio, drones.bandwidth_kbps) for drones in self.fleet
        ]
        radios += [(point.radio, None) for point in self.access_points]
        most = 0.0
        for radio, kbps in radios:
            if not all(
                type(one).__module__.startswith("desim_uav.") for one in (radio, radio.sharing)
            ):
                return 0
            most = max(most, radio.bandwidth_hz(kbps) * max(radio.efficiencies()) / 1e6)
        return 0 if math.isinf(most) else math.ceil(most)

    @property
    def limited_battery(self) -> bool:
        """Do some drones have to charge?"""
        return any(drones.battery is not None for drones in self.fleet)

    @property
    def effective_world_seed(self) -> int:
        """The seed the world is drawn from."""
        return self.seed if self.world_seed is None else self.world_seed


def paper_preset(given: Mapping[str, Any]) -> dict[str, Any]:
    """The paper's code as defaults beneath the keys of a file: ``given`` with them filled in."""
    filled = dict(given)
    drones = given.get("drones", {})
    if isinstance(drones, Mapping):
        filled["drones"] = _paper_drones(drones)
    elif isinstance(drones, list):
        filled["drones"] = [_paper_drones(d) if isinstance(d, Mapping) else d for d in drones]
    filled = _with_default(filled, "demand", DEMAND, "none", 0.1)
    filled = _with_default(filled, "reward", REWARD, "cost_sign", 1.0)
    learning = given.get("learning", {})
    if isinstance(learning, Mapping):
        filled["learning"] = PAPER_LEARNING | dict(learning)
        for key in ("alpha", "epsilon"):
            if isinstance(learning.get(key), Mapping):
                filled["learning"][key] = PAPER_LEARNING[key] | dict(learning[key])
    return filled


def _paper_drones(given: Mapping[str, Any]) -> dict[str, Any]:
    """Drones, or a type of them, with the default of the paper's code."""
    return _with_default(given, "battery", BATTERY, "respawn_after_min", 0.0)


def _with_default(
    given: Mapping[str, Any], key: str, slot: Slot, parameter: str, value: float
) -> dict[str, Any]:
    """``given`` with a parameter of the component at ``key``, where its kind has one to give."""
    component = given.get(key, {})
    if not isinstance(component, Mapping):
        return dict(given)
    if parameter not in slot.parameter_names(component.get("kind")):
        return dict(given)
    return {**given, key: {parameter: value, **component}}
