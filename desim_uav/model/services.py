"""Services: the stages of which their requests consist, and the numbers that requests draw."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple, Protocol

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen
from numpy.typing import NDArray

from desim_uav.model.rules import US
from desim_uav.registry import register

MICROBITS = 10**12
"""The millionths of a bit in a megabit."""

MOST_REQUIRED, MOST_BPS = 2**62, 10**12
"""The largest service time in microseconds, or volume in millionths of a bit, and the largest
bandwidth of a request: what is done for it, and a bandwidth times the millionths of a bit/s/Hz,
then fits in 64 bits."""

LARGEST_UBIT = 10**18
"""The largest volume of a service in millionths of a bit, which is 1e6 Mbit."""

UBIT_PER_BIT = 10**6
"""The millionths of a bit in a bit."""

LINK, PROCESSOR = "link", "processor"
RESOURCES = (LINK, PROCESSOR)
"""The resources of stages: the link of a user to the drone or access point it is attached to, and
the processor of the one to which it was attached when the stage began."""

WAITING, SHARING, COMPUTING, NOWHERE, MOVING = range(5)
"""The lines of a drone in which requests stand, by what their stages need: a rate that is held, for
which they wait until it fits, what is left of the bandwidth, which they share, or its processor. A
task of which no part is at a drone, because its user computes it or the rest of it, is in none. One
that moves from one processor to another stands in a line of the drone it moves to."""


@dataclass(frozen=True)
class Stage:
    """A part of a service: an amount of a resource, which is needed before the next stage begins.

    Its numbers are drawn from the lists of ``Service.values``, which it names. The amount is a
    value of ``amount``, times one of ``times`` if this is given, times ``scale``, over ``per`` and
    rounded down; a stage of amount 0 is left out. On a link, it is a time in microseconds if it is
    ``timed``, else a volume in millionths of a bit. A stage with a ``rate`` in bit/s holds this
    rate while it is served, and waits until there is bandwidth for it; one without a rate gets what
    the drones' sharing gives it. What goes ``up`` is sent by the user, in a band of its own if the
    radio has one. On a processor, the amount is in thousandths of a cycle.
    """

    amount: str
    rate: str | None = None
    timed: bool = False
    times: str | None = None
    per: int = 1
    resource: str = LINK
    scale: int = 1
    up: bool = False

    @property
    def of_bits(self) -> bool:
        """Whether the amount is a volume, in millionths of a bit."""
        return self.resource == LINK and not self.timed


class Terms(NamedTuple):
    """What holds for all requests for a service: a deadline, and what a handover does to them.

    A request is late ``deadline_us`` after it was made (None: never); if it ``drops``, it is closed
    then, unless it ``stays_begun`` and a processor has begun to compute it. If it ``restarts``,
    what was sent to one drone is of no use at another one. If it ``migrates``, it follows its user
    over backhauls from one processor to another, as long as none has begun to compute it.
    """

    deadline_us: int | None = None
    drops: bool = False
    stays_begun: bool = False
    restarts: bool = False
    migrates: bool = False


NO_TERMS = Terms()
"""The terms of services that have no method ``terms``: no deadline, and nothing sent is lost."""


def terms_of(service: Any) -> Terms:
    """Return the terms of a service."""
    terms: Terms = service.terms() if hasattr(service, "terms") else NO_TERMS
    return terms


KEEPS = ("newest", "oldest", "last")
"""Which updates a full buffer keeps."""
NEWEST, OLDEST, LAST = range(len(KEEPS))

PREEMPTS = (False, True, "all")
"""What a new update replaces that is being sent: nothing, that of its own sensor, or all others."""
FROM_ALL = 2
"""The number of the last one of PREEMPTS."""

MOST_BUFFERED = 100_000
"""The largest number of updates that a buffer holds."""


class Collecting(NamedTuple):
    """How updates of a service are kept: the size of a buffer, what it keeps, and the age's limit.

    ``keeps`` is the number of one of KEEPS, and ``preempts`` of one of PREEMPTS; with LAST, a new
    update also replaces the one that is being sent, or those of all sensors at its drone. Of those
    that wait, the last one is sent next if it ``sends_last``. Drones carry updates to the
    ``ground`` to deliver them. Sensors wait until ``wait_us`` after an update was begun to be sent,
    if they take them at will.
    """

    buffer: int
    keeps: int
    preempts: int
    sends_last: bool
    limit_us: int | None
    ground: bool
    wait_us: int


def collecting_of(service: Any) -> Collecting | None:
    """Return how updates of a service are kept; None if it is none that sensors send."""
    keeps: Collecting | None = service.collecting() if hasattr(service, "collecting") else None
    return keeps


class Service(Protocol):
    """A service, as data: the stages of its requests, and lists of equally likely values.

    A request draws one value from each list, independently and in the order of the lists, when the
    sample path is drawn. Continuous distributions are lists of their quantiles.
    """

    def values(self) -> Mapping[str, NDArray[np.int64]]:
        """Return the lists from which a request draws, by name: whole numbers, at least one.

        If a list has the name of a field, messages about the list name this key of the scenario.
        """

    def stages(self) -> tuple[Stage, ...]:
        """Return the stages in the order in which a request passes through them."""


class Amount(NamedTuple):
    """The least, the mean and the largest amount that requests can need in a stage."""

    least: int
    mean: float
    most: int


def amount_of(service: Service, stage: Stage) -> Amount:
    """Return what requests for a service can need in one of its stages."""
    values = service.values()
    own = values[stage.amount]
    least, mean, most = int(np.min(own)), float(np.mean(own)), int(np.max(own))
    if stage.times is not None:
        by = values[stage.times]
        least, most = least * int(np.min(by)), most * int(np.max(by))
        mean *= float(np.mean(by))
    scale, per = stage.scale, stage.per
    return Amount(least * scale // per, mean * scale / per, most * scale // per)


def largest_product(service: Service, stage: Stage) -> int:
    """Return the largest product of what a stage multiplies, before it is divided by ``per``."""
    factors = [service.values()[name] for name in (stage.amount, stage.times) if name is not None]
    return math.prod([stage.scale, *(int(np.max(each)) for each in factors)])


def rate_of(stage: Stage, most_bps: int, clock: int) -> int:
    """Return how much of a stage can be done in a microsecond.

    Links have ``most_bps`` in bit/s, and cores ``clock`` thousandths of a cycle per microsecond.
    """
    if stage.resource == PROCESSOR:
        return clock
    return 1 if stage.timed else most_bps


def rates_bps(service: Service, stage: Stage) -> NDArray[np.int64]:
    """Return the rates in bit/s that a stage of a service can hold; 0 if it holds none."""
    none = np.zeros(1, np.int64)
    return none if stage.rate is None else service.values()[stage.rate]


def largest_bps(service: Service) -> float:
    """Return the largest rate in bit/s that a request for a service can hold."""
    return max(float(np.max(rates_bps(service, stage))) for stage in service.stages())


def has_volumes(service: Service) -> bool:
    """Return whether requests for a service ask for a volume in one of their stages."""
    return any(stage.of_bits for stage in service.stages())


def computes(service: Service) -> bool:
    """Return whether requests for a service need a processor in one of their stages."""
    return any(stage.resource == PROCESSOR for stage in service.stages())


def is_task(service: Service) -> bool:
    """Return whether requests need a processor, have a deadline, or lose what they have sent."""
    return computes(service) or terms_of(service) != NO_TERMS


def is_one_time(service: Service) -> bool:
    """Return whether requests for a service ask for one time, for which they hold a rate."""
    return len(service.stages()) == 1 and service.stages()[0].timed


def problems_of(service: Any) -> list[str]:
    """Return what is wrong with the values and stages of a service of one's own."""
    values, stages = service.values(), service.stages()
    problems = [f"values: {name!r} is empty" for name, own in values.items() if len(own) == 0]
    if not stages:
        problems.append("stages must have at least one stage")
    for number, stage in enumerate(stages):
        fields = [("amount", stage.amount), ("times", stage.times), ("rate", stage.rate)]
        problems += [
            f"stages: {number}: {key}: {name!r} must be one of {', '.join(values)}"
            for key, name in fields
            if name is not None and name not in values
        ]
        if stage.resource not in RESOURCES:
            allowed = ", ".join(RESOURCES)
            problems.append(
                f"stages: {number}: resource: {stage.resource!r} must be one of {allowed}"
            )
        if stage.resource == PROCESSOR and (stage.timed or stage.up or stage.rate is not None):
            problems.append(f"stages: {number}: a processor has neither timed nor up nor a rate")
        elif stage.timed and stage.rate is None:
            problems.append(f"stages: {number}: needs a rate, because its amount is a time")
        for key, factor in (("per", stage.per), ("scale", stage.scale)):
            if factor < 1:
                problems.append(f"stages: {number}: {key}: {factor} must be at least 1")
    if (
        not problems
        and len(stages) > 1
        and all(amount_of(service, one).least < 1 for one in stages)
    ):
        problems.append("stages: one of them must always have an amount above 0")
    return problems


