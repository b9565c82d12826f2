"""When users ask, and for what. At most one open request a user."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, Protocol

import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from numpy.typing import NDArray

from desim_uav.model.kernels import kernel
from desim_uav.model.rules import US
from desim_uav.model.services import Catalogue
from desim_uav.model.streams import Purpose, Streams, advanced, as_uniform, states_of
from desim_uav.model.traces import index, quantity, read_table
from desim_uav.registry import did_you_mean, register

DUE_US, SERVICE, REQUIRED_US, BANDWIDTH_BPS = range(4)
"""Columns of a table of requests."""


class Requests(NamedTuple):
    """What all users ask for in one episode: rows DUE_US SERVICE REQUIRED_US BANDWIDTH_BPS.

    User u's are ``offsets[u]:offsets[u + 1]``. ``after_previous``: DUE_US counts from the end of
    the user's previous request (the first: from the episode's start) and a user waits for that
    end; otherwise it is the time of an arrival, dropped while a request of that user is open.
    """

    rows: NDArray[np.int64]
    offsets: NDArray[np.int64]
    after_previous: bool


class ManyRequests(Sequence[Requests]):
    """The requests of several episodes, in a table: of episode k ``begins[k]:begins[k + 1]``.

    ``offsets`` (episodes, users + 1) are counted in each.
    """

    def __init__(
        self, rows: NDArray[np.int64], offsets: NDArray[np.int64], after_previous: bool
    ) -> None:
        self.offsets, self.after_previous = offsets, after_previous
        ends: list[int] = np.cumsum(offsets[:, -1]).tolist()
        self.begins, self.rows = [0, *ends[:-1]], rows[: ends[-1]]

    def __len__(self) -> int:
        return len(self.offsets)

    def __getitem__(self, k: Any) -> Any:
        """Those of an episode."""
        own, begin = self.offsets[k], self.begins[k]
        return Requests(self.rows[begin : begin + own[-1]], own, self.after_previous)


class Demand(Protocol):
    """A model of demand.

    One that draws nothing may say ``draws = False``: it is asked once, not for each episode.
    """

    def requests(
        self, users: int, services: Catalogue, streams: Streams, horizon_us: int
    ) -> Requests:
        """The requests of one episode; user u may draw from stream u only."""


Weight = Annotated[float, Ge(0)]
PAPER_MIX = {"throughput": 0.5, "edge_computing": 0.25, "data_gathering": 0.15}


@register("demand", "continuous")
@dataclass(frozen=True)
class Continuous:
    """Each user asks once, at the start, to be covered for the whole episode; no bandwidth.

    The request counts as the first service of the scenario (throughput, in the paper).
    """

    draws: ClassVar = False

    def requests(
        self, users: int, services: Catalogue, streams: Streams, horizon_us: int
    ) -> Requests:
        """One request a user."""
        rows = np.zeros((users, 4), np.int64)
        rows[:, REQUIRED_US] = horizon_us
        return Requests(rows, np.arange(users + 1), after_previous=True)


class _Drawn(ABC):
    """A demand that a compiled loop draws, a stream for each user."""

    @abstractmethod
    def law(self) -> tuple[int, float, float]:
        """The kind of process, the probability of asking for nothing, a mean time in seconds."""

    def requests(
        self, users: int, services: Catalogue, streams: Streams, horizon_us: int
    ) -> Requests:
        """The requests of one episode."""
        states = streams.states(users)[np.newaxis]
        drawn: Requests = _drawn(services, states, *self.law(), horizon_us)[0]
        return drawn


@register("demand", "static")
@dataclass(frozen=True)
class Static(_Drawn):
    """Each user asks once, at the start, for a service drawn from the mix.

    ``none``: the probability that it asks for nothing.
    """

    none: Annotated[float, Ge(0), Le(1)] = 0.0
    """The probability that a user asks for nothing."""
    mix: dict[str, Weight] = field(default_factory=PAPER_MIX.copy)
    """The weight of each service. Weights are normalised; a service that is not named has
    none.
    """

    def law(self) -> tuple[int, float, float]:
        """At most one request a user."""
        return _ONCE, self.none, 0.0


@register("demand", "dynamic")
@dataclass(frozen=True)
class Dynamic(_Drawn):
    """As static at the start; then each user thinks, once its request has ended, and asks again.

    Think times are exponential. A draw of nothing (probability ``none``) is another think time.
    """

    think_time_s: Annotated[float, Gt(0)] = 300.0
    """The mean of the exponential time between the end of a request and the next one, in
    seconds.
    """
    none: Annotated[float, Ge(0), Lt(1)] = 0.0
    """The probability that a draw is no request but another think time."""
    mix: dict[str, Weight] = field(default_factory=PAPER_MIX.copy)
    """The weight of each service. Weights are normalised; a service that is not named has
    none.
    """

    def law(self) -> tuple[int, float, float]:
        """Requests until their required and think times together pass the horizon."""
        return _CHAIN, self.none, self.think_time_s


@register("demand", "poisson")
@dataclass(frozen=True)
class Poisson(_Drawn):
    """Each user's requests arrive as a Poisson process; those during an open one are dropped."""

    rate_per_hour: Annotated[float, Ge(1e-6), Le(1e6)]
    """The mean number of arrivals per user and hour."""
    none: Annotated[float, Ge(0), Lt(1)] = 0.0
    """The probability that an arrival is no request."""
    mix: dict[str, Weight] = field(default_factory=PAPER_MIX.copy)
    """The weight of each service. Weights are normalised; a service that is not named has
    none.
    """

    def law(self) -> tuple[int, float, float]:
        """Arrivals before the horizon."""
        return _ARRIVALS, self.none, 3600.0 / self.rate_per_hour


