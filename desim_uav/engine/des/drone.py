"""A drone: a SimPy process that takes commands, flies, returns, queues, charges, and may crash."""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import TYPE_CHECKING, Any

import numpy as np
import simpy
from numpy.typing import NDArray

from desim_uav.engine.des.agenda import Signal
from desim_uav.model.battery import charged_us, time_to_full_us
from desim_uav.model.motion import REST, travelled
from desim_uav.model.rules import AIRBORNE, MOVES, US, Action, Mode, Phase

if TYPE_CHECKING:
    from desim_uav.engine.des.agenda import Due
    from desim_uav.engine.des.request import Request
    from desim_uav.engine.des.simulation import Simulation
    from desim_uav.engine.des.station import Station
    from desim_uav.model.grid import Cell
    from desim_uav.model.motion import Transit
    from desim_uav.model.planner import Node, Return

Life = Generator[simpy.Event, Any, None]


class Drone:
    """One drone's state and its life.

    ``node`` (cell x, cell y, level) is where it rests, or where its present flight began;
    ``battery_us`` what it had then (``since_us``). ``flight_number`` changes with every leg,
    landing and crash, so that what was foreseen for a flight is known to be stale.
    """

    def __init__(self, simulation: Simulation, index: int, cell: Cell, ceiling: bool) -> None:
        self.simulation = simulation
        self.agenda = simulation.agenda
        self.world = simulation.world
        self.energy = simulation.world.scenario.drones.battery
        self.index = index
        self.ceiling = ceiling
        self.flight_number = 0
        self.command: Signal | None = None
        self.free_bps = self.world.bandwidth_bps
        self.used_bps = 0
        self.attached_users = 0
        self.served_requests = 0
        self.waiting: list[Request] = []
        self.tracked = False
        self.respawns = 0
        self.way_back: Return | None = None
        self._appear(cell)
        self.process = self.agenda.process(self._life())

    def _appear(self, cell: Cell) -> None:
        """Airborne at the lowest level, full battery, holding no pad."""
        self.mode = Mode.FLYING
        self.battery_us = self.world.capacity_us
        self.since_us = self.agenda.now
        self.node: Node = (*cell, 0)
        self._rest()

    def _rest(self) -> None:
        self.flight: Transit = REST
        self.from_m = self.to_m = self.world.grid.centre(self.node[0], self.node[1])
        self.from_z_m = self.to_z_m = self.world.grid.levels_m[self.node[2]]

    # ---- the life of a drone

    def _life(self) -> Life:
        while True:
            try:
                self.command = Signal(self.agenda)
                action = yield self.command
                self._settle_battery()
                if action is Action.GOTO_CHARGING_STATION:
                    yield from self._return()
                elif action is Action.CHARGE:
                    yield from self._charge(Phase.COMMAND)
                else:
                    yield from self._fly(action)
            except simpy.Interrupt:
                self.revival = Signal(self.agenda)
                yield self.revival

    def _fly(self, action: Action) -> Life:
        """A step of serving flight: a move to the next cell, or a hover."""
        self.mode = Mode.FLYING
        target, transit = self.node, REST
        if action is not Action.HOVER:
            target, transit = self._neighbour(MOVES[action]), self.world.epoch_transits[action]
            if not self.world.grid.can_enter(*target, self.ceiling):
                self._emit(Phase.COMMAND, "blocked")
                target, transit = self.node, REST
        self._depart(target, transit, self.world.step_us)
        self.simulation.airlink.track(self, transit, self.world.step_us, Phase.COVERAGE)
        if transit is not REST:
            self._emit(Phase.COMMAND, "depart")
            yield self.agenda.at(self.since_us + transit.duration_us, Phase.ARRIVAL, self.index)
            self._arrive(target)

    def _return(self) -> Life:
        """Fly back by A* without stopping for decisions; land and queue at once.

        The first path is planned from where the drone believes it is and flown as relative hops; a
        path that ends away from a station is followed by one from where it is.
        """
        self.mode = Mode.RETURNING
        self.simulation.airlink.silence(self, Phase.COVERAGE)
        phase = Phase.COMMAND
        plan = self.way_back
        while self.station_here() is None:
            for hop in plan.hops if plan else ():
                target = self._neighbour(hop)
                if not self.world.grid.can_enter(*target, self.ceiling):
                    self._emit(phase, "blocked")
                    break
                transit = self.world.fastest_transits[hop]
                self._settle_battery()
                self._depart(target, transit, transit.duration_us)
                self._emit(phase, "depart")
                yield self.agenda.at(self.since_us + transit.duration_us, Phase.ARRIVAL, self.index)
                phase = Phase.ARRIVAL
                self._arrive(target)
            plan = self.world.planner.plan(self.node, self.ceiling)
            assert plan is not None, "a world's stations can be reached from wherever one can fly"
        yield from self._charge(phase)

    def _charge(self, phase: Phase) -> Life:
        """Land, wait for a pad, charge until full; wait there, landed, for the next command."""
        station = self.station_here()
        assert station is not None
        self.simulation.airlink.silence(self, Phase.COVERAGE)
        self._settle_battery()
        self.landed_us = self.agenda.now
        self.flight_number += 1
        self.mode = Mode.QUEUED
        self._emit(phase, "land", station.index)
        with station.pads.request() as pad:
            yield pad
            self.simulation.count_queueing(self)
            self._settle_battery()
            self.mode = Mode.CHARGING
            if self.since_us > self.landed_us:
                phase = Phase.ARRIVAL
            self._emit(phase, "charge", station.index)
            capacity_us, full_charge_us = self.world.capacity_us, self.simulation.full_charge_us
            rest_us = time_to_full_us(self.battery_us, capacity_us, full_charge_us)
            yield self.agenda.at(self.since_us + rest_us, Phase.ARRIVAL, self.index)
            self._settle_battery()
            self.mode = Mode.CHARGED
            self._emit(Phase.ARRIVAL, "charged", station.index)
            self.simulation.log.charges += 1

    # ---- flights

    def _neighbour(self, hop: Node) -> Node:
        return self.node[0] + hop[0], self.node[1] + hop[1], self.node[2] + hop[2]

    def _depart(self, target: Node, transit: Transit, span_us: int) -> None:
        """Begin a leg of ``span_us``: a transit to ``target``, then a hover there."""
        self.flight = transit
        self.flight_number += 1
        if transit is not REST:
            self.to_m = self.world.grid.centre(target[0], target[1])
            self.to_z_m = self.world.grid.levels_m[target[2]]
        if self.energy is not None:
            lasts_us = self.energy.lasts_us(transit, self.battery_us)
            if lasts_us <= span_us:
                self.agenda.call(
                    self._on_depletion,
                    self.flight_number,
                    self.since_us + lasts_us,
                    Phase.DEPLETION,
                    self.index,
                )

    def _arrive(self, target: Node) -> None:
        self.simulation.log.distance_m += self.flight.distance_m
        self.node = target
        self.from_m, self.from_z_m = self.to_m, self.to_z_m
        self._emit(Phase.ARRIVAL, "arrive")

    def position_m(self) -> tuple[float, float, float]:
        """Where the drone is now: x, y, z."""
        (x0, y0), (x1, y1), z0, z1 = self.from_m, self.to_m, self.from_z_m, self.to_z_m
        if self.from_m == self.to_m and z0 == z1:
            return x0, y0, z0
        share = self.flown_m() / self.flight.distance_m
        return x0 + share * (x1 - x0), y0 + share * (y1 - y0), z0 + share * (z1 - z0)

    def flown_m(self) -> float:
        """How far the present transit has come; 0 once it has arrived."""
        if self.from_m == self.to_m and self.from_z_m == self.to_z_m:
            return 0.0
        return travelled(self.flight.profile, (self.agenda.now - self.since_us) / US)

    def station_here(self) -> Station | None:
        """The station on whose cell the drone rests, at its landing level."""
        return self.simulation.station_at.get(self.node)

    # ---- what the drone knows

    def orient(self, error_cells: NDArray[np.float64] | None) -> None:
        """Take bearings at a decision epoch: where it believes it is, and its way back from there.

        ``error_cells``: by how much it mistakes x and y. It knows its altitude.
        """
        grid = self.world.grid
        if error_cells is None and self.from_m is self.to_m and self.from_z_m == self.to_z_m:
            self.belief = self.node
        else:
            x, y, z = self.position_m()
            if error_cells is not None:
                x += float(error_cells[0]) * grid.cell_m[0]
                y += float(error_cells[1]) * grid.cell_m[1]
            self.belief = (*grid.cell_of(x, y), grid.level_of(z))
        if self.energy is not None:
            self.way_back = self.world.planner.plan(self.belief, self.ceiling)

    def return_us(self) -> float | None:
        """n_B: the time of the quickest return from where the drone believes it is."""
        if self.energy is None:
            return None
        return math.inf if self.way_back is None else self.way_back.duration_us

    # ---- battery

    def battery_now_us(self) -> int:
        """What the battery holds now."""
        if self.energy is None:
            return 0
        elapsed_us = self.agenda.now - self.since_us
        if self.mode in AIRBORNE:
            return self.battery_us - self.energy.drained_us(self.flight, elapsed_us)
        if self.mode is Mode.CHARGING:
            full_charge_us = self.simulation.full_charge_us
            return charged_us(self.battery_us, elapsed_us, self.world.capacity_us, full_charge_us)
        return self.battery_us

    def _settle_battery(self) -> None:
        """Book what the time since the last change of flight or mode has cost or charged."""
        self.battery_us = self.battery_now_us()
        self.since_us = self.agenda.now
        self.flight = REST

    def _on_depletion(self, due: Due) -> None:
        if due.args == self.flight_number:
            self._crash()

    def _crash(self) -> None:
        """The battery is empty in the air: the drone falls where it is, its users are dropped."""
        self._emit(Phase.DEPLETION, "deplete")
        x_m, y_m, _ = self.position_m()
        self.simulation.log.distance_m += self.flown_m()
        self.node = (*self.world.grid.cell_of(x_m, y_m), 0)
        self.from_m = self.to_m = (x_m, y_m)
        self.from_z_m = self.to_z_m = 0.0
        self._settle_battery()
        self.crashed_us = self.agenda.now
        self.flight_number += 1
        self.mode = Mode.CRASHED
        self.command = None
        self.simulation.airlink.silence(self, Phase.DEPLETION)
        self.simulation.log.crashes += 1
        self._emit(Phase.DEPLETION, "crash")
        self.process.interrupt()

    def respawn(self, station: int) -> None:
        """A new drone takes its place, on a station."""
        self._appear(self.world.stations[station])
        self._emit(Phase.RESPAWN, "respawn", station)
        self.revival.give(None, Phase.RESPAWN, self.index)

    def _emit(self, phase: Phase, kind: str, station: int = -1) -> None:
        t_us = self.agenda.now - self.simulation.origin_us
        self.simulation.emit((t_us, phase, kind, self.index, -1, -1, station))
