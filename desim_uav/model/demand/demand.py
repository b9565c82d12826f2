"""Demand: when users make requests and for which service, with at most one open per user."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Protocol

import numpy as np
from annotated_types import Ge, Le

from desim_uav.errors import SimulationError, did_you_mean, in_short
from desim_uav.model.catalogue import Catalogue
from desim_uav.model.demand.asking import NO_MORE_US, Asker, Offer, RowDemand, ask_for_mix
from desim_uav.model.demand.recorded import recorded_values
from desim_uav.model.demand.requests import (
    BANDWIDTH_BPS,
    DRAWN,
    DUE_US,
    REQUIRED_US,
    SERVICE,
    Requests,
)
from desim_uav.model.random.streams import (
    Purpose,
    Seeds,
    Stream,
    Streams,
    exponential_us,
    seed_of_each,
)
from desim_uav.model.rules import US
from desim_uav.model.services import MOST_REQUIRED
from desim_uav.model.traces import LARGEST, index, quantity, read_table
from desim_uav.registry import register
from desim_uav.rowcode.components import kind_of


class Demand(Protocol):
    """A demand model, which determines the requests of all users.

    A model without randomness may have ``draws = False``; its requests are then made once and used
    in every episode.
    """

    def requests(
        self, users: int, services: Catalogue, streams: Streams, horizon_us: int
    ) -> Requests:
        """Return the requests of one episode; user u may draw from stream u only.

        ``horizon_us`` is the length of the episode in microseconds.
        """


class Sensed(Protocol):
    """A demand whose users are sensors: they send the updates of a service."""

    def law(self, services: Mapping[str, Any]) -> Demand:
        """Return the demand model that draws the updates, given the services by name."""


def is_sensed(demand: object) -> bool:
    """Return whether users of this demand are sensors (see ``Sensed``)."""
    return hasattr(demand, "law")


def drawn_by(demand: Any, services: Mapping[str, Any]) -> Any:
    """Return the demand model that draws the requests, or the updates, of a demand's users."""
    return demand.law(services) if is_sensed(demand) else demand


MixWeight = Annotated[float, Ge(0)]
Nothing = Annotated[float, Ge(0), Le(0.999)]
"""The probability that a draw asks for nothing: rarely enough that the draws come to an end."""

SHORTEST_S, LONGEST_S = 0.001, 1e9
"""Think times are at least a millisecond on average, so that time passes from draw to draw."""

FEWEST = 0.1
"""If fewer requests than this are expected in an episode, they are hardly meant."""

PAPER_MIX = {"throughput": 0.5, "edge_computing": 0.25, "data_gathering": 0.15}


@register("demand", "continuous")
@dataclass(frozen=True)
class Continuous:
    """Each user makes one request at the start: to be covered during the whole episode.

    The request needs no bandwidth and counts as one for the scenario's first service (throughput,
    in the paper).
    """

    draws: ClassVar = False

    def requests(
        self, users: int, services: Catalogue, streams: Streams, horizon_us: int
    ) -> Requests:
        """Return one request per user."""
        rows = np.zeros((users, 4), np.int64)
        rows[:, REQUIRED_US] = horizon_us
        return Requests(rows, np.arange(users + 1), after_previous=True)

    def expected_draws(self, users: int, required_s: float, horizon_s: float) -> float:
        """Return the number of requests of all users in an episode."""
        return users


@register("demand", "static")
@dataclass(frozen=True)
class Static(RowDemand):
    """Each user makes one request at the start, for a service drawn from the mix.

    ``none``: the probability that it asks for nothing.
    """

    none: Annotated[float, Ge(0), Le(1)] = 0.0
    """The probability that a user asks for nothing."""
    mix: dict[str, MixWeight] = field(default_factory=PAPER_MIX.copy)
    """The weight of each service. Weights are normalised; a service that is not named has
    none.
    """

    def next_request(self, asker: Asker, stream: Stream, services: Offer) -> None:
        """Draw a request at the start, and then no more."""
        asker.wait_us = 0 if asker.draws == 0 else NO_MORE_US
        ask_for_mix(asker, stream, services, self.none)

    def expected_draws(self, users: int, required_s: float, horizon_s: float) -> float:
        """Return the number of draws of all users in an episode, for a request or for nothing."""
        return users


