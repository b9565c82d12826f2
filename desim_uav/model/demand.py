"""Demand: when users make requests and for which service, with at most one open per user."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, Protocol

import numpy as np
from annotated_types import Ge, Le
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
    """All users' requests in one episode: rows of DUE_US SERVICE REQUIRED_US BANDWIDTH_BPS.

    The rows of user u are ``offsets[u]:offsets[u + 1]``. If ``after_previous`` is true, DUE_US
    counts from the end of the user's previous request, and for the first request from the start of
    the episode. Otherwise DUE_US is the time of an arrival, which is dropped while another request
    of that user is open.
    """

    rows: NDArray[np.int64]
    offsets: NDArray[np.int64]
    after_previous: bool


class ManyRequests(Sequence[Requests]):
    """The requests of several episodes in one table.

    The rows of episode k are ``begins[k]:begins[k + 1]``. ``offsets`` (episodes, users + 1) count
    from the beginning of each episode's rows.
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
        """Return the requests of episode k of the table."""
        own, begin = self.offsets[k], self.begins[k]
        return Requests(self.rows[begin : begin + own[-1]], own, self.after_previous)


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


Weight = Annotated[float, Ge(0)]
Nothing = Annotated[float, Ge(0), Le(0.999)]
"""The probability that a draw asks for nothing: rarely enough that the draws come to an end."""

SHORTEST_S, LONGEST_S = 0.001, 1e9
"""Think times are at least a millisecond on average, so that time passes from draw to draw."""

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
        """The number of requests of all users in an episode."""
        return users


class _Drawn(ABC):
    """A demand that a compiled loop draws, with one random stream per user."""

    @abstractmethod
    def law(self) -> tuple[int, float, float]:
        """Return the kind of process, the probability of no request, and a mean time in seconds."""

    def requests(
        self, users: int, services: Catalogue, streams: Streams, horizon_us: int
    ) -> Requests:
        """Return the requests of one episode."""
        states = streams.states(users)[np.newaxis]
        drawn: Requests = _drawn(services, states, *self.law(), horizon_us)[0]
        return drawn

    def expected_draws(self, users: int, required_s: float, horizon_s: float) -> float:
        """How often all users draw in an episode, for a request of ``required_s`` or for nothing.

        A drawn request may never be made: users wait until the one before has been served.
        """
        process, none, mean_s = self.law()
        if process == _ONCE:
            return users
        each_s = mean_s if process == _ARRIVALS else mean_s + (1.0 - none) * required_s
        return users * (1.0 + horizon_s / each_s)


@register("demand", "static")
@dataclass(frozen=True)
class Static(_Drawn):
    """Each user makes one request at the start, for a service drawn from the mix.

    ``none``: the probability that it asks for nothing.
    """

    none: Annotated[float, Ge(0), Le(1)] = 0.0
    """The probability that a user asks for nothing."""
    mix: dict[str, Weight] = field(default_factory=PAPER_MIX.copy)
    """The weight of each service. Weights are normalised; a service that is not named has
    none.
    """

    def law(self) -> tuple[int, float, float]:
        """Return the parameters of at most one request per user."""
        return _ONCE, self.none, 0.0


@register("demand", "dynamic")
@dataclass(frozen=True)
class Dynamic(_Drawn):
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
    mix: dict[str, Weight] = field(default_factory=PAPER_MIX.copy)
    """The weight of each service. Weights are normalised; a service that is not named has
    none.
    """

    def law(self) -> tuple[int, float, float]:
        """Return the parameters of requests that follow each other until the horizon."""
        return _CHAIN, self.none, self.think_time_s


@register("demand", "poisson")
@dataclass(frozen=True)
class Poisson(_Drawn):
    """Each user's requests arrive as a Poisson process.

    An arrival during an open request of the same user is dropped.
    """

    rate_per_hour: Annotated[float, Ge(1e-6), Le(1e6)]
    """The mean number of arrivals per user and hour."""
    none: Nothing = 0.0
    """The probability that an arrival is no request."""
    mix: dict[str, Weight] = field(default_factory=PAPER_MIX.copy)
    """The weight of each service. Weights are normalised; a service that is not named has
    none.
    """

    def law(self) -> tuple[int, float, float]:
        """Return the parameters of arrivals before the horizon."""
        return _ARRIVALS, self.none, 3600.0 / self.rate_per_hour


@register("demand", "trace")
@dataclass(frozen=True)
class Trace:
    """Takes requests from a CSV file: user, t_s, service, required_s, bandwidth_kbps."""

    file: Path
    """The CSV file, relative to the scenario's file."""
    draws: ClassVar = False

    def __post_init__(self) -> None:
        """Read the file. Raises ValueError with file and line if it is not such a table."""
        for *_, required_s, _, line in self._table():
            if round(required_s * US) < 1:
                raise ValueError(f"{self.file}:{line}: required_s: must be above 0")

    def problems(self, users: int, services: Sequence[str]) -> list[str]:
        """Return the problems of the file: users or services that the scenario does not have."""
        found = []
        for user, _, service, _, _, line in self._table():
            if user >= users:
                found.append(f"{self.file}:{line}: user: {user}: must be from 0 to {users - 1}")
            if service not in services:
                hint = did_you_mean(service, services)
                found.append(
                    f"{self.file}:{line}: service: {service!r}: unknown{hint}; "
                    f"allowed: {', '.join(services)}"
                )
        return found

    def expected_draws(self, users: int, required_s: float, horizon_s: float) -> float:
        """The number of recorded requests."""
        return len(self._table())

    def requests(
        self, users: int, services: Catalogue, streams: Streams, horizon_us: int
    ) -> Requests:
        """Return the recorded requests before the horizon, which are the same in every episode."""
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
    """Draw the requests of several episodes."""
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
    """Write all users' requests, episode by episode, and return their number.

    ``offsets`` (episodes, users + 1) count from the beginning of each episode. Requests that do
    not fit into ``rows`` are counted but not written. Each draw takes five uniform numbers, of
    which some may not be used: for whether there is a request, for service, duration and
    bandwidth, and for the time to the next draw.
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
    """Return an exponential time; rounding hides last-bit differences of log between platforms."""
    return np.int64(np.rint(-math.log1p(-uniform) * mean_s * 1e6))
