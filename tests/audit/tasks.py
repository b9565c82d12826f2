"""Checks of tasks at processors: where they stand, at which rates they are computed, for how long.

What is done for requests is also integrated here, from the rates after each event.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from desim_uav.engine.base import ClosedRequest, EpisodeLog
from desim_uav.model.services import COMPUTING, MOVING, NOWHERE
from desim_uav.rules.processing import EarliestDeadline, FirstComeTasks, ProcessorSharing
from desim_uav.rules.rows import Drone, State, User
from desim_uav.rules.words import CRASHED

if TYPE_CHECKING:
    from desim_uav.engine.des import Simulation


@dataclass
class Work:
    """What has been done of a stage, which needs ``required``, in the units of its line."""

    required: int
    line: int
    timed: bool
    done: int = 0

    @property
    def counts(self) -> int:
        """What counts: the last microsecond may do more than is needed."""
        return min(self.done, self.required)


@dataclass
class TaskRecord:
    """What an audit has seen of an episode until ``now_us``; ``whole``: from its start.

    The open request of each user is known by its number, its stage (or the drone it moves to, see
    ``_part``), and how often it has begun anew, and is served at a rate. ``work`` is what has been
    done for requests, by their numbers and these parts; ``lines`` are the tasks at each processor,
    as their users and when they arrived. At a processor there were tasks for ``there_us``
    altogether; those that left had been there for ``visits_us``. The processors of the users
    ``own`` compute now. Somebody served each request for ``served_us``, and drones computed all
    tasks for ``computing_us``.
    """

    log: EpisodeLog
    whole: bool
    now_us: int = 0
    open: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    rates: dict[int, int] = field(default_factory=dict)
    work: defaultdict[int, dict[int, Work]] = field(default_factory=lambda: defaultdict(dict))
    lines: defaultdict[int, dict[int, int]] = field(default_factory=lambda: defaultdict(dict))
    there_us: Counter[int] = field(default_factory=Counter)
    visits_us: Counter[int] = field(default_factory=Counter)
    own: set[int] = field(default_factory=set)
    served_us: Counter[int] = field(default_factory=Counter)
    computing_us: int = 0


RECORDS: WeakKeyDictionary[Simulation, TaskRecord] = WeakKeyDictionary()
"""What the audit has noted of each simulation so far."""


def audit_tasks(simulation: Simulation) -> None:
    """Check all tasks now. Raises AssertionError if something is wrong."""
    state, log = simulation.state, simulation.log
    record = RECORDS.get(simulation)
    if record is None or record.log is not log or state.now_us < record.now_us:
        record = RECORDS[simulation] = TaskRecord(log, state.now_us == state.step == 0)
        record.now_us = state.now_us
    _elapse(record, state.now_us)
    if log.duration_us > 0:
        for drone in state.senders:
            _visits(record, state, drone)
        if record.whole:
            _totals(simulation, record)
        return
    for user in state.users:
        if user.request.number >= 0:
            _task(simulation, user)
    for drone in state.senders:
        _processor(simulation, drone)
        _visits(record, state, drone)
    record.rates.clear()
    record.own = {user.index for user in state.users if own_runs(state, user)}
    for user in state.users:
        if user.request.number >= 0:
            _done(simulation, record, user)
        else:
            record.open.pop(user.index, None)


def _elapse(record: TaskRecord, now_us: int) -> None:
    """Serve and wait until now."""
    elapsed_us, record.now_us = now_us - record.now_us, now_us
    for user, rate in record.rates.items():
        number, stage, _ = record.open[user]
        work = record.work[number][stage]
        work.done += rate * elapsed_us
        record.computing_us += elapsed_us * (work.line == COMPUTING)
    for user in record.own | set(record.rates):
        record.served_us[record.open[user][0]] += elapsed_us
    for drone, line in record.lines.items():
        record.there_us[drone] += elapsed_us * len(line)


def _task(simulation: Simulation, user: User) -> None:
    """Check that a task is at one place, that its times add up, and that it is not too late."""
    world, state, request = simulation.constants, simulation.state, user.request
    task, terms = state.tasks[user.index], world.terms[request.service]
    sites = [drone.index for drone in state.senders if user.index in drone.computing]
    if request.line == NOWHERE:
        assert not sites and request.server < 0, "a task is at a processor that its user has"
        assert task.own > 0 and not task.own_done, f"the task of user {user.index} is lost"
    elif request.line == COMPUTING:
        assert sites == [task.site] * (task.site >= 0), f"the task of user {user.index} is lost"
        assert task.site >= 0 or user.holder < 0, f"the task of user {user.index} does not arrive"
        assert request.server in (-1, task.site), "computed at another processor"
        if terms.migrates and task.computing_us == 0 and request.server < 0 <= task.site:
            assert not _is_reached(simulation, user), f"the task of user {user.index} stays"
    elif request.line == MOVING:
        ways = [drone.index for drone in state.senders if user.index in drone.moving]
        assert not sites and ways == [task.target], f"the task of user {user.index} is lost"
        assert request.server in (-1, task.target), "moved to another drone"
        assert terms.migrates and task.computing_us == 0, "a task moves that has begun"
        assert task.target != task.site and _has_backhaul(simulation, task.site, task.target)
        if user.holder != task.target:
            assert not _is_reached(simulation, user), f"the task of user {user.index} does not turn"
    else:
        assert not sites, f"user {user.index} has a task at a processor that needs none"
        assert request.server in (-1, user.holder), "sent to another drone"
        ways = (-1, task.site) if task.site >= 0 and not state.relays else (-1, user.holder)
        assert request.server in ways, "a result from elsewhere"
    served_us = task.sending_us + task.computing_us
    if task.own == 0:
        assert request.served_us == served_us, "time served is that of sending and computing"
    assert request.t_request_us + served_us <= state.now_us, "served longer than open"
    if own_runs(state, user):
        assert task.own_from_us <= state.now_us <= task.own_until_us, "longer than needed"
    computed = task.own > 0 or task.computing_us > 0 or request.line == COMPUTING
    if terms.drops and not (terms.stays_begun and computed):
        assert state.now_us <= task.deadline_us, f"the task of user {user.index} is late"


def _is_reached(simulation: Simulation, user: User) -> bool:
    """Whether a task could move to the drone that its user is attached to, if that is another."""
    site = simulation.state.tasks[user.index].site
    return user.holder not in (-1, site) and _has_backhaul(simulation, site, user.holder)


def _has_backhaul(simulation: Simulation, *senders: int) -> bool:
    """Whether all of these drones and access points have a backhaul."""
    backhauls = simulation.world.backhauls
    radios = [simulation.state.senders[one].radio for one in senders]
    return all(backhauls[radio] is not None for radio in radios)


def own_runs(state: State, user: User) -> bool:
    """Return whether the processor of a user computes its part of a task."""
    task = state.tasks[user.index]
    return user.request.number >= 0 and task.own > 0 and not task.own_done


def _processor(simulation: Simulation, drone: Drone) -> None:
    """Check the order of the tasks at a processor, and that its cores are given as they must be."""
    state = simulation.state
    processor = simulation.world.processors[drone.radio]
    if processor is None:
        assert not drone.computing, f"tasks at drone {drone.index}, which has no processor"
        return
    line = [state.users[u] for u in drone.computing]
    places = [_place(state, user, processor.sharing.by_deadline) for user in line]
    assert places == sorted(set(places)), f"the order of tasks at {drone.index}"
    rates = [user.request.rate if user.request.server >= 0 else 0 for user in line]
    full = processor.cores * processor.clock
    assert sum(rates) <= full, f"cores of {drone.index} are given twice"
    assert max(rates, default=0) <= processor.clock, f"a task of {drone.index} has several cores"
    if drone.mode == CRASHED and drone.point < 0:
        assert not line, f"tasks at drone {drone.index}, which has crashed"
    runs = drone.serving or (drone.computes and processor.on_ground)
    if not runs:
        assert not any(rates), f"the processor of {drone.index} does not stand still"
    elif not drone.scan:
        assert rates == _expected(processor, len(line), rates), f"rates at {drone.index}: {rates}"


def _place(state: State, user: User, by_deadline: bool) -> tuple[int, int, int]:
    """Return the place of a task in a line."""
    task = state.tasks[user.index]
    return task.deadline_us if by_deadline else 0, task.arrived_us, user.index


def _expected(processor: Any, there: int, rates: list[int]) -> list[int]:
    """Return the rates of the tasks at a processor; those of an own discipline are not known."""
    cores, clock, sharing = processor.cores, processor.clock, processor.sharing
    if isinstance(sharing, (FirstComeTasks, EarliestDeadline)):
        return [clock] * min(there, cores) + [0] * (there - cores)
    if isinstance(sharing, ProcessorSharing):
        return [min(clock, clock * cores // max(there, 1))] * there
    return rates


def _visits(record: TaskRecord, state: State, drone: Drone) -> None:
    """Count for how long those who leave a processor were there."""
    before = record.lines[drone.index]
    record.lines[drone.index] = {user: state.tasks[user].arrived_us for user in drone.computing}
    for user, arrived_us in before.items():
        if user not in drone.computing:
            record.visits_us[drone.index] += state.now_us - arrived_us
    for user, arrived_us in record.lines[drone.index].items():
        assert before.get(user, state.now_us) == arrived_us or not record.whole, "arrived before"


def _done(simulation: Simulation, record: TaskRecord, user: User) -> None:
    """Check that what is done for a request is what its rates add up to."""
    world, state, request = simulation.constants, simulation.state, user.request
    task, terms = state.tasks[user.index], world.terms[request.service]
    now = request.number, _part(state, user), task.restarts
    before = record.open.get(user.index, (-1, -1, -1))
    works, counted = record.work[request.number], request.done
    if request.server >= 0:
        counted += request.rate * (state.now_us - request.counted_us)
        record.rates[user.index] = request.rate
    if now != before:
        if before[0] == now[0] and before[2] != now[2]:
            stages = [part for part in works if part >= 0]
            assert task.restarts == before[2] + 1 and request.stage == min(stages), "not anew"
            works.clear()
        elif before[0] == now[0] and min(before[1], now[1]) < 0:
            _moved(record, user, before[1], task.site)
        stage = world.stages[world.first_stages[request.service] + request.stage]
        works[now[1]] = Work(request.required, request.line, bool(stage.timed))
        works[now[1]].done = 0 if record.whole else counted
        record.open[user.index] = now
    if request.line == NOWHERE:
        return
    work = works[now[1]]
    if (work.required, work.line) != (request.required, request.line):
        assert work.done == 0, "another task than before"
        work.required, work.line = request.required, request.line
    if terms.restarts and counted == 0 < work.done and (task.site < 0 or state.relays):
        assert user.holder not in (-1, request.last_server), "lost without a handover"
        work.done = 0
    assert work.counts == min(counted, work.required), f"what is done for user {user.index}"


def _part(state: State, user: User) -> int:
    """Return the stage of a request, or -1 less the number of the drone that it moves to."""
    task, request = state.tasks[user.index], user.request
    return -1 - task.target if request.line == MOVING else request.stage


def _moved(record: TaskRecord, user: User, part: int, site: int) -> None:
    """Check that all of a task has come that arrives, and nothing was computed of one that leaves.

    It is at its ``site``, and was in this ``part``.
    """
    work = record.work[user.request.number][part]
    if part >= 0:
        assert work.line == COMPUTING and work.done == 0, "a task moves that has begun"
    elif site == -1 - part and record.whole:
        assert work.done >= work.required, "a task arrives before its last bit"


def _totals(simulation: Simulation, record: TaskRecord) -> None:
    """Check that bits, cycles and times add up at the end of an episode, and Little's law."""
    requests = simulation.log.requests
    for one in requests:
        works = record.work.get(one.request_id, {})
        bits = sum(w.counts for w in works.values() if w.line < COMPUTING and not w.timed)
        assert one.sent_ubit == bits, f"bits of request {one.request_id}"
        _cycles(works, one)
        assert one.served_us == record.served_us[one.request_id], "time served"
        assert one.served_us <= one.sending_us + one.computing_us + one.own_us
        assert one.served_us <= one.t_end_us - one.t_request_us
        terms = simulation.constants.terms[one.service]
        ends = terms.drops and not terms.stays_begun
        assert not ends or one.t_end_us <= one.deadline_us, f"request {one.request_id} is late"
    assert sum(one.computing_us for one in requests) == record.computing_us, "time of computing"
    assert record.there_us == record.visits_us, "tasks there and their visits: Little's law"


def _cycles(works: dict[int, Work], one: ClosedRequest) -> None:
    """Check the cycles of a request: all of a stage that it has passed, and what is logged now.

    Those of the part that is offloaded and of the rest add up, but for what is rounded.
    """
    for stage, work in works.items():
        if work.line == COMPUTING:
            done = work.required if stage < one.stage else one.done
            assert work.counts == done, f"cycles of request {one.request_id}"
            whole = one.asked_cycles * one.part
            assert abs(work.required - whole) <= 1 + 1e-9 * whole, "the part that is offloaded"