def scaled(numbers: tuple[float, ...], factor: int) -> NDArray[np.int64]:
    """Return numbers in units that are smaller by a factor, rounded."""
    return np.array([round(one * factor) for one in numbers], np.int64)


def _bps(kbps: tuple[float, ...]) -> NDArray[np.int64]:
    return scaled(kbps, 1000)


@register("service", "uniform_choice")
@register("service", "hold")
@dataclass(frozen=True)
class UniformChoice:
    """A request takes one of the durations and one of the bandwidths, independently of each other.

    All durations are equally likely, and so are all bandwidths. This kind has two names, `hold` and
    `uniform_choice`.
    """

    duration_min: Annotated[tuple[Annotated[float, Gt(0)], ...], MinLen(1)]
    """The service times a request can require, in minutes, equally likely."""
    bandwidth_kbps: Annotated[tuple[Annotated[float, Ge(0)], ...], MinLen(1)]
    """The bandwidths a request can occupy, in kbit/s, equally likely."""

    def values(self) -> dict[str, NDArray[np.int64]]:
        """Return the durations in microseconds, and the bandwidths in bit/s."""
        durations_us = [round(minutes * 60 * US) for minutes in self.duration_min]
        return {
            "duration_min": np.array(durations_us, np.int64),
            "bandwidth_kbps": _bps(self.bandwidth_kbps),
        }

    def stages(self) -> tuple[Stage, ...]:
        """Return the one stage: the bandwidth is held for the duration."""
        return (Stage("duration_min", rate="bandwidth_kbps", timed=True),)


