"""Components of one's own that index beyond a table, which scenarios of tests name.

``at`` is the index. The line of each fault ends with the comment ``# here``.
"""

from __future__ import annotations

import inspect
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from desim_uav.learning.q_learning import QLearning
from desim_uav.model.admission import RowAdmission
from desim_uav.model.demand.asking import RowDemand, ask_for, ask_for_mix
from desim_uav.model.energy.battery import Endurance
from desim_uav.model.energy.charging import Constant
from desim_uav.model.mobility.walking import RowMobility, stay
from desim_uav.model.observations import Feature, RowObservation
from desim_uav.model.radio.path_loss import FreeSpace
from desim_uav.model.rewards import RowReward
from desim_uav.model.sharing import RowSharing
from desim_uav.rowcode.kernels import rule

CONSTANTS = np.array([0.25, 0.5, 1.0])


def place_of(part: Any) -> str:
    """The end of the message of a fault in this class or function: file, line and function."""
    lines, first = inspect.getsourcelines(part)
    (line,) = [first + k for k, text in enumerate(lines) if text.endswith("# here\n")]
    before = [text.strip() for text in lines[: line - first]]
    names = [text.split("(")[0][4:] for text in before if text.startswith("def ")]
    name = part.__qualname__ + ("" if inspect.isfunction(part) else f".{names[-1]}")
    return f"({__file__}:{line}, in {name})"


@dataclass(frozen=True)
class Previous(RowReward):
    """Pay by another drone, which may not exist."""

    at: int = -1
    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        other = state.observations[self.at]  # here
        drone.terms[0] = float(other.attached_users)


@dataclass(frozen=True)
class TermTooMany(RowReward):
    """Write a term that the reward does not have."""

    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        drone.terms[0] = 1.0
        drone.terms[1] = 2.0  # here


@rule
def helped(state: Any, at: int) -> float:
    return float(state.users[at].request.number)  # here


@dataclass(frozen=True)
class Helped(RowReward):
    """Pay by a function of one's own."""

    at: int = 10**9
    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        drone.terms[0] = helped(state, self.at)


@dataclass(frozen=True)
class FromArray(RowReward):
    """Pay by an array of the module."""

    at: int = 3
    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        drone.terms[0] = CONSTANTS[self.at]  # here


@dataclass(frozen=True)
class Popping(RowReward):
    """Take what nobody has put."""

    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        while True:
            drone.waiting.pop()  # here


@dataclass(frozen=True)
class Removing(RowReward):
    """Remove what is not there."""

    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        drone.waiting.clear()
        drone.waiting.append(7)
        drone.waiting.remove(8)  # here


@dataclass(frozen=True)
class Inserting(RowReward):
    """Insert beyond the end."""

    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        drone.waiting.clear()
        drone.waiting.insert(2, 7)  # here


@dataclass(frozen=True)
class Crowded(RowReward):
    """Pay, but not if more than ``at`` users are attached to drone 0."""

    at: int = 20
    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        drone.terms[int(state.observations[0].attached_users > self.at)] = 1.0  # here


@dataclass(frozen=True)
class Scanning(RowAdmission):
    """Look at a user who does not exist."""

    at: int = -1

    def scan_rows(self, world: Any, path: Any, state: Any, drone: Any, phase: int) -> None:
        if state.users[self.at].holder > 0:  # here
            drone.waiting.clear()


@dataclass(frozen=True)
class Seeing(RowObservation):
    """Write a feature that it does not have."""

    at: int = 1

    def features(self, facts: Any) -> tuple[Feature, ...]:
        return (Feature("x", 0, 1, True),)

    def write(self, world: Any, state: Any, drone: Any) -> None:
        drone.features[self.at] = 1.0  # here


@dataclass(frozen=True)
class Draining(Endurance):
    """Look at a piece that a hover does not have."""

    at: int = -1

    def drains(self, flight: Any, elapsed_us: int) -> int:
        if flight.distance_m == 0.0:
            return int(flight.pieces[self.at].start_s)  # here
        return elapsed_us


@dataclass(frozen=True)
class Charging(Constant):
    """Look up a rate that it does not have."""

    at: int = -1
    rates: tuple[float, ...] = (1.0, 2.0)

    def charged(self, battery: int, elapsed_us: int, capacity: int) -> int:
        if elapsed_us > 0 and self.rates[self.at] > 0.0:  # here
            return capacity
        return battery


@dataclass(frozen=True)
class Sharing(RowSharing):
    """Share with a user who does not exist."""

    at: int = -1

    def divide(self, world: Any, state: Any, drone: Any, phase: int) -> None:
        if state.users[drone.sharing[self.at]].holder > 1000:  # here
            drone.waiting.clear()


@dataclass(frozen=True)
class Walking(RowMobility):
    """Look up a speed that it does not have."""

    at: int = -1
    speeds: tuple[float, ...] = (1.0, 2.0)

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        stay(walker, walker.t_us + int(1e6 * self.speeds[self.at]))  # here


@dataclass(frozen=True)
class Asking(RowDemand):
    """Look up a wait that it does not have."""

    at: int = -1
    waits: tuple[float, ...] = (1.0, 2.0)

    def next_request(self, asker: Any, stream: Any, services: Any) -> None:
        asker.wait_us = int(1e6 * self.waits[self.at])  # here
        ask_for_mix(asker, stream, services, 0.0)


@dataclass(frozen=True)
class AskingForMore(RowDemand):
    """Ask a rule for a service that does not exist."""

    def next_request(self, asker: Any, stream: Any, services: Any) -> None:
        asker.wait_us = 1
        ask_for(asker, stream, services, 1000)


@dataclass(frozen=True)
class Losing(FreeSpace):
    """Look up a loss that it does not have."""

    at: int = -1
    losses: tuple[float, ...] = (1.0, 2.0)

    def los_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        extra_db = 0.0 * self.losses[self.at]  # here
        return 20.0 * math.log10(max(distance_m, 1.0)) + 40.0 + extra_db

    def slope(self, distance_m: float, height_m: float, within_m: float) -> tuple[float, float]:
        return 1e3, 1e3


class NextState(QLearning):
    """Learn of a state that does not exist."""

    @staticmethod
    def update(q: Any, lesson: Any) -> None:
        q[0, lesson.state, lesson.action] = 0.5
        q[0, q.states, lesson.action] = 1.0  # here


class LastAction(QLearning):
    """Learn by the action before the first."""

    @staticmethod
    def update(q: Any, lesson: Any) -> None:
        value = q[0, lesson.state, -1]  # here
        q[0, lesson.state, 0] = value


class Allowed(QLearning):
    """Ask whether an action is allowed that does not exist."""

    @staticmethod
    def update(q: Any, lesson: Any) -> None:
        if lesson.allowed[len(lesson.allowed)]:  # here
            q[0, lesson.state, 0] = 1.0
