"""Energy models, by which flight drains a battery, and charging.

The charge of a battery is measured in microseconds of autonomy (flight time), or by an energy model
with a ``capacity_uj`` in microjoules; names such as ``charge`` stand for both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, Protocol

from annotated_types import Ge, Gt, Le

from desim_uav.model.motion.motion import Motion, Transit
from desim_uav.model.rules import MINUTE_US, US
from desim_uav.registry import register
from desim_uav.rowcode.kernels import kernel

MOST_CHARGE = 2**46
"""The largest capacity, in microseconds or microjoules: ``_share`` counts up to it."""

LONGEST_MIN = 1_000_000
"""The longest autonomy and the longest full charge, in minutes, that ``charge_after`` allows."""

WH_UJ = 3_600_000_000
"""The microjoules of a watt-hour."""

MOST_UJ = 2.0**46
"""The most energy of a leg that is told: 100,000 such legs add up to less than 2^63."""


class Energy(Protocol):
    """An energy model, which says how flight drains a battery and what happens if it is empty."""

    autonomy_min: float
    return_below: float
    on_crash: Literal["respawn", "remove", "end_episode"]
    respawn_after_min: float

    def drain_of(self, flight: Transit, elapsed_us: int) -> int:
        """Return the autonomy used in the first ``elapsed_us`` of a transit (``REST``: a hover).

        It is a whole number of microseconds and must not decrease with ``elapsed_us``, which is at
        most the transit's duration; a hover can last for any time.
        """

    def lasts_us(self, flight: Transit, charge: int) -> int:
        """Return the smallest ``elapsed_us`` at which ``drain_of`` reaches ``charge``."""


class RowEnergy:
    """An energy model that can be compiled, so that both engines run it.

    A subclass is a frozen dataclass with the fields of ``Energy``. ``flight`` has
    ``duration_us``, ``distance_m`` (0.0: a hover) and ``pieces``, each with its constant
    ``acceleration_mps2`` and, at its start, ``start_s``, ``from_m`` and ``speed_mps``; the last one
    is the rest at the destination. ``rises``, ``tail_mps`` and ``side_mps`` are those of
    ``model.motion.motion.Transit``. Compiled code can use rows and numbers only.
    """

    plain: ClassVar = ("drain_of", "lasts_us")
    """The methods of which a subclass overrides one if it works on Python objects, not on rows."""

    def drains(self, flight: Transit, elapsed_us: int) -> int:
        """Return the autonomy used, in microseconds (see ``Energy.drain_of``)."""
        raise NotImplementedError

    def lasts(self, flight: Transit, charge: int) -> int:
        """Return the time until the battery is empty, in microseconds (see ``Energy.lasts_us``)."""
        raise NotImplementedError

    def drain_of(self, flight: Transit, elapsed_us: int) -> int:
        """Return the autonomy used, by ``drains``."""
        return self.drains(flight, elapsed_us)

    def lasts_us(self, flight: Transit, charge: int) -> int:
        """Return the time until the battery is empty, by ``lasts``."""
        return self.lasts(flight, charge)


def capacity_of(energy: Energy | None) -> int:
    """Return what a full battery holds, in microseconds or microjoules; 0 if it is unlimited."""
    if energy is None:
        return 0
    return in_joules(energy) or round(energy.autonomy_min * 60 * US)


def in_joules(energy: Energy | None) -> int:
    """Return the capacity in microjoules, or 0 if a battery is not measured in them."""
    return getattr(energy, "capacity_uj", 0)


def drain_per_s_of(energy: Energy | None, wind_mps: float = 0.0) -> int:
    """Return how much charge a second of hovering takes: in microseconds, or in microjoules.

    In wind, a drone hovers at its speed through the air, if the energy model has powers by speed.
    """
    level_w: Callable[[float], float] | None = getattr(energy, "level_w", None)
    if wind_mps > 0.0 and in_joules(energy) and level_w is not None:
        return max(1, round(level_w(wind_mps) * US))
    return getattr(energy, "hover_uw", US)


def time_of_hover_problems(capacity_wh: float, power_w: float, autonomy_min: float) -> list[str]:
    """Return why a battery does not last for a time that can be counted, if so."""
    if 1 / 60 <= autonomy_min <= LONGEST_MIN:
        return []
    return [
        f"{capacity_wh:g} Wh last {60 * autonomy_min:g} s in a hover at {power_w:g} W; capacity_wh "
        f"must suffice for 1 s to {LONGEST_MIN} min"
    ]


@register("battery", "endurance")
@dataclass(frozen=True)
class Endurance(RowEnergy):
    """Drains one second of autonomy per second in the air, whatever the drone does (the paper).

    ``return_below``: goto_charging_station is allowed at or below this share of the capacity.
    ``respawn_after_min``: the time after a crash until a drone is replaced, in minutes, rounded up
    to a decision epoch.
    """

    autonomy_min: Annotated[float, Gt(0)] = 30.0
    """How long a full battery lasts in the air, in minutes."""
    return_below: Annotated[float, Gt(0), Le(1)] = 0.2
    """`goto_charging_station` is allowed at or below this share of the capacity."""
    on_crash: Literal["respawn", "remove", "end_episode"] = "respawn"
    """What happens after a crash: the drone is replaced (`respawn`), stays away (`remove`), or
    the episode ends (`end_episode`).
    """
    respawn_after_min: Annotated[float, Ge(0)] = 10.0
    """How many minutes after a crash the drone is replaced, at the next decision epoch."""

    def drains(self, flight: Transit, elapsed_us: int) -> int:
        """Return the time in the air, which is the autonomy used."""
        return elapsed_us

    def lasts(self, flight: Transit, charge: int) -> int:
        """Return the charge, which is the time left in the air."""
        return charge


@register("battery", "per_action")
@dataclass(frozen=True)
class PerAction(Endurance):
    """Drains the same for every action: a step of hovering, or a flight to the next cell or level.

    Each hop of a return is an action too, however short it is. The battery drains evenly during a
    flight.
    """

    action_min: Annotated[float, Ge(1 / 60), Le(1440)] = 1.0
    """How much autonomy an action takes, in minutes. It must be the length of a step."""

    def drains(self, flight: Transit, elapsed_us: int) -> int:
        """Return the share of an action that has passed, or the time of a hover."""
        if flight.distance_m == 0.0:
            return elapsed_us
        action_us = round(self.action_min * float(MINUTE_US))
        drain_of, _ = _share(action_us, elapsed_us, flight.duration_us)
        return drain_of

    def lasts(self, flight: Transit, charge: int) -> int:
        """Return the time until the actions' shares add up to the battery."""
        if flight.distance_m == 0.0:
            return charge
        action_us = round(self.action_min * float(MINUTE_US))
        flights, duration_us = charge // action_us, flight.duration_us
        rest_us, left = _share(duration_us, charge - flights * action_us, action_us)
        return int(flights * duration_us + rest_us + (1 if left > 0 else 0))

    def problems(self, motion: Motion, step_s: float) -> list[str]:
        """Return why an action of serving flight would not take ``action_min``."""
        if getattr(motion, "space", "cells") == "free":
            return ["an action leads to the next cell: drones.motion must have space: cells"]
        if round(self.action_min * float(MINUTE_US)) != round(step_s * US):
            return [
                f"an action takes {self.action_min:g} min, but a step of hovering takes "
                f"{step_s / 60:g}; action_min must be the length of a step"
            ]
        if getattr(motion, "timing", "fill_epoch") != "fill_epoch":
            return [
                "a drone that hovers after a move would pay for two actions; per_action needs "
                "drones.motion.timing: fill_epoch"
            ]
        return []


