"""What a scenario says: frozen models whose attribute names are the keys of the file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal, cast

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StringConstraints,
    model_validator,
)

import desim_uav.model
from desim_uav import registry
from desim_uav.model.admission import Admission, FirstCome
from desim_uav.model.battery import Endurance, Energy
from desim_uav.model.demand import Demand, Dynamic
from desim_uav.model.mobility import Mobility, RandomWalk
from desim_uav.model.motion import BangCoastBang, Motion
from desim_uav.model.observations import Encoding, Position
from desim_uav.model.rewards import MultiService, Reward
from desim_uav.model.services import PAPER, Service
from desim_uav.scenario.components import Slot, errors, strictly
from desim_uav.scenario.yaml12 import KeyPath

registry.discover(desim_uav.model)

MOTION = Slot("motion", "bang_coast_bang", Motion)
BATTERY = Slot("battery", "endurance", Energy)
ADMISSION = Slot("admission", "first_come", Admission)
MOBILITY = Slot("mobility", "random_walk", Mobility)
DEMAND = Slot("demand", "dynamic", Demand)
REWARD = Slot("reward", "multi_service", Reward)
OBSERVATION = Slot("observation", "position", Encoding)
SERVICE = Slot("service", "uniform_choice", Service)


def _ascending(values: tuple[float, float]) -> tuple[float, float]:
    low, high = values
    if low > high:
        raise ValueError(f"must be [low, high] with low <= high; {low:g} is above {high:g}")
    return values


Metres = Annotated[float, Field(gt=0, le=1e6)]
Length = Annotated[float, Field(ge=0, le=1e6)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Height = Annotated[float, Field(gt=0, le=1e4)]
Point = tuple[Length, Length]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
Index = Annotated[int, Field(ge=0, lt=1000)]
CellCount = Annotated[int, Field(ge=1, le=1000)]
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}$")]

FractionRange = Annotated[tuple[Fraction, Fraction], AfterValidator(_ascending)]
HeightRange = Annotated[tuple[Height, Height], AfterValidator(_ascending)]
RadiusRange = Annotated[tuple[Metres, Metres], AfterValidator(_ascending)]


class Section(BaseModel):
    """A mapping of a scenario file: unknown keys are refused, values never change."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def _settle(self, **values: object) -> None:
        """Set what follows from other keys; ``model_fields_set`` still says what was given."""
        self.__dict__.update(values)


class Levels(Section):
    """The altitudes drones fly at: the lowest, and the step between levels (3D)."""

    min_altitude_m: Height = 20.0
    step_m: Height = 20.0


class DrawnObstacles(Section):
    """Buildings to be drawn: covered fraction, heights, the side of a square (null: the cell)."""

    coverage: FractionRange = (0.05, 0.15)
    height_m: HeightRange = (20.0, 60.0)
    square_m: Metres | None = None


class ListedObstacles(Section):
    """Buildings one by one: [cell x, cell y, height in metres]."""

    cells: tuple[tuple[Index, Index, Height], ...]


def _obstacles(value: Any) -> Any:
    if isinstance(value, DrawnObstacles | ListedObstacles):
        return value
    if not isinstance(value, Mapping):
        raise ValueError("must be a mapping, or null for none")
    return strictly(ListedObstacles if "cells" in value else DrawnObstacles, dict(value))


Obstacles = Annotated[DrawnObstacles | ListedObstacles, BeforeValidator(_obstacles)]


class Map(Section):
    """The map: its size, its cells, and in 3D its levels and obstacles."""

    size_m: tuple[Metres, Metres] = (2400.0, 2400.0)
    cells: tuple[CellCount, CellCount] = (10, 10)
    dimensions: Literal[2, 3] = 3
    levels: Levels = Levels()
    obstacles: Obstacles | None = DrawnObstacles()

    @model_validator(mode="after")
    def _nothing_stands_in_the_way_in_2d(self) -> Map:
        if self.dimensions == 2 and "obstacles" not in self.model_fields_set:
            self._settle(obstacles=None)
        return self

    @property
    def cell_m(self) -> tuple[float, float]:
        """The size of a cell along x and y."""
        return self.size_m[0] / self.cells[0], self.size_m[1] / self.cells[1]


class Drones(Section):
    """The drones: how many, what they cover and carry, how they fly."""

    count: Annotated[int, Field(ge=1, le=10_000)] = 3
    start_cells: tuple[tuple[Index, Index], ...] | None = None
    footprint_radius_m: Metres = 600.0
    bandwidth_kbps: Annotated[float, Field(gt=0, le=1e9)] | None = 5000.0
    motion: Annotated[Motion, MOTION] = BangCoastBang()
    battery: Annotated[Energy, BATTERY] | None = cast(Energy, Endurance())
    admission: Annotated[Admission, ADMISSION] = FirstCome()


class Stations(Section):
    """The charging stations, on a circle around the middle of the map; count 0: none."""

    count: Annotated[int, Field(ge=0, le=1000)] = 3
    radius_m: Length = 960.0
    pads: Annotated[int, Field(ge=1, le=10_000)] = 1
    full_charge_min: Annotated[float, Field(ge=1e-6, le=1e6)] = 5.0


class Clusters(Section):
    """Where users live: how many clusters, and the range of their radii."""

    count: Annotated[int, Field(ge=1, le=10_000)] = 4
    radius_m: RadiusRange = (240.0, 480.0)


class Users(Section):
    """The users: drawn around clusters, or at given positions, and how they move."""

    count: Annotated[int, Field(ge=1, le=1_000_000)] = 48
    clusters: Clusters | None = Clusters()
    positions_m: Annotated[tuple[Point, ...], Field(min_length=1)] | None = None
    max_height_m: Annotated[float, Field(ge=0, le=1e4)] = 9.0
    mobility: Annotated[Mobility, MOBILITY] = RandomWalk()

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
    sigma_cells: Annotated[float, Field(ge=0, le=1000)] = 1.0


