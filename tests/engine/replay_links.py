"""What an event log of radio links adds up to, in whole numbers, read instant by instant.

The log says which class each link has, whom users are attached to, and whose request is served.
Everything else follows, and is held against what the engine has logged: the bandwidth that each
request occupies, the rates of those that share the rest, what is delivered, and when it is done.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import groupby
from operator import itemgetter
from typing import Any

from desim_uav.engine.base import ClosedRequest, EpisodeLog, Event
from desim_uav.model.rules import Outcome
from desim_uav.sample_path import SamplePath
from desim_uav.world import World
from tests.engine.replay_stages import Part, parts_of
from tests.reference.shares import hz_for, whole

PING_PONG_US = 1_000_000
"""A user who is back with a drone within this time of the handover makes a ping-pong."""


@dataclass(frozen=True)
class Band:
    """The bandwidth of a drone or an access point, how it is shared, and the backhaul behind it.

    Uploads may have a band of their own: ``hz`` is by whether it is theirs.
    """

    hz: Mapping[bool, float]
    efficiencies: Sequence[int]
    sharing: str
    backhaul_bps: float

    @classmethod
    def of(cls, radio: Any, disc_kbps: float | None, backhaul: Any) -> Band:
        """The band of a radio; ``disc_kbps`` is the bandwidth of a disc."""
        name = type(radio.sharing).__name__
        kind = "".join("_" * (c.isupper() and k > 0) + c.lower() for k, c in enumerate(name))
        capacity_bps = math.inf if backhaul is None else backhaul.capacity_bps
        efficiencies = (0, *radio.efficiencies())
        hz = {False: radio.bandwidth_hz(disc_kbps)}
        if getattr(radio, "uplink_mhz", None) is not None:
            hz[True] = round(radio.uplink_mhz * 1e6)
        return cls(hz, efficiencies, kind, capacity_bps)

    def is_up(self, work: Work) -> bool:
        """Whether a request is served in a band for uploads."""
        return work.part.up and True in self.hz


@dataclass
class Link:
    """A user as the events tell it: its classes by drone, its holder and its open request.

    It left drone ``left`` at ``left_us``, and was handed over from ``came_from`` at ``came_us``.
    ``out``: the request during which it had no link last.
    """

    classes: Counter[int] = field(default_factory=Counter)
    holder: int = -1
    request: int = -1
    left: int = -1
    left_us: int = -1
    came_from: int = -1
    came_us: int = -1
    out: int = -1


@dataclass
class Work:
    """A request as the events tell it."""

    logged: ClosedRequest
    parts: Sequence[Part]
    stage: int = 0
    server: int = -1
    since_us: int = 0
    rate: int = 0
    hz: int = 0
    done: int = 0
    served_us: int = 0
    ended: bool = False

    @property
    def part(self) -> Part:
        """The present stage."""
        return self.parts[self.stage]


class LinkReplay:
    """Who is served, at which rate, after each instant of an episode."""

    def __init__(self, world: World, log: EpisodeLog, path: SamplePath | None) -> None:
        points = world.scenario.access_points
        self.bands = [
            Band.of(drones.radio, drones.bandwidth_kbps, drones.backhaul)
            for drones in world.scenario.fleet
            for _ in range(drones.count)
        ]
        self.bands += [Band.of(point.radio, None, point.backhaul) for point in points]
        self.users = [Link() for _ in world.homes]
        parts = parts_of(world, log, path)
        self.work = [Work(*each) for each in zip(log.requests, parts, strict=True)]
        self.log, self.step_us, self.now_us = log, world.step_us, 0
        self.attached_us = self.bandwidth_us_hz = self.outage_us = 0
        self.handovers = self.ping_pongs = self.outages = 0

    def check(self) -> None:
        """Replay the episode."""
        assert self.log.events is not None
        for t_us, rows in groupby(self.log.events, key=itemgetter(0)):
            self._elapse(t_us)
            before = [(work.server, work.since_us) for work in self.work]
            events = list(rows)
            for _, phase in groupby(events, key=itemgetter(1)):
                self._apply(t_us, list(phase))
            self._share(t_us)
            if t_us < self.log.duration_us:
                self._check_holds(t_us, before, events)
        self._elapse(self.log.duration_us)
        self._check_totals()

    def _elapse(self, t_us: int) -> None:
        """Serve until an instant."""
        elapsed_us, self.now_us = t_us - self.now_us, t_us
        if elapsed_us == 0:
            return
        for user in self.users:
            self.attached_us += elapsed_us * (user.holder >= 0)
            out = user.request if not any(user.classes.values()) else -1
            self.outage_us += elapsed_us * (out >= 0)
            self.outages += out not in (-1, user.out)
            user.out = out
        for work in self.work:
            if work.server >= 0:
                work.served_us += elapsed_us
                work.done += elapsed_us * work.rate
                self.bandwidth_us_hz += elapsed_us * work.hz

    def _apply(self, t_us: int, rows: list[Event]) -> None:
        """Apply the rows of a phase. Their order says nothing, but who comes where does."""
        holders, servers = Counter[tuple[int, int]](), Counter[tuple[int, int]]()
        for _, _, kind, drone, user, request, _, *link_class in rows:
            if kind == "request":
                assert self.users[user].request < 0
                self.users[user].request = request
            elif kind in ("enter", "exit", "class"):
                self._grade(kind, drone, self.users[user], link_class[0])
            elif kind in ("attach", "detach"):
                holders[user, drone] += 1 if kind == "attach" else -1
            elif kind in ("serve", "stop"):
                servers[request, drone] += 1 if kind == "serve" else -1
        for (user, drone), change in sorted(holders.items(), key=itemgetter(1)):
            self._attach(t_us, drone, self.users[user], change)
        for (request, drone), change in sorted(servers.items(), key=itemgetter(1)):
            self._serve(t_us, drone, self.work[request], change)
        for _, _, kind, drone, user, request, *_, stage in rows:
            if kind == "stage":
                _begin_stage(self.work[request], stage, drone)
            if kind in ("complete", "refuse", "close"):
                self._close(t_us, kind, self.users[user], self.work[request])

    def _grade(self, kind: str, drone: int, user: Link, link_class: int) -> None:
        """Let a link pass to a class."""
        before = user.classes[drone]
        assert link_class != before, "a class that is no other"
        assert (before == 0, link_class == 0) == (kind == "enter", kind == "exit")
        user.classes[drone] = link_class

    def _attach(self, t_us: int, drone: int, user: Link, change: int) -> None:
        """Attach a user to a drone, or detach it."""
        if change < 0:
            assert user.holder == drone
            user.holder, user.left, user.left_us = -1, drone, t_us
        elif change > 0:
            assert user.holder == -1, "attached twice"
            user.holder = drone
            if user.left_us == t_us and user.left != drone:
                self.handovers += 1
                back = user.came_from == drone and t_us - user.came_us <= PING_PONG_US
                self.ping_pongs += back
                user.came_from, user.came_us = user.left, t_us

    def _serve(self, t_us: int, drone: int, work: Work, change: int) -> None:
        """Serve a request by a drone, or no longer."""
        if change < 0:
            assert work.server == drone
            work.server = -1
        elif change > 0:
            assert work.server == -1, "served twice"
            work.server, work.since_us = drone, t_us
        elif work.server == drone:  # it has been stopped and admitted again
            work.since_us = t_us

    def _close(self, t_us: int, kind: str, user: Link, work: Work) -> None:
        """Close a request: it is complete once all is done, and not a microsecond earlier."""
        logged = work.logged
        assert work.server == -1 and not work.ended, "the stop comes before the close"
        assert (logged.outcome is Outcome.COMPLETED) == (kind == "complete")
        assert (logged.request_id, logged.t_end_us) == (user.request, t_us)
        if kind == "complete":
            assert work.done >= logged.required > work.done - work.rate, "not in this microsecond"
            assert not any(part.amount for part in work.parts[work.stage + 1 :]), "stages are left"
        assert logged.required == work.part.amount
        assert logged.done == min(work.done, logged.required), "what was delivered adds up"
        assert logged.served_us == work.served_us
        passed = work.parts[: work.stage]
        if all(part.timed for part in (*passed, work.part)):
            assert work.served_us == logged.done + sum(part.amount for part in passed)
        user.request, work.ended = -1, True

    def _share(self, t_us: int) -> None:
        """Compute what each served request occupies, and the rates at which it is served."""
        for d, band in enumerate(self.bands):
            held, elastic = self._at(d)
            free_hz, free_bps = dict(band.hz), band.backhaul_bps
            for user, work in held:
                if work.server == d:
                    work.hz = self._needed_hz(d, user, work)
                    work.rate = 1 if work.part.timed else work.part.bps
                    free_hz[band.is_up(work)] -= work.hz
                    free_bps -= work.part.bps
            assert min(free_hz.values()) >= 0, f"drone {d} holds more than its bandwidth at {t_us}"
            assert free_bps >= 0, f"drone {d} holds more than its backhaul at {t_us}"
            elastic.sort(key=lambda pair: (pair[1].logged.t_request_us, pair[1].logged.user))
            proposals = [
                one for up, hz in free_hz.items() for one in self._proposals(d, up, hz, elastic)
            ]
            part, total_bps = Fraction(1), sum(rate for _, rate, _ in proposals)
            if total_bps > free_bps:
                part = Fraction(int(free_bps), total_bps)
            for work, rate, proposed_hz in proposals:
                work.rate = int(rate * part)
                assert (work.server == d) == (work.rate > 0), f"{work.rate} bit/s at {t_us}"
                work.hz = int(proposed_hz * part)

    def _proposals(
        self, d: int, up: bool, free_hz: float, elastic: list[tuple[Link, Work]]
    ) -> list[tuple[Work, int, int]]:
        """The rate and bandwidth of each elastic request of a band, but for the backhaul."""
        band = self.bands[d]
        mine = [(user, work) for user, work in elastic if band.is_up(work) == up]
        if not mine:
            return []
        efficiencies = [band.efficiencies[user.classes[d]] for user, _ in mine]
        rates = whole(band.sharing, int(free_hz), efficiencies)
        each_hz = int(free_hz) // len(mine)
        proposed_hz = {
            "equal": [each_hz] * len(mine),
            "proportional_fair": [each_hz] * len(mine),
            "max_min": list(map(hz_for, rates, efficiencies)),
            "max_rate": [int(free_hz)] * len(mine),
        }[band.sharing]
        return [(work, *own) for (_, work), *own in zip(mine, rates, proposed_hz, strict=True)]

    def _at(self, d: int) -> tuple[list[tuple[Link, Work]], list[tuple[Link, Work]]]:
        """The open requests of those attached to a drone, held and elastic ones."""
        held, elastic = [], []
        for user in self.users:
            work = self.work[user.request] if user.request >= 0 else None
            if work is not None and (user.holder < 0 or user.holder != work.server):
                assert work.server < 0, "served by another drone than its own"
            if work is not None and user.holder == d:
                assert user.classes[d] > 0, "attached in class 0"
                (elastic if work.part.shares else held).append((user, work))
        return held, elastic

    def _needed_hz(self, d: int, user: Link, work: Work) -> int:
        return hz_for(work.part.bps, self.bands[d].efficiencies[user.classes[d]])

    def _check_holds(self, t_us: int, before: list[tuple[int, int]], events: list[Event]) -> None:
        """Nobody who fits waits, and who waits again was admitted after those who go on."""
        stopped = {event[5] for event in events if event[2] == "stop"}
        passed = {event[5] for event in events if event[2] == "stage"}  # whose stage ended
        for d, band in enumerate(self.bands):
            held, _ = self._at(d)
            served = [work for _, work in held if work.server == d]
            held_hz = Counter[bool]()
            for work in served:
                held_hz[band.is_up(work)] += work.hz
            held_bps = sum(work.part.bps for work in served)
            for user, work in held:
                up = band.is_up(work)
                in_band = self._needed_hz(d, user, work) <= band.hz[up] - held_hz[up]
                fits = in_band and work.part.bps <= band.backhaul_bps - held_bps
                assert work.server == d or not fits, "it would fit"
            for up in band.hz:
                admitted = {
                    (before[user.request][1], work.logged.t_request_us, work.logged.user): (
                        user.request in stopped
                    )
                    for user, work in held
                    if before[user.request][0] == d and user.request not in passed
                    if band.is_up(work) == up
                }
                suspended = [place for place, stops in admitted.items() if stops]
                kept = [place for place, stops in admitted.items() if not stops]
                if suspended and kept:
                    assert max(kept) < min(suspended), f"not the last admitted waits at {t_us}"

    def _check_totals(self) -> None:
        """Compare the sums of the episode."""
        log = self.log
        assert all(work.ended for work in self.work), "a request without an end"
        assert all(user.holder < 0 for user in self.users), "an attachment without an end"
        assert not any(any(user.classes.values()) for user in self.users)
        assert log.attached_us == self.attached_us
        assert log.bandwidth_us_hz == self.bandwidth_us_hz
        if log.links is not None:
            counted = (self.handovers, self.ping_pongs, self.outages, self.outage_us)
            assert counted == tuple(log.links)
            begins, ends = (
                [event[0] for event in log.events or () if event[2] == kind]
                for kind in ("outage", "outage_end")
            )
            assert len(begins) == len(ends) == self.outages
            assert sum(ends) - sum(begins) == self.outage_us


def _begin_stage(work: Work, stage: int, drone: int) -> None:
    """Pass a request on to a stage: the one before is done, and those between are nothing."""
    assert work.server == -1 and not work.ended, "the stop comes before the next stage"
    if drone >= 0:
        amount = work.part.amount
        assert work.done >= amount > work.done - work.rate, "not in this microsecond"
    passed = work.parts[work.stage + (drone >= 0) : stage]
    assert not any(part.amount for part in passed), "a stage is left out"
    work.stage, work.done = stage, 0


def check_links(world: World, log: EpisodeLog, path: SamplePath | None = None) -> None:
    """Replay an episode from its events alone, and hold it against what was logged."""
    LinkReplay(world, log, path).check()
