"""What an event log adds up to, read row by row."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from operator import itemgetter
from typing import NamedTuple

from desim_uav.engine.base import EpisodeLog, Event
from desim_uav.model.rules import Outcome, Phase
from desim_uav.sample_path import SamplePath
from desim_uav.world import World
from tests.engine.replay_links import check_links
from tests.engine.replay_stages import Part, parts_of


@dataclass
class Told:
    """A request as the events tell it."""

    user: int
    t_request_us: int
    served_us: int = 0
    attached_us: int = 0
    interruptions: int = 0
    t_first_us: int | None = None
    t_end_us: int = -1
    outcome: Outcome = Outcome.NEVER_SERVED


PHASES = {
    "complete": {Phase.COMPLETION},
    "exit": {Phase.EXIT, Phase.DEPLETION, Phase.RECORD, Phase.COVERAGE},
    "arrive": {Phase.ARRIVAL},
    "charged": {Phase.ARRIVAL, Phase.COMMAND},  # the latter where the battery was full
    "land": {Phase.ARRIVAL, Phase.COMMAND},
    "charge": {Phase.ARRIVAL, Phase.COMMAND},
    "enter": {Phase.ENTRY, Phase.COVERAGE},
    "request": {Phase.REQUEST},
    "stage": {Phase.COMPLETION, Phase.REQUEST},
    "deplete": {Phase.DEPLETION},
    "crash": {Phase.DEPLETION},
    "attach": {Phase.ATTACHMENT, Phase.COVERAGE},
    "detach": {Phase.EXIT, Phase.DEPLETION, Phase.RECORD, Phase.COVERAGE},
    "serve": {Phase.ATTACHMENT, Phase.ADMISSION},
    "refuse": {Phase.ATTACHMENT, Phase.ADMISSION},
    "stop": {Phase.COMPLETION, Phase.EXIT, Phase.DEPLETION, Phase.RECORD, Phase.COVERAGE},
    "close": {Phase.RECORD},
    "respawn": {Phase.RESPAWN},
    "decide": {Phase.COMMAND},
    "depart": {Phase.COMMAND, Phase.ARRIVAL},
    "blocked": {Phase.COMMAND, Phase.ARRIVAL},
    "conflict": {Phase.SEPARATION},
    "clear": {Phase.SEPARATION},
}
"""When things of a kind happen. An admission scan belongs to the attachment phase, or to 12."""

TAKING = {"enter": 1, "attach": 2, "serve": 3, "refuse": 3}
"""The order within a phase: these events come after all others, in the order of the numbers."""


def _as_read(event: Event) -> tuple[int, int, int]:
    """A log has drone after drone; a reader takes a phase's rows by what they do."""
    t_us, phase, kind, *_ = event
    return t_us, phase, TAKING.get(kind, 0)