class Episode(Section):
    """How long an episode is; ``carry_over``: drones begin it as they ended the one before."""

    steps: Annotated[int, Field(ge=1, le=1_000_000)] = 30
    step_s: Annotated[float, Field(ge=1, le=86_400)] = 60.0
    carry_over: bool = False


ALGORITHMS = ("q_learning", "sarsa", "expected_sarsa", "double_q")


def _algorithm(name: str) -> str:
    if name not in ALGORITHMS and not re.fullmatch(r"[\w.]+:\w+", name):
        raise ValueError(
            f"unknown algorithm{registry.did_you_mean(name, ALGORITHMS)}; "
            f'allowed: {", ".join(ALGORITHMS)}, or "package.module:Class"'
        )
    return name


class Schedule(Section):
    """A parameter over the episodes of a training: ``start`` x ``decay`` each, down to ``end``."""

    start: Fraction = 1.0
    decay: Fraction = 1.0
    end: Fraction = 0.0

    def at(self, episode: int) -> float:
        """Its value in an episode, counted from 0."""
        return max(self.end, self.start * self.decay**episode)


def _schedule(value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | float | Mapping | Schedule):
        raise ValueError("must be a number, or a mapping of start, decay and end")
    return {"start": value} if isinstance(value, int | float) else value


def _over(default: Schedule) -> BeforeValidator:
    """A number is a constant; of a mapping, what is not given is as by default."""

    def filled(value: Any) -> Any:
        return default.model_dump() | value if isinstance(value, dict) else _schedule(value)

    return BeforeValidator(filled)


ALPHA = Schedule(start=1.0, decay=0.9996, end=0.1)
EPSILON = Schedule(start=0.4, decay=0.9996, end=0.02)


LARGEST_Q = 1e6
InitialQ = (
    Literal["zero", "random", "max_reward", "prior"]
    | Annotated[float, Field(ge=-LARGEST_Q, le=LARGEST_Q)]
)
INITIAL_Q = ("zero", "random", "max_reward", "prior")


def _initial_q(value: Any) -> Any:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if number and abs(value) <= LARGEST_Q:
        return value
    if value not in INITIAL_Q:
        near = registry.did_you_mean(value, INITIAL_Q) if isinstance(value, str) else ""
        raise ValueError(f"must be {', '.join(INITIAL_Q)}, or a number from -1e6 to 1e6{near}")
    return value


class Learning(Section):
    """How a drone learns: the algorithm, its parameters, and for how many episodes.

    With carry-over, every so many episodes (``restart_every``; null: never) begin at the starts.
    """

    algorithm: Annotated[str, AfterValidator(_algorithm)] = "q_learning"
    alpha: Annotated[Schedule, _over(ALPHA)] = ALPHA
    gamma: Annotated[float, Field(ge=0, lt=1)] = 0.95
    epsilon: Annotated[Schedule, _over(EPSILON)] = EPSILON
    initial_q: Annotated[InitialQ, BeforeValidator(_initial_q)] = 3.0
    episodes: Annotated[int, Field(ge=1, le=10**7)] = 12_000
    restart_every: Annotated[int, Field(ge=1, le=10**7)] | None = 3


class Scenario(Section):
    """A scenario, fully resolved: every key has its value, the preset's among them."""

    name: Name = "scenario"
    seed: Seed = 0
    world_seed: Seed | None = None
    preset: Literal["paper"] | None = None
    map: Map = Map()
    drones: Drones = Drones()
    stations: Stations = Stations()
    users: Users = Users()
    demand: Annotated[Demand, DEMAND] = Dynamic()
    services: Annotated[
        dict[Name, Annotated[Service, SERVICE]], Field(min_length=1, max_length=1000)
    ] = Field(default_factory=lambda: dict(PAPER))
    position_noise: PositionNoise | None = None
    episode: Episode = Episode()
    reward: Annotated[Reward, REWARD] = MultiService()
    observation: Annotated[Encoding, OBSERVATION] = Position()
    learning: Learning = Learning()

    @property
    def three_d(self) -> bool:
        """Do drones change altitude?"""
        return self.map.dimensions == 3

    @property
    def limited_battery(self) -> bool:
        """Do drones have to charge?"""
        return self.drones.battery is not None

    @property
    def effective_world_seed(self) -> int:
        """The seed the world is drawn from."""
        return self.seed if self.world_seed is None else self.world_seed


PAPER_LEARNING: dict[str, Any] = {
    "alpha": {"start": 1.0, "decay": 1.0, "end": 0.0},
    "gamma": 0.95,
    "epsilon": {"start": 1.0, "decay": 0.998, "end": 0.01},
    "initial_q": "random",
    "episodes": 7000,
    "restart_every": None,
}
"""How the paper trained."""


def paper_preset(given: Mapping[str, Any]) -> dict[str, Any]:
    """The paper's code as defaults beneath the keys of a file: ``given`` with them filled in."""
    filled = dict(given)
    drones = given.get("drones", {})
    if isinstance(drones, Mapping):
        filled["drones"] = _with_default(drones, "battery", BATTERY, "respawn_after_min", 0.0)
    filled = _with_default(filled, "demand", DEMAND, "none", 0.1)
    filled = _with_default(filled, "reward", REWARD, "cost_sign", 1.0)
    learning = given.get("learning", {})
    if isinstance(learning, Mapping):
        filled["learning"] = PAPER_LEARNING | dict(learning)
        for key in ("alpha", "epsilon"):
            if isinstance(learning.get(key), Mapping):
                filled["learning"][key] = PAPER_LEARNING[key] | dict(learning[key])
    return filled


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
