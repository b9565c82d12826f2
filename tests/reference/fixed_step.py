"""A second simulator of the model, by fixed time steps, to hold the event-driven engine against.

It shares no code with the package and no method with its engine: time advances by ``dt``, nothing
is looked for between two ticks, and what happens there is noticed at the next tick. Coverage is a
sampled distance, served time a sum of ticks, a return a table of Dijkstra times. So every moment
it notices is late by less than ``dt``, and its results tend to the exact ones as ``dt`` goes to 0.

Only motion has its closed form (hops of a return follow each other without waiting for a tick).
Times are whole microseconds, so that ticks at 0.1 s and decision epochs meet.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

US = 1_000_000
NEVER = 2**62
HOPS = {
    "forward": (0, 1, 0),
    "backward": (0, -1, 0),
    "right": (1, 0, 0),
    "left": (-1, 0, 0),
    "up": (0, 0, 1),
    "down": (0, 0, -1),
}
Node = tuple[int, int, int]
"""(cell x, cell y, level)."""


@dataclass(frozen=True)
class Request:
    """What a user will ask for; ``due_us`` counts as ``Inputs.after_previous`` says."""

    due_us: int
    required_us: int
    bandwidth_bps: int


@dataclass(frozen=True)
class Inputs:
    """One episode in plain numbers. ``levels_m``: all altitudes; ``levels``: how many a drone has.

    ``legs``: for each user an array of rows t0_s, x0, y0, vx, vy. ``capacity_us`` None is an
    unlimited battery, ``respawn_after_us`` None is no respawn. ``plan`` settles what the model
    leaves open, which of several equally short ways is flown: a way (hops) from a node for a drone
    with so many levels, checked here against Dijkstra's time; without it any shortest way is flown.
    """

    cell_m: tuple[float, float]
    height_m: np.ndarray
    levels_m: tuple[float, ...]
    level_step_m: float
    three_d: bool
    levels: tuple[int, ...]
    stations: Sequence[tuple[int, int]]
    starts: Sequence[tuple[int, int]]
    radius_m: float
    bandwidth_bps: float
    max_speed_mps: float
    max_acceleration_mps2: float
    fill_epoch: bool
    returns_fill_epoch: bool
    capacity_us: int | None
    return_below: float
    respawn_after_us: int | None
    charge_us: int
    pads: int
    steps: int
    step_us: int
    legs: Sequence[np.ndarray]
    requests: Sequence[Sequence[Request]]
    after_previous: bool
    position_error: np.ndarray | None
    respawn: np.ndarray
    plan: Callable[[Node, int], Sequence[Node]] | None = None


@dataclass
class Record:
    """A drone at the end of a step. ``return_us``: the flight time home from its believed cell."""

    mode: str
    node: Node
    position_m: tuple[float, float, float]
    battery_us: float | None
    action_taken: str
    attached: tuple[int, ...]
    return_us: float | None


@dataclass
class Closed:
    """A request that has ended."""

    user: int
    required_us: int
    served_us: int
    t_request_us: int
    t_end_us: int
    completed: bool


@dataclass
class Result:
    """What became of the episode; ``records[step][drone]``."""

    records: list[list[Record]] = field(default_factory=list)
    requests: list[Closed] = field(default_factory=list)
    attached_us: int = 0
    crashes: int = 0
    charges: int = 0
    suppressed: int = 0
    qoe1: float = 0.0
    qoe2: float = 0.0
    qoe3: float = 0.0


@dataclass(frozen=True)
class Hop:
    """A rest-to-rest flight of ``distance_m``: ramp up, cruise at ``speed_mps``, ramp down."""

    distance_m: float
    speed_mps: float
    acceleration_mps2: float
    duration_s: float

    def flown_m(self, elapsed_s: float) -> float:
        ramp = self.speed_mps / self.acceleration_mps2
        left = self.duration_s - elapsed_s
        if left <= 0.0:
            return self.distance_m
        if elapsed_s < ramp:
            return 0.5 * self.acceleration_mps2 * elapsed_s**2
        if left < ramp:
            return self.distance_m - 0.5 * self.acceleration_mps2 * left**2
        return self.speed_mps * (elapsed_s - 0.5 * ramp)


def quickest(distance_m: float, v: float, a: float) -> Hop:
    if distance_m >= v * v / a:
        return Hop(distance_m, v, a, distance_m / v + v / a)
    peak = math.sqrt(a * distance_m)
    return Hop(distance_m, peak, a, 2.0 * peak / a)


def filling(distance_m: float, duration_s: float, a: float) -> Hop:
    at = a * duration_s
    return Hop(distance_m, (at - math.sqrt(at * at - 4.0 * a * distance_m)) / 2.0, a, duration_s)


class Map:
    """Where drones can be, and how long the way home is from there."""

    def __init__(self, inputs: Inputs) -> None:
        self.inputs = inputs
        self.shape = inputs.height_m.shape
        v, a = inputs.max_speed_mps, inputs.max_acceleration_mps2
        dx, dy = inputs.cell_m
        lengths = (dx, dy, inputs.level_step_m)
        quick = [quickest(length, v, a) for length in lengths]
        filled = [filling(length, inputs.step_us / US, a) for length in lengths]
        self.commanded = filled if inputs.fill_epoch else quick
        self.returning = filled if inputs.returns_fill_epoch else quick
        self.hop_us = [round(hop.duration_s * US) for hop in self.returning]
        self.home_us = {levels: self._homes(levels) for levels in set(inputs.levels)}

    def free(self, node: Node, levels: int) -> bool:
        x, y, level = node
        if not (0 <= x < self.shape[0] and 0 <= y < self.shape[1] and 0 <= level < levels):
            return False
        height = self.inputs.height_m[x, y]
        return height <= 0.0 or self.inputs.levels_m[level] > height

    def neighbours(self, node: Node, levels: int) -> list[tuple[Node, Node, int]]:
        """(free neighbour, hop, time) of a node."""
        found = []
        for hop in HOPS.values():
            other = moved(node, hop)
            if self.free(other, levels):
                found.append((other, hop, self.hop_us[axis_of(hop)]))
        return found

    def _homes(self, levels: int) -> list[dict[Node, int]]:
        """The quickest time between each free node and each station."""
        tables = []
        for x, y in self.inputs.stations:
            table = {(x, y, 0): 0}
            heap = [(0, (x, y, 0))]
            while heap:
                time, node = heapq.heappop(heap)
                if time > table[node]:
                    continue
                for other, _, hop_us in self.neighbours(node, levels):
                    if time + hop_us < table.get(other, NEVER):
                        table[other] = time + hop_us
                        heapq.heappush(heap, (time + hop_us, other))
            tables.append(table)
        return tables

    def nearest(self, node: Node, levels: int) -> tuple[int, int]:
        """(time, station) of the quickest way home, which may begin inside a building."""
        best = (NEVER, -1)
        for station, table in enumerate(self.home_us[levels]):
            time = table.get(node, NEVER)
            if time == NEVER:
                ways = self.neighbours(node, levels)
                time = min((us + table.get(n, NEVER) for n, _, us in ways), default=NEVER)
            if time < best[0]:
                best = (time, station)
        return best

    def way_home(self, node: Node, levels: int) -> list[Node]:
        """The hops of a quickest way to the nearest station."""
        time, station = self.nearest(node, levels)
        assert time < NEVER
        goal = (*self.inputs.stations[station], 0)
        table = self.home_us[levels][station]
        if self.inputs.plan is not None:
            hops = [tuple(hop) for hop in self.inputs.plan(node, levels)]
            flown, at = 0, node
            for hop in hops:
                at = moved(at, hop)
                assert self.free(at, levels), f"{node}: planned through a building at {at}"
                flown += self.hop_us[axis_of(hop)]
            assert (flown, at) == (time, goal), f"{node}: {flown} us to {at}, not {time} to {goal}"
            return hops
        hops = []
        while node != goal:
            node, hop, _ = min(
                self.neighbours(node, levels), key=lambda way: way[2] + table.get(way[0], NEVER)
            )
            hops.append(hop)
        return hops


def axis_of(hop: Node) -> int:
    return next(axis for axis in range(3) if hop[axis])


def moved(node: Node, hop: Node) -> Node:
    return node[0] + hop[0], node[1] + hop[1], node[2] + hop[2]


@dataclass
class Drone:
    """``node`` is where it rests or was last; a flight goes on from there until ``until_us``."""

    index: int
    levels: int
    node: Node
    battery_us: float
    mode: str = "flying"
    action: str = "hover"
    hop: Node | None = None
    flight: Hop | None = None
    since_us: int = 0
    until_us: int = 0
    path: list[Node] = field(default_factory=list)
    crashed_us: int = 0
    crash_position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    respawns: int = 0


class FixedStep:
    """One episode, tick by tick."""

    def __init__(self, inputs: Inputs, dt_us: int, before: FixedStep | None = None) -> None:
        assert inputs.step_us % dt_us == 0
        self.inputs, self.dt_us, self.map = inputs, dt_us, Map(inputs)
        self.result = Result()
        full = inputs.capacity_us or 0
        self.drones = [
            Drone(d, levels, (*inputs.starts[d], 0), full) for d, levels in enumerate(inputs.levels)
        ]
        self.waiting: list[list[Drone]] = [[] for _ in inputs.stations]
        self.on_pads: list[list[Drone]] = [[] for _ in inputs.stations]
        if before is not None:
            self._carry_over(before)
        names = ["forward", "backward", "right", "left", "hover"]
        names += ["up", "down"] if inputs.three_d else []
        names += ["goto_charging_station", "charge"] if inputs.capacity_us is not None else []
        self.actions = names
        users = len(inputs.legs)
        self.horizon_us = inputs.steps * inputs.step_us
        self.covered = np.zeros((len(self.drones), users), bool)
        self.entered_us = np.zeros((len(self.drones), users), np.int64)
        self.attached = np.full(users, -1)
        self.served_by = np.full(users, -1)
        self.open = np.zeros(users, bool)
        self.served_us = np.zeros(users, np.int64)
        self.required_us = np.zeros(users, np.int64)
        self.asked_us = np.zeros(users, np.int64)
        self.bandwidth = np.zeros(users, np.int64)
        self.asked = np.zeros(users, int)
        first = [own[0].due_us if own else NEVER for own in inputs.requests]
        self.due_us = np.array(first, np.int64)
        self.rescan = True

    def _carry_over(self, before: FixedStep) -> None:
        """Drones and pads as they were at the end of the episode before, their clocks set back."""
        self.drones, self.waiting, self.on_pads = before.drones, before.waiting, before.on_pads
        for drone in self.drones:
            drone.respawns = 0
            drone.since_us -= before.horizon_us
            drone.until_us -= before.horizon_us
            drone.crashed_us -= before.horizon_us

    def run(self, commands: Sequence[Sequence[int]]) -> Result:
        ticks = self.inputs.step_us // self.dt_us
        for step in range(self.inputs.steps):
            xy = self._users_at(step * self.inputs.step_us + self.dt_us * np.arange(ticks + 1))
            start_us = step * self.inputs.step_us
            if step == 0:
                self._happen(0, xy[0])
            self._respawn(start_us)
            self._command(start_us, step, commands[step])
            self._cover(start_us, xy[0])
            self._admit()
            for tick in range(1, ticks + 1):
                self._elapse()
                self._happen(start_us + tick * self.dt_us, xy[tick])
            self._record(step + 1)
        for user in np.flatnonzero(self.open):
            self._close(user, self.horizon_us, False)
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

    def _elapse(self) -> None:
        """What ``dt`` does to clocks: service, coverage, batteries."""
        served = self.served_by >= 0
        self.served_us[served] += self.dt_us
        self.result.attached_us += int((self.attached >= 0).sum()) * self.dt_us
        if self.inputs.capacity_us is None:
            return
        for drone in self.drones:
            if drone.mode in ("flying", "returning"):
                drone.battery_us -= self.dt_us
            elif drone.mode == "charging":
                drone.battery_us += self.inputs.capacity_us / self.inputs.charge_us * self.dt_us

    def _happen(self, t_us: int, xy: np.ndarray) -> None:
        """The phases of an instant before its step record."""
        done = self.open & (self.served_us >= self.required_us)
        if done.any():
            for user in np.flatnonzero(done):
                self._close(user, t_us, True)
        for drone in self.drones:
            self._arrive(drone, t_us)
        self._charged()
        self._ask(t_us)
        for drone in self.drones:
            self._deplete(drone, t_us)
        self._cover(t_us, xy)
        self._admit()

    def _close(self, user: int, t_us: int, completed: bool) -> None:
        required = int(self.required_us[user])
        served = min(int(self.served_us[user]), required)
        closed = Closed(user, required, served, int(self.asked_us[user]), t_us, completed)
        self.result.requests.append(closed)
        self.open[user] = False
        self.served_by[user] = -1
        self.rescan = True
        own = self.inputs.requests[user]
        if self.inputs.after_previous and self.asked[user] < len(own):
            self.due_us[user] = t_us + own[self.asked[user]].due_us

    def _ask(self, t_us: int) -> None:
        """Open what has become due (before the end: ``due`` counts, not the tick)."""
        late = (self.due_us <= t_us) & (self.due_us < self.horizon_us)
        if not late.any():
            return
        for user in np.flatnonzero(late):
            own = self.inputs.requests[user]
            while self.due_us[user] <= t_us:
                request = own[self.asked[user]]
                self.asked[user] += 1
                self.due_us[user] = NEVER
                if not self.inputs.after_previous and self.asked[user] < len(own):
                    self.due_us[user] = own[self.asked[user]].due_us
                if self.open[user]:
                    self.result.suppressed += 1
                    continue
                self.open[user] = True
                self.asked_us[user] = t_us
                self.served_us[user] = 0
                self.required_us[user] = request.required_us
                self.bandwidth[user] = request.bandwidth_bps
                self.rescan = True

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
            self._take_hop(drone, hop, since_us, self.map.returning[axis_of(hop)])
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
            for drone in [d for d in on_pads if d.battery_us >= self.inputs.capacity_us - 0.5]:
                drone.battery_us = self.inputs.capacity_us
                drone.mode = "charged"
                on_pads.remove(drone)
                self.result.charges += 1
        self._start_charging()

    def _deplete(self, drone: Drone, t_us: int) -> None:
        airborne = drone.mode in ("flying", "returning")
        if self.inputs.capacity_us is not None and airborne and drone.battery_us <= 0:
            drone.crash_position_m = self._position(drone, t_us)
            drone.mode, drone.crashed_us, drone.battery_us = "crashed", t_us, 0
            drone.hop, drone.path = None, []
            self.result.crashes += 1

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

    def _cover(self, t_us: int, xy: np.ndarray) -> None:
        """Sample who is covered; detach and attach accordingly."""
        covered = np.zeros_like(self.covered)
        for drone in self.drones:
            if drone.mode == "flying":
                x, y, _ = self._position(drone, t_us)
                away = (xy[0] - x) ** 2 + (xy[1] - y) ** 2
                covered[drone.index] = away <= self.inputs.radius_m**2
        if (covered == self.covered).all():
            return
        self.entered_us[covered & ~self.covered] = t_us
        self.covered = covered
        self.rescan = True
        for user in range(covered.shape[1]):
            holder = self.attached[user]
            if holder >= 0 and covered[holder, user]:
                continue
            self.attached[user] = self.served_by[user] = -1
            if covered[:, user].any():
                entered = np.where(covered[:, user], self.entered_us[:, user], NEVER)
                self.attached[user] = entered.argmin()

    def _admit(self) -> None:
        """First come, first served, whoever fits: (request time, user)."""
        if not self.rescan:
            return
        self.rescan = False
        for drone in range(len(self.drones)):
            taken = self.bandwidth[self.served_by == drone].sum()
            waits = self.open & (self.attached == drone) & (self.served_by < 0)
            for user in sorted(np.flatnonzero(waits), key=lambda user: (self.asked_us[user], user)):
                if taken + self.bandwidth[user] <= self.inputs.bandwidth_bps:
                    taken += self.bandwidth[user]
                    self.served_by[user] = drone

    def _believed(self, drone: Drone, epoch: int) -> Node:
        if self.inputs.position_error is None:
            return drone.node
        cell = np.rint(np.array(drone.node[:2]) + self.inputs.position_error[drone.index, epoch])
        x, y = np.clip(cell.astype(int), 0, np.array(self.map.shape) - 1).tolist()
        return x, y, drone.node[2]

    def _allowed(self, drone: Drone, epoch: int) -> set[str]:
        if drone.mode == "returning":
            return {"goto_charging_station"}
        if drone.mode in ("queued", "charging"):
            return {"charge"}
        if drone.mode == "crashed":
            return {"hover"}
        allowed = set(self.actions) - {"goto_charging_station", "charge"}
        capacity = self.inputs.capacity_us
        if capacity is None:
            return allowed
        # As fractions: 0.3 of 500 s is 150 s, not 149.99999999999997.
        low = Fraction(str(self.inputs.return_below)) * capacity
        home_us, _ = self.map.nearest(self._believed(drone, epoch), drone.levels)
        if drone.battery_us <= low and home_us < NEVER:
            allowed.add("goto_charging_station")
        if self._station(drone.node) is not None and drone.battery_us < capacity:
            allowed.add("charge")
        return allowed

    def _respawn(self, t_us: int) -> None:
        after = self.inputs.respawn_after_us
        for drone in self.drones:
            if drone.mode == "crashed" and after is not None and drone.crashed_us + after <= t_us:
                station = self.inputs.respawn[drone.index, drone.respawns]
                drone.respawns += 1
                drone.node = (*self.inputs.stations[station], 0)
                drone.mode, drone.battery_us = "flying", self.inputs.capacity_us

    def _command(self, t_us: int, epoch: int, commands: Sequence[int]) -> None:
        for drone, command in zip(self.drones, commands, strict=True):
            allowed = self._allowed(drone, epoch)
            action = self.actions[command] if 0 <= command < len(self.actions) else None
            if action not in allowed:
                action = next(iter(allowed)) if len(allowed) == 1 else "hover"
            drone.action = action
            if drone.mode not in ("flying", "charged"):
                continue
            drone.mode = "flying"
            if action == "charge":
                self._land(drone)
            elif action == "goto_charging_station":
                drone.mode = "returning"
                if self._station(drone.node) is None:  # else it lands, whatever it believes
                    believed = self._believed(drone, epoch)
                    drone.path = list(self.map.way_home(believed, drone.levels))
                self._fly_on(drone, t_us)
            elif action in HOPS and self.map.free(moved(drone.node, HOPS[action]), drone.levels):
                hop = HOPS[action]
                self._take_hop(drone, hop, t_us, self.map.commanded[axis_of(hop)])

    def _record(self, epoch: int) -> None:
        records = []
        t_us = epoch * self.inputs.step_us
        for drone in self.drones:
            limited = self.inputs.capacity_us is not None
            home_us = None
            if limited:
                home_us, _ = self.map.nearest(self._believed(drone, epoch), drone.levels)
                home_us = math.inf if home_us >= NEVER else home_us
            record = Record(
                drone.mode,
                drone.node,
                self._position(drone, t_us),
                drone.battery_us if limited else None,
                drone.action,
                tuple(np.flatnonzero(self.attached == drone.index).tolist()),
                home_us,
            )
            records.append(record)
        self.result.records.append(records)

    def _measure(self) -> None:
        result, closed = self.result, self.result.requests
        users = len(self.inputs.legs)
        result.qoe3 = 100.0 * result.attached_us / (users * self.horizon_us)
        if closed:
            result.qoe1 = 100.0 * float(np.mean([r.served_us / r.required_us for r in closed]))
            unserved = [r.t_end_us - r.t_request_us - r.served_us for r in closed]
            result.qoe2 = float(np.mean(unserved)) / (60 * US)


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
