"""A drone: a SimPy process that takes commands, flies, returns, queues, charges, and may crash."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import simpy
from numpy.typing import NDArray

from desim_uav.engine.base import CarriedDrone, FlownLeg
from desim_uav.engine.des.agenda import Life, Signal, key
from desim_uav.engine.des.airlink import AirLink
from desim_uav.engine.des.flights import Flights, neighbour
from desim_uav.engine.des.journal import Journal
from desim_uav.engine.des.station import Station
from desim_uav.model.battery import charged_us, time_to_full_us
from desim_uav.model.grid import Cell
from desim_uav.model.motion import REST, Leg, travelled
from desim_uav.model.planner import Node, Return
from desim_uav.model.rules import US, Action, Mode, Phase
from desim_uav.model.state import Observation, observed
from desim_uav.world import World

# An enum member is looked up slowly in Python 3.11.
FLYING, RETURNING, QUEUED = Mode.FLYING, Mode.RETURNING, Mode.QUEUED
CHARGING, CHARGED, CRASHED = Mode.CHARGING, Mode.CHARGED, Mode.CRASHED
ARRIVAL, DEPLETION, RESPAWN = Phase.ARRIVAL, Phase.DEPLETION, Phase.RESPAWN
COMMAND, COVERAGE = Phase.COMMAND, Phase.COVERAGE
HOVER, GOTO, CHARGE = Action.HOVER, Action.GOTO_CHARGING_STATION, Action.CHARGE


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
        flights: Flights,
        carried: CarriedDrone | None = None,
    ) -> None:
        self.world = world
        self.facts = world.facts
        self.step_us = world.step_us
        self.energy = world.scenario.drones.battery
        self.agenda = journal.agenda
        self.log = journal.log
        self.airlink = airlink
        self.radio = airlink.radios[index]
        self.stations = stations
        self.index = index
        self.events = self.log.events
        self.arrival_key = key(ARRIVAL, index)
        self.ceiling = ceiling
        self.flights = flights
        self.leg_number = 0
        self.command: Signal | None = None
        self.way_back: Return | None = None
        self.return_us: float | None = None
        self.hop: Node | None = None
        self.route: list[Node] = []
        self.pad: simpy.resources.resource.Request | None = None
        if carried is None:
            self._appear(world.starts[index])
        else:
            self._go_on(carried)

    def start(self) -> None:
        """Begin to live. Who began to queue in an episode before is in its place from the start."""
        if self.mode in (QUEUED, CHARGING):
            self.pad = self.stations[self.node].pads.request()
        self.process = self.agenda.process(self._life())

    def _appear(self, cell: Cell) -> None:
        """Airborne at the lowest level, full battery, holding no pad."""
        self.mode = FLYING
        self.battery_us = self.world.capacity_us
        self.since_us = self.agenda._now
        self.counted_m = 0.0
        self.node: Node = (*cell, 0)
        self.leg = self.flights.hover(self.node)
        self._log_leg()

    # ---- from one episode to the next

    def carried(self) -> CarriedDrone:
        """What the next episode has to know."""
        return CarriedDrone(
            self.mode,
            self.node,
            self.battery_us,
            self.agenda._now - self.since_us,
            self.hop,
            tuple(self.route),
            self.counted_m,
            0 if self.pad is None else self.stations[self.node].place(self.pad),
            self.leg.from_m if self.mode is CRASHED else None,
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
            self.leg = self.flights.hop(self.node, carried.hop)
            self._foresee_depletion(self.leg.transit.duration_us)
        else:
            self.leg = self.flights.hover(self.node)
        self._log_leg()

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

    def be_told(self, action: Action) -> None:
        """Take a command, which it waits for, and act on it at once."""
        assert self.command is not None
        told, self.command = self.command, None
        told.give_now(action)

    def _unfinished(self) -> Life:
        """What the drone was about in the episode before, if it was."""
        if self.mode is RETURNING:
            return self._go_home(ARRIVAL)
        if self.mode in (QUEUED, CHARGING):
            return self._queue_and_charge(ARRIVAL)
        if self.mode is CRASHED:
            return self._lie()
        return self._rest()

    def _obey(self, action: Action) -> Life:
        if action is GOTO:
            return self._return()
        if action is CHARGE:
            return self._land(COMMAND)
        return self._fly(action)

    def _rest(self) -> Life:
        yield from ()

    def _lie(self) -> Life:
        """Crashed, until another drone takes its place."""
        self.revival = Signal(self.agenda)
        yield self.revival

    def _fly(self, action: Action) -> Life:
        """A step of serving flight: a move to the next cell, or a hover."""
        step_us = self.step_us
        move = None
        if action is not HOVER:
            move = self.flights.move(self.node, action, self.ceiling)
            if move is None:
                self.emit(COMMAND, "blocked")
        if move is None:
            self._begin(FLYING, self.flights.hover(self.node), step_us)
            self.airlink.track(self.radio, self.leg, step_us, COVERAGE)
            return
        target, leg = move
        self._begin(FLYING, leg, step_us)
        self.airlink.track(self.radio, leg, step_us, COVERAGE)
        if self.events is not None:
            self.emit(COMMAND, "depart")
        duration_us = leg.transit.duration_us
        yield self.agenda.at(self.since_us + duration_us, self.arrival_key)
        self._arrive(target)
        self._foresee_depletion(step_us - duration_us)

    def _return(self) -> Life:
        """Fly back by A* without stopping for decisions; land and queue at once.

        The first path is planned from where the drone believes it is and flown as relative hops; a
        path that ends away from a station is followed by one from where it is.
        """
        self._change_mode(RETURNING)
        self.airlink.silence(self.radio, COVERAGE)
        if self.node not in self.stations and self.way_back is not None:
            self.route = list(self.way_back.hops)
        yield from self._go_home(COMMAND)

    def _go_home(self, phase: Phase) -> Life:
        """Fly the hop under way, then hop by hop to a station, and land."""
        while self.hop is not None or self.node not in self.stations or self.route:
            if self.hop is None:
                self._next_hop(phase)
            if self.hop is not None:
                yield self.agenda.at(self.since_us + self.leg.transit.duration_us, self.arrival_key)
                phase = ARRIVAL
                self._arrive(neighbour(self.node, self.hop))
                self.hop = None
        yield from self._land(phase)

    def _next_hop(self, phase: Phase) -> None:
        """Begin the next hop of the route, unless it is blocked, which ends the route."""
        if not self.route:
            again = self.world.planner.plan(self.node, self.ceiling)
            assert again is not None, "a world's stations can be reached from wherever one can fly"
            self.route = list(again.hops)
        hop = self.route.pop(0)
        if not self.world.grid.can_enter(*neighbour(self.node, hop), self.ceiling):
            self.emit(phase, "blocked")
            self.route = []
            return
        leg = self.flights.hop(self.node, hop)
        self._begin(RETURNING, leg, leg.transit.duration_us)
        self.emit(phase, "depart")
        self.hop = hop

    def _land(self, phase: Phase) -> Life:
        """Land, wait for a pad, charge until full; wait there, landed, for the next command."""
        self.airlink.silence(self.radio, COVERAGE)
        self._change_mode(QUEUED)
        self.leg = self.flights.hover(self.node)
        self.emit(phase, "land", self.stations[self.node].index)
        yield from self._queue_and_charge(phase)

    def _queue_and_charge(self, phase: Phase) -> Life:
        station = self.stations[self.node]
        if self.pad is None:
            self.pad = station.pads.request()
        with self.pad:
            yield self.pad
            if self.mode is QUEUED:
                self.count_queueing()
                if self.agenda._now > self.since_us:
                    phase = ARRIVAL
                self._change_mode(CHARGING)
                self.emit(phase, "charge", station.index)
            rest_us = time_to_full_us(
                self.battery_us, self.world.capacity_us, self.world.full_charge_us
            )
            if rest_us > 0:
                phase = ARRIVAL
                yield self.agenda.at(self.since_us + rest_us, self.arrival_key)
            self._change_mode(CHARGED)
            self.emit(phase, "charged", station.index)
            self.log.charges += 1
        self.pad = None

    def count_queueing(self) -> None:
        """Count what a queued drone has waited for a pad in this episode."""
        self.log.queueing_us += self.agenda._now - max(self.since_us, 0)

    # ---- legs

    def _begin(self, mode: Mode, leg: Leg, span_us: int) -> None:
        """Begin a leg of ``span_us``, and foresee whether the battery lasts it out."""
        self._change_mode(mode)
        self.leg = leg
        if self.events is not None and leg.transit is not REST:
            self._log_leg()
        self._foresee_depletion(span_us)

    def _foresee_depletion(self, span_us: int) -> None:
        energy = self.energy
        if energy is None:
            return
        lasts_us = energy.lasts_us(self.leg.transit, self.battery_us)
        if lasts_us <= span_us:
            depleted_us = self.since_us + lasts_us
            place = key(DEPLETION, self.index)
            self.agenda.call(self._on_depletion, self.leg_number, depleted_us, place)

    def count_distance(self) -> None:
        """Count what the drone has flown of its leg, and not counted before."""
        flown_m = travelled(self.leg.transit.profile, (self.agenda._now - self.since_us) / US)
        self.log.distance_m += flown_m - self.counted_m
        self.counted_m = flown_m

    def _arrive(self, target: Node) -> None:
        """End a leg; the drone hovers where it has led."""
        self.log.distance_m += self.leg.transit.distance_m - self.counted_m
        self._change_mode(self.mode)
        self.node = target
        self.leg = self.flights.hover(target)
        if self.events is not None:
            self.emit(ARRIVAL, "arrive")

    def position_m(self) -> tuple[float, float, float]:
        """Where the drone is now: x, y, z."""
        leg = self.leg
        if leg.transit is REST:
            x_m, y_m = leg.from_m
            return x_m, y_m, leg.from_z_m
        return leg.position_m((self.agenda._now - self.since_us) / US)

    # ---- what the drone knows

    def observe(self, step: int) -> Observation:
        """What it knows at a decision epoch, once it has taken its bearings."""
        radio, back, capacity_s = self.radio, self.way_back, self.facts.capacity_s
        battery_us = self.battery_seen_us = self.battery_now_us()
        ix, iy, level = self.belief
        served = tuple(radio.served)
        return observed(
            (
                self.index,
                step,
                self.facts.steps,
                (ix, iy),
                level,
                self.mode,
                None if capacity_s is None else battery_us / US,
                capacity_s,
                None if self.return_us is None else self.return_us / US,
                radio.attached_users,
                sum(served),
                radio.used_bps / 1000,
                None if back is None else back.station,
                None if back is None else back.duration_us / US,
                served,
                tuple(radio.asking),
            )
        )

    def may(self) -> tuple[Mode, bool, bool]:
        """What its mask depends on, as it was observed last: its mode, and two questions.

        Is the battery low enough for a return? Is the drone on a station, at its landing level,
        and not full?
        """
        if self.energy is None:
            return self.mode, False, False
        battery_us, world = self.battery_seen_us, self.world
        may_charge = battery_us < world.capacity_us and self.node in self.stations
        return self.mode, battery_us <= world.return_below_us, may_charge

    def orient(self, error_cells: NDArray[np.float64] | None) -> None:
        """Take bearings at a decision epoch: where it believes it is, and its way back from there.

        ``error_cells``: by how much it mistakes x and y. It knows its altitude. ``return_us`` is
        n_B, the battery the way back takes.
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
            back = self.way_back = self.world.planner.plan(self.belief, self.ceiling)
            self.return_us = math.inf if back is None else back.drained_us

    # ---- battery

    def battery_now_us(self) -> int:
        """What the battery holds now."""
        energy = self.energy
        if energy is None:
            return 0
        elapsed_us = self.agenda._now - self.since_us
        mode = self.mode
        if mode is FLYING or mode is RETURNING:
            return self.battery_us - energy.drained_us(self.leg.transit, elapsed_us)
        if mode is CHARGING:
            world = self.world
            return charged_us(self.battery_us, elapsed_us, world.capacity_us, world.full_charge_us)
        return self.battery_us

    def _change_mode(self, mode: Mode) -> None:
        """Book what the battery has lost or won so far; from now on another leg or mode counts."""
        if self.energy is not None:
            self.battery_us = self.battery_now_us()
        self.since_us = self.agenda._now
        self.counted_m = 0.0
        self.leg_number += 1
        self.mode = mode

    def _on_depletion(self, leg_number: int) -> None:
        if leg_number == self.leg_number:
            self._crash()

    def _crash(self) -> None:
        """The battery is empty in the air: the drone falls where it is, its users are dropped."""
        self.emit(DEPLETION, "deplete")
        x_m, y_m, _ = self.position_m()
        self.count_distance()
        self._change_mode(CRASHED)
        self.node = (*self.world.grid.cell_of(x_m, y_m), 0)
        self.leg = Leg(REST, (x_m, y_m), (x_m, y_m), 0.0, 0.0)
        self.command = None
        self.hop, self.route = None, []
        self.airlink.silence(self.radio, DEPLETION)
        self.log.crashed.append(self.index)
        self.emit(DEPLETION, "crash")
        self._log_leg()
        self.process.interrupt()

    def down_us(self) -> int:
        """How long a crashed drone has been down."""
        return self.agenda._now - self.since_us

    def respawn(self, station: int) -> None:
        """A new drone takes its place, on a station."""
        self._appear(self.world.stations[station])
        self.emit(RESPAWN, "respawn", station)
        self.revival.give(None, key(RESPAWN, self.index))

    def _log_leg(self) -> None:
        """Write to the log what it is about: a transit, or to be where it is."""
        if self.events is not None:
            leg = self.leg
            self.log.legs.append(
                FlownLeg(
                    self.since_us,
                    self.index,
                    leg.transit.duration_us,
                    self.mode,
                    (*leg.from_m, leg.from_z_m),
                    (*leg.to_m, leg.to_z_m),
                )
            )

    def emit(self, phase: Phase, kind: str, station: int = -1) -> None:
        """Write to the log, where events are kept, what happens to it."""
        if self.events is not None:
            self.events.append((self.agenda._now, phase, kind, self.index, -1, -1, station))
