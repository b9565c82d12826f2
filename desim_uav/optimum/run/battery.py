"""What flights take from the battery of a type of drones, in whole units, and how long it lasts.

The relaxed drone of a bound has its drains rounded down, so that it never has less than a drone of
an engine after the same legs. The careful drone of a schedule has them rounded up, so that it never
has more.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.drone_type import DroneType
from desim_uav.errors import UsageError
from desim_uav.model.energy.battery import Endurance, PerAction
from desim_uav.model.energy.charging import Constant, Swap, Tapered
from desim_uav.model.energy.rotary_wing import RotaryWing
from desim_uav.model.motion.needs import drawn_uj
from desim_uav.model.rules import Action
from desim_uav.optimum.run.legs import HEADINGS

FLIGHTS = (*HEADINGS, Action.UP, Action.DOWN)
"""The actions that are legs, by their number."""

ROUNDED = 4
"""By how many units the drain of a leg may differ that is computed in parts, each rounded down."""

FINEST = 24
"""The largest number of units that the cheapest leg takes."""

CLOSE = 0.005
"""The share of a leg's drain that rounding may change where fewer units are enough."""


class Charges(NamedTuple):
    """A battery in whole units: what legs take, and what follows after u units have been taken.

    ``drains`` are those of legs. A charge ends with ``full`` units taken. After u units the battery
    has at most ``most`` (J,) and at least ``least`` (J,), in units of its model; ``leg`` is the
    most that a leg takes of it.
    """

    drains: NDArray[np.int64]
    full: int
    leg: int
    most: NDArray[np.int64]
    least: NDArray[np.int64]


def refuse_other_batteries(kind: DroneType) -> None:
    """Raise UsageError, with the key, if a battery or its charging is not of a known kind."""
    battery: Any = kind.drones.battery
    charging: Any = kind.scenario.charging
    if type(battery) not in (Endurance, PerAction, RotaryWing):
        raise UsageError(
            f"drones.battery.kind: {type(battery).__name__}: a run can be bounded only with "
            "endurance, per_action or rotary_wing, whose drain in a step is known"
        )
    if kind.on_crash == "end_episode":
        raise UsageError(
            "drones.battery.on_crash: a run cannot be bounded with 'end_episode', because its "
            "length depends on the policy"
        )
    if type(charging) not in (Constant, Tapered, Swap):
        raise UsageError(
            f"stations.charging.kind: {type(charging).__name__}: a run can be bounded only with "
            "constant, cc_cv or swap, with which a charge takes no longer if the battery has more"
        )


def relaxed_charges(kind: DroneType, step_us: int, finest: int = FINEST) -> Charges:
    """Return the battery of the relaxed drone, whose cheapest leg takes at most ``finest`` units.

    Its hover takes no more than a climb, a descent, or a blocked move, which are hovers on the map.
    """
    flown = _flown(kind, step_us)
    ranges = [flown[leg] for leg in HEADINGS]
    rises = [flown[leg] for leg in (Action.UP, Action.DOWN)]
    hovers = [ranges[0], *rises]
    ranges[0] = min(low for low, _ in hovers), max(high for _, high in hovers)
    lows = [low for low, _ in ranges]
    unit = _unit(lows, finest, lambda low, parts: low // parts, np.floor)
    drains = np.array([low // unit for low in lows])
    shares = [high / (drain * unit) for (_, high), drain in zip(ranges, drains, strict=True)]
    used = np.arange(-(-kind.capacity // unit))
    full = (kind.capacity - kind.full) // unit
    taken = np.ceil(used * (unit * max(shares))).astype(np.int64)
    after_charge = kind.full - np.ceil(np.maximum(used - full, 0) * (unit * max(shares)))
    least = np.minimum(kind.capacity - taken, after_charge.astype(np.int64))
    leg = max(high for _, high in ranges)
    return Charges(drains, full, leg, kind.capacity - used * unit, least)


def careful_charges(kind: DroneType, step_us: int) -> Charges:
    """Return the battery of a drone of a schedule, whose legs are ``FLIGHTS``."""
    flown = _flown(kind, step_us)
    highs = [flown[leg][1] for leg in FLIGHTS]
    unit = _unit(highs, FINEST, lambda high, parts: -(-high // parts), np.ceil)
    used = np.arange(-(-kind.capacity // unit))
    left = kind.capacity - used * unit
    drains = np.array([-(-high // unit) for high in highs])
    full = -(-(kind.capacity - kind.full) // unit)
    return Charges(drains, full, max(highs), left, left)


def crash_us(kind: DroneType, step_us: int, least: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the least time from charges of at least so much to the replacement after a crash.

    It is that to an empty battery, and the downtime. The drone may hover, fly or return, and its
    last leg or hop may take all of what it takes at once.
    """
    battery: Any = kind.drones.battery
    lasts_us = np.zeros(len(least), np.int64)
    if type(battery) is Endurance:
        lasts_us = np.maximum(least, 0)
    if type(battery) is RotaryWing:
        hops = [
            (battery.drain_of(flight, flight.duration_us), flight.duration_us)
            for flight in kind.return_transits.values()
        ]
        taken = [(high, step_us) for _, high in _flown(kind, step_us).values()]
        taken += [(drain + drawn_uj(kind.draws_uw, us) + ROUNDED, us) for drain, us in hops]
        last, fastest = max(drain for drain, _ in taken), max(drain / us for drain, us in taken)
        lasts_us = np.floor(np.maximum(least - last, 0) / fastest).astype(np.int64)
    return lasts_us + kind.respawn_after_us


def hop_of(kind: DroneType, axis: tuple[int, int, int]) -> tuple[int, int]:
    """Return the time of a hop of a return, and what it takes from the battery at least."""
    flight = kind.return_transits[axis]
    battery: Any = kind.drones.battery
    if type(battery) is not RotaryWing:
        return flight.duration_us, flight.duration_us
    return flight.duration_us, battery.drain_of(flight, flight.duration_us) - ROUNDED


def _flown(kind: DroneType, step_us: int) -> dict[Action, tuple[int, int]]:
    """Return what a step with each leg takes at least and at most; a leg that is none hovers."""
    battery: Any = kind.drones.battery
    if type(battery) is not RotaryWing:
        return dict.fromkeys(FLIGHTS, (step_us, step_us))
    drawn = drawn_uj(kind.draws_uw, step_us)
    taken = {
        leg: int(battery.drain_of(kind.epoch_transits.get(leg, kind.rest), step_us))
        for leg in FLIGHTS
    }
    return {leg: (max(1, uj - ROUNDED), uj + drawn + ROUNDED) for leg, uj in taken.items()}


def _unit(
    drains: list[int],
    finest: int,
    part: Callable[[int, int], int],
    rounded: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> int:
    """Return the largest unit whose rounding changes all drains little, or else the best one."""
    units = [max(1, part(min(drains), parts)) for parts in range(1, finest + 1)]
    taken = np.array(drains, float)
    losses = [float(np.abs(rounded(taken / unit) * unit / taken - 1.0).max()) for unit in units]
    close = [unit for unit, loss in zip(units, losses, strict=True) if loss <= CLOSE]
    return close[0] if close else units[int(np.argmin(losses))]