@register("demand", "dynamic")
@dataclass(frozen=True)
class Dynamic(RowDemand):
    """Each user makes a request at the start, and another one a think time after each has ended.

    Think times are exponential. With probability ``none`` a draw gives no request but another
    think time.
    """

    think_time_s: Annotated[float, Ge(SHORTEST_S), Le(LONGEST_S)] = 300.0
    """The mean of the exponential time between the end of a request and the next one, in
    seconds.
    """
    none: Nothing = 0.0
    """The probability that a draw is no request but another think time."""
    mix: dict[str, MixWeight] = field(default_factory=PAPER_MIX.copy)
    """The weight of each service. Weights are normalised; a service that is not named has
    none.
    """

    asks_from_lists = True

    def next_request(self, asker: Asker, stream: Stream, services: Offer) -> None:
        """Draw a request at the start, and then each after a think time."""
        asker.wait_us = 0
        if asker.draws > 0:
            asker.wait_us = exponential_us(stream, self.think_time_s)
        ask_for_mix(asker, stream, services, self.none)

    def expected_draws(self, users: int, required_s: float, horizon_s: float) -> float:
        """Return the mean number of draws of all users in an episode, for a request or for nothing.

        A request takes ``required_s``. A drawn request may never be made, because users wait until
        the previous one has been served.
        """
        return users * (1.0 + horizon_s / (self.think_time_s + (1.0 - self.none) * required_s))


@register("demand", "poisson")
@dataclass(frozen=True)
class Poisson(RowDemand):
    """Each user's requests arrive as a Poisson process.

    An arrival during an open request of the same user is dropped.
    """

    rate_per_hour: Annotated[float, Ge(1e-6), Le(1e6)]
    """The mean number of arrivals per user and hour."""
    none: Nothing = 0.0
    """The probability that an arrival is no request."""
    mix: dict[str, MixWeight] = field(default_factory=PAPER_MIX.copy)
    """The weight of each service. Weights are normalised; a service that is not named has
    none.
    """

    after_previous = False
    asks_from_lists = True

    def next_request(self, asker: Asker, stream: Stream, services: Offer) -> None:
        """Draw a request after an exponential time."""
        asker.wait_us = exponential_us(stream, 3600.0 / self.rate_per_hour)
        ask_for_mix(asker, stream, services, self.none)

    def expected_draws(self, users: int, required_s: float, horizon_s: float) -> float:
        """Return the mean number of arrivals in an episode, of requests or of nothing."""
        return users * (1.0 + horizon_s * self.rate_per_hour / 3600.0)

    def doubts(self, users: int, horizon_s: float) -> Iterator[str]:
        """Yield whether hardly any request is made in an episode."""
        yield from too_few((1.0 - self.none) * users * horizon_s * self.rate_per_hour / 3600.0)


