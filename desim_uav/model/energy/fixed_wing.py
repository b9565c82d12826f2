"""The battery of a fixed-wing drone, for motions that never hover."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Gt, Le

from desim_uav.model.energy.battery import MOST_UJ, WH_UJ, RowEnergy, time_of_hover_problems
from desim_uav.model.energy.propulsion.fixed_wing import (
    WINGS,
    BestSpeeds,
    Wing,
    best_speeds,
    power_w,
    speeding_j,
)
from desim_uav.model.motion.motion import Motion, Transit
from desim_uav.model.rules import US
from desim_uav.registry import NameOr, kind_name, register
from desim_uav.rowcode.kernels import rule


@register("battery", "fixed_wing")
@dataclass(frozen=True)
class FixedWing(RowEnergy):
    """Drains the energy that a fixed wing takes (Zeng and Zhang 2017).

    It cannot hover, so that it needs a motion of your own with ``hovers = False``, whose flights
    have a speed above 0 everywhere. Where the drone waits, it loiters at the speed of least power.
    """

    needs_calm: ClassVar = True
    """It loiters on circles, on which the wind would come from all sides."""

    capacity_wh: Annotated[float, Ge(1e-3), Le(1e4)] = 50.0
    """What a full battery holds, in watt-hours."""
    parameters: Annotated[
        Any, NameOr(tuple(WINGS), Wing, "a mapping with the parameters of a wing")
    ] = "zeng2017"
    """The wing: `zeng2017` are the paper's parameters; or a mapping with `c1` and `c2`."""
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
    """How long a full battery lasts while the drone loiters, in minutes."""
    capacity_uj: int = field(init=False, repr=False, default=0)
    hover_uw: int = field(init=False, repr=False, default=0)
    loiter_w: float = field(init=False, repr=False, default=0.0)
    c1: float = field(init=False, repr=False, default=0.0)
    c2: float = field(init=False, repr=False, default=0.0)

    def __post_init__(self) -> None:
        """Set the numbers that follow from the parameters."""
        wing = self.wing
        loiter_w = power_w(wing, best_speeds(wing).endurance_mps) + self.electronics_w
        capacity_uj = round(self.capacity_wh * WH_UJ)
        follows = {
            "c1": float(wing.c1),
            "c2": float(wing.c2),
            "loiter_w": loiter_w,
            "hover_uw": max(1, round(loiter_w * US)),
            "capacity_uj": capacity_uj,
            "autonomy_min": capacity_uj / (loiter_w * 60 * US),
        }
        for name, value in follows.items():
            object.__setattr__(self, name, value)

    @property
    def wing(self) -> Wing:
        """The parameters of the wing."""
        wing: Wing = WINGS.get(self.parameters, self.parameters)
        return wing

    def level_w(self, speed_mps: float) -> float:
        """Return the power in level flight at a constant speed, in watts."""
        return float(power_w(self.wing, speed_mps) + self.electronics_w)

    def best_speeds(self) -> BestSpeeds:
        """Return the speeds of the longest flight in time, and of the longest in distance."""
        return best_speeds(self.wing, self.electronics_w)

    def drains(self, flight: Transit, elapsed_us: int) -> int:
        """Return the energy used in µJ, rounded down."""
        return used_uj(self, flight, elapsed_us)

    def lasts(self, flight: Transit, charge: int) -> int:
        """Return the time until the energy used reaches the battery, rounded up."""
        least_us, most_us = -1, int(flight.duration_us)
        while used_uj(self, flight, most_us) < charge:
            least_us, most_us = most_us, 2 * most_us + US
        while most_us - least_us > 1:
            middle_us = (least_us + most_us) // 2
            if used_uj(self, flight, middle_us) < charge:
                least_us = middle_us
            else:
                most_us = middle_us
        return most_us

    def problems(self, motion: Motion, step_s: float) -> list[str]:
        """Return why a fixed wing cannot fly like this."""
        if getattr(motion, "hovers", True):
            kind = kind_name(motion)
            return [f"a fixed wing cannot hover, but drones hover with drones.motion: {kind!r}"]
        return time_of_hover_problems(self.capacity_wh, self.loiter_w, self.autonomy_min)


@rule
def used_uj(own: FixedWing, flight: Transit, elapsed_us: int) -> int:
    """Return the energy of the first ``elapsed_us`` of a flight in µJ, rounded down.

    It is at most ``MOST_UJ``, which is more than any battery holds.
    """
    return int(min(energy_j(own, flight, elapsed_us) * 1e6, MOST_UJ))


@rule
def energy_j(own: FixedWing, flight: Transit, elapsed_us: int) -> float:
    """Return the energy of the first ``elapsed_us`` of a flight, or of loitering, in joules."""
    elapsed_s = elapsed_us / US
    if flight.distance_m == 0.0:
        return float(own.loiter_w * elapsed_s)
    pieces, energy = flight.pieces, 0.0
    for k in range(len(pieces)):
        piece = pieces[k]
        passes_s = elapsed_s - piece.start_s
        if passes_s <= 0.0:
            break
        if k + 1 < len(pieces):
            passes_s = min(passes_s, pieces[k + 1].start_s - piece.start_s)
            energy += piece_j(own, piece, passes_s)
        else:
            energy += own.loiter_w * passes_s
    return energy


@rule
def piece_j(own: Any, piece: Any, passes_s: float) -> float:
    """Return the energy of the beginning of a piece of a flight."""
    if piece.acceleration_mps2 == 0.0:
        return float((power_w(own, piece.speed_mps) + own.electronics_w) * passes_s)
    end_mps = piece.speed_mps + piece.acceleration_mps2 * passes_s
    drag_j = speeding_j(own.c1, own.c2, piece.speed_mps, end_mps) / piece.acceleration_mps2
    return float(drag_j + own.electronics_w * passes_s)
