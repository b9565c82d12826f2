"""Components that keep their promises, and some that break one each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from desim_uav.model.mobility.mobility import Walks
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