def check_log(world: World, log: EpisodeLog, path: SamplePath | None = None) -> None:
    """Replay an episode from its events alone, in a reader's order.

    Every enter has its exit, attach its detach, serve its stop, and request its one complete,
    refuse or close; requests and totals are what they add up to. Where links have classes or
    requests ask for volumes, ``replay_links`` reads the events. Where services have several stages,
    the sample ``path`` says which. Tasks at processors, and updates of sensors, are not replayed:
    the audit checks them.
    """
    assert log.events is not None
    keys = [(t_us, phase, drone, user) for t_us, phase, _, drone, user, *_ in log.events]
    assert keys == sorted(keys)
    if world.services.has_tasks or world.senses:
        return
    if world.graded or any(world.services.has_volumes):
        check_links(world, log, path)
        return
    parts = parts_of(world, log, path)
    replay = Replay(world, parts)
    for (t_us, phase), rows in groupby(sorted(log.events, key=_as_read), key=itemgetter(0, 1)):
        assert 0 <= t_us <= log.duration_us
        assert phase != Phase.RECORD or t_us == log.duration_us, "let go of before the end"
        concerned = set()
        for row in rows:
            assert phase in PHASES[row[2]], f"{row[2]} in phase {phase}"
            replay.apply(row)
            concerned.add(row[4])
        for user in concerned - {-1}:
            replay.check_held(user, settled=phase in (Phase.ATTACHMENT, Phase.COVERAGE))
    replay.check_over()

    assert log.attached_us == replay.attached_us
    assert log.bandwidth_us_hz == replay.bandwidth_us
    assert len(log.requests) == len(replay.told)
    for number, request in enumerate(log.requests):
        was, spells = replay.told[number], replay.spells[number]
        was.served_us = sum(stop - start for _, start, stop in spells)
        if was.outcome is not Outcome.COMPLETED:
            was.outcome = Outcome.UNFINISHED if spells else Outcome.NEVER_SERVED
        was.t_first_us = spells[0][1] if spells else None
        was.interruptions = sum(a[2] < b[1] for a, b in pairwise(spells))
        if was.outcome is Outcome.UNFINISHED:
            was.interruptions += spells[-1][2] < was.t_end_us
        drones = [drone for drone, *_ in spells]
        assert request.request_id == number
        assert request.drones == [d for k, d in enumerate(drones) if k == 0 or drones[k - 1] != d]
        assert was == Told(
            request.user,
            request.t_request_us,
            request.served_us,
            request.attached_us,
            request.interruptions,
            request.t_first_us,
            request.t_end_us,
            request.outcome,
        )
        open_us = request.t_end_us - request.t_request_us
        assert request.served_us <= request.attached_us <= open_us
        assert request.served_us <= sum(part.amount for part in parts[number])
        assert request.served_us == request.done + sum(
            part.amount for part in parts[number][: request.stage]
        )
        assert request.required == parts[number][request.stage].amount
        assert (request.done == request.required) == (was.outcome is Outcome.COMPLETED)


class Counts(NamedTuple):
    """What there is at a decision epoch; by drone (and service), ``open_requests`` by service."""

    attached: list[int]
    served: list[list[int]]
    asking: list[list[int]]
    open_requests: list[int]


def counts(world: World, log: EpisodeLog) -> Iterator[Counts]:
    """Counted from the events alone at each decision epoch, before its record and commands."""
    assert log.events is not None
    services, drones = range(len(world.services.names)), range(world.scenario.drone_count)
    of = {request.request_id: request.service for request in log.requests}
    replay = Replay(world, parts_of(world, log, None))
    rows = sorted(log.events, key=_as_read)
    done = 0
    for epoch_us in range(0, log.duration_us + 1, world.step_us):
        while done < len(rows) and rows[done][:2] < (epoch_us, Phase.RECORD):
            replay.apply(rows[done])
            done += 1
        holders = [held[0] for held in replay.attached if held is not None]
        served = [(drone, of[request]) for request, (drone, _) in replay.running.items()]
        asking = [
            (drone, of[request])
            for user, request in replay.open_of.items()
            for drone in replay.covering[user]
        ]
        opened = [of[request] for request in replay.open_of.values()]
        yield Counts(
            [holders.count(drone) for drone in drones],
            [[served.count((drone, service)) for service in services] for drone in drones],
            [[asking.count((drone, service)) for service in services] for drone in drones],
            [opened.count(service) for service in services],
        )


