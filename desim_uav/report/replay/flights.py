"""The flights of an episode's drones: their legs, speed profiles and powers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from desim_uav.model.energy.battery import in_joules
from desim_uav.model.motion.limits import CALM
from desim_uav.model.motion.motion import Transit, flown_transit
from desim_uav.model.motion.space import flight_of
from desim_uav.model.motion.wind import WindCourse, flown_along, motion_in, way_between
from desim_uav.model.rules import US, Mode
from desim_uav.report.batteries import powers_w
from desim_uav.report.replay.checks import Checks, Whole
from desim_uav.report.replay.columns import Column, codes, delta, floats, plain
from desim_uav.scenario.drones import flies_freely

if TYPE_CHECKING:
    import pandas as pd


class Flights:
    """Encodes the legs of a run's episodes and collects the ``profiles`` of their transits.

    ``powers`` has the times and the watts of each profile, or None if batteries have no energy.
    """

    def __init__(self, check: Checks) -> None:
        self.check = check
        self.scenario = check.run.scenario
        self.profiles: list[list[list[float]]] = []
        self.powers: list[list[tuple[float, float]] | None] = []
        self._profile_of: dict[tuple[Any, ...], tuple[int, int]] = {}

    def legs(self, legs: pd.DataFrame) -> dict[str, Column]:
        """Return legs by drone in order of time, with their profiles."""
        self.check.within(legs, "legs", "drone", self.scenario.drone_count)
        legs = legs.sort_values("drone", kind="stable")
        t_us = self.check.us(legs, "legs", "t_s", -(10**15))
        drone = legs["drone"].to_numpy(np.int64)
        first = np.searchsorted(drone, np.arange(self.scenario.drone_count + 1))
        present = np.diff(first) > 0
        self.check.expect(bool(present.all()), "legs", "a drone has no leg")
        ascends = (np.diff(t_us) >= 0) | (np.diff(drone) > 0)
        self.check.expect(bool(ascends.all()), "legs", "t_s: not in order")
        self.check.expect(
            bool((t_us[first[:-1]] <= 0).all()), "legs", "a drone's first leg begins after 0"
        )
        duration_us = self.check.us(legs, "legs", "duration_s", 0)
        places = {}
        for side in ("from", "to"):
            for axis in "xyz":
                places[f"leg.{axis}_{side}"] = floats(
                    self.check.finite(legs, "legs", f"{axis}_{side}_m")
                )
        mode = self.check.codes(legs, "legs", "mode", Mode)
        types = np.array(self.scenario.type_numbers)[drone]
        profile = self._flown_by(places, mode, duration_us, types)
        return places | {
            "leg.first": plain(first),
            "leg.t_us": delta(t_us),
            "leg.duration_us": plain(duration_us),
            "leg.mode": codes(mode),
            "leg.profile": plain(profile),
        }

    def _flown_by(
        self, places: dict[str, Column], mode: Whole, duration_us: Whole, types: Whole
    ) -> Whole:
        """Return the number of each leg's profile, or -1 for a rest."""
        ends = [
            np.stack([places[f"leg.{axis}_{side}"].values.astype(float) for axis in "xyz"], axis=1)
            for side in ("from", "to")
        ]
        length_m = np.abs(ends[1] - ends[0]).sum(axis=1)
        free = [flies_freely(drones) for drones in self.scenario.fleet]
        profile = np.full(len(mode), -1, np.int64)
        for k in np.flatnonzero(duration_us > 0):
            of_type, lasted_us, length = int(types[k]), int(duration_us[k]), float(length_m[k])
            start, stop = (side[k].tolist() for side in ends)
            if free[of_type]:
                what = "the leg takes"
                number, takes_us = self._free_profile(of_type, start, stop, lasted_us)
            else:
                what, commanded = f"{length:g} m take", int(mode[k]) == Mode.FLYING
                way = way_between(start, stop)
                number, takes_us = self._profile(of_type, commanded, length, lasted_us, way)
            self.check.expect(
                abs(takes_us - lasted_us) <= 1,
                "legs",
                f"duration_s: {what} {takes_us / US:g} s in this scenario, not {lasted_us / US:g}",
            )
            profile[k] = number
        return profile

    def _free_profile(
        self, of_type: int, start: list[float], stop: list[float], lasted_us: int
    ) -> tuple[int, int]:
        """Return the number of the profile of a leg of free flight, and its duration (µs)."""
        key: Any = (of_type, *start, *stop, lasted_us)
        if key not in self._profile_of:
            space = self.check.run.world.types[of_type].space
            leg = space.leg(key[1:4], key[4:7], lasted_us)
            self._add(key, flight_of(leg, space.wind))
        return self._profile_of[key]

    def _profile(
        self, of_type: int, commanded: bool, length_m: float, lasted_us: int, way: WindCourse
    ) -> tuple[int, int]:
        """Return the number of the profile of a type's transit, and its duration (µs).

        Of several transits, it is that of the one that lasts nearest to ``lasted_us``.
        """
        wind, drones = self.scenario.wind_mps, self.scenario.fleet[of_type]
        matters = wind != CALM or in_joules(drones.battery)
        course = tuple(float(np.sign(part)) for part in way) if matters else ()
        key = of_type, commanded, round(length_m, 6), lasted_us, course
        if key not in self._profile_of:
            step_s = self.scenario.episode.step_s
            self.check.expect(length_m > 0, "legs", "a transit leads nowhere")
            try:
                motion = motion_in(drones.motion, wind, way)
                transit = flown_transit(motion, commanded, length_m, step_s, lasted_us)
            except ValueError as error:
                raise self.check.error("legs", str(error)) from error
            self._add(key, flown_along(transit, wind, way))
        return self._profile_of[key]

    def _add(self, key: tuple[Any, ...], transit: Transit) -> None:
        """Add the powers and the profile of a transit of the type ``key[0]``.

        Distances are shares of the whole: x = from + share * (to - from).
        """
        self._profile_of[key] = len(self.profiles), transit.duration_us
        length_m, energy = transit.distance_m, self.scenario.fleet[key[0]].battery
        self.profiles.append((transit.profile / [1.0, length_m, length_m, length_m]).tolist())
        self.powers.append(powers_w(energy, transit) if energy and in_joules(energy) else None)
