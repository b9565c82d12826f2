"""A drone: a SimPy process that takes commands, flies, returns, queues, charges, and may crash."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import simpy
from numpy.typing import NDArray

from desim_uav.engine.base import CarriedDrone
from desim_uav.engine.des.agenda import Life, Signal
from desim_uav.engine.des.airlink import AirLink
from desim_uav.engine.des.journal import Journal
from desim_uav.engine.des.station import Station
from desim_uav.model.battery import charged_us, time_to_full_us
from desim_uav.model.grid import Cell
from desim_uav.model.motion import REST, Leg, Transit, travelled
from desim_uav.model.planner import Node, Return
from desim_uav.model.rules import AIRBORNE, MOVES, US, Action, Mode, Phase
from desim_uav.model.state import Observation
from desim_uav.world import World


class Drone:
    """One drone's state and its life.

    ``node`` (cell x, cell y, level) is where it rests, or where its present leg began;
    ``battery_us`` what it had then (``since_us``; below 0: in an episode before). On a return
    ``hop`` is the one under way and ``route`` those to follow. ``leg_number`` changes with every
    leg, landing and crash, so that a depletion foreseen before is known to be stale. ``command``
    is set while the drone can be told something.
    """

    def __init__(
        self,
        world: World,
        journal: Journal,
        airlink: AirLink,
        stations: Mapping[Node, Station],
        index: int,
        ceiling: bool,
        carried: CarriedDrone | None = None,
    ) -> None:
        self.world = world
        self.energy = world.scenario.drones.battery
        self.journal = journal
        self.agenda = journal.agenda
        self.airlink = airlink
        self.radio = airlink.radios[index]
        self.stations = stations
        self.index = index
        self.ceiling = ceiling
        self.leg_number = 0
        self.respawns = 0
        self.command: Signal | None = None
        self.way_back: Return | None = None
        self.hop: Node | None = None
        self.route: list[Node] = []
        self.pad: simpy.resources.resource.Request | None = None
        if carried is None:
            self._appear(world.starts[index])
        else:
            self._go_on(carried)

    def start(self) -> None:
        """Begin to live. Who began to queue in an episode before is in its place from the start."""
        if self.mode in (Mode.QUEUED, Mode.CHARGING):
            self.pad = self.stations[self.node].pads.request()
        self.process = self.agenda.process(self._life())

    def _appear(self, cell: Cell) -> None:
        """Airborne at the lowest level, full battery, holding no pad."""
        self.mode = Mode.FLYING
        self.battery_us = self.world.capacity_us
        self.since_us = self.agenda.now
        self.counted_m = 0.0
        self.node: Node = (*cell, 0)
        self.leg = self._leg_to(self.node, REST)

    # ---- from one episode to the next

    def carried(self) -> CarriedDrone:
        """What the next episode has to know."""
        return CarriedDrone(
            self.mode,
            self.node,
            self.battery_us,
            self.agenda.now - self.since_us,
            self.hop,
            tuple(self.route),
            self.counted_m,
            0 if self.pad is None else self.stations[self.node].place(self.pad),
            self.leg.from_m if self.mode is Mode.CRASHED else None,
        )

    def _go_on(self, carried: CarriedDrone) -> None:
        """Be as the episode before has left it."""
        self.mode = carried.mode
        self.node = carried.node
        self.battery_us = carried.battery_us
        self.since_us = -carried.age_us
        self.route = list(carried.route)
        self.counted_m = carried.counted_m
        self.hop = carried.hop
        if carried.fallen_m is not None:
            self.leg = Leg(REST, carried.fallen_m, carried.fallen_m, 0.0, 0.0)
        elif carried.hop is not None:
            transit = self.world.fastest_transits[carried.hop]
            self.leg = self._leg_to(self._neighbour(carried.hop), transit)
            self._foresee_depletion(transit, transit.duration_us)
        else:
            self.leg = self._leg_to(self.node, REST)

    # ---- the life of a drone

    def _life(self) -> Life:
        doing = self._unfinished()
        while True:
            try:
                yield from doing
                self.command = Signal(self.agenda)
                doing = self._obey((yield self.command))
            except simpy.Interrupt:
                doing = self._lie()

    def _unfinished(self) -> Life:
        """What the drone was about in the episode before, if it was."""
        if self.mode is Mode.RETURNING:
            return self._go_home(Phase.ARRIVAL)
        if self.mode in (Mode.QUEUED, Mode.CHARGING):
            return self._queue_and_charge(Phase.ARRIVAL)
        if self.mode is Mode.CRASHED:
            return self._lie()
        return self._rest()

    def _obey(self, action: Action) -> Life:
        if action is Action.GOTO_CHARGING_STATION:
            return self._return()
        if action is Action.CHARGE:
            return self._land(Phase.COMMAND)
        return self._fly(action)

    def _rest(self) -> Life:
        yield from ()

    def _lie(self) -> Life:
        """Crashed, until another drone takes its place."""
        self.revival = Signal(self.agenda)
        yield self.revival

    def _fly(self, action: Action) -> Life:
        """A step of serving flight: a move to the next cell, or a hover."""
        target, transit = self.node, REST
        if action is not Action.HOVER:
            there = self._neighbour(MOVES[action])
            if self.world.grid.can_enter(*there, self.ceiling):
                target, transit = there, self.world.epoch_transits[action]
            else:
                self._emit(Phase.COMMAND, "blocked")
        step_us = self.world.step_us
        self._begin(Mode.FLYING, target, transit, step_us)
        self.airlink.track(self.radio, self.leg, step_us, Phase.COVERAGE)
        if transit is not REST:
            self._emit(Phase.COMMAND, "depart")
            yield self.agenda.at(self.since_us + transit.duration_us, Phase.ARRIVAL, self.index)
            self._arrive(target)
            self._begin(Mode.FLYING, target, REST, step_us - transit.duration_us)

    def _return(self) -> Life:
        """Fly back by A* without stopping for decisions; land and queue at once.

        The first path is planned from where the drone believes it is and flown as relative hops; a
        path that ends away from a station is followed by one from where it is.
        """
        self._change_mode(Mode.RETURNING)
        self.airlink.silence(self.radio, Phase.COVERAGE)
        if self.node not in self.stations and self.way_back is not None:
            self.route = list(self.way_back.hops)
        yield from self._go_home(Phase.COMMAND)

    def _go_home(self, phase: Phase) -> Life:
        """Fly the hop under way, then hop by hop to a station, and land."""
        while self.hop is not None or self.node not in self.stations or self.route:
            if self.hop is None:
                self._next_hop(phase)
            if self.hop is not None:
                yield self.agenda.at(
                    self.since_us + self.leg.transit.duration_us, Phase.ARRIVAL, self.index
                )
                phase = Phase.ARRIVAL
                self._arrive(self._neighbour(self.hop))
                self.hop = None
        yield from self._land(phase)

    def _next_hop(self, phase: Phase) -> None:
        """Begin the next hop of the route, unless it is blocked, which ends the route."""
        if not self.route:
            again = self.world.planner.plan(self.node, self.ceiling)
            assert again is not None, "a world's stations can be reached from wherever one can fly"
            self.route = list(again.hops)
        hop = self.route.pop(0)
        target = self._neighbour(hop)
        if not self.world.grid.can_enter(*target, self.ceiling):
            self._emit(phase, "blocked")
            self.route = []
            return
        transit = self.world.fastest_transits[hop]
        self._begin(Mode.RETURNING, target, transit, transit.duration_us)
        self._emit(phase, "depart")
        self.hop = hop

    def _land(self, phase: Phase) -> Life:
        """Land, wait for a pad, charge until full; wait there, landed, for the next command."""
        self.airlink.silence(self.radio, Phase.COVERAGE)
        self._change_mode(Mode.QUEUED)
        self.leg = self._leg_to(self.node, REST)
        self._emit(phase, "land", self.stations[self.node].index)
        yield from self._queue_and_charge(phase)

    def _queue_and_charge(self, phase: Phase) -> Life:
        station = self.stations[self.node]
        if self.pad is None:
            self.pad = station.pads.request()
        with self.pad:
            yield self.pad
            if self.mode is Mode.QUEUED:
                self.count_queueing()
                if self.agenda.now > self.since_us:
                    phase = Phase.ARRIVAL
                self._change_mode(Mode.CHARGING)
                self._emit(phase, "charge", station.index)
            rest_us = time_to_full_us(
                self.battery_us, self.world.capacity_us, self.world.full_charge_us
            )
            if rest_us > 0:
                phase = Phase.ARRIVAL
                yield self.agenda.at(self.since_us + rest_us, phase, self.index)
            self._change_mode(Mode.CHARGED)
            self._emit(phase, "charged", station.index)
            self.journal.log.charges += 1
        self.pad = None

    def count_queueing(self) -> None:
        """Count what a queued drone has waited for a pad in this episode."""
        self.journal.log.queueing_us += self.agenda.now - max(self.since_us, 0)

    # ---- legs

    def _neighbour(self, hop: Node) -> Node:
        return self.node[0] + hop[0], self.node[1] + hop[1], self.node[2] + hop[2]

    def _leg_to(self, target: Node, transit: Transit) -> Leg:
        grid = self.world.grid
        here, there = self.node, target
        return Leg(
            transit,
            grid.centre(here[0], here[1]),
            grid.centre(there[0], there[1]),
            grid.levels_m[here[2]],
            grid.levels_m[there[2]],
        )

    def _begin(self, mode: Mode, target: Node, transit: Transit, span_us: int) -> None:
        """Begin a leg of ``span_us``, and foresee whether the battery lasts it out."""
        self._change_mode(mode)
        self.leg = self._leg_to(target, transit)
        self._foresee_depletion(transit, span_us)

    def _foresee_depletion(self, transit: Transit, span_us: int) -> None:
        if self.energy is not None:
            lasts_us = self.energy.lasts_us(transit, self.battery_us)
            if lasts_us <= span_us:
                self.agenda.call(
                    self._on_depletion,
                    self.leg_number,
                    self.since_us + lasts_us,
                    Phase.DEPLETION,
                    self.index,
                )

    def count_distance(self) -> None:
        """Count what the drone has flown of its leg, and not counted before."""
        flown_m = travelled(self.leg.transit.profile, (self.agenda.now - self.since_us) / US)
        self.journal.log.distance_m += flown_m - self.counted_m
        self.counted_m = flown_m

    def _arrive(self, target: Node) -> None:
        self.journal.log.distance_m += self.leg.transit.distance_m - self.counted_m
        self._change_mode(self.mode)
        self.node = target
        self._emit(Phase.ARRIVAL, "arrive")

    def position_m(self) -> tuple[float, float, float]:
        """Where the drone is now: x, y, z."""
        return self.leg.position_m((self.agenda.now - self.since_us) / US)

    # ---- what the drone knows

    def observe(self, step: int) -> Observation:
        """What it knows at a decision epoch, once it has taken its bearings."""
        radio, back = self.radio, self.way_back
        limited = self.energy is not None
        return_us = self.return_us()
        ix, iy, level = self.belief
        return Observation(
            self.index,
            step,
            self.world.scenario.episode.steps,
            (ix, iy),
            level,
            self.mode,
            self.battery_now_us() / US if limited else None,
            self.world.capacity_us / US if limited else None,
            None if return_us is None else return_us / US,
            radio.attached_users,
            sum(radio.served),
            radio.used_bps / 1000,
            None if back is None else back.station,
            None if back is None else back.duration_us / US,
            tuple(radio.served),
            tuple(radio.asking),
        )

    def may_return(self) -> bool:
        """Is the battery low enough for a return?"""
        return self.battery_now_us() <= self.world.return_below_us

    def may_charge(self) -> bool:
        """Is it on a station, at its landing level, and not full?"""
        return self.node in self.stations and self.battery_now_us() < self.world.capacity_us

    def orient(self, error_cells: NDArray[np.float64] | None) -> None:
        """Take bearings at a decision epoch: where it believes it is, and its way back from there.

        ``error_cells``: by how much it mistakes x and y. It knows its altitude.
        """
        grid = self.world.grid
        if error_cells is None and self.leg.transit is REST:
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
        """n_B: the battery a return takes from where the drone believes it is."""
        if self.energy is None:
            return None
        return math.inf if self.way_back is None else self.way_back.drained_us

    # ---- battery

    def battery_now_us(self) -> int:
        """What the battery holds now."""
        if self.energy is None:
            return 0
        elapsed_us = self.agenda.now - self.since_us
        if self.mode in AIRBORNE:
            return self.battery_us - self.energy.drained_us(self.leg.transit, elapsed_us)
        if self.mode is Mode.CHARGING:
            world = self.world
            return charged_us(self.battery_us, elapsed_us, world.capacity_us, world.full_charge_us)
        return self.battery_us

    def _change_mode(self, mode: Mode) -> None:
        """Book what the battery has lost or won so far; from now on another leg or mode counts."""
        self.battery_us = self.battery_now_us()
        self.since_us = self.agenda.now
        self.counted_m = 0.0
        self.leg_number += 1
        self.mode = mode

    def _on_depletion(self, leg_number: int) -> None:
        if leg_number == self.leg_number:
            self._crash()

    def _crash(self) -> None:
        """The battery is empty in the air: the drone falls where it is, its users are dropped."""
        self._emit(Phase.DEPLETION, "deplete")
        x_m, y_m, _ = self.position_m()
        self.count_distance()
        self._change_mode(Mode.CRASHED)
        self.node = (*self.world.grid.cell_of(x_m, y_m), 0)
        self.leg = Leg(REST, (x_m, y_m), (x_m, y_m), 0.0, 0.0)
        self.command = None
        self.hop, self.route = None, []
        self.airlink.silence(self.radio, Phase.DEPLETION)
        self.journal.log.crashed.append(self.index)
        self._emit(Phase.DEPLETION, "crash")
        self.process.interrupt()

    def down_us(self) -> int:
        """How long a crashed drone has been down."""
        return self.agenda.now - self.since_us

    def respawn(self, station: int) -> None:
        """A new drone takes its place, on a station."""
        self._appear(self.world.stations[station])
        self._emit(Phase.RESPAWN, "respawn", station)
        self.revival.give(None, Phase.RESPAWN, self.index)

    def _emit(self, phase: Phase, kind: str, station: int = -1) -> None:
        self.journal.emit((self.agenda.now, phase, kind, self.index, -1, -1, station))
