"""Requests of users at each tick: what is open, who is admitted, and at which rate it is served."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from tests.reference.inputs import NEVER, Closed, Inputs, Request, Result
from tests.reference.shares import hz_for, whole


def _amount(stage: Request) -> int:
    """What a stage asks for."""
    return stage.volume_ubit or stage.required_us


class Services:
    """The requests of all users, of which each has one open at most.

    ``server``: the transmitter that serves a user, -1 for none. ``left``: what is still to serve,
    in 1e-6 bit of a transfer and in microseconds of a hold. ``pace``: how much of it is served in a
    microsecond, which is the rate in bit/s of a transfer and 1 for a hold. A request is held if it
    occupies bandwidth for its own rate: a hold, or a transfer where bandwidth is held. The time
    served and what is required are those of the present stage; ``before`` has, for each user, the
    stages that have been done, and the time and the bits of them, and ``later`` those to come.
    """

    def __init__(self, inputs: Inputs, result: Result) -> None:
        self.inputs, self.result = inputs, result
        self.links = [*inputs.links, *(point.link for point in inputs.access_points)]
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
        self.asked_us = np.zeros(users, np.int64)
        self.admitted_us = np.zeros(users, np.int64)
        self.asked = np.zeros(users, int)
        self.before = np.zeros((users, 3), np.int64)
        self.stages = np.ones(users, int)
        self.later: list[list[Request]] = [[] for _ in range(users)]
        first = [own[0].due_us if own else NEVER for own in inputs.requests]
        self.due_us = np.array(first, np.int64)
        self.changed = True

    def elapse(self, dt_us: int) -> None:
        """Serve for a tick."""
        served = self.server >= 0
        self.served_us[served] += dt_us
        self.left -= np.where(served, self.pace * dt_us, 0)

    def complete(self, t_us: int) -> None:
        """Close what has been served in full, or pass it on to its next stage."""
        done = self.open & (self.left <= 0)
        if done.any():
            for user in np.flatnonzero(done):
                if any(_amount(stage) for stage in self.later[user]):
                    self._pass_on(user)
                else:
                    self.close(user, t_us, True)

    def _pass_on(self, user: int) -> None:
        """Begin the next stage that is of anything."""
        self.before[user] += (1, *self._done(user))
        self._begin(user)

    def _begin(self, user: int) -> None:
        """Begin the first of the stages to come, or the next that is of anything."""
        stage = self.later[user].pop(0)
        while _amount(stage) == 0:
            self.before[user, 0] += 1
            stage = self.later[user].pop(0)
        self.server[user] = -1
        self.served_us[user] = 0
        self.required_us[user] = stage.required_us
        self.volume_ubit[user] = stage.volume_ubit
        self.left[user] = _amount(stage)
        self.wanted_bps[user] = stage.bandwidth_bps
        self.changed = True

    def _done(self, user: int) -> tuple[int, int]:
        """The time and the bits that have been served of the present stage, less what is beyond."""
        served, volume = int(self.served_us[user]), int(self.volume_ubit[user])
        if volume:
            return served, volume - max(int(self.left[user]), 0)
        return min(served, int(self.required_us[user])), 0

    def close(self, user: int, t_us: int, completed: bool) -> None:
        """Log a request, and let the user ask again if its demand waits for that."""
        served, delivered = self._done(user)
        volume = int(self.volume_ubit[user])
        passed, served_before, delivered_before = self.before[user].tolist()
        if completed:
            passed += len(self.later[user])
        closed = Closed(
            user,
            served_before + served,
            delivered_before + delivered,
            delivered / volume if volume else served / int(self.required_us[user]),
            passed,
            int(self.stages[user]),
            int(self.asked_us[user]),
            t_us,
            completed,
        )
        self.result.requests.append(closed)
        self.open[user] = False
        self.server[user] = -1
        self.changed = True
        own = self.inputs.requests[user]
        if self.inputs.follows[user] and self.asked[user] < len(own):
            self.due_us[user] = t_us + own[self.asked[user]].due_us

    def ask(self, t_us: int) -> None:
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
                if not self.inputs.follows[user] and self.asked[user] < len(own):
                    self.due_us[user] = own[self.asked[user]].due_us
                if self.open[user]:
                    self.result.suppressed += 1
                    continue
                self.open[user] = True
                self.asked_us[user] = t_us
                self.before[user] = 0
                self.later[user] = [request, *request.then]
                self.stages[user] = len(self.later[user])
                self._begin(user)

    def allocate(self, t_us: int, holder: np.ndarray, classes: np.ndarray) -> None:
        """Let each transmitter serve those attached to it, if anything has changed."""
        if not self.changed:
            return
        self.changed = False
        for d, link in enumerate(self.links):
            efficiency = np.array(link.efficiencies)[classes[d]]
            self._suspend(d, efficiency)
            attached = self.open & (holder == d)
            elastic = attached & (self.volume_ubit > 0) & (link.sharing != "held")
            free_hz, free_bps = self._hold(t_us, d, attached & ~elastic, efficiency)
            self._share(d, elastic, (free_hz, free_bps), efficiency)

    def _suspend(self, d: int, efficiency: np.ndarray) -> None:
        """Let the held requests that were admitted last wait until the others fit."""
        served = [int(user) for user in np.flatnonzero(self.server == d) if self._is_held(user, d)]
        served.sort(key=lambda user: (self.admitted_us[user], self.asked_us[user], user))
        while sum(self._need_hz(user, efficiency) for user in served) > self.links[d].bandwidth_hz:
            self.server[served.pop()] = -1

    def _hold(
        self, t_us: int, d: int, held: np.ndarray, efficiency: np.ndarray
    ) -> tuple[float, float]:
        """Admit whoever fits, in order of request times and users.

        Return what is left of the band and of the backhaul.
        """
        served = np.flatnonzero(held & (self.server == d))
        free_hz = self.links[d].bandwidth_hz - sum(self._need_hz(u, efficiency) for u in served)
        free_bps = self.links[d].backhaul_bps - int(self.wanted_bps[served].sum())
        waits = np.flatnonzero(held & (self.server < 0))
        for user in sorted(waits.tolist(), key=lambda user: (self.asked_us[user], user)):
            need_hz = self._need_hz(user, efficiency)
            if need_hz <= free_hz and self.wanted_bps[user] <= free_bps:
                free_hz -= need_hz
                free_bps -= int(self.wanted_bps[user])
                self.server[user] = d
                self.admitted_us[user] = t_us
                self.pace[user] = self.wanted_bps[user] if self.volume_ubit[user] else 1
        return free_hz, free_bps

    def _is_held(self, user: int, d: int) -> bool:
        return self.volume_ubit[user] == 0 or self.links[d].sharing == "held"

    def _need_hz(self, user: int, efficiency: np.ndarray) -> int:
        return hz_for(int(self.wanted_bps[user]), int(efficiency[user]))

    def _share(
        self, d: int, elastic: np.ndarray, free: tuple[float, float], efficiency: np.ndarray
    ) -> None:
        """Share the rest of the bandwidth and of the backhaul among transfers."""
        free_hz, free_bps = free
        users = sorted(np.flatnonzero(elastic).tolist(), key=lambda u: (self.asked_us[u], u))
        if not users:
            return
        rates = whole(self.links[d].sharing, int(free_hz), [int(efficiency[u]) for u in users])
        part = Fraction(1)
        if sum(rates) > free_bps:
            part = Fraction(int(free_bps), sum(rates))
        for user, rate in zip(users, rates, strict=True):
            rate_bps = int(rate * part)
            self.pace[user] = rate_bps
            self.server[user] = d if rate_bps > 0 else -1
