"""Requests of users at each tick: what is open, who is admitted, and at which rate it is served.

Backhauls do not bring results of tasks to others than the transmitter that has computed them.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from tests.reference.inputs import NEVER, Closed, Inputs, Request, Result
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

    def _own(self) -> np.ndarray:
        """Whose own processors compute now."""
        own: np.ndarray = self.open & (self.tasks.own_left > 0)
        return own

    def complete(self, t_us: int) -> None:
        """Close what has been served in full, or pass it on to its next stage."""
        tasks = self.tasks
        for user in np.flatnonzero(self.open & (self.left <= 0) & ~tasks.alone):
            if any(stage.amount for stage in self.later[user]):
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
        self.tasks.site[user], self.tasks.arrived_us[user] = server, t_us
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
        tasks.site[user] = -1
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
        """The share of the present stage that has been done."""
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
        part = self._part(user, request)
        if part < 1.0:
            tasks.begin_own(user, request, part)
            self._begin_anew(user)
            self.changed = True

    def _part(self, user: int, request: Request) -> float:
        """Return the part of a task that is offloaded."""
        kind = self.inputs.offloading
        if kind in ("always", "never"):
            return float(kind == "always")
        own_us = cycles_of(request) / int(self.tasks.clocks[user])
        offloaded_us = self._offloaded_us(user, request)
        if kind == "split":
            return own_us / (own_us + offloaded_us)
        return float(offloaded_us < own_us)

    def _offloaded_us(self, user: int, request: Request) -> float:
        """How long all of a task would take if it were offloaded, as far as is known now."""
        d = int(self.holder[user])
        if d < 0:
            return np.inf
        link, at_link, total = self.links[d], self._at_links(d), 0.0
        at_link[user] = False
        held, bps_of = self._held(d), []
        for band_hz, inside in self._bands(d):
            served = np.flatnonzero(at_link & (self.server == d) & held & inside)
            free_hz = int(band_hz) - sum(self._need_hz(d, u) for u in served)
            sharers = int((at_link & ~held & inside).sum()) + 1
            bps_of.append(free_hz // sharers * self._efficiency(d, user) // 1_000_000)
        for stage in (request, *request.then):
            if stage.cycles:
                there = self.open & ~self.tasks.alone & (self.tasks.cycles > 0)
                total += stage.cycles / self.inputs.processors[d].clock
                total += self.tasks.backlog_us(d, there, self.left)
            elif stage.amount:
                rate = bps_of[-1] if stage.up else bps_of[0]
                bps = stage.bandwidth_bps if link.sharing == "held" else rate
                if bps == 0:
                    return np.inf
                total += stage.amount / bps
        return total

    def attach(self, user: int, holder: np.ndarray) -> None:
        """Note that a user has another holder; what has not begun is decided anew."""
        self.holder = holder
        self.changed = True
        tasks = self.tasks
        if not tasks.cycles[user]:
            self.server[user] = -1
        untouched = tasks.last[user] < 0 and tasks.site[user] < 0 and tasks.own[user] == 0
        if self.open[user] and holder[user] >= 0 and untouched and user not in self.sensors.of:
            self._offload(user)

    def crash(self, d: int) -> None:
        """Lose the tasks that a drone has received, and what it carries."""
        self.sensors.crash(d)
        for user in np.flatnonzero(self.open & (self.tasks.site == d) & ~self.tasks.alone):
            self._begin_anew(user)
            self.result.restarts += 1
        self.changed = True

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

    def unload(self, d: int, t_us: int) -> None:
        """Deliver what a drone carries that has landed."""
        self.changed |= self.sensors.unload(d, t_us)

    # ---- who is served

    def _held(self, d: int) -> np.ndarray:
        """Whose present stages hold their rates at a transmitter."""
        held: np.ndarray = (self.volume_ubit == 0) | (self.links[d].sharing == "held")
        return held

    def _at_links(self, d: int) -> np.ndarray:
        """Whose requests are sent over links of a transmitter, or wait for that."""
        tasks = self.tasks
        at_link = self.open & (self.holder == d) & (tasks.cycles == 0) & ~tasks.alone
        at_link &= (tasks.site < 0) | (tasks.site == d)
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
        self.sensors.keep_room(holder.tolist(), asked)
        for d, link in enumerate(self.links):
            attached = self._at_links(d)
            self._restart(d, attached)
            bands = self._bands(d)
            for band in bands:
                self._suspend(d, band)
            held, rest = attached & self._held(d), []
            for band in bands:
                free_hz = self._hold(t_us, d, held, band)
                rest.append((free_hz, attached & ~held & band[1]))
            free_bps = link.backhaul_bps - int(self.wanted_bps[held & (self.server == d)].sum())
            self._divide(d, rest, free_bps)
        for d, processor in enumerate(self.inputs.processors):
            here = self.open & ~self.tasks.alone & (self.tasks.cycles > 0)
            for user in np.flatnonzero(here & (self.tasks.site < 0) & (holder == d)):
                self._arrive(user, d, t_us)
            line = self.tasks.line(d, here)
            for user, pace in zip(line, paces(processor, len(line)), strict=True):
                self.pace[user] = pace
                self.server[user] = d if pace > 0 and running[d] else -1

    def _restart(self, d: int, attached: np.ndarray) -> None:
        """Let stages begin anew that another one has sent a part of, if they must."""
        for user in np.flatnonzero(attached & (self.tasks.last >= 0) & (self.tasks.last != d)):
            request = self.request[user]
            assert request is not None
            if request.restarts and self.server[user] < 0:
                self.left[user] = self.volume_ubit[user]

    def _bands(self, d: int) -> list[Band]:
        """The bands of a transmitter in Hz, that of uploads last, and whose stages are in them."""
        link = self.links[d]
        if link.uplink_hz is None:
            return [(link.bandwidth_hz, np.ones_like(self.up))]
        return [(link.bandwidth_hz, ~self.up), (link.uplink_hz, self.up)]

    def _suspend(self, d: int, band: Band) -> None:
        """Let the held requests that were admitted last wait until the others fit into a band."""
        here = (self.server == d) & (self.tasks.cycles == 0) & self._held(d) & band[1]
        served = [int(user) for user in np.flatnonzero(here)]
        served.sort(key=lambda user: (self.admitted_us[user], self.asked_us[user], user))
        while sum(self._need_hz(d, user) for user in served) > band[0]:
            self.server[served.pop()] = -1

    def _hold(self, t_us: int, d: int, held: np.ndarray, band: Band) -> float:
        """Admit whoever fits into a band, in order of request times and users.

        Return what is left of the band.
        """
        (free_hz, inside), served = band, held & (self.server == d)
        free_hz -= sum(self._need_hz(d, u) for u in np.flatnonzero(served & inside))
        free_bps = self.links[d].backhaul_bps - int(self.wanted_bps[served].sum())
        waits = np.flatnonzero(held & inside & (self.server < 0))
        for user in sorted(waits.tolist(), key=lambda user: (self.asked_us[user], user)):
            need_hz = self._need_hz(d, user)
            if need_hz <= free_hz and self.wanted_bps[user] <= free_bps:
                free_hz -= need_hz
                free_bps -= int(self.wanted_bps[user])
                self.server[user] = d
                self.admitted_us[user] = t_us
                self.pace[user] = self.wanted_bps[user] if self.volume_ubit[user] else 1
        return free_hz

    def _efficiency(self, d: int, user: int) -> int:
        return int(self.efficiencies[d][self.classes[d, user]])

    def _need_hz(self, d: int, user: int) -> int:
        return hz_for(int(self.wanted_bps[user]), self._efficiency(d, user))

    def _divide(self, d: int, rest: list[Band], free_bps: float) -> None:
        """Share the rest of each band, and that of the backhaul, among transfers."""
        rates: dict[int, int] = {}
        for free_hz, elastic in rest:
            users = sorted(np.flatnonzero(elastic).tolist(), key=lambda u: (self.asked_us[u], u))
            if users:
                each = [self._efficiency(d, u) for u in users]
                shared = whole(self.links[d].sharing, int(free_hz), each)
                rates |= dict(zip(users, shared, strict=True))
        total = sum(rates.values())
        part = Fraction(int(free_bps), total) if total > free_bps else Fraction(1)
        for user, rate in rates.items():
            rate_bps = int(rate * part)
            self.pace[user] = rate_bps
            self.server[user] = d if rate_bps > 0 else -1
