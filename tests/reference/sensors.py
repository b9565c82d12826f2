"""Sensors at each tick: the updates in their buffers, what drones carry, and ages."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np

from tests.reference.inputs import Inputs, Request, Result


@dataclass
class Sensor:
    """A buffer of updates, each with the time at which it was taken, and an age.

    ``fresh_us``: when the freshest update that has been delivered was taken. The age has been
    integrated to ``area_us2`` until ``since_us``.
    """

    buffer: list[tuple[int, Request]] = field(default_factory=list)
    fresh_us: int = 0
    since_us: int = 0
    area_us2: float = 0.0

    def fall(self, t_us: int, taken_us: int) -> None:
        """Deliver an update; an older one than before changes nothing."""
        sides_us = (self.since_us - self.fresh_us) + (t_us - self.fresh_us)
        self.area_us2 += (t_us - self.since_us) * sides_us / 2
        self.since_us = t_us
        self.fresh_us = max(self.fresh_us, taken_us)


class Sensors:
    """All sensors. ``carried``: of each transmitter, its updates as user, time taken, and volume.

    ``sent_ubit``: how much of the first of them its backhaul has brought to the ground.
    ``promised``: the transmitter that keeps room for the update which each user sends.
    """

    def __init__(self, inputs: Inputs, result: Result) -> None:
        self.inputs, self.result = inputs, result
        rules = inputs.sensors or [None] * len(inputs.legs)
        self.rules = list(rules)
        self.of = {user: Sensor() for user, rule in enumerate(rules) if rule is not None}
        self.drones = len(inputs.starts)
        links = [*inputs.links, *(point.link for point in inputs.access_points)]
        self.over_backhaul = [link.backhaul_bps < inf for link in links]
        self.carried: list[list[tuple[int, int, int]]] = [[] for _ in links]
        self.sent_ubit = [0] * len(links)
        self.promised: dict[int, int] = {}

    def surplus(self, user: int, begun: bool) -> list[int]:
        """Which updates of a buffer have to go, one after the other, as a new one has come last."""
        rule, count, gone = self.rules[user], len(self.of[user].buffer), list[int]()
        assert rule is not None
        buffer = self.of[user].buffer
        first = min(range(int(count > 1 and begun), count), key=lambda k: buffer[k][0])
        if rule.keeps == "last":
            first = 0 if rule.preempt else first
            gone = [first] * max(count - 1 - first, 0)
        elif rule.keeps == "oldest":
            first = count - 1
        if count - len(gone) > rule.buffer:
            gone.append(first)
        return gone

    def put_next_first(self, user: int) -> bool:
        """Put the update first that is sent next. Return whether it was not."""
        buffer, rule = self.of[user].buffer, self.rules[user]
        if rule is None or not rule.sends_last:
            return False
        last = max(range(len(buffer)), key=lambda k: buffer[k][0])
        buffer.insert(0, buffer.pop(last))
        return last > 0

    def rivals(self, user: int, holder: np.ndarray) -> list[int]:
        """Other sensors at the same transmitter whose updates a new one of a sensor replaces."""
        rules, own = self.rules, self.rules[user]
        if own is None or not own.preempts_all or holder[user] < 0:
            return []
        return [
            other
            for other, sensor in self.of.items()
            if other != user
            and holder[other] == holder[user]
            and getattr(rules[other], "preempts_all", False)
            and sensor.buffer
        ]

    def receive(self, user: int, t_us: int, server: int) -> None:
        """Take an update out of the buffer, of which the last bit has come."""
        taken_us, request = self.of[user].buffer.pop(0)
        self.promised.pop(user, None)
        if self._is_carried(user, server):
            self.carried[server].append((user, taken_us, request.volume_ubit))
        else:
            self._deliver(user, t_us, taken_us)

    def unload(self, d: int, t_us: int) -> bool:
        """Deliver all that a drone carries, as it has landed. Return whether there was anything."""
        there, self.carried[d], self.sent_ubit[d] = self.carried[d], [], 0
        for user, taken_us, _ in there:
            self._deliver(user, t_us, taken_us)
        return bool(there)

    def crash(self, d: int) -> None:
        """Lose all that a drone carries."""
        self.result.lost += len(self.carried[d])
        self.carried[d], self.sent_ubit[d] = [], 0

    def send_stored(self, rates_bps: list[float], dt_us: int) -> None:
        """Send what is carried over backhauls for a tick, one update after the other."""
        for d, there in enumerate(self.carried):
            if there and self.over_backhaul[d]:
                self.sent_ubit[d] += int(rates_bps[d]) * dt_us

    def deliver_sent(self, t_us: int) -> bool:
        """Deliver what backhauls have brought to the ground. Return whether there was anything."""
        delivered = len(self.result.delivered)
        for d, there in enumerate(self.carried):
            while there and self.sent_ubit[d] >= there[0][2]:
                user, taken_us, volume = there.pop(0)
                self.sent_ubit[d] = self.sent_ubit[d] - volume if there else 0
                self._deliver(user, t_us, taken_us)
        return len(self.result.delivered) > delivered

    def keep_room(self, holder: np.ndarray, asked: list[tuple[int, int]]) -> None:
        """Offer room in stores to users with an open request (``asked``: when, who)."""
        for _, user in sorted(asked):
            self.ask_room(user, holder)

    def ask_room(self, user: int, holder: np.ndarray) -> None:
        """Promise room in the store of a user's transmitter, if there is any.

        Whoever asks first has it, until it leaves the transmitter, or its update is replaced.
        """
        self.promised = {u: d for u, d in self.promised.items() if holder[u] == d}
        d = int(holder[user])
        if self._is_carried(user, d) and user not in self.promised:
            kept = sum(self._size(other) for other, at in self.promised.items() if at == d)
            stored = sum(size for *_, size in self.carried[d])
            most = self.inputs.store_ubit if d < self.drones else inf
            if stored + kept + self._size(user) <= most:
                self.promised[user] = d

    def has_room(self, user: int, d: int) -> bool:
        """Whether a user's update may be sent to a transmitter."""
        return not self._is_carried(user, d) or self.promised.get(user) == d

    def end(self, horizon_us: int) -> None:
        """Integrate ages until the end."""
        for sensor in self.of.values():
            sensor.fall(horizon_us, 0)
            self.result.ages_us.append(sensor.area_us2 / horizon_us)

    def _size(self, user: int) -> int:
        return self.of[user].buffer[0][1].volume_ubit

    def _is_carried(self, user: int, d: int) -> bool:
        rule = self.rules[user]
        stores = 0 <= d < self.drones or (d >= 0 and self.over_backhaul[d])
        return rule is not None and rule.at_ground and stores

    def _deliver(self, user: int, t_us: int, taken_us: int) -> None:
        self.of[user].fall(t_us, taken_us)
        self.result.delivered.append((user, taken_us, t_us))
