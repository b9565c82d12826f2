"""The battery of a rotary-wing drone: flights take energy that depends on speeds and climbs.

The battery is measured in microjoules: where other batteries have microseconds of autonomy, names
such as ``charge`` stand for microjoules here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Gt, Le

from desim_uav.model.energy.battery import (
    LONGEST_MIN,
    MOST_UJ,
    WH_UJ,
    RowEnergy,
    time_of_hover_problems,
)
from desim_uav.model.energy.propulsion.rotary_wing import (
    ROTORS,
    BestSpeeds,
    Powers,
    Rotor,
    best_speeds,
    derived,
    power_w,
    powers_of,
    rotor_of,
    speeding_j,
)
from desim_uav.model.energy.work import speeding_in_wind_j
from desim_uav.model.motion.motion import Motion, Piece, Transit
from desim_uav.model.rules import US
from desim_uav.registry import NameOr, register
from desim_uav.rowcode.kernels import rule

LONGEST_US = 2**60
"""No battery lasts longer, in microseconds."""

NEAR_US = 1024
"""A search takes steps of a microsecond up to this distance from its start, then longer ones."""


ALIKE = 0.02
"""Parameters of a rotor contradict each other if they differ by more than this share."""

LONGER = 1.25
"""The ratio of the times of a hover in wind and in still air from which on there is a warning."""

FORMULAS = {
    "disc_area_m2": "π R²",
    "tip_speed_mps": "Ω R",
    "induced_speed_mps": "sqrt(W / 2 ρ A)",
}
"""How parameters of a rotor follow from others."""


@register("battery", "rotary_wing")
@dataclass(frozen=True)
class RotaryWing(RowEnergy):
    """Drains the energy that a rotary wing takes (Zeng, Xu and Zhang 2019).

    The energy of each leg is exact: it is integrated over its speeds in closed form. A battery that
    hovers for half an hour by the paper's parameters holds 84.242 Wh.
    """

    capacity_wh: Annotated[float, Ge(1e-3), Le(1e4)] = 84.242
    """What a full battery holds, in watt-hours."""
    parameters: Annotated[
        Any, NameOr(tuple(ROTORS), Rotor, "a mapping with the parameters of a rotor")
    ] = "zeng2019"
    """The rotor: `zeng2019` are the parameters of the paper's Table I, `zeng2018` those of its
    first version; or a mapping with `weight_n`, `air_density_kg_m3`, `rotor_radius_m`,
    `blade_speed_rad_s`, `solidity`, `profile_drag`, `fuselage_drag` and `induced_factor`. Of the
    others, `disc_area_m2` is by default π R², `tip_speed_mps` Ω R, and `induced_speed_mps`
    sqrt(W / 2 ρ A).
    """
    mass_kg: Annotated[float, Ge(1e-3), Le(1e4)] | None = None
    """The mass of the drone, in kilograms, instead of `parameters`, beside `hover_w` or
    `hover_min`. The rotor then has the shape of `zeng2019` and this power in a hover.
    """
    hover_w: Annotated[float, Ge(1e-3), Le(1e6)] | None = None
    """The power of a hover in still air, in watts, with the electronics."""
    later: ClassVar = ("mass_kg", "hover_w", "hover_min")

    hover_min: Annotated[float, Ge(1 / 60), Le(LONGEST_MIN)] | None = None
    """How long a full battery lasts in a hover in still air, in minutes, instead of `hover_w`."""
    climb: bool = True
    """Whether a climb takes, beside the power of a hover, the weight times the height. A descent
    takes the power of a hover.
    """
    electronics_w: Annotated[float, Ge(0), Le(1e5)] = 0.0
    """What radio, processor and other electronics take in the air all the time, in watts."""
    return_below: Annotated[float, Gt(0), Le(1)] = 0.2
    """`goto_charging_station` is allowed at or below this share of the capacity."""
    on_crash: Literal["respawn", "remove", "end_episode"] = "respawn"
    """What happens after a crash: the drone is replaced (`respawn`), stays away (`remove`), or
    the episode ends (`end_episode`).
    """
    respawn_after_min: Annotated[float, Ge(0)] = 10.0
    """How many minutes after a crash the drone is replaced, at the next decision epoch."""

    autonomy_min: float = field(init=False, repr=False, default=0.0)
    """How long a full battery lasts in a hover, in minutes."""
    capacity_uj: int = field(init=False, repr=False, default=0)
    hover_uw: int = field(init=False, repr=False, default=0)
    rest_w: float = field(init=False, repr=False, default=0.0)
    lifts_n: float = field(init=False, repr=False, default=0.0)
    blade_w: float = field(init=False, repr=False, default=0.0)
    induced_w: float = field(init=False, repr=False, default=0.0)
    drag_w: float = field(init=False, repr=False, default=0.0)
    tip_mps: float = field(init=False, repr=False, default=0.0)
    flow_mps: float = field(init=False, repr=False, default=0.0)

    def __post_init__(self) -> None:
        """Set the numbers that follow from the parameters. Raises ValueError if some contradict."""
        self._check_datasheet()
        rotor = self.rotor
        powers = powers_of(rotor)
        rest_w = power_w(powers, 0.0) + self.electronics_w
        capacity_uj = round(self.capacity_wh * WH_UJ)
        follows = powers._asdict() | {
            "lifts_n": float(rotor.weight_n) if self.climb else 0.0,
            "rest_w": rest_w,
            "hover_uw": max(1, round(rest_w * US)),
            "capacity_uj": capacity_uj,
            "autonomy_min": capacity_uj / (rest_w * 60 * US),
        }
        for name, value in follows.items():
            object.__setattr__(self, name, value)

    def _check_datasheet(self) -> None:
        """Raise ValueError unless mass and hover are both given, or neither."""
        names = [name for name in ("hover_w", "hover_min") if getattr(self, name) is not None]
        if self.mass_kg is None:
            if names:
                raise ValueError(f"{names[0]} needs mass_kg, from which the rotor follows")
            return
        if len(names) != 1:
            raise ValueError("mass_kg needs either hover_w or hover_min")
        if self.parameters != "zeng2019":
            raise ValueError("give parameters, or mass_kg and hover_w or hover_min, not both")
        if self._datasheet_w <= self.electronics_w:
            raise ValueError(
                f"a hover takes {self._datasheet_w:g} W, which must be more than electronics_w, "
                f"{self.electronics_w:g}"
            )

    @property
    def _datasheet_w(self) -> float:
        """The power of a hover that is given, with the electronics, in watts."""
        if self.hover_min is not None:
            return self.capacity_wh * 60.0 / self.hover_min
        assert self.hover_w is not None
        return self.hover_w

    @property
    def rotor(self) -> Rotor:
        """The parameters of the rotor."""
        if self.mass_kg is not None:
            return rotor_of(self.mass_kg, self._datasheet_w - self.electronics_w)
        rotor: Rotor = ROTORS.get(self.parameters, self.parameters)
        return rotor

    @property
    def powers(self) -> Powers:
        """The coefficients of the power of level flight, without the electronics."""
        return powers_of(self.rotor)

    def level_w(self, speed_mps: float) -> float:
        """Return the power in level flight at a constant speed, in watts."""
        return float(power_w(self.powers, speed_mps) + self.electronics_w)

    def best_speeds(self) -> BestSpeeds:
        """Return the speeds of the longest flight in time, and of the longest in distance."""
        return best_speeds(self.powers, self.electronics_w)

    def drains(self, flight: Transit, elapsed_us: int) -> int:
        """Return the energy used in µJ, rounded down."""
        return used_uj(self, flight, elapsed_us)

    def lasts(self, flight: Transit, charge: int) -> int:
        """Return the time until the energy used reaches the battery, rounded up to a microsecond.

        The energy rises with time, so the microsecond is found by halving an interval. If the
        drone hovers, perhaps after a flight, the search begins at the result of a division.
        """
        least_us, most_us = -1, int(flight.duration_us)
        used = used_uj(self, flight, most_us)
        if used < charge:
            rests_us = (charge - used) / hovering_w(self, flight)
            near_us = most_us + int(min(rests_us, LONGEST_US))
            least_us, most_us = near_us - 1, near_us
            while used_uj(self, flight, most_us) < charge and most_us < LONGEST_US:
                least_us, most_us = most_us, most_us + 1 + (most_us - near_us) // NEAR_US
            while used_uj(self, flight, least_us) >= charge:
                least_us, most_us = least_us - 1 - (near_us - least_us) // NEAR_US, least_us
        while most_us - least_us > 1:
            middle_us = (least_us + most_us) // 2
            if used_uj(self, flight, middle_us) < charge:
                least_us = middle_us
            else:
                most_us = middle_us
        return most_us

    def problems(self, motion: Motion, step_s: float) -> list[str]:
        """Return why the battery would not last for a time that can be counted."""
        return time_of_hover_problems(self.capacity_wh, self.rest_w, self.autonomy_min)

    def doubts(self, wind_mps: float) -> Iterator[str]:
        """Yield parameters that contradict each other, and how a wind changes the time of a hover.

        Only differences of more than ``ALIKE`` and ``LONGER`` are reported.
        """
        rotor = self.rotor
        for name, follows in derived(rotor)._asdict().items():
            value = getattr(rotor, name)
            if value is not None and not 1.0 - ALIKE <= value / follows <= 1.0 + ALIKE:
                yield (
                    f"parameters.{name}: {value:g}: {FORMULAS[name]} = {follows:g} by the other "
                    "parameters; without this key it is that"
                )
        in_wind_w = self.level_w(wind_mps)
        if not 1.0 / LONGER <= self.rest_w / in_wind_w <= LONGER:
            more = self.rest_w > in_wind_w
            percent = 100.0 * abs(self.rest_w / in_wind_w - 1.0)
            yield (
                f"in the wind of {wind_mps:g} m/s a hover takes {in_wind_w:.4g} W instead of "
                f"{self.rest_w:.4g} W in still air, so that a battery lasts {percent:.0f} % "
                f"{'longer' if more else 'less long'}: a hover is then a level flight through the "
                "air (explanation/wind)"
            )


@rule
def used_uj(own: RotaryWing, flight: Transit, elapsed_us: int) -> int:
    """Return the energy of the first ``elapsed_us`` of a flight in µJ, rounded down.

    It is at most ``MOST_UJ``, which is more than any battery holds.
    """
    return int(min(energy_j(own, flight, elapsed_us) * 1e6, MOST_UJ))


@rule
def energy_j(own: RotaryWing, flight: Transit, elapsed_us: int) -> float:
    """Return the energy of the first ``elapsed_us`` of a flight or of a hover, in joules.

    ``flight.rises`` is the sine of the angle at which it climbs: 0 in level flight, 1 straight up.
    """
    elapsed_s = elapsed_us / US
    if flight.distance_m == 0.0:
        return float(hovering_w(own, flight) * elapsed_s)
    pieces, energy, flown_m = flight.pieces, 0.0, 0.0
    level = math.sqrt(1.0 - flight.rises * flight.rises)
    for k in range(len(pieces)):
        piece = pieces[k]
        passes_s = elapsed_s - piece.start_s
        if passes_s <= 0.0:
            break
        if k + 1 < len(pieces):
            passes_s = min(passes_s, pieces[k + 1].start_s - piece.start_s)
        flown_m = piece.from_m + (
            piece.speed_mps * passes_s + 0.5 * piece.acceleration_mps2 * passes_s * passes_s
        )
        if is_calm(flight):
            energy += piece_j(own, piece, level, passes_s)
        else:
            energy += piece_in_wind_j(own, flight, piece, level, passes_s)
    if flight.rises > 0.0:
        energy += own.lifts_n * flight.rises * flown_m
    return energy


@rule
def is_calm(flight: Transit) -> bool:
    """Return whether a flight has no wind."""
    return bool(flight.tail_mps == 0.0) & bool(flight.side_mps == 0.0)


@rule
def hovering_w(own: Any, flight: Any) -> float:
    """Return the power of a hover where a flight ends, in watts: that at the speed of the wind."""
    if is_calm(flight):
        return float(own.rest_w)
    tail, side = flight.tail_mps, flight.side_mps
    electronics_w = own.rest_w - own.blade_w - own.induced_w
    return float(power_w(own, math.sqrt(tail * tail + side * side)) + electronics_w)


@rule
def piece_in_wind_j(
    own: RotaryWing, flight: Transit, piece: Piece, level: float, passes_s: float
) -> float:
    """Return the energy of the beginning of a piece of a flight in wind, without climbing."""
    tail, side = flight.tail_mps, flight.side_mps
    first = level * piece.speed_mps - tail
    last = max(-tail, first + level * piece.acceleration_mps2 * passes_s)
    drag_j = speeding_in_wind_j(power_w, own, side, first, last, passes_s, own.flow_mps)
    electronics_j = (own.rest_w - own.blade_w - own.induced_w) * passes_s
    return float(drag_j + electronics_j)


@rule
def piece_j(own: Any, piece: Any, level: float, passes_s: float) -> float:
    """Return the energy of the beginning of a piece of a flight, without that of climbing.

    ``level`` is the horizontal part of its speed, as a share.
    """
    electronics_j = (own.rest_w - own.blade_w - own.induced_w) * passes_s
    acceleration, speed = level * piece.acceleration_mps2, level * piece.speed_mps
    if acceleration == 0.0:
        return float(power_w(own, speed) * passes_s + electronics_j)
    end_mps = max(0.0, speed + acceleration * passes_s)
    drag_j = (speeding_j(own, end_mps) - speeding_j(own, speed)) / acceleration
    return float(drag_j + electronics_j)
