"""The charge of drones' batteries at any time of an episode, in the units of the energy model."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise

import pandas as pd

from desim_uav.drone_type import DroneType
from desim_uav.errors import PolicyError
from desim_uav.model.energy.battery import Energy
from desim_uav.model.energy.charging import Charging
from desim_uav.model.motion.motion import Transit
from desim_uav.model.rules import US
from desim_uav.report.run import Run
from desim_uav.report.tracks import Track

Knot = tuple[int, int]
"""A time in microseconds and the charge at that time; the charge is linear in between."""

PARTS = 16
"""The number of pieces of which a charge is drawn that is not linear."""

RAMP_PARTS = 8
"""The number of pieces of which the energy of a drone that speeds up or slows down is drawn."""

NEAR_US = 1000
"""Half the time over which a power is measured."""


def charges_before(run: Run, episode: int) -> list[int]:
    """Return each drone's charge at the start of an episode: full, or that of the episode before.

    It is 0 if the battery is unlimited. Raises PolicyError if the table of steps lacks it.
    """
    types = [run.world.type_of(drone) for drone in range(run.scenario.drone_count)]
    steps = run.of("steps", episode - 1)
    last = run.scenario.episode.steps - 1
    if run.scenario.decisions.by_event:
        last = steps["step"].max()
    ends = steps[steps["step"] == last].sort_values("drone")
    if not run.settings.carry_over or len(ends) != len(types) or _ended(types, ends["crashed"]):
        return [own.capacity for own in types]
    held_s = [s if own.limited else 0.0 for own, s in zip(types, ends["battery_s"], strict=True)]
    if pd.isna(held_s).any():
        raise PolicyError(f"{run.folder / 'steps.parquet'}: battery_s: a value is missing")
    return [
        round(battery_s * own.drain_per_s) for own, battery_s in zip(types, held_s, strict=True)
    ]


def _ended(types: Sequence[DroneType], crashed: Iterable[bool]) -> bool:
    """Return whether a drone had crashed whose type's crashes end episodes."""
    fallen = zip(types, crashed, strict=True)
    return any(has and own.on_crash == "end_episode" for own, has in fallen)


def battery_curve(
    own: DroneType,
    track: Track,
    begins_with: int,
    records: Sequence[Knot],
    events: Sequence[tuple[int, str]],
    end_us: int,
) -> list[Knot]:
    """Return the charge of a battery of this type: ``battery_knots``, and others in its flights."""
    energy, charging = own.drones.battery, own.scenario.charging
    assert energy is not None
    assert charging is not None
    knots = battery_knots(begins_with, records, events, own.capacity, charging)
    flown = knots_in_flight(energy, track, knots, end_us)
    return sorted([*flown, *knots], key=lambda knot: knot[0])


def battery_knots(
    begins_with: int,
    records: Sequence[Knot],
    events: Sequence[tuple[int, str]],
    capacity: int,
    charging: Charging,
) -> list[Knot]:
    """Return the charge of a battery: its records, and exact values at events between them.

    ``events`` are times and kinds of a drone's events, in order. A battery is empty at a crash, and
    full after charging and in a replacement. The charge at landing is computed backwards from the
    charging that follows, so it does not depend on the energy model.
    """
    knots, full = [(0, begins_with), *records], charging.full(capacity)
    for k, (t_us, kind) in enumerate(events):
        if kind == "crash":
            knots.append((t_us, 0))
        elif kind == "respawn":
            knots += [(t_us, 0), (t_us, capacity)]
        elif kind == "charged":
            knots.append((t_us, max(full, knots[-1][1] if knots[-1][0] == t_us else 0)))
        elif kind in ("land", "charge"):
            charge, until_us = _on_landing(events[k:], records, capacity, charging)
            knots.append((t_us, charge))
            if kind == "charge":
                knots += _while_charging(charge, t_us, until_us, capacity, charging)
    # The sort is stable: jumps keep their order, and a replacement at a record comes after it.
    return sorted(knots, key=lambda knot: knot[0])


