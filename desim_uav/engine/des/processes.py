"""The SimPy processes of an episode. Each waits for its next event, and then calls a rule."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import simpy

from desim_uav.engine.des.clock import Clock, Due, Process
from desim_uav.rules import due, words
from desim_uav.rules.charging import await_full, begin_charging, end_charging
from desim_uav.rules.coverage import on_crossing
from desim_uav.rules.crash import crash
from desim_uav.rules.decide import obey, on_arrival
from desim_uav.rules.flight import station_under
from desim_uav.rules.points import on_renewal
from desim_uav.rules.requests import (
    on_completion,
    on_deadline,
    on_delivery,
    on_own_completion,
    on_request,
)
from desim_uav.rules.rows import Drone, User
from desim_uav.rules.separation import on_separation
from desim_uav.rules.settle import on_turn, settle


class Processes:
    """The processes of an episode: those of drones, batteries, footprints, users and services."""

    def __init__(self, clock: Clock, world: Any, path: Any, state: Any) -> None:
        self.clock = clock
        self.world, self.path, self.state = world, path, state
        self.pads = [simpy.Resource(clock, world.pads) for _ in state.stations]
        self.commands = [Due(clock) for _ in state.drones]
        self.begun = Due(clock)
        self.pad_requests: dict[int, Any] = {}

    def begin(self) -> None:
        """Start all processes; drones that are at a station request its pads in their order."""
        for station, pads in zip(self.state.stations, self.pads, strict=True):
            for drone in station.queue:
                self.pad_requests[drone] = pads.request()
        self.drones = [self.clock.process(self.drone(drone)) for drone in self.state.drones]
        for drone in self.state.drones:
            self.clock.process(self.battery(drone))
        for sender in self.state.senders:
            self.clock.process(self.footprint(sender))
            if self.state.uploads:
                self.clock.process(self.backhaul(sender))
        for user in self.state.users:
            self.clock.process(self.user(user))
            self.clock.process(self.service(user))
            if self.state.by_level:
                self.clock.process(self.levels(user))
            if self.state.keeps_tasks:
                self.clock.process(self.deadline(user))
                self.clock.process(self.own(user))
        self.clock.process(self.step())
        self.clock.process(self.attachment())
        if self.state.pairs:
            self.clock.process(self.separation())
        if self.state.renews:
            self.clock.process(self.points())

    def tell(self) -> None:
        """Schedule, in this instant, the actions of drones that wait for their commands."""
        now_us = self.state.now_us
        for drone in self.state.drones:
            if drone.waits:
                command = self.commands[drone.index]
                self.commands[drone.index] = Due(self.clock)
                self.clock.happen(command, now_us, due.key(words.COMMAND, drone.index, -1))
        begun, self.begun = self.begun, Due(self.clock)
        self.clock.happen(begun, now_us, due.key(words.COVERAGE, -1, -1))

    def drone(self, drone: Drone) -> Process:
        """Obey a command; fly, return, queue and charge; after a crash, wait to be replaced."""
        world, path, state = self.world, self.path, self.state
        while True:
            try:
                if drone.waits or drone.mode == words.CRASHED:
                    yield self.commands[drone.index]
                    obey(world, path, state, drone)
                elif drone.mode in words.IN_QUEUE:
                    yield from self.charge(drone, station_under(world, drone))
                else:
                    yield from self.until(due.arrival_slot(state, drone.index))
                    on_arrival(world, path, state, drone)
            except simpy.Interrupt:  # by its battery: it has crashed
                pass

    def charge(self, drone: Drone, station: int) -> Process:
        """Queue for a pad, and charge on it until the battery is full."""
        world, state, phase = self.world, self.state, words.ARRIVAL
        with self.pad_requests.pop(drone.index, None) or self.pads[station].request() as pad:
            yield pad
            state.now_us = self.clock.now
            if drone.mode == words.QUEUED:
                phase = begin_charging(world, state, drone, station)
            if await_full(world, state, drone):
                yield from self.until(due.arrival_slot(state, drone.index))
                phase = words.ARRIVAL
            end_charging(world, state, drone, station, phase)

    def battery(self, drone: Drone) -> Process:
        """Let the drone crash whenever its battery is empty."""
        slot = due.depletion_slot(self.state, drone.index)
        while True:
            yield from self.until(slot)
            crash(self.world, self.path, self.state, drone)
            self.drones[drone.index].interrupt()

    def footprint(self, drone: Drone) -> Process:
        """Let users enter and leave the footprint."""
        slot = due.crossing_slot(self.state, drone.index)
        return self.whenever(slot, on_crossing, self.world, self.path, self.state, drone)

    def backhaul(self, sender: Drone) -> Process:
        """Bring the updates in the sender's store to the ground, one after the other."""
        slot = due.upload_slot(self.state, sender.index)
        return self.whenever(slot, on_delivery, self.world, self.path, self.state, sender)

    def user(self, user: User) -> Process:
        """Make the user's requests, one after the other."""
        slot = due.ask_slot(self.state, user.index)
        return self.whenever(slot, on_request, self.world, self.path, self.state, user)

    def service(self, user: User) -> Process:
        """Complete each of the user's requests when it has been served for the required time."""
        slot = due.completion_slot(self.state, user.index)
        return self.whenever(slot, on_completion, self.world, self.path, self.state, user)

    def levels(self, user: User) -> Process:
        """Hand the user over to drones that it receives better."""
        slot = due.association_slot(self.state, user.index)
        return self.whenever(slot, on_turn, self.world, self.path, self.state, user)

    def deadline(self, user: User) -> Process:
        """Close each of the user's tasks that is not done in time."""
        slot = due.deadline_slot(self.state, user.index)
        return self.whenever(slot, on_deadline, self.world, self.path, self.state, user)

    def own(self, user: User) -> Process:
        """End what the user's own processor computes."""
        slot = due.own_slot(self.state, user.index)
        return self.whenever(slot, on_own_completion, self.world, self.path, self.state, user)

    def step(self) -> Process:
        """Attach users and admit requests once all drones have begun what they are told."""
        while True:
            yield self.begun
            settle(self.world, self.path, self.state, words.COVERAGE, words.ADMISSION)

    def attachment(self) -> Process:
        """Attach users and admit requests at the end of each instant that requires it."""
        slot = due.settle_slot(self.state)
        phases = words.ATTACHMENT, words.ATTACHMENT
        return self.whenever(slot, settle, self.world, self.path, self.state, *phases)

    def separation(self) -> Process:
        """Let pairs of drones come too near to each other, and part again."""
        slot = due.separation_slot(self.state)
        return self.whenever(slot, on_separation, self.world, self.state)

    def points(self) -> Process:
        """Let the access points serve on between two decision epochs."""
        slot = due.renewal_slot(self.state)
        return self.whenever(slot, on_renewal, self.world, self.path, self.state)

    def until(self, slot: int) -> Process:
        """Wait until the event of a slot happens, which one that has been cancelled does not."""
        events = self.clock.events
        yield events[slot]
        while not events[slot].has_happened():
            yield events[slot]
        self.state.now_us = events[slot].t_us

    def whenever(self, slot: int, rule: Callable[..., None], *arguments: Any) -> Process:
        """Call a rule with these arguments each time that the event of a slot happens."""
        state, events = self.state, self.clock.events
        while True:
            yield events[slot]
            event = events[slot]  # which may have taken the place of the one before
            if event.has_happened():
                state.now_us = event.t_us
                rule(*arguments)