@register("demand", "trace")
@dataclass(frozen=True)
class Trace:
    """Requests from a CSV file: user, t_s, service, required_s, bandwidth_kbps."""

    file: Path
    """The CSV file, relative to the scenario's file."""
    draws: ClassVar = False

    def __post_init__(self) -> None:
        """Raises ValueError, naming file and line, where the file is not such a table."""
        for *_, required_s, _, line in self._table():
            if round(required_s * US) < 1:
                raise ValueError(f"{self.file}:{line}: required_s: must be above 0")

    def problems(self, users: int, services: Sequence[str]) -> list[str]:
        """What does not fit a scenario: users or services it does not have."""
        found = []
        for user, _, service, _, _, line in self._table():
            if user >= users:
                found.append(f"{self.file}:{line}: user: {user}: there are {users} users")
            if service not in services:
                hint = did_you_mean(service, services)
                found.append(
                    f"{self.file}:{line}: service: {service!r}: unknown{hint}; "
                    f"allowed: {', '.join(services)}"
                )
        return found

    def requests(
        self, users: int, services: Catalogue, streams: Streams, horizon_us: int
    ) -> Requests:
        """The recorded requests that fall in the episode, the same in every episode."""
        by_user: list[list[tuple[int, int, int, int]]] = [[] for _ in range(users)]
        for user, t_s, service, required_s, kbps, _ in self._table():
            due = round(t_s * US)
            if due < horizon_us:
                required_us, bps = round(required_s * US), round(kbps * 1000)
                by_user[user].append((due, services.names.index(service), required_us, bps))
        rows = [row for own in by_user for row in sorted(own)]
        offsets = np.cumsum([0, *map(len, by_user)])
        return Requests(np.array(rows, np.int64).reshape(-1, 4), offsets, after_previous=False)

    def _table(self) -> list[tuple[Any, ...]]:
        columns: dict[str, Callable[[str], Any]] = {
            "user": index,
            "t_s": quantity,
            "service": str,
            "required_s": quantity,
            "bandwidth_kbps": quantity,
        }
        return read_table(self.file, columns)


