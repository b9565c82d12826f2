"""Requests of users at each tick: what is open, who is admitted, and at which rate it is served."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from tests.reference.backhauls import Backhauls
from tests.reference.inputs import NEVER, Closed, Inputs, Request, Result
from tests.reference.offloading import offloaded_part
from tests.reference.processors import Tasks, cycles_of, paces
from tests.reference.sensors import Sensors
from tests.reference.shares import hz_for, whole

Band = tuple[float, np.ndarray]
"""A bandwidth in Hz, and who of all users has a stage in it."""


class Services:
    """The requests of all users, of which each has one open at most.

    ``server``: the transmitter that serves a user, -1 for none. ``left``: what is still to serve,
    in 1e-6 bit of a transfer, in microseconds of a hold, and in thousandths of a cycle of what is
    computed (see ``processors``). ``pace``: how much of it is served in a
    microsecond, which is the rate in bit/s of a transfer and 1 for a hold. A request is held if it
    occupies bandwidth for its own rate: a hold, or a transfer where bandwidth is held. The time
    served and what is required are those of the present stage; ``before`` has, for each user, the
    stages that have been done, and the time and the bits of them, and ``later`` those to come.
    """

    def __init__(self, inputs: Inputs, result: Result) -> None:
        self.inputs, self.result = inputs, result
        self.links = [*inputs.links, *(point.link for point in inputs.access_points)]
        self.efficiencies = [np.array(link.efficiencies) for link in self.links]
        self.horizon_us = inputs.steps * inputs.step_us
        users = len(inputs.legs)
        self.server = np.full(users, -1)
        self.open = np.zeros(users, bool)
        self.served_us = np.zeros(users, np.int64)
        self.required_us = np.zeros(users, np.int64)
        self.volume_ubit = np.zeros(users, np.int64)
        self.left = np.zeros(users, np.int64)
        self.pace = np.ones(users, np.int64)
        self.wanted_bps = np.zeros(users, np.int64)
        self.up = np.zeros(users, bool)
        self.asked_us = np.zeros(users, np.int64)
        self.admitted_us = np.zeros(users, np.int64)
        self.asked = np.zeros(users, int)
        self.before = np.zeros((users, 3), np.int64)
        self.request: list[Request | None] = [None] * users
        self.tasks, self.sensors = Tasks(inputs), Sensors(inputs, result)
        self.backhauls = Backhauls(self.links)
        self.holder = np.full(users, -1)
        self.classes = np.zeros((len(self.links), users), int)
        self.running = np.ones(len(self.links), bool)
        self.stages = np.ones(users, int)
        self.later: list[list[Request]] = [[] for _ in range(users)]
        first = [own[0].due_us if own else NEVER for own in inputs.requests]
        self.due_us = np.array(first, np.int64)
        self.changed = True

    def elapse(self, dt_us: int) -> None:
        """Serve for a tick."""
        served, own = self.server >= 0, self._own()
        self.served_us[served | own] += dt_us
        self.left -= np.where(served, self.pace * dt_us, 0)
        self.tasks.elapse(dt_us, self.server, own)
        self.sensors.send_stored(self.backhauls.store_bps, dt_us)

    def _own(self) -> np.ndarray:
        """Whose own processors compute now."""
        own: np.ndarray = self.open & (self.tasks.own_left > 0)
        return own

    def complete(self, t_us: int) -> None:
        """Close what has been served in full, or pass it on to its next stage."""
        tasks = self.tasks
        self.changed |= self.sensors.deliver_sent(t_us)
        for user in np.flatnonzero(self.open & (self.left <= 0) & ~tasks.alone):
            if tasks.target[user] >= 0:
                self._arrive(user, int(tasks.target[user]), t_us)
            elif any(stage.amount for stage in self.later[user]):
                self._pass_on(user, t_us)
            elif tasks.own_left[user] > 0:
                tasks.alone[user], self.server[user] = True, -1
                self.changed = True
            else:
                self.close(user, t_us, True)
        for user in np.flatnonzero(self.open & tasks.alone & (tasks.own_left <= 0)):
            self.close(user, t_us, True)
        for user in np.flatnonzero(self.open & (tasks.deadline_us <= t_us)):
            request, begun = self.request[user], tasks.computing_us[user] > 0 or tasks.own[user] > 0
            assert request is not None
            if request.on_deadline == "drop" or (request.on_deadline == "leave" and not begun):
                self.result.late += 1
                self.close(user, t_us, False)

    def _pass_on(self, user: int, t_us: int) -> None:
        """Begin the next stage that is of anything; whoever has received the last one computes."""
        server = int(self.server[user])
        self.before[user] += (1, *self._done(user))
        self._begin(user)
        if self.tasks.cycles[user]:
            self._arrive(user, server, t_us)

    def _arrive(self, user: int, server: int, t_us: int) -> None:
        """Let a task stand in the line of a processor."""
        tasks = self.tasks
        tasks.site[user], tasks.arrived_us[user], tasks.target[user] = server, t_us, -1
        self.left[user], self.server[user] = tasks.cycles[user], -1
        self.changed = True

    def _begin(self, user: int) -> None:
        """Begin the first of the stages to come, or the next that is of anything."""
        stage = self.later[user].pop(0)
        while stage.amount == 0:
            self.before[user, 0] += 1
            stage = self.later[user].pop(0)
        self.server[user] = -1
        self.served_us[user] = 0
        self.required_us[user] = stage.required_us
        self.volume_ubit[user] = stage.volume_ubit
        self.tasks.cycles[user] = stage.cycles
        self.left[user] = stage.amount
        self.wanted_bps[user], self.up[user] = stage.bandwidth_bps, stage.up
        self.changed = True

    def _begin_anew(self, user: int) -> None:
        """Begin the part of a request that is offloaded, if there is one, from its start."""
        request, tasks = self.request[user], self.tasks
        assert request is not None
        part = tasks.part[user]
        self.before[user, 1] += self._done(user)[0] if tasks.site[user] >= 0 else 0
        self.before[user, 0] = self.before[user, 2] = 0
        tasks.site[user] = tasks.target[user] = -1
        self.later[user] = [stage.part(part) for stage in (request, *request.then)]
        self.stages[user] = len(self.later[user])
        if any(stage.amount for stage in self.later[user]):
            self._begin(user)
        else:
            tasks.alone[user], tasks.part[user] = True, 0.0
            tasks.cycles[user] = self.volume_ubit[user] = self.required_us[user] = 0

    def _done(self, user: int) -> tuple[int, int]:
        """The time and the bits that have been served of the present stage, less what is beyond."""
        served, volume = int(self.served_us[user]), int(self.volume_ubit[user])
        if volume:
            return served, volume - max(int(self.left[user]), 0)
        if self.tasks.cycles[user] or self.tasks.alone[user]:
            return served, 0
        return min(served, int(self.required_us[user])), 0

    def _share(self, user: int) -> float:
        """The share of the present stage that has been done, nothing while a task moves."""
        if self.tasks.target[user] >= 0:
            return 0.0
        amount = self.volume_ubit[user] or self.tasks.cycles[user] or self.required_us[user]
        return 1.0 - max(int(self.left[user]), 0) / int(amount) if amount else 0.0

    def close(self, user: int, t_us: int, completed: bool) -> None:
        """Log a request, and let the user ask again if its demand waits for that."""
        served, delivered = self._done(user)
        passed, served_before, delivered_before = self.before[user].tolist()
        stages, done, tasks = int(self.stages[user]), self._share(user), self.tasks
        if completed:
            passed += len(self.later[user])
        if tasks.own[user]:
            alone = tasks.part[user] == 0.0
            stages, passed = (1, 0) if alone else (stages + 1, passed)
            done = 0.0 if alone else done
            passed += tasks.own_share(user)
        closed = Closed(
            user,
            served_before + served,
            delivered_before + delivered,
            done,
            passed,
            stages,
            int(self.asked_us[user]),
            t_us,
            completed,
            int(tasks.computing_us[user]),
            int(tasks.own_us[user]),
        )
        self.result.requests.append(closed)
        self.open[user] = False
        server, self.server[user] = int(self.server[user]), -1
        tasks.own_left[user] = 0
        self.changed = True
        own = self.inputs.requests[user]
        if self.inputs.follows[user] and self.asked[user] < len(own):
            self.due_us[user] = t_us + self._waits_us(user, served) + own[self.asked[user]].due_us
        if completed and user in self.sensors.of:
            self.sensors.receive(user, t_us, server)
            self._send_next(user)

    def _waits_us(self, user: int, served_us: int) -> int:
        """How long a sensor that takes updates at will waits before it does."""
        rule = self.sensors.rules[user]
        return 0 if rule is None else max(0, rule.wait_us - served_us)

    def ask(self, t_us: int) -> None:
        """Open what has become due (before the end: ``due`` counts, not the tick)."""
        late = (self.due_us <= t_us) & (self.due_us < self.horizon_us)
        if not late.any():
            return
        for user in np.flatnonzero(late):
            own = self.inputs.requests[user]
            while self.due_us[user] <= t_us:
                due_us, request = int(self.due_us[user]), own[self.asked[user]]
                self.asked[user] += 1
                self.due_us[user] = NEVER
                if not self.inputs.follows[user] and self.asked[user] < len(own):
                    self.due_us[user] = own[self.asked[user]].due_us
                if user in self.sensors.of:
                    self._take(user, due_us, request, t_us)
                elif self.open[user]:
                    self.result.suppressed += 1
                else:
                    self._open(user, t_us, request)
                    self._offload(user)

    def _open(self, user: int, asked_us: int, request: Request) -> None:
        """Open a request."""
        self.open[user] = True
        self.asked_us[user] = asked_us
        self.before[user] = 0
        self.request[user] = request
        self.tasks.forget(user)
        self.tasks.deadline_us[user] = min(asked_us + request.deadline_us, NEVER)
        self.later[user] = [request, *request.then]
        self.stages[user] = len(self.later[user])
        self._begin(user)

    # ---- tasks

    def _offload(self, user: int) -> None:
        """Decide which part of a task, of which nothing has begun, is offloaded."""
        request, tasks = self.request[user], self.tasks
        assert request is not None
        if cycles_of(request) == 0 or tasks.clocks[user] == 0:
            return
        part = offloaded_part(self, user, request)
        if part < 1.0:
            tasks.begin_own(user, request, part)
            self._begin_anew(user)
            self.changed = True

    def attach(self, t_us: int, user: int, holder: np.ndarray) -> None:
        """Note that a user has another holder; what has not begun is decided anew."""
        self.holder = holder
        self.changed = True
        tasks = self.tasks
        if not tasks.cycles[user]:
            self.server[user] = -1
        untouched = tasks.last[user] < 0 and tasks.site[user] < 0 and tasks.own[user] == 0
        if user in self.sensors.of:
            self._ask_room(user)
        elif self.open[user] and holder[user] >= 0 and untouched:
            self._offload(user)
        elif self.open[user]:
            self._follow(user, int(holder[user]), t_us)

    def crash(self, d: int, t_us: int) -> None:
        """Lose the tasks that a drone has received, and what it carries; others do not come."""
        self.sensors.crash(d)
        for user in np.flatnonzero(self.open & (self.tasks.site == d) & ~self.tasks.alone):
            self._begin_anew(user)
            self.result.restarts += 1
        for user in np.flatnonzero(self.open & (self.tasks.target == d)):
            self._arrive(user, int(self.tasks.site[user]), t_us)
        self.changed = True

    def _follow(self, user: int, d: int, t_us: int) -> None:
        """Let a task that waits at a processor, or is on its way to one, move to another one."""
        tasks, request = self.tasks, self.request[user]
        assert request is not None
        site, goes = int(tasks.site[user]), tasks.target[user] >= 0
        stays = tasks.computing_us[user] > 0 or (self.server[user] >= 0 and not goes)
        if not request.migrates or d < 0 or site < 0 or tasks.cycles[user] == 0 or stays:
            return
        if d == (tasks.target[user] if goes else site) or not self.backhauls.connect(site, d):
            return
        volume = request.part(float(tasks.part[user])).volume_ubit
        if d == site or volume == 0:
            self._arrive(user, d, t_us)
        else:
            tasks.target[user], self.left[user], self.server[user] = d, volume, -1

    # ---- sensors

    def _take(self, user: int, taken_us: int, request: Request, t_us: int) -> None:
        """Put an update into a sensor's buffer, which makes room for it."""
        buffer = self.sensors.of[user].buffer
        buffer.append((taken_us, request))
        for other in self.sensors.rivals(user, self.holder):
            self._drop(other, 0, t_us)
        for k in self.sensors.surplus(user, self._is_begun(user)):
            self._drop(user, k, t_us)
        self._send_next(user)

    def _is_begun(self, user: int) -> bool:
        """Whether a part of a user's open request has been sent, or is being sent."""
        return bool(self.open[user]) and bool(self.server[user] >= 0 or self.served_us[user] > 0)

    def _drop(self, user: int, k: int, t_us: int) -> None:
        """Drop an update of a buffer; the request that is open is for the first one."""
        if k == 0 and self.open[user]:
            self.close(user, t_us, False)
            self.sensors.promised.pop(user, None)
        self.sensors.of[user].buffer.pop(k)
        self.result.dropped += 1

    def _send_next(self, user: int) -> None:
        """Open the request of the update that is sent next, which keeps the time of an open one."""
        buffer = self.sensors.of[user].buffer
        if not buffer or self._is_begun(user):
            return
        if self.sensors.put_next_first(user) and self.open[user]:
            self.sensors.promised.pop(user, None)
            self._open(user, int(self.asked_us[user]), buffer[0][1])
        elif not self.open[user]:
            self._open(user, *buffer[0])
        self._ask_room(user)

    def _ask_room(self, user: int) -> None:
        """Ask for room in the store of a user's transmitter."""
        if self.open[user]:
            self.sensors.ask_room(user, self.holder)

    def unload(self, d: int, t_us: int) -> None:
        """Deliver what a drone carries that has landed."""
        self.changed |= self.sensors.unload(d, t_us)

    # ---- who is served

    def held(self, d: int) -> np.ndarray:
        """Whose present stages hold their rates at a transmitter."""
        held: np.ndarray = (self.volume_ubit == 0) | (self.links[d].sharing == "held")
        return held

    def at_links(self, d: int) -> np.ndarray:
        """Whose requests are sent over links of a transmitter, or wait for that."""
        tasks = self.tasks
        at_link = self.open & (self.holder == d) & (tasks.cycles == 0) & ~tasks.alone
        at_link &= (tasks.site < 0) | self.backhauls.connected[:, d][tasks.site]
        for user in self.sensors.of:
            at_link[user] &= bool(at_link[user]) and self.sensors.has_room(user, d)
        return at_link

    def allocate(
        self, t_us: int, holder: np.ndarray, classes: np.ndarray, running: np.ndarray
    ) -> None:
        """Let each transmitter serve those attached to it, if anything has changed.

        The processors of those ``running`` compute.
        """
        self.changed |= bool((running != self.running).any())
        if not self.changed:
            return
        self.changed = False
        self.holder, self.classes, self.running = holder, classes, running
        asked = [(int(self.asked_us[user]), user) for user in self.sensors.of if self.open[user]]
        self.sensors.keep_room(holder, asked)
        attached = [self.at_links(d) for d in range(len(self.links))]
        for d in range(len(self.links)):
            self._restart(d, attached[d])
            for band in self.bands(d):
                self._suspend(d, band)
        rest = [self._hold_all(t_us, d, attached[d]) for d in range(len(self.links))]
        self.backhauls.count(self, [attached[d] & ~self.held(d) for d in range(len(self.links))])
        for d in range(len(self.links)):
            self._divide(d, rest[d])
        self._move()
        for d, processor in enumerate(self.inputs.processors):
            here = self.open & ~self.tasks.alone & (self.tasks.cycles > 0)
            for user in np.flatnonzero(here & (self.tasks.site < 0) & (holder == d)):
                self._arrive(user, d, t_us)
            line = self.tasks.line(d, here)
            for user, pace in zip(line, paces(processor, len(line)), strict=True):
                self.pace[user] = pace
                self.server[user] = d if pace > 0 and running[d] else -1

    def _move(self) -> None:
        """Give rates to tasks that move from one processor to another."""
        for user in np.flatnonzero(self.open & (self.tasks.target >= 0)):
            target = int(self.tasks.target[user])
            ends = int(self.tasks.site[user]), target
            self.pace[user] = min(self.backhauls.part_bps(end) for end in ends)
            self.server[user] = target if self.pace[user] > 0 else -1

    def _restart(self, d: int, attached: np.ndarray) -> None:
        """Let stages begin anew that another one has sent a part of, if they must."""
        for user in np.flatnonzero(attached & (self.tasks.last >= 0) & (self.tasks.last != d)):
            request = self.request[user]
            assert request is not None
            if request.restarts and self.server[user] < 0:
                self.left[user] = self.volume_ubit[user]

    def bands(self, d: int) -> list[Band]:
        """The bands of a transmitter in Hz, that of uploads last, and whose stages are in them."""
        link = self.links[d]
        if link.uplink_hz is None:
            return [(link.bandwidth_hz, np.ones_like(self.up))]
        return [(link.bandwidth_hz, ~self.up), (link.uplink_hz, self.up)]

    def _suspend(self, d: int, band: Band) -> None:
        """Let the held requests that were admitted last wait until the others fit into a band."""
        here = (self.server == d) & (self.tasks.cycles == 0) & self.held(d) & band[1]
        served = [int(user) for user in np.flatnonzero(here)]
        served.sort(key=lambda user: (self.admitted_us[user], self.asked_us[user], user))
        while sum(self.need_hz(d, user) for user in served) > band[0]:
            self.server[served.pop()] = -1

    def _hold_all(self, t_us: int, d: int, attached: np.ndarray) -> list[Band]:
        """Admit whoever fits, and return what is left of each band, and who shares it."""
        held = attached & self.held(d)
        return [
            (self._hold(t_us, d, held, band), attached & ~held & band[1]) for band in self.bands(d)
        ]

    def _hold(self, t_us: int, d: int, held: np.ndarray, band: Band) -> float:
        """Admit whoever fits into a band, in order of request times and users.

        Return what is left of the band.
        """
        (free_hz, inside), served = band, held & (self.server == d)
        free_hz -= sum(self.need_hz(d, u) for u in np.flatnonzero(served & inside))
        waits = np.flatnonzero(held & inside & (self.server < 0))
        for user in sorted(waits.tolist(), key=lambda user: (self.asked_us[user], user)):
            need_hz, ends = self.need_hz(d, user), {d, self.relay(d, user)}
            free_bps = min(self.backhauls.free_bps(self, end) for end in ends)
            if need_hz <= free_hz and self.wanted_bps[user] <= free_bps:
                free_hz -= need_hz
                self.server[user] = d
                self.admitted_us[user] = t_us
                self.pace[user] = self.wanted_bps[user] if self.volume_ubit[user] else 1
        return free_hz

    def efficiency(self, d: int, user: int) -> int:
        return int(self.efficiencies[d][self.classes[d, user]])

    def need_hz(self, d: int, user: int) -> int:
        return hz_for(int(self.wanted_bps[user]), self.efficiency(d, user))

    def relay(self, d: int, user: int) -> int:
        """The transmitter over whose backhaul a result comes that is sent to a user, or ``d``."""
        site = int(self.tasks.site[user])
        return d if site < 0 else site

    def _divide(self, d: int, rest: list[Band]) -> None:
        """Share the rest of each band, and that of the backhaul, among transfers."""
        rates: dict[int, int] = {}
        for free_hz, elastic in rest:
            users = sorted(np.flatnonzero(elastic).tolist(), key=lambda u: (self.asked_us[u], u))
            if users:
                each = [self.efficiency(d, u) for u in users]
                shared = whole(self.links[d].sharing, int(free_hz), each)
                rates |= dict(zip(users, shared, strict=True))
        backhauls = self.backhauls
        for user in rates:
            site = self.relay(d, user)
            if site != d:
                rates[user] = min(rates[user], int(backhauls.part_bps(site)))
        total, free_bps = sum(rates.values()), max(backhauls.for_sharing_bps(d), 0)
        part = Fraction(int(free_bps), total) if total > free_bps else Fraction(1)
        for user, rate in rates.items():
            self.pace[user] = int(rate * part)
            self.server[user] = d if self.pace[user] > 0 else -1
        backhauls.store_bps[d] = max(free_bps - sum(int(self.pace[user]) for user in rates), 0)