@register("service", "transfer")
@dataclass(frozen=True)
class Transfer:
    """A request asks for a volume, and ends when this has been delivered.

    All volumes are equally likely. Its rate is what the drones' ``radio.sharing`` gives it; under
    ``held`` it holds one of the rates of ``bandwidth_kbps``, all equally likely.
    """

    volume_mbit: Annotated[tuple[Annotated[float, Ge(1e-12), Le(1e6)], ...], MinLen(1)]
    """The volumes that a request can ask for, in Mbit, equally likely."""
    bandwidth_kbps: Annotated[tuple[Annotated[float, Ge(0.001)], ...], MinLen(1)] | None = None
    """The rates that a request can hold, in kbit/s, equally likely: for the sharing `held` only."""

    def values(self) -> dict[str, NDArray[np.int64]]:
        """Return the volumes in millionths of a bit, and the rates in bit/s (0: none are held)."""
        volumes_ubit = [round(mbit * MICROBITS) for mbit in self.volume_mbit]
        return {
            "volume_mbit": np.array(volumes_ubit, np.int64),
            "bandwidth_kbps": _bps(self.bandwidth_kbps or (0,)),
        }

    def stages(self) -> tuple[Stage, ...]:
        """Return the one stage: the volume is delivered."""
        return (Stage("volume_mbit", rate="bandwidth_kbps" if self.bandwidth_kbps else None),)