@register("demand", "trace")
@dataclass(frozen=True)
class Trace:
    """Takes requests from a CSV file: user, t_s, service, and what is asked for.

    For a service of the kind `hold` this is in the columns required_s and bandwidth_kbps. Others
    have a column for each of their lists, such as volume_mbit or input_mbit, in the same units; a
    list of one value needs none.
    """

    file: Path
    """The CSV file, relative to the scenario's file."""
    later: ClassVar = ("begin_s",)

    begin_s: Annotated[float, Ge(0), Le(LARGEST)] = 0.0
    """The time of the recording at which an episode begins, in seconds. Requests before it are left
    out, and so are those at or after the end of the episode.
    """
    draws: ClassVar = False

    def __post_init__(self) -> None:
        """Read the file. Raises ValueError with file and line if it is not such a table."""
        for *_, required_s, _, line in self._table():
            if required_s is not None and round(required_s * US) < 1:
                raise ValueError(f"{self.file}:{line}: required_s: must be above 0")

    def misfits(self, services: Mapping[str, Any]) -> list[str]:
        """Return what the requests of the file lack, or must not ask for."""
        return recorded_values(self.file, services).problems

    def problems(self, users: int, services: Sequence[str]) -> list[str]:
        """Return the problems of the file: users or services that the scenario does not have."""
        problems = []
        for user, _, service, _, _, line in self._table():
            if user >= users:
                problems.append(f"{self.file}:{line}: user: {user}: must be from 0 to {users - 1}")
            if service not in services:
                hint = did_you_mean(service, services)
                problems.append(
                    f"{self.file}:{line}: service: {in_short(repr(service))}: unknown{hint}; "
                    f"allowed: {', '.join(services)}"
                )
        return problems

    def doubts(self, users: int, horizon_s: float) -> Iterator[str]:
        """Yield how many requests an episode leaves out that lasts so long."""
        times_us = [self._due_us(t_s) for _, t_s, *_ in self._table()]
        left_out = sum(not 0 <= due < round(horizon_s * US) for due in times_us)
        if not times_us:
            yield f"{self.file}: it has no requests"
        elif left_out:
            yield (
                f"{self.file}: {left_out} of {len(times_us)} requests are left out, because they "
                f"are not made within an episode: from begin_s: {self.begin_s:g} to before "
                f"{self.begin_s + horizon_s:g} s"
            )

    def summary(self, users: int, horizon_s: float) -> str:
        """Return in words who makes requests in the recording, and when."""
        rows = self._table()
        if not rows:
            return f"{self.file.name}: no requests"
        times_s = [t_s for _, t_s, *_ in rows]
        return (
            f"{self.file.name}: {len(rows)} requests of {len({row[0] for row in rows})} users; "
            f"{min(times_s):g} to {max(times_s):g} s, of which an episode has {self.begin_s:g} to "
            f"{self.begin_s + horizon_s:g} s"
        )

    def largest_kbps(self) -> Mapping[str, float]:
        """Return the largest bandwidth that is asked for by each service."""
        largest: dict[str, float] = {}
        for _, _, service, _, kbps, _ in self._table():
            largest[service] = max(kbps or 0.0, largest.get(service, 0.0))
        return largest

    def expected_draws(self, users: int, required_s: float, horizon_s: float) -> float:
        """Return the number of recorded requests."""
        return len(self._table())

    def requests(
        self, users: int, services: Catalogue, streams: Streams, horizon_us: int
    ) -> Requests:
        """Return the recorded requests of an episode, which are the same in every episode."""
        by_user: list[list[list[int]]] = [[] for _ in range(users)]
        drawn, width = recorded_values(self.file, services.offered).values, services.draws
        for user, t_s, service, *_, line in self._table():
            due = self._due_us(t_s)
            if 0 <= due < horizon_us:
                own = drawn[line] + [0] * (width - len(drawn[line]))
                by_user[user].append([due, services.names.index(service), *own])
        rows = [row for own in by_user for row in sorted(own)]
        offsets, columns = np.cumsum([0, *map(len, by_user)]), DRAWN + width
        return Requests(
            np.array(rows, np.int64).reshape(-1, columns), offsets, after_previous=False
        )

    def _due_us(self, t_s: float) -> int:
        """Return the time in an episode at a time of the recording."""
        return round(t_s * US) - round(self.begin_s * US)

    def _table(self) -> list[tuple[Any, ...]]:
        columns: dict[str, Callable[[str], Any]] = {
            "user": index,
            "t_s": quantity,
            "service": str,
        }
        times = {"required_s": quantity, "bandwidth_kbps": quantity}
        return read_table(self.file, columns, times)


def too_few(requests: float) -> Iterator[str]:
    """Yield that hardly any request is made in an episode, if so few are expected."""
    if requests < FEWEST:
        yield f"only {requests:.2g} requests are expected in an episode, of all users together"


