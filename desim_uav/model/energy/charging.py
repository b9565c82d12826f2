"""Charging: how the battery of a drone on a pad becomes full, in closed form.

Charges are whole numbers, of microseconds of autonomy or of microjoules, and times are whole
microseconds. The charge at a time is rounded down, and the time until the battery is full up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Protocol

from annotated_types import Ge, Gt, Le

from desim_uav.model.energy.battery import (
    LONGEST_MIN,
    Energy,
    capacity_of,
    charge_after,
    in_joules,
    time_to_full_us,
)
from desim_uav.model.rules import MINUTE_US, US
from desim_uav.registry import kind_name, register
from desim_uav.rowcode.kernels import kernel, rule

MOST_US = 2**60
"""No charge lasts longer, in microseconds; this is more than ``LONGEST_MIN``."""

NEAR_US = 1024
"""A search takes single steps up to so many microseconds from where it begins."""


class Charging(Protocol):
    """A model of charging, whose numbers are charges and microseconds."""

    def charged(self, battery: int, elapsed_us: int, capacity: int) -> int:
        """Return the charge ``elapsed_us`` after it was ``battery``; it must not decrease."""

    def until_full_us(self, battery: int, capacity: int) -> int:
        """Return the least time until ``charged`` is ``full``, or 0 if the battery is full now."""

    def full(self, capacity: int) -> int:
        """Return the charge at which a battery counts as full, and at which charging ends."""


class RowCharging:
    """A model of charging that can be compiled, so that both engines run it.

    A subclass is a frozen dataclass. In compiled code ``charged`` and ``until_full_us`` can use its
    fields that are numbers, + - * /, ``math.sqrt``, ``min`` and ``max``, and kernels.
    """

    plain: ClassVar = ()

    def charged(self, battery: int, elapsed_us: int, capacity: int) -> int:
        """Return the charge (see ``Charging.charged``)."""
        raise NotImplementedError

    def until_full_us(self, battery: int, capacity: int) -> int:
        """Return the time until the battery is full (see ``Charging.until_full_us``)."""
        raise NotImplementedError

    def full(self, capacity: int) -> int:
        """Return the capacity."""
        return capacity


Minutes = Annotated[float, Ge(1e-6), Le(LONGEST_MIN)]


@register("charging", "constant")
@dataclass(frozen=True)
class Constant(RowCharging):
    """Charges at a constant rate (the paper)."""

    full_charge_min: Minutes = 5.0
    """How long it takes to charge an empty battery, in minutes."""

    def charged(self, battery: int, elapsed_us: int, capacity: int) -> int:
        """Return the charge, which rises linearly up to the capacity."""
        full_charge_us = round(self.full_charge_min * 60 * US)
        return int(charge_after(battery, elapsed_us, capacity, full_charge_us))

    def until_full_us(self, battery: int, capacity: int) -> int:
        """Return the share of a full charge that is missing."""
        full_charge_us = round(self.full_charge_min * 60 * US)
        return int(time_to_full_us(battery, capacity, full_charge_us))


@register("charging", "cc_cv")
@dataclass(frozen=True)
class Tapered(RowCharging):
    """Charges at a constant power at first (constant current), then ever more slowly.

    From ``taper_from`` on (constant voltage) the missing charge falls exponentially, at first with
    the power that there was. Give either ``power_w`` or ``full_charge_min``.
    """

    power_w: Annotated[float, Ge(1e-3), Le(1e9)] | None = None
    """The power of charging until it tapers off, in watts, for a battery with a `capacity_wh`."""
    full_charge_min: Minutes | None = None
    """How long it takes until an empty battery counts as full, in minutes."""
    taper_from: Annotated[float, Ge(0), Le(0.999)] = 0.8
    """The share of the capacity from which on the power falls."""
    full_at: Annotated[float, Gt(0), Le(0.9999)] = 0.99
    """The share of the capacity at which a battery counts as full."""

    power: float = field(init=False, repr=False, default=0.0)
    """The power in µJ per µs, or 0 if it follows from the time."""
    per_capacity: float = field(init=False, repr=False, default=0.0)
    """The power over the capacity, per µs, if it follows from the time."""

    def __post_init__(self) -> None:
        """Set the power. Raises ValueError unless there is either a power or a time."""
        if (self.power_w is None) == (self.full_charge_min is None):
            raise ValueError("give either power_w or full_charge_min")
        if self.power_w is not None:
            object.__setattr__(self, "power", float(self.power_w))
        if self.full_charge_min is not None:
            knee, left = min(self.taper_from, self.full_at), 1.0 - self.taper_from
            span = knee + left * math.log(left / (1.0 - max(self.taper_from, self.full_at)))
            object.__setattr__(self, "per_capacity", span / (self.full_charge_min * 60 * US))

    def full(self, capacity: int) -> int:
        """Return the share ``full_at`` of the capacity."""
        return _full(self, capacity)

    def charged(self, battery: int, elapsed_us: int, capacity: int) -> int:
        """Return the charge, which does not rise above ``full``."""
        power, full = self.power + self.per_capacity * capacity, _full(self, capacity)
        return int(tapered(battery, elapsed_us, capacity, power, float(self.taper_from), full))

    def until_full_us(self, battery: int, capacity: int) -> int:
        """Return the time until ``full`` is reached."""
        power, full = self.power + self.per_capacity * capacity, _full(self, capacity)
        return int(until_tapered(battery, capacity, power, float(self.taper_from), full))

    def problems(self, battery: Energy) -> list[str]:
        """Return why a battery cannot be charged like this."""
        if self.power_w is not None and not in_joules(battery):
            kind = kind_name(battery)
            return [
                f"power_w charges a battery that is measured in Wh, which {kind!r} is not; "
                "give full_charge_min"
            ]
        capacity = capacity_of(battery)
        if self.full_at * capacity < 1.0:
            unit = "microjoules" if in_joules(battery) else "microseconds"
            return [
                f"full_at: {self.full_at:g} of a capacity of {capacity:g} {unit} is less than one, "
                "the least charge"
            ]
        takes_min = self.until_full_us(0, capacity) / MINUTE_US
        if takes_min > LONGEST_MIN:
            more = "more than " if takes_min * MINUTE_US >= MOST_US else ""
            return [
                f"a full charge takes {more}{takes_min:g} min; it may take {LONGEST_MIN} at most"
            ]
        return []


@rule
def _full(own: Tapered, capacity: int) -> int:
    """Return the charge that counts as full, at least 1."""
    full: int = max(1, round(own.full_at * float(capacity)))
    return full


@kernel
def tapered(
    battery: int, elapsed_us: int, capacity: int, power: float, taper_from: float, full: int
) -> int:
    """Return the charge, rounded down, that a battery has ``elapsed_us`` later (see ``Tapered``).

    The missing charge falls by the factor exp(-t / τ), τ = (1 - taper_from) capacity / power.
    """
    if battery >= full:
        return battery
    knee = taper_from * capacity
    linear_us = max(0.0, (knee - battery) / power)
    if elapsed_us <= linear_us:
        return min(full, battery + int(power * elapsed_us))
    tau_us = (1.0 - taper_from) * capacity / power
    missing = capacity - max(float(battery), knee)
    charge = capacity - missing * math.exp((linear_us - elapsed_us) / tau_us)
    return max(battery, min(full, int(charge)))


@kernel
def until_tapered(battery: int, capacity: int, power: float, taper_from: float, full: int) -> int:
    """Return the least time until ``tapered`` reaches ``full``, or ``MOST_US`` if it is longer.

    From the time by the formula on it is sought step by step, first of a microsecond, then of ever
    more; in the last step it is found by bisection.
    """
    if battery >= full:
        return 0
    knee = taper_from * capacity
    if full <= knee:
        takes_us = (full - battery) / power
    else:
        linear_us = max(0.0, (knee - battery) / power)
        tau_us = (1.0 - taper_from) * capacity / power
        missing = capacity - max(float(battery), knee)
        takes_us = linear_us + tau_us * math.log(missing / (capacity - full))
    near_us = int(min(takes_us, MOST_US))
    least_us, most_us = near_us - 1, near_us
    while most_us < MOST_US and tapered(battery, most_us, capacity, power, taper_from, full) < full:
        least_us, most_us = most_us, most_us + 1 + (most_us - near_us) // NEAR_US
    while least_us > 0 and tapered(battery, least_us, capacity, power, taper_from, full) >= full:
        least_us, most_us = least_us - 1 - (near_us - least_us) // NEAR_US, least_us
    least_us = max(least_us, 0)
    while most_us - least_us > 1:
        middle_us = (least_us + most_us) // 2
        if tapered(battery, middle_us, capacity, power, taper_from, full) < full:
            least_us = middle_us
        else:
            most_us = middle_us
    return most_us


@register("charging", "swap")
@dataclass(frozen=True)
class Swap(RowCharging):
    """Replaces the battery by a full one, which always takes the same time."""

    minutes: Minutes
    """How long it takes, in minutes."""

    def charged(self, battery: int, elapsed_us: int, capacity: int) -> int:
        """Return the old battery's charge until the new one is in place."""
        return capacity if elapsed_us >= round(self.minutes * 60 * US) else battery

    def until_full_us(self, battery: int, capacity: int) -> int:
        """Return the time of a swap, or 0 if the battery is full."""
        return round(self.minutes * 60 * US) if battery < capacity else 0