@register("service", "compute")
@dataclass(frozen=True)
class Compute:
    """A task that a drone computes: its input goes up, its result comes down.

    All values of a list are equally likely, and drawn independently. The number of cycles is the
    size of the input, in bits, times the cycles per bit.
    """

    input_mbit: Annotated[tuple[Annotated[float, Ge(1e-6), Le(1e6)], ...], MinLen(1)]
    """The sizes of the input, in Mbit, rounded to whole bits."""
    cycles_per_bit: Annotated[tuple[Annotated[float, Ge(0.001), Le(1e9)], ...], MinLen(1)]
    """The cycles that a bit of the input takes, rounded to thousandths of a cycle."""
    output_mbit: Annotated[tuple[Annotated[float, Ge(0), Le(1e6)], ...], MinLen(1)] = (0.0,)
    """The sizes of the result, in Mbit, rounded to whole bits; 0: nothing comes down."""
    bandwidth_kbps: Annotated[tuple[Annotated[float, Ge(0.001)], ...], MinLen(1)] | None = None
    """The rates that a task can hold on its link, in kbit/s: for the sharing `held` only."""
    deadline_s: Annotated[float, Ge(1e-6), Le(1e9)] | None = None
    """A task is late so many seconds after it was made; null means never."""
    on_deadline: Literal["count", "drop", "leave"] = "count"
    """What happens to late tasks: they go on (count), are closed at that instant (drop), or are
    closed if no processor has begun to compute them (leave).
    """
    handover: Literal["resume", "restart", "migrate"] = "resume"
    """Whether bits that were sent to one drone count at another one (resume), or are sent anew
    (restart); with migrate they count, and a task that a processor has, but has not begun to
    compute, follows its user to the processor of the other drone, over the backhauls of both.
    """

    def values(self) -> dict[str, NDArray[np.int64]]:
        """Return the sizes in bits, and the cycles per bit in thousandths."""
        return {
            "input_mbit": scaled(self.input_mbit, 10**6),
            "cycles_per_bit": scaled(self.cycles_per_bit, 1000),
            "output_mbit": scaled(self.output_mbit, 10**6),
            "bandwidth_kbps": _bps(self.bandwidth_kbps or (0,)),
        }

    def stages(self) -> tuple[Stage, ...]:
        """Return the stages: the link up, the processor and, with a result, the link down."""
        rate = "bandwidth_kbps" if self.bandwidth_kbps else None
        task = (
            Stage("input_mbit", rate=rate, scale=UBIT_PER_BIT, up=True),
            Stage("input_mbit", times="cycles_per_bit", resource=PROCESSOR),
        )
        down = (Stage("output_mbit", rate=rate, scale=UBIT_PER_BIT),)
        return task + down if any(self.output_mbit) else task

    def terms(self) -> Terms:
        """Return the deadline, and what a handover does."""
        deadline_us = None if self.deadline_s is None else round(self.deadline_s * US)
        late, handover = self.on_deadline, self.handover
        drops, stays_begun = late != "count", late == "leave"
        return Terms(deadline_us, drops, stays_begun, handover == "restart", handover == "migrate")


PAPER: dict[str, Service] = {
    "throughput": UniformChoice((1, 2, 3, 4, 5, 6), (96, 160, 200, 320, 750, 1000, 2500)),
    "edge_computing": UniformChoice((3,), (10, 20, 30, 40, 50)),
    "data_gathering": UniformChoice((2,), (24, 48, 72, 96, 192)),
}
"""The three services of the paper."""
