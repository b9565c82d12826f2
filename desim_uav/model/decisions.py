"""Decisions: when drones are asked what to do next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Protocol

from annotated_types import Ge, Le

from desim_uav.registry import register
from desim_uav.rowcode.kernels import kernel


class Decisions(Protocol):
    """The component ``decisions`` of a scenario, which says when drones receive commands.

    With ``by_event``, a drone is asked for its next command when it is free, and a hover lasts for
    ``patience_s`` seconds. Otherwise all drones are asked together, at the end of each step.
    """

    by_event: bool
    patience_s: float


@register("decisions", "clock")
@dataclass(frozen=True)
class ByClock:
    """All drones are asked at the end of each step, as in the paper."""

    by_event: ClassVar[bool] = False
    patience_s: ClassVar[float] = 0.0


@register("decisions", "event")
@dataclass(frozen=True)
class ByEvent:
    """Each drone is asked when it is free: it has arrived, is charged, or has hovered for a time.

    A drone that replaces a crashed one is asked when it appears. In free flight, a drone is asked
    when it has arrived, but not earlier than ``patience_s`` after its last command; it hovers until
    then.
    """

    patience_s: Annotated[float, Ge(1), Le(86_400)] = 60.0
    """How long a drone hovers until it is asked again, in seconds."""

    by_event: ClassVar[bool] = True


@kernel
def discount_of(gamma: float, steps: float) -> float:
    """Return the discount of what follows a transition that has lasted so many steps.

    ``gamma`` is the discount of a step. By clock each transition lasts for a step, and its discount
    is exactly ``gamma``. By event, the transition is one of a semi-Markov decision process.
    """
    return float(gamma**steps)
