"""A second simulator of the model, by fixed time steps, to hold the event-driven engine against.

It shares no code with the package and no method with its engine: time advances by ``dt``, nothing
is looked for between two ticks, and what happens there is noticed at the next tick. Coverage is a
sampled distance, the class of a link a sampled ratio, served time and delivered bits are sums of
ticks, a return a table of Dijkstra times. So every moment it notices is late by less than ``dt``,
and its results tend to the exact ones as ``dt`` goes to 0.

Only motion has its closed form (hops of a return follow each other without waiting for a tick).
Times are whole microseconds, so that ticks at 0.1 s and decision epochs meet.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from tests.reference.association import Attachments
from tests.reference.energy import Rotor
from tests.reference.flight import HOPS, Drone, Hop, Map, axis_of, moved
from tests.reference.inputs import NEVER, US, Inputs, Node, Record, Result
from tests.reference.radio import look
from tests.reference.service import Services

SLICES = 100


class FixedStep:
    """One episode, tick by tick."""

    def __init__(self, inputs: Inputs, dt_us: int, before: FixedStep | None = None) -> None:
        assert inputs.step_us % dt_us == 0
        self.inputs, self.dt_us, self.map = inputs, dt_us, Map(inputs)
        self.result = Result()
        self.hops_take = {hop: self._takes(way, hop) for hop, way in self.map.returning.items()}
        full = inputs.capacity or 0
        self.drones = [
            Drone(d, levels, (*inputs.starts[d], 0), full) for d, levels in enumerate(inputs.levels)
        ]
        self.waiting: list[list[Drone]] = [[] for _ in inputs.stations]
        self.on_pads: list[list[Drone]] = [[] for _ in inputs.stations]
        if before is not None:
            self._carry_over(before)
        names = ["forward", "backward", "right", "left", "hover"]
        names += ["up", "down"] if inputs.three_d else []
        if inputs.cruise:
            slow, *others = inputs.cruise
            first = [name if name == "hover" else at(name, slow) for name in names]
            moves = [name for name in names if name != "hover"]
            names = first + [at(name, speed) for speed in others for name in moves]
        names += ["goto_charging_station", "charge"] if inputs.capacity is not None else []
        self.actions = names
        self.horizon_us = inputs.steps * inputs.step_us
        points = inputs.access_points
        self.links = [*inputs.links, *(point.link for point in points)]
        self.position_m = np.zeros((len(self.links), 3))
        self.position_m[len(self.drones) :] = [p.position_m for p in points] if points else 0.0
        ground = np.zeros(len(inputs.legs))
        self.users_height_m = ground if inputs.users_height_m is None else inputs.users_height_m
        self.classes = np.zeros((len(self.links), len(inputs.legs)), int)
        self.attachments = Attachments(inputs, self.result)
        self.services = Services(inputs, self.result)

    def _carry_over(self, before: FixedStep) -> None:
        """Drones and pads as they were at the end of the episode before, their clocks set back."""
        self.drones, self.waiting, self.on_pads = before.drones, before.waiting, before.on_pads
        for drone in self.drones:
            drone.respawns = 0
            drone.since_us -= before.horizon_us
            drone.until_us -= before.horizon_us
            drone.crashed_us -= before.horizon_us

    def run(self, commands: Sequence[Any]) -> Result:
        ticks = self.inputs.step_us // self.dt_us
        for step in range(self.inputs.steps):
            xy = self._users_at(step * self.inputs.step_us + self.dt_us * np.arange(ticks + 1))
            start_us = step * self.inputs.step_us
            if step == 0:
                self._happen(0, xy[0])
            self._respawn(start_us)
            self._command(start_us, step, commands[step])
            self._serve(start_us, xy[0])
            for tick in range(1, ticks + 1):
                self._elapse(start_us + tick * self.dt_us)
                self._happen(start_us + tick * self.dt_us, xy[tick])
            self._record(step + 1)
        for user in np.flatnonzero(self.services.open):
            self.services.close(user, self.horizon_us, False)
        self._measure()
        return self.result

    def _users_at(self, t_us: np.ndarray) -> np.ndarray:
        """Positions (tick, 2, user)."""
        xy = np.empty((len(t_us), 2, len(self.inputs.legs)))
        for user, legs in enumerate(self.inputs.legs):
            row = legs[np.searchsorted(legs[:, 0], t_us / US, side="right") - 1]
            elapsed = t_us / US - row[:, 0]
            xy[:, 0, user] = row[:, 1] + row[:, 3] * elapsed
            xy[:, 1, user] = row[:, 2] + row[:, 4] * elapsed
        return xy

    def _elapse(self, t_us: int) -> None:
        """What the ``dt`` until now does to clocks: service, coverage, batteries."""
        self.services.elapse(self.dt_us)
        self.result.attached_us += int((self.attachments.holder >= 0).sum()) * self.dt_us
        if self.inputs.capacity is None:
            return
        for drone in self.drones:
            if drone.mode in ("flying", "returning"):
                drone.charge -= self._drained(drone, t_us)
            elif drone.mode == "charging" and self.inputs.charger is not None:
                rate = self.inputs.charger.rate(drone.charge / self.inputs.capacity)
                drone.charge += rate * self.inputs.capacity * self.dt_us / US
            elif drone.mode == "charging":
                drone.charge += self.inputs.capacity / self.inputs.charge_us * self.dt_us

    def _drained(self, drone: Drone, t_us: int) -> float:
        """What a drone takes in the ``dt`` until now: that time, or µJ by its mean speed."""
        rotor = self.inputs.rotor
        if rotor is None:
            return self.dt_us
        before, now = self._position(drone, t_us - self.dt_us), self._position(drone, t_us)
        velocity = [(b - a) / (self.dt_us / US) for a, b in zip(before, now, strict=True)]
        return self._power_w(rotor, velocity) * self.dt_us

    def _power_w(self, rotor: Rotor, velocity_mps: Sequence[float]) -> float:
        """The power at a velocity over the ground."""
        (east, north, up), wind = velocity_mps, self.inputs.wind_mps
        return rotor.power_w(math.hypot(east - wind[0], north - wind[1]), up)

    def _takes(self, flight: Hop, ahead: Sequence[float]) -> float:
        """What a flight takes from a battery: its time, or µJ by the mean speeds of slices.

        Ramps are cut into slices. Both take the same.
        """
        duration_us, rotor = round(flight.duration_s * US), self.inputs.rotor
        if rotor is None:
            return duration_us

        def at_speed(speed_mps: float) -> float:
            return self._power_w(rotor, [part * speed_mps for part in ahead])

        ramp_s = flight.speed_mps / flight.acceleration_mps2
        speeds = [flight.speed_mps * (k + 0.5) / SLICES for k in range(SLICES)]
        ramp_uj = sum(map(at_speed, speeds)) / SLICES * ramp_s * US
        return 2 * ramp_uj + at_speed(flight.speed_mps) * (duration_us - 2 * ramp_s * US)

    def _happen(self, t_us: int, xy: np.ndarray) -> None:
        """The phases of an instant before its step record.

        At the start users are attached before they ask for anything.
        """
        if t_us == 0:
            self._serve(t_us, xy)
        self.services.complete(t_us)
        for drone in self.drones:
            self._arrive(drone, t_us)
            if drone.mode in ("queued", "charging"):
                self.services.unload(drone.index, t_us)
        self._charged()
        self.services.ask(t_us)
        for drone in self.drones:
            self._deplete(drone, t_us)
        self._serve(t_us, xy)

    def _arrive(self, drone: Drone, t_us: int) -> None:
        """End flights whose time has come; a return goes on to its next hop at once."""
        while drone.hop is not None and t_us >= drone.until_us:
            drone.node = moved(drone.node, drone.hop)
            drone.hop = None
            if drone.mode == "returning":
                self._fly_on(drone, drone.until_us)

    def _fly_on(self, drone: Drone, since_us: int) -> None:
        """The next hop of a return; at the end of its path land, or plan again from the truth."""
        if drone.path and not self.map.free(moved(drone.node, drone.path[0]), drone.levels):
            drone.path = []
        if not drone.path and self._station(drone.node) is None:
            drone.path = list(self.map.way_home(drone.node, drone.levels))
        if drone.path:
            hop = drone.path.pop(0)
            self._take_hop(drone, hop, since_us, self.map.returning[hop])
        else:
            self._land(drone)

    def _take_hop(self, drone: Drone, hop: Node, since_us: int, flight: Hop) -> None:
        drone.hop, drone.flight, drone.since_us = hop, flight, since_us
        drone.until_us = since_us + round(flight.duration_s * US)

    def _station(self, node: Node) -> int | None:
        if node[2] == 0 and node[:2] in list(self.inputs.stations):
            return list(self.inputs.stations).index(node[:2])
        return None

    def _land(self, drone: Drone) -> None:
        drone.mode = "queued"
        self.waiting[self._station(drone.node)].append(drone)
        self._start_charging()

    def _start_charging(self) -> None:
        for waiting, on_pads in zip(self.waiting, self.on_pads, strict=True):
            while waiting and len(on_pads) < self.inputs.pads:
                drone = waiting.pop(0)
                drone.mode = "charging"
                on_pads.append(drone)

    def _charged(self) -> None:
        for on_pads in self.on_pads:
            full = self._full()
            for drone in [d for d in on_pads if d.charge >= full - 0.5]:
                drone.charge = full
                drone.mode = "charged"
                on_pads.remove(drone)
                self.result.charges += 1
        self._start_charging()

    def _full(self) -> float:
        """The charge at which a battery is full."""
        charger = self.inputs.charger
        return self.inputs.capacity * (1.0 if charger is None else charger.full_at)

    def _deplete(self, drone: Drone, t_us: int) -> None:
        airborne = drone.mode in ("flying", "returning")
        if self.inputs.capacity is not None and airborne and drone.charge <= 0:
            drone.crash_position_m = self._position(drone, t_us)
            drone.mode, drone.crashed_us, drone.charge = "crashed", t_us, 0
            drone.hop, drone.path = None, []
            self.result.crashes += 1
            self.services.crash(drone.index, t_us)

    def _position(self, drone: Drone, t_us: int) -> tuple[float, float, float]:
        if drone.mode == "crashed":
            return drone.crash_position_m
        (dx, dy), levels_m = self.inputs.cell_m, self.inputs.levels_m
        x, y, level = drone.node
        at = [(x + 0.5) * dx, (y + 0.5) * dy, levels_m[level]]
        if drone.hop is not None:
            axis = axis_of(drone.hop)
            at[axis] += drone.hop[axis] * drone.flight.flown_m((t_us - drone.since_us) / US)
        return at[0], at[1], at[2]

    def _serve(self, t_us: int, xy: np.ndarray) -> None:
        """Sample the class of each link; then attach users, and let transmitters serve them."""
        serving = np.ones(len(self.links), bool)
        for drone in self.drones:
            serving[drone.index] = flying = drone.mode == "flying"
            if flying:
                self.position_m[drone.index] = self._position(drone, t_us)
        classes, level_dbm = look(self.links, self.position_m, serving, xy, self.users_height_m)
        services = self.services
        services.changed |= bool((classes != self.classes).any())
        self.classes = services.classes = classes

        def later_dbm() -> np.ndarray:
            position_m = self.position_m.copy()
            for drone in self.drones:
                if serving[drone.index]:
                    position_m[drone.index] = self._position(drone, t_us + self.dt_us)
            return look(self.links, position_m, serving, xy, self.users_height_m)[1]

        for user in self.attachments.follow(t_us, classes > 0, level_dbm, later_dbm):
            services.attach(t_us, user, self.attachments.holder)
        running = serving.copy()
        for drone in self.drones if self.inputs.processors else ():
            on_ground = self.inputs.processors[drone.index].on_ground
            running[drone.index] |= on_ground and drone.mode != "crashed"
        services.allocate(t_us, self.attachments.holder, classes, running)

    def _believed(self, drone: Drone, epoch: int) -> Node:
        if self.inputs.position_error is None:
            return drone.node
        cell = np.rint(np.array(drone.node[:2]) + self.inputs.position_error[drone.index, epoch])
        x, y = np.clip(cell.astype(int), 0, np.array(self.map.shape) - 1).tolist()
        return x, y, drone.node[2]

    def _allowed(self, drone: Drone, epoch: int, charge: float) -> set[str]:
        if drone.mode == "returning":
            return {"goto_charging_station"}
        if drone.mode in ("queued", "charging"):
            return {"charge"}
        if drone.mode == "crashed":
            return {"hover"}
        allowed = set(self.actions) - {"goto_charging_station", "charge"}
        capacity = self.inputs.capacity
        if capacity is None:
            return allowed
        # As fractions: 0.3 of 500 s is 150 s, not 149.99999999999997.
        low = Fraction(str(self.inputs.return_below)) * capacity
        home_us, _ = self.map.nearest(self._believed(drone, epoch), drone.levels)
        if charge <= low and home_us < NEVER:
            allowed.add("goto_charging_station")
        if self._station(drone.node) is not None and charge < self._full():
            allowed.add("charge")
        return allowed

    def _respawn(self, t_us: int) -> None:
        for drone in self.drones:
            if drone.mode == "crashed" and self._replaced_us(drone) <= t_us:
                station = self.inputs.respawn[drone.index, drone.respawns]
                drone.respawns += 1
                drone.node = (*self.inputs.stations[station], 0)
                drone.mode, drone.charge = "flying", self.inputs.capacity

    def _replaced_us(self, drone: Drone) -> int:
        """When a crashed drone may be replaced."""
        after_us = self.inputs.respawn_after_us
        return NEVER if after_us is None else drone.crashed_us + after_us

    def _command(self, t_us: int, epoch: int, commands: Sequence[Any]) -> None:
        for drone, command in zip(self.drones, commands, strict=True):
            drone.action = self._taken(command, self._allowed(drone, epoch, drone.charge))
            if drone.mode in ("flying", "charged"):
                self._obey(drone, t_us, epoch, command)

    def _taken(self, command: Any, allowed: set[str]) -> str:
        """The action that is taken: that of the command, if the mask allows it."""
        action = self.actions[command] if 0 <= command < len(self.actions) else None
        if action in allowed:
            return action
        return next(iter(allowed)) if len(allowed) == 1 else "hover"

    def _obey(self, drone: Drone, t_us: int, epoch: int, command: Any) -> None:
        """Begin the drone's action, which stands for the command."""
        action, drone.mode = drone.action, "flying"
        if action == "charge":
            self._land(drone)
        elif action == "goto_charging_station":
            drone.mode = "returning"
            if self._station(drone.node) is None:  # else it lands, whatever it believes
                believed = self._believed(drone, epoch)
                drone.path = list(self.map.way_home(believed, drone.levels))
            self._fly_on(drone, t_us)
        name, _, speed = action.partition("@")
        hop = HOPS.get(name)
        if hop is not None and self.map.free(moved(drone.node, hop), drone.levels):
            flown = self.map.cruising[float(speed)] if speed else self.map.commanded
            self._take_hop(drone, hop, t_us, flown[hop])

    def _return(self, drone: Drone, epoch: int) -> float | None:
        """What the way home takes from the battery; infinity without a way."""
        if self.inputs.capacity is None:
            return None
        node = self._believed(drone, epoch)
        home_us, _ = self.map.nearest(node, drone.levels)
        if home_us >= NEVER:
            return math.inf
        if self.inputs.rotor is None:
            return home_us
        return sum(self.hops_take[hop] for hop in self.map.way_home(node, drone.levels))

    def _record(self, epoch: int) -> None:
        records = []
        t_us = epoch * self.inputs.step_us
        for drone in self.drones:
            record = Record(
                drone.mode,
                drone.node,
                self._position(drone, t_us),
                None if self.inputs.capacity is None else drone.charge,
                drone.action,
                tuple(np.flatnonzero(self.attachments.holder == drone.index).tolist()),
                self._return(drone, epoch),
            )
            records.append(record)
        self.result.records.append(records)

    def _measure(self) -> None:
        result, closed = self.result, self.result.requests
        self.services.sensors.end(self.horizon_us)
        users = len(self.inputs.legs)
        result.qoe3 = 100.0 * result.attached_us / (users * self.horizon_us)
        if closed:
            result.qoe1 = 100.0 * float(np.mean([request.share for request in closed]))
            unserved = [r.t_end_us - r.t_request_us - r.served_us for r in closed]
            result.qoe2 = float(np.mean(unserved)) / self.inputs.step_us


def at(name: str, speed_mps: float) -> str:
    """The name of a move at a cruise speed."""
    return f"{name}@{speed_mps}".removesuffix(".0")


def simulate(inputs: Inputs, commands: Sequence[Sequence[int]], dt_s: float) -> Result:
    """Run one episode in steps of ``dt_s``; ``commands[step][drone]`` index the model's actions."""
    return FixedStep(inputs, round(dt_s * US)).run(commands)


def simulate_on(
    episodes: Sequence[tuple[Inputs, Sequence[Sequence[int]]]], dt_s: float
) -> list[Result]:
    """Run episodes one after the other, drones carried over from each to the next."""
    results: list[Result] = []
    simulator = None
    for inputs, commands in episodes:
        simulator = FixedStep(inputs, round(dt_s * US), simulator)
        results.append(simulator.run(commands))
    return results