class Replay:
    """Who is covered, attached and served, as the rows of a log tell it one by one."""

    def __init__(self, world: World, parts: Sequence[Sequence[Part]]) -> None:
        users = len(world.homes)
        self.limits_bps = [world.links[number].bandwidth_hz for number in world.type_numbers]
        self.parts = parts
        self.bandwidth_bps = [own[0].bps for own in parts]
        self.covering: list[set[int]] = [set() for _ in range(users)]
        self.attached: list[tuple[int, int] | None] = [None] * users
        self.open_of: dict[int, int] = {}
        self.told: dict[int, Told] = {}
        self.running: dict[int, tuple[int, int]] = {}
        self.spells: defaultdict[int, list[tuple[int, int, int]]] = defaultdict(list)
        self.in_use_bps = [0] * world.scenario.drone_count
        self.attached_us = self.bandwidth_us = 0

    def apply(self, row: Event) -> None:
        """Apply one row; kinds that are of no user change nothing."""
        t_us, phase, kind, drone, user, request_id, *_ = row
        if kind == "request":
            assert request_id == len(self.told), "requests are numbered as they open"
            assert user not in self.open_of, "a second open request"
            self.told[request_id], self.open_of[user] = Told(user, t_us), request_id
        elif kind == "enter":
            assert drone not in self.covering[user], "entered twice"
            self.covering[user].add(drone)
        elif kind == "exit":
            assert drone in self.covering[user], "an exit without an entry"
            self.covering[user].remove(drone)
        elif kind == "attach":
            assert self.attached[user] is None and drone in self.covering[user]
            self.attached[user] = (drone, t_us)
        elif kind == "detach":
            self._detach(t_us, drone, user)
        elif kind == "serve":
            assert self._holder(user) == drone and self.open_of[user] == request_id
            assert request_id not in self.running, "served twice"
            self.running[request_id] = (drone, t_us)
            self.in_use_bps[drone] += self.bandwidth_bps[request_id]
            assert self.in_use_bps[drone] <= self.limits_bps[drone]
        elif kind == "stop":
            assert self._holder(user) == drone and self.open_of[user] == request_id
            left = phase not in (Phase.COMPLETION, Phase.RECORD)
            assert (drone not in self.covering[user]) == left, "the exit comes before the stop"
            self._stop(t_us, drone, request_id)
        elif kind == "stage":
            assert request_id not in self.running, "the stop comes before the next stage"
            self.bandwidth_bps[request_id] = self.parts[request_id][row[-1]].bps
        elif kind in ("complete", "refuse", "close"):
            assert self._holder(user) == drone
            self._close(t_us, kind, user, request_id)

    def _holder(self, user: int) -> int:
        held = self.attached[user]
        return -1 if held is None else held[0]

    def _detach(self, t_us: int, drone: int, user: int) -> None:
        held = self.attached[user]
        assert held is not None and held[0] == drone
        assert drone not in self.covering[user], "the exit comes before the detach"
        assert self.open_of.get(user) not in self.running, "the stop comes before the detach"
        self.attached_us += t_us - held[1]
        if user in self.open_of:
            self._count_attached(t_us, user)
        self.attached[user] = None

    def _stop(self, t_us: int, drone: int, request_id: int) -> None:
        by, since_us = self.running.pop(request_id)
        assert by == drone
        self.in_use_bps[drone] -= self.bandwidth_bps[request_id]
        self.bandwidth_us += self.bandwidth_bps[request_id] * (t_us - since_us)
        if t_us > since_us:
            self.spells[request_id].append((drone, since_us, t_us))

    def _close(self, t_us: int, kind: str, user: int, request_id: int) -> None:
        assert request_id not in self.running, "the stop comes before the close"
        if self.attached[user] is not None:
            self._count_attached(t_us, user)
        assert self.open_of.pop(user) == request_id
        self.told[request_id].t_end_us = t_us
        if kind == "complete":
            self.told[request_id].outcome = Outcome.COMPLETED

    def _count_attached(self, now_us: int, user: int) -> None:
        held, request = self.attached[user], self.told[self.open_of[user]]
        assert held is not None
        request.attached_us += now_us - max(held[1], request.t_request_us)

    def check_held(self, user: int, settled: bool) -> None:
        """After a phase a user is held from where it is covered, and once settled it is held."""
        holder = self._holder(user)
        assert holder in {-1, *self.covering[user]}, "an attachment outlives its coverage"
        assert not settled or holder >= 0 or not self.covering[user], "covered, held by nobody"

    def check_over(self) -> None:
        """After the episode nothing is left of it."""
        assert not any(self.covering), "an entry without an exit"
        assert not any(self.attached), "an attachment without a detachment"
        assert not self.running, "a service without a stop"
        assert not self.open_of, "a request without an end"
        assert not any(self.in_use_bps)