def knots_in_flight(
    energy: Energy, track: Track, knots: Sequence[Knot], end_us: int
) -> Iterator[Knot]:
    """Yield the charge in flights that take more or less than a hover, where it is not linear.

    ``knots`` are those of ``battery_knots``: a flight begins with the charge of one of them, or at
    the end of the hop before it. If it began before the episode, the energy until then is added.
    """
    times = [t_us for t_us, _ in knots]
    landed_us, charge = -1, 0
    for number, flight in track.flights():
        starts_us = int(track.starts_us[number])
        if starts_us < 0:
            charge = knots[0][1] + energy.drain_of(flight, -starts_us)
        elif starts_us != landed_us:
            charge = knots[bisect_right(times, starts_us) - 1][1]
        until_us = min(end_us, track.until_us(number))
        for elapsed_us in () if _is_even(energy, flight) else samples_us(flight):
            if elapsed_us > 0 and 0 < starts_us + elapsed_us <= until_us:
                yield starts_us + elapsed_us, charge - energy.drain_of(flight, elapsed_us)
        landed_us = starts_us + flight.duration_us
        charge -= energy.drain_of(flight, flight.duration_us)


def _is_even(energy: Energy, flight: Transit) -> bool:
    """Return whether a flight takes a microsecond of autonomy in each microsecond."""
    times = (flight.duration_us // 2, flight.duration_us)
    return all(energy.drain_of(flight, t_us) == t_us for t_us in times)


def samples_us(flight: Transit, ramp_parts: int = RAMP_PARTS) -> list[int]:
    """Return the times of a flight between which its power is near constant, from 0 to its end."""
    times_us = [0]
    for piece, after in pairwise(flight.pieces):
        parts = ramp_parts if piece.acceleration_mps2 else 1
        span_s = after.start_s - piece.start_s
        times_us += [round((piece.start_s + span_s * k / parts) * US) for k in range(1, parts + 1)]
    return sorted({min(t_us, flight.duration_us) for t_us in times_us} | {flight.duration_us})


def powers_w(
    energy: Energy, flight: Transit, ramp_parts: int = RAMP_PARTS
) -> list[tuple[float, float]]:
    """Return times of a flight in seconds and the power then in watts, near linear in between."""
    powers = []
    for t_us in samples_us(flight, ramp_parts):
        low, high = max(0, t_us - NEAR_US), min(flight.duration_us, t_us + NEAR_US)
        used = energy.drain_of(flight, high) - energy.drain_of(flight, low)
        powers.append((t_us / US, round(used / (high - low), 3)))
    return powers


def _while_charging(
    charge: int, t_us: int, until_us: int, capacity: int, charging: Charging
) -> list[Knot]:
    """Return knots between the start and the end of a charge; none if it is linear."""
    span_us = until_us - t_us
    halfway = charging.charged(charge, span_us // 2, capacity)
    ends = charging.charged(charge, span_us, capacity)
    if span_us < PARTS or abs(2 * halfway - charge - ends) <= 4 + 2 * (ends - charge) // span_us:
        return []
    parts = [span_us * k // PARTS for k in range(1, PARTS)] + [span_us - 1]
    return [(t_us + part_us, charging.charged(charge, part_us, capacity)) for part_us in parts]


def _on_landing(
    events: Sequence[tuple[int, str]], records: Sequence[Knot], capacity: int, charging: Charging
) -> tuple[int, int]:
    """Return the charge of a drone that lands or begins to charge at the first of these events.

    The second number is the time until which it charges; if it does not, that of the last record.
    """
    lands_us, (ends_us, level) = events[0][0], records[-1]
    charge_us = next((t_us for t_us, kind in events if kind == "charge"), None)
    full_at_us = next((t_us for t_us, kind in events if kind == "charged"), None)
    until_us = ends_us if full_at_us is None else full_at_us
    waits = [charge for t_us, charge in records if lands_us <= t_us <= (charge_us or lands_us)]
    if charge_us is None:  # it waits for a pad until the end
        return level, ends_us
    if waits:
        return waits[0], until_us
    record = next(((t, c) for t, c in records if charge_us < t < until_us), None)
    if record is not None or full_at_us is None:
        t_us, level = record or records[-1]
        span_us = t_us - charge_us
        return _least(capacity, lambda b: charging.charged(b, span_us, capacity) >= level), until_us
    span_us = full_at_us - charge_us
    return _least(capacity, lambda b: charging.until_full_us(b, capacity) <= span_us), until_us


def _least(most: int, holds: Callable[[int], bool]) -> int:
    """Return the least number up to ``most`` from which on a condition holds."""
    least = -1
    while most - least > 1:
        middle = (least + most) // 2
        if holds(middle):
            most = middle
        else:
            least = middle
    return most