def requests_of(
    demand: Demand,
    users: int,
    services: Catalogue,
    seeds: Seeds,
    episodes: Sequence[int],
    horizon_us: int,
    first: int = 0,
) -> Sequence[Requests]:
    """Return the requests of several episodes by a model that is not over rows.

    ``first`` is the number of the first user's random stream. Raises SimulationError if a number of
    requests cannot be counted.
    """
    own = zip(seed_of_each(seeds, episodes), episodes, strict=True)
    streams = [Streams(seed, Purpose.DEMAND, episode, first) for seed, episode in own]
    return [
        _counted(demand, demand.requests(users, services, each, horizon_us), services, users)
        for each in streams
    ]


def _counted(demand: Demand, requests: Requests, services: Catalogue, users: int) -> Requests:
    """Return these requests, with a column for each value that a request can draw.

    Raises SimulationError if sums of their numbers need over 64 bits, or if nothing is asked for.
    """
    problem = _misshapen(requests, users)
    if problem:
        raise SimulationError(f"demand: {kind_of(demand)!r}: {problem}")
    lacking = DRAWN + services.draws - requests.rows.shape[1]
    rows = np.pad(requests.rows, ((0, 0), (0, max(lacking, 0))))
    service = np.clip(rows[:, SERVICE], 0, len(services.names) - 1)
    limits = {DUE_US: (0, MOST_REQUIRED)} | {
        DRAWN + k: (services.least[service, k], services.most[service, k])
        for k in range(services.draws)
    }
    for column, (least, most) in limits.items():
        values = rows[:, column]
        wrong = np.flatnonzero((values < least) | (values > most))
        if len(wrong):
            low, high = (np.broadcast_to(limit, len(rows))[wrong[0]] for limit in (least, most))
            name = COLUMNS.get(column, f"its number {column}")
            raise SimulationError(
                f"demand: {kind_of(demand)!r}: request {wrong[0]}: {name} is {values[wrong[0]]}, "
                f"which must be from {low} to {high}"
            )
    for number, stages in enumerate(services.stages):
        own = rows[rows[:, SERVICE] == number, DRAWN:]
        amounts = [
            own[:, amount] * (own[:, times] if times >= 0 else 1) * scale // per
            for _, _, amount, times, per, *_, scale in stages
        ]
        if len(own) and np.max(amounts, axis=0).min() < 1:
            raise SimulationError(
                f"demand: {kind_of(demand)!r}: a request for {services.names[number]!r} asks for "
                "nothing in any stage"
            )
    return requests._replace(rows=rows)


def _misshapen(requests: Requests, users: int) -> str:
    """Return the problem if these are not rows of whole numbers, each user's in order of time."""
    try:
        rows, offsets, follows = (np.asarray(part) for part in requests)
    except (TypeError, ValueError):  # it has not three parts
        rows = offsets = follows = np.zeros(0)
    shaped = rows.ndim == 2 and rows.shape[1] >= DRAWN and offsets.shape == (users + 1,)
    if not (shaped and rows.dtype.kind == offsets.dtype.kind == "i"):
        return f"requests() must return rows of whole numbers and {users + 1} whole offsets"
    if offsets[0] != 0 or offsets[-1] != len(rows) or (np.diff(offsets) < 0).any():
        return f"the offsets of requests() must rise from 0 to the number of rows, {len(rows)}"
    begins = np.zeros(len(rows) + 1, bool)
    begins[offsets] = True
    user = np.repeat(np.arange(users), np.diff(offsets))
    falls = (np.diff(rows[:, DUE_US]) < 0) & ~begins[1:-1]
    falls &= ~np.broadcast_to(follows, users)[user[1:]]
    late = np.flatnonzero(falls)
    return f"row {late[0] + 1} of requests() is earlier than the row before it" if len(late) else ""


COLUMNS = {
    DUE_US: "its time in µs",
    REQUIRED_US: "what it requires, in µs or millionths of a bit,",
    BANDWIDTH_BPS: "its bandwidth in bit/s",
}
"""What the first columns of a table of requests hold, by their numbers."""