@kernel
def charge_after(charge: int, elapsed_us: int, capacity: int, full_charge_us: int) -> int:
    """Return the battery after ``elapsed_us`` of charging, rounded down to a microsecond.

    Charging is linear and takes ``full_charge_us`` for the whole capacity. All times are below
    2^46 microseconds, which is more than ``LONGEST_MIN``.
    """
    if elapsed_us >= full_charge_us:
        return capacity
    gain, _ = _share(capacity, elapsed_us, full_charge_us)
    return min(capacity, charge + gain)


@kernel
def time_to_full_us(charge: int, capacity: int, full_charge_us: int) -> int:
    """Return the time to a full battery, rounded up to a microsecond (see ``charge_after``)."""
    takes_us, rest = _share(full_charge_us, capacity - charge, capacity)
    return takes_us + (1 if rest > 0 else 0)


@kernel
def _share(amount: int, part: int, whole: int) -> tuple[int, int]:
    """Return the quotient and the remainder of ``amount * part`` divided by ``whole``.

    The product of two times may need more than 64 bits, so the amount is taken 16 bits at a time,
    as in long division. 0 <= part <= whole; all three are below 2^46.
    """
    quotient, rest = 0, 0
    for shift in (32, 16, 0):
        rest = (rest << 16) + part * ((amount >> shift) & 0xFFFF)
        quotient = (quotient << 16) + rest // whole
        rest = rest % whole
    return quotient, rest
