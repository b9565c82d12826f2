"""What a scenario says about learning: the algorithm, its parameters, and their schedules."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from desim_uav.errors import did_you_mean
from desim_uav.scenario.section import Fraction, Section

ALGORITHMS = ("q_learning", "sarsa", "expected_sarsa", "double_q")


def _algorithm(name: str) -> str:
    if name not in ALGORITHMS and not re.fullmatch(r"[\w.]+:\w+", name):
        ppo = "; PPO is trained by policies/ppo.py of the checkout" if "ppo" in name.lower() else ""
        raise ValueError(
            f"unknown algorithm{did_you_mean(name, ALGORITHMS)}; "
            f'allowed: {", ".join(ALGORITHMS)}, or "package.module:Class"{ppo}'
        )
    return name


class Schedule(Section):
    """A parameter over the episodes of a training: ``start`` x ``decay`` each, down to ``end``."""

    start: Fraction = 1.0
    """The value in the first episode."""
    decay: Fraction = 1.0
    """The factor by which the value is multiplied after each episode."""
    end: Fraction = 0.0
    """The value below which it does not fall."""

    def at(self, episode: int) -> float:
        """Its value in an episode, counted from 0."""
        return self.over((episode,))[0]

    def over(self, episodes: Iterable[int]) -> list[float]:
        """Its values in these episodes."""
        start, decay, end = self.start, self.decay, self.end
        values = [start * decay**episode for episode in episodes]
        return [value if value > end else end for value in values]


def _schedule(value: object) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | float | Mapping | Schedule):
        raise ValueError("must be a number, or a mapping of start, decay and end")
    return {"start": value} if isinstance(value, int | float) else value


def _over(default: Schedule) -> BeforeValidator:
    """A number is a constant; of a mapping, what is not given is as by default."""

    def filled(value: object) -> Any:
        return default.model_dump() | value if isinstance(value, dict) else _schedule(value)

    return BeforeValidator(filled, json_schema_input_type=Schedule | Fraction)


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
        near = did_you_mean(value, INITIAL_Q) if isinstance(value, str) else ""
        raise ValueError(f"must be {', '.join(INITIAL_Q)}, or a number from -1e6 to 1e6{near}")
    return value


class Learning(Section):
    """How a drone learns: the algorithm, its parameters, and for how many episodes.

    With carry-over, every so many episodes (``restart_every``; null: never) begin at the starts.
    """

    algorithm: Annotated[str, AfterValidator(_algorithm)] = "q_learning"
    """`q_learning`, `sarsa`, `expected_sarsa`, `double_q`, or the class of an algorithm of
    your own as `"package.module:Class"`.
    """
    alpha: Annotated[Schedule, _over(ALPHA)] = ALPHA
    """The learning rate: a number, or a schedule over the episodes."""
    gamma: Annotated[float, Field(ge=0, lt=1)] = 0.95
    """The discount factor per step, from which environments also compute the info `discount`."""
    epsilon: Annotated[Schedule, _over(EPSILON)] = EPSILON
    """The probability of a random action: a number, or a schedule over the episodes."""
    initial_q: Annotated[InitialQ, BeforeValidator(_initial_q)] = 3.0
    """The values with which a table begins: `zero`, `random` (uniform from 0 to 1),
    `max_reward` (1), `prior` (how near the action's next cell is to a cluster), or a
    number.
    """
    episodes: Annotated[int, Field(ge=1, le=10**7)] = 12_000
    """The number of episodes of a training."""
    restart_every: Annotated[int, Field(ge=1, le=10**7)] | None = 3
    """With carry-over, every so many episodes of a training begin at the start places; null
    means never.
    """


PAPER_LEARNING: dict[str, Any] = {
    "alpha": {"start": 1.0, "decay": 1.0, "end": 0.0},
    "gamma": 0.95,
    "epsilon": {"start": 1.0, "decay": 0.998, "end": 0.01},
    "initial_q": "random",
    "episodes": 7000,
    "restart_every": None,
}
"""The keys with which the paper trained its learners."""