_ONCE, _CHAIN, _ARRIVALS = range(3)


def requests_of(
    demand: Demand,
    users: int,
    services: Catalogue,
    seed: int,
    episodes: Sequence[int],
    horizon_us: int,
) -> Sequence[Requests]:
    """The requests of several episodes."""
    if isinstance(demand, _Drawn) and type(demand).requests is _Drawn.requests:
        states = states_of(seed, Purpose.DEMAND, episodes, users)
        return _drawn(services, states, *demand.law(), horizon_us)
    streams = [Streams(seed, Purpose.DEMAND, episode) for episode in episodes]
    return [demand.requests(users, services, each, horizon_us) for each in streams]


def _drawn(
    services: Catalogue,
    states: NDArray[np.uint64],
    process: int,
    none: float,
    mean_s: float,
    horizon_us: int,
) -> ManyRequests:
    episodes, users, _ = states.shape
    offsets = np.zeros((episodes, users + 1), np.int64)
    law = (services.share, services.sizes, services.durations_us, services.bandwidths_bps)
    rows = np.empty((episodes * users * 16, 4), np.int64)
    count = _draw(*law, states, process, none, mean_s, horizon_us, offsets, rows)
    if count > len(rows):
        rows = np.empty((count, 4), np.int64)
        _draw(*law, states, process, none, mean_s, horizon_us, offsets, rows)
    return ManyRequests(rows, offsets, after_previous=process != _ARRIVALS)


@kernel
def _draw(
    share: NDArray[np.float64],
    sizes: NDArray[np.int64],
    durations_us: NDArray[np.int64],
    bandwidths_bps: NDArray[np.int64],
    states: NDArray[np.uint64],
    process: int,
    none: float,
    mean_s: float,
    horizon_us: int,
    offsets: NDArray[np.int64],
    rows: NDArray[np.int64],
) -> int:
    """Write all users' requests, episode by episode; their number.

    ``offsets`` (episodes, users + 1) are counted in each. What does not fit ``rows`` is not
    written. Five uniform numbers a draw, whatever comes of them: nothing or something, service,
    duration, bandwidth, and the time to the next draw.
    """
    count = first = 0
    users = states.shape[1]
    for k in range(len(states) * users):
        episode, user = k // users, k % users
        if user == 0:
            first = count
        own = states[episode, user]
        state = (own[0], own[1], own[2], own[3])
        due = np.int64(0)
        elapsed = np.int64(0)
        if process == _ARRIVALS:
            word, state = advanced(state)
            due = _exponential_us(as_uniform(word), mean_s)
            elapsed = due
        while elapsed < horizon_us:
            word, state = advanced(state)
            asks = as_uniform(word) >= none
            word, state = advanced(state)
            which = as_uniform(word)
            service = 0
            for bound in share:  # all of them: a branch that nobody can foresee costs more
                service += int(bound <= which)
            word, state = advanced(state)
            duration = durations_us[service, int(as_uniform(word) * sizes[service, 0])]
            word, state = advanced(state)
            bandwidth = bandwidths_bps[service, int(as_uniform(word) * sizes[service, 1])]
            word, state = advanced(state)
            gap = _exponential_us(as_uniform(word), mean_s)
            if asks:
                if count < len(rows):
                    rows[count, DUE_US] = due
                    rows[count, SERVICE] = service
                    rows[count, REQUIRED_US] = duration
                    rows[count, BANDWIDTH_BPS] = bandwidth
                count += 1
            if process == _ONCE:
                break
            if process == _ARRIVALS:
                due += gap
                elapsed = due
            else:
                due = gap if asks else due + gap
                elapsed += gap + (duration if asks else 0)
        offsets[episode, user + 1] = count - first
    return count


@kernel
def _exponential_us(uniform: float, mean_s: float) -> np.int64:
    """An exponential time; a last-bit difference of log between platforms ends in the rounding."""
    return np.int64(np.rint(-math.log1p(-uniform) * mean_s * 1e6))
