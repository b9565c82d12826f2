"""Components that keep their promises, and some that break one each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from desim_uav.errors import SimulationError
from desim_uav.model.demand.requests import Requests
from desim_uav.model.energy.battery import Endurance
from desim_uav.model.mobility.mobility import Walks
from desim_uav.model.mobility.walking import RowMobility, stay
from desim_uav.model.observations import Feature, RowObservation
from desim_uav.model.rewards import RowReward
from desim_uav.testing import check_component, compare_engines

FEW: dict[str, Any] = {"users": {"count": 6}, "episode": {"steps": 6}}
HERE = "tests.testing.test_checks_of_components"


def using(**keys: Any) -> dict[str, Any]:
    return {"name": "few", **FEW, **keys}


@dataclass(frozen=True)
class Modest(RowReward):
    """A share of the users."""

    share: float = 0.5
    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        drone.terms[0] = self.share * drone.attached_users


@dataclass(frozen=True)
class Counting:
    """A reward that counts all drones' steps since the process began."""

    names = ("steps",)
    steps: ClassVar[list[int]] = []

    def terms(self, drone: Any, open_requests: Any, facts: Any) -> dict[str, float]:
        self.steps.append(1)
        return {"steps": float(len(self.steps))}


@dataclass(frozen=True)
class Careless:
    """Users whose homes are drawn from NumPy's own generator, and not from their streams."""

    def walks(self, homes: Any, streams: Any, area: Any, horizon_us: int) -> Walks:
        places = np.random.default_rng().random((len(homes), 2)) * (area.width_m, area.depth_m)
        legs = np.column_stack([np.zeros(len(homes)), places, np.zeros((len(homes), 2))])
        return Walks(legs, np.arange(len(homes) + 1))


class Grabbing(RowReward):
    """A reward that takes all bandwidth away."""

    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        drone.free_hz = 0


class Listing:
    """A reward that returns no mapping."""

    def terms(self, drone: Any, open_requests: Any, facts: Any) -> Any:
        return [1.0]


class Renaming:
    """A reward whose terms have other names in each step."""

    def terms(self, drone: Any, open_requests: Any, facts: Any) -> dict[str, float]:
        return {f"step_{drone.step}": 1.0}


class Wide(RowObservation):
    """A feature that exceeds its bound."""

    whole = False

    def features(self, facts: Any) -> tuple[Feature, ...]:
        return (Feature("one", 0.0, 1.0, self.whole),)

    def write(self, world: Any, state: Any, drone: Any) -> None:
        drone.features[0] = 5.0


class Broken(Wide):
    """A feature that is no whole number, as it was said to be."""

    whole = True

    def write(self, world: Any, state: Any, drone: Any) -> None:
        drone.features[0] = 0.5


class Long:
    """More numbers than features."""

    def features(self, facts: Any) -> tuple[Feature, ...]:
        return (Feature("one", 0.0, 1.0, False),)

    def encode(self, observation: Any, facts: Any) -> tuple[float, ...]:
        return (0.5, 0.5)


class InSeconds(RowMobility):
    """Legs whose times are in seconds, and not in microseconds."""

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        stay(walker, walker.t_us + 30)


class OnTheMap(RowMobility):
    """Walks that change the map."""

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        area.width_m = 100.0


class Flat:
    """Walks that are one array."""

    def walks(self, homes: Any, streams: Any, area: Any, horizon_us: int) -> Any:
        return np.zeros((3, 2))


@dataclass(frozen=True)
class Table:
    """Two requests of each user at given times."""

    first_us: float = 0.0
    numbers: str = "int64"

    def requests(self, users: int, services: Any, streams: Any, horizon_us: int) -> Requests:
        two = [[self.first_us, 0, 60_000_000, 1000], [10_000_000, 0, 60_000_000, 1000]]
        rows = np.array(two * users).astype(self.numbers)
        return Requests(rows, np.arange(users + 1) * 2, False)


