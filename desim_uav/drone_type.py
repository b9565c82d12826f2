"""A type of drones in a world: what its battery, its flights and its returns come to."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from desim_uav.copies import Unchanging
from desim_uav.model.energy.battery import capacity_of, drain_per_s_of, in_joules
from desim_uav.model.geometry.grid import Cell, Grid
from desim_uav.model.geometry.prisms import Zone
from desim_uav.model.motion.motion import (
    Motion,
    Transit,
    commanded_transit,
    cruise_of,
    return_transit,
)
from desim_uav.model.motion.needs import drawn_uj, needs_of
from desim_uav.model.motion.planner import HOPS, Node, Planner
from desim_uav.model.motion.space import Space, space_of
from desim_uav.model.motion.wind import flown_along, motion_in, rest_in
from desim_uav.model.offloading import shares_of
from desim_uav.model.rules import MOVES, NEVER, US, Choice, actions, free_actions, kind_of
from desim_uav.model.services import MICROBITS
from desim_uav.scenario.drones import Drones, flies_freely
from desim_uav.scenario.schema import Scenario
from desim_uav.scenario.shield import drain_of_hover


@dataclass(frozen=True, eq=False)
class DroneType(Unchanging):
    """A type of drones, ``drones``, in a world with this map and these charging stations."""

    drones: Drones
    scenario: Scenario
    grid: Grid
    stations: tuple[Cell, ...]

    @property
    def limited(self) -> bool:
        """Whether its drones have to charge."""
        return self.drones.battery is not None

    @cached_property
    def actions(self) -> tuple[Choice, ...]:
        """The actions that its drones can take.

        They are the first of those of the world, unless only some types fly freely: the actions
        that these have are then at other places (see ``World.actions``).
        """
        if self.free:
            return free_actions(self.limited, self.shares)
        cruise_mps = cruise_of(self.drones.motion)
        return actions(self.scenario.three_d, self.limited, cruise_mps, self.shares)

    @cached_property
    def free(self) -> bool:
        """Whether its drones fly freely, and not from cell to cell."""
        return flies_freely(self.drones)

    @property
    def shares(self) -> tuple[float, ...]:
        """The shares of tasks that a command can choose, ascending; none without a choice."""
        return shares_of(self.scenario.offloading)

    @property
    def chooses_cruise(self) -> bool:
        """Whether a command of free flight has a number for the cruise speed."""
        return self.free and bool(cruise_of(self.drones.motion))

    @cached_property
    def space(self) -> Space:
        """What free flight needs. Raises ValueError if a station is in an obstacle."""
        zones = [
            Zone(np.array(zone.polygon_m, float), *zone.altitude_m)
            for zone in self.scenario.map.no_fly
        ]
        stations_m = np.array([self.grid.centre(*cell) for cell in self.stations]).reshape(-1, 2)
        drones = self.drones
        return space_of(
            drones.motion, self.scenario.wind_mps, drones.battery, self.grid, zones, stations_m
        )

    @cached_property
    def capacity(self) -> int:
        """The capacity of a battery in units of the energy model; 0 if it is unlimited."""
        return capacity_of(self.drones.battery)

    @cached_property
    def drain_per_s(self) -> int:
        """How many units of its battery a drone takes in a second of hovering."""
        return drain_per_s_of(self.drones.battery, self.rest.side_mps)

    @property
    def store_ubit(self) -> int | None:
        """What a drone's store holds, in millionths of a bit; None if it is not limited."""
        store_mbit = self.drones.store_mbit
        return None if store_mbit is None else round(store_mbit * MICROBITS)

    def hover_us(self, charge: int) -> int:
        """Return for how many microseconds of hovering a charge lasts."""
        return charge if self.drain_per_s == US else round(charge * US / self.drain_per_s)

    @property
    def in_joules(self) -> bool:
        """Whether batteries are measured in microjoules, and not in microseconds of autonomy."""
        return in_joules(self.drones.battery) > 0

    @cached_property
    def full(self) -> int:
        """The charge at which a battery counts as full; 0 if it is unlimited."""
        charging = self.scenario.charging
        return 0 if charging is None or not self.limited else charging.full(self.capacity)

    def until_full_us(self, battery: int) -> int:
        """Return the time to charge a battery that holds so much, in microseconds."""
        charging = self.scenario.charging
        return 0 if charging is None else charging.until_full_us(battery, self.capacity)

    @cached_property
    def full_charge_us(self) -> int:
        """The time to charge an empty battery, in microseconds; 0 if batteries are unlimited."""
        return self.until_full_us(0)

    @cached_property
    def return_charge(self) -> int:
        """The battery level at or below which a drone may return, in units of the battery."""
        battery = self.drones.battery
        return 0 if battery is None else round(battery.return_below * self.capacity)

    @cached_property
    def respawn_after_us(self) -> int:
        """The least time from a crash to the drone's replacement, in microseconds."""
        battery = self.drones.battery
        return 0 if battery is None else round(battery.respawn_after_min * 60 * US)

    @cached_property
    def on_crash(self) -> str:
        """What happens after a crash: respawn, remove or end_episode."""
        battery = self.drones.battery
        return "remove" if battery is None else battery.on_crash

    @cached_property
    def epoch_transits(self) -> dict[Choice, Transit]:
        """The transit that each moving action commands."""
        step_s = self.scenario.episode.step_s
        moves = {each: MOVES[kind_of(each)] for each in self.actions if kind_of(each) in MOVES}
        return {
            each: self._flown(
                commanded_transit(self._motion(move), each, self._hop_m(move), step_s), move
            )
            for each, move in moves.items()
            if self._has_hop(move)
        }

    @cached_property
    def return_transits(self) -> dict[Node, Transit]:
        """The transit of each hop (dx, dy, dlevel) of a return."""
        motion, step_s = self.drones.motion, self.scenario.episode.step_s
        flights = {
            move: return_transit(self._motion(move), self._hop_m(move), step_s)
            if self._has_hop(move)
            else motion.fastest_transit(self._hop_m(move))  # never flown: it need not fit a step
            for move in MOVES.values()
        }
        return {move: self._flown(flight, move) for move, flight in flights.items()}

    @cached_property
    def rest(self) -> Transit:
        """The hover of its drones, which has the wind from the side."""
        return rest_in(self.scenario.wind_mps)

    @cached_property
    def planner(self) -> Planner:
        """The planner of returns to the stations."""
        flights = [self.return_transits[hop] for hop in HOPS]
        hop_us = tuple(flight.duration_us for flight in flights)
        energy = self.drones.battery
        if energy is None:
            return Planner(self.grid, self.stations, hop_us)
        hop_drains = tuple(energy.drain_of(each, each.duration_us) for each in flights)
        return Planner(self.grid, self.stations, hop_us, hop_drains)

    @property
    def shielded(self) -> bool:
        """Whether actions are masked after which its drones could not reach a station any more."""
        return self.drones.shielded and self.limited

    @property
    def draws_uw(self) -> int:
        """What its processor takes of the battery at most, in microwatts."""
        processor = self.drones.processor
        return 0 if processor is None or not self.in_joules else processor.most_uw

    def needs(self, ceiling: bool, early: bool = True) -> NDArray[np.int64]:
        """Return what a shielded drone needs at each place (see ``model.motion.needs.needs_of``).

        Returns are planned from where drones believe to be, and do not count if they may be wrong.
        Moves do not count if drones give way to others. If a drone may not return ``early``, that
        is above ``return_below``, a return counts where it is allowed to a drone that cannot hover
        any more, because it takes at most what ``return_below`` leaves after a hover.
        """
        if (ceiling, early) not in self._needs:
            scenario = self.scenario
            most = NEVER if early else self.return_charge - drain_of_hover(scenario, self.drones)
            most = -1 if scenario.position_noise is not None else most
            moves = {} if scenario.on_conflict == "hover_higher_index" else self._taken_by_moves
            needs = needs_of(self.planner, ceiling, most, self.draws_uw, moves)
            self._needs[ceiling, early] = needs
        return self._needs[ceiling, early]

    @cached_property
    def _needs(self) -> dict[tuple[bool, bool], NDArray[np.int64]]:
        return {}

    def taken_by(self, flight: Transit, span_us: int) -> int:
        """Return what a flight, and the hover after it, take of the battery in a time.

        It is 0 without a battery. What a processor draws is not counted.
        """
        energy, rest_us = self.drones.battery, max(span_us - flight.duration_us, 0)
        if energy is None:
            return 0
        flown = energy.drain_of(flight, flight.duration_us) if flight.duration_us else 0
        return int(flown + energy.drain_of(self.rest, rest_us))

    @property
    def _taken_by_moves(self) -> dict[Node, int]:
        """The least that a commanded move takes of the battery until the next command."""
        scenario = self.scenario
        taken: dict[Node, int] = {}
        for each, flight in self.epoch_transits.items():
            move, span_us = MOVES[kind_of(each)], flight.duration_us
            if not scenario.decisions.by_event:
                span_us = round(scenario.episode.step_s * US)
            drain = self.taken_by(flight, span_us) + drawn_uj(self.draws_uw, span_us)
            taken[move] = min(drain, taken.get(move, drain))
        return taken

    def _motion(self, move: Node) -> Motion:
        """Return the motion in the direction of a move, given the wind."""
        return motion_in(self.drones.motion, self.scenario.wind_mps, move)

    def _flown(self, flight: Transit, move: Node) -> Transit:
        """Return a flight as that of a move, which may rise and have wind."""
        return flown_along(flight, self.scenario.wind_mps, move)

    def _has_hop(self, move: Node) -> bool:
        sizes = (*self.grid.cells, len(self.grid.levels_m))
        return any(step != 0 and size > 1 for step, size in zip(move, sizes, strict=True))

    def _hop_m(self, move: tuple[int, int, int]) -> float:
        dx, dy = self.grid.cell_m
        return dx if move[0] else dy if move[1] else self.grid.level_step_m