@dataclass(frozen=True)
class Lasting(Endurance):
    """A battery that lasts ``times`` as long as its drain says."""

    times: float = 2.0
    falls: bool = False

    def drains(self, flight: Any, elapsed_us: int) -> int:
        return -elapsed_us if self.falls else elapsed_us

    def lasts(self, flight: Any, charge: int) -> int:
        return int(charge * self.times)


@dataclass(frozen=True)
class Patient(Endurance):
    """A battery that counts seconds."""

    def drains(self, flight: Any, elapsed_us: int) -> int:
        return elapsed_us // 1_000_000

    def lasts(self, flight: Any, charge: int) -> int:
        return charge * 1_000_000


def of_drones(**keys: Any) -> dict[str, Any]:
    return {"drones": {"battery": keys}, "stations": {"count": 1}}


def of_users(kind: str) -> dict[str, Any]:
    return {"users": {"count": 6, "mobility": {"kind": f"{HERE}:{kind}"}}}


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "writes": ({"reward": {"kind": f"{HERE}:Grabbing"}}, "it must write its own numbers only"),
    "terms": ({"reward": {"kind": f"{HERE}:Listing"}}, r"must return a mapping .* \[1.0\]"),
    "names": ({"reward": {"kind": f"{HERE}:Renaming"}}, r"must return the terms \['step_"),
    "bounds": ({"observation": {"kind": f"{HERE}:Wide"}}, "'one' is 5.0, which is not from 0 to 1"),
    "whole": ({"observation": {"kind": f"{HERE}:Broken"}}, "'one' is 0.5, and was declared"),
    "long": ({"observation": {"kind": f"{HERE}:Long"}}, "2 numbers for 1 features"),
    "seconds": (of_users("InSeconds"), "fewer than a millisecond each; walker.t_us is in micro"),
    "map": (of_users("OnTheMap"), r"'.*:OnTheMap' failed: AttributeError"),
    "flat": (of_users("Flat"), "must return legs of five columns"),
    "order": (
        {"demand": {"kind": f"{HERE}:Table", "first_us": 5e7}},
        r"row 1 of requests\(\) is earlier than the row before it",
    ),
    "floats": (
        {"demand": {"kind": f"{HERE}:Table", "numbers": "float64"}},
        "must return rows of whole numbers and 7 whole offsets",
    ),
    "inverse": (
        of_drones(kind=f"{HERE}:Lasting"),
        "'Lasting', a hover: a charge of 18000000 lasts 36000000 µs, but 36000000 is taken",
    ),
    "falls": (of_drones(kind=f"{HERE}:Lasting", falls=True), "it has taken -18000000; before"),
    "units": (of_drones(kind=f"{HERE}:Patient"), "lasts 1800000000000000 µs; autonomy_min says"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_one(name: str):
    keys, message = WRONG[name]
    with pytest.raises((AssertionError, SimulationError), match=message):
        check_component(using(**keys), seeds=1, episodes=1, compiled=False)


def test_one_table_of_requests_in_order():
    check_component(using(demand={"kind": f"{HERE}:Table"}), seeds=1, episodes=1, compiled=False)


def test_a_good_component():
    check_component(using(reward={"kind": f"{HERE}:Modest"}), seeds=1)


def test_one_that_remembers_between_runs():
    scenario = using(reward={"kind": f"{HERE}:Counting"})
    with pytest.raises(AssertionError, match=r"steps, row \d+, reward: .* \(seed 1 after others\)"):
        check_component(scenario, compiled=False)


def test_one_that_cannot_be_compiled():
    with pytest.raises(AssertionError, match=r"reward: .*Counting"):
        check_component(using(reward={"kind": f"{HERE}:Counting"}))


def test_one_that_draws_for_itself():
    scenario = using(users={"count": 6, "mobility": {"kind": f"{HERE}:Careless"}})
    with pytest.raises(AssertionError, match=r"row \d+, "):
        check_component(scenario, seeds=1)


@pytest.mark.parametrize("case", ["case1", "case8"])
def test_the_engines_agree(case: str):
    compare_engines(case, {"episode.steps": 5}, seeds=1, episodes=1)
