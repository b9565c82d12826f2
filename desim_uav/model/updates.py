"""Updates of sensors: when a sensor takes a measurement, which it then has to send."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Le

from desim_uav.model.catalogue import Catalogue
from desim_uav.model.demand.asking import Asker, Offer, RowDemand, ask_for_mix
from desim_uav.model.demand.demand import too_few
from desim_uav.model.demand.requests import DRAWN, Requests
from desim_uav.model.random.streams import Stream, Streams, exponential_us, uniform
from desim_uav.model.rules import US
from desim_uav.model.traces import LARGEST, index, quantity, read_table
from desim_uav.registry import register

Seconds = Annotated[float, Ge(0.001), Le(1e9)]
"""A time between two updates: at least a millisecond, so that time passes."""


@register("updates", "poisson")
@dataclass(frozen=True)
class PoissonUpdates(RowDemand):
    """A sensor's updates are a Poisson process."""

    mean_s: Seconds
    """The mean time between two updates, in seconds."""
    after_previous: ClassVar = False
    asks_from_lists = True

    def next_request(self, asker: Asker, stream: Stream, services: Offer) -> None:
        """Draw an update after an exponential time."""
        asker.wait_us = exponential_us(stream, self.mean_s)
        ask_for_mix(asker, stream, services, 0.0)

    def expected_draws(self, users: int, required_s: float, horizon_s: float) -> float:
        """Return the mean number of updates of all sensors in an episode."""
        return users * (1.0 + horizon_s / self.mean_s)

    def doubts(self, users: int, horizon_s: float) -> Iterator[str]:
        """Yield whether hardly any update is taken in an episode."""
        yield from too_few(users * horizon_s / self.mean_s)


@register("updates", "periodic")
@dataclass(frozen=True)
class PeriodicUpdates(RowDemand):
    """A sensor's updates are taken at equal intervals."""

    every_s: Seconds
    """The time between two updates, in seconds."""
    offset: Literal["uniform", 0] = "uniform"
    """When the first one is taken: at the time 0, or, if it is `uniform`, at a time within the
    first interval that is drawn for each sensor.
    """
    after_previous: ClassVar = False
    asks_from_lists = True

    every_us: int = field(init=False, repr=False, compare=False)
    first_us: int = field(init=False, repr=False, compare=False)
    """When the first one is taken; -1 if that is drawn."""

    def __post_init__(self) -> None:
        """Set the times in microseconds."""
        object.__setattr__(self, "every_us", round(self.every_s * US))
        object.__setattr__(self, "first_us", -1 if self.offset == "uniform" else 0)

    def next_request(self, asker: Asker, stream: Stream, services: Offer) -> None:
        """Draw the first update in the first interval, and then one after each interval."""
        asker.wait_us = self.every_us
        if asker.draws == 0:
            within = uniform(stream)
            asker.wait_us = self.first_us
            if self.first_us < 0:
                asker.wait_us = int(within * self.every_us)
        ask_for_mix(asker, stream, services, 0.0)

    def from_now(self, now_us: int) -> PeriodicUpdates:
        """Return the model as it goes on at a time; a time that was drawn is drawn anew."""
        later = replace(self)
        if self.first_us >= 0:
            object.__setattr__(later, "first_us", (self.first_us - now_us) % self.every_us)
        return later

    def expected_draws(self, users: int, required_s: float, horizon_s: float) -> float:
        """Return the number of updates of all sensors in an episode."""
        return users * (1.0 + horizon_s / self.every_s)

    def doubts(self, users: int, horizon_s: float) -> Iterator[str]:
        """Yield whether hardly any update is taken in an episode."""
        if self.offset == "uniform":
            yield from too_few(users * horizon_s / self.every_s)


@register("updates", "at_will")
@dataclass(frozen=True)
class UpdatesAtWill(RowDemand):
    """A sensor takes its next update when the last one has been delivered, or some time later."""

    wait_s: Annotated[float, Ge(0), Le(1e9)] = 0.0
    """The least time, in seconds, from the beginning of sending to the next update: when an update
    has been sent for a shorter time, the sensor waits for the rest of it.
    """
    asks_from_lists = True

    def next_request(self, asker: Asker, stream: Stream, services: Offer) -> None:
        """Draw an update that is taken as soon as it can be."""
        asker.wait_us = 0
        ask_for_mix(asker, stream, services, 0.0)

    @property
    def wait_us(self) -> int:
        """``wait_s`` in microseconds."""
        return round(self.wait_s * US)

    def expected_draws(self, users: int, required_s: float, horizon_s: float) -> float:
        """Return the largest number of updates that all sensors can send in an episode."""
        return users * (1.0 + horizon_s / max(required_s, 1e-6))


@register("updates", "trace")
@dataclass(frozen=True)
class UpdateTrace:
    """Takes the times of updates from a CSV file: user, t_s. Sizes are the service's first one."""

    file: Path
    """The CSV file, relative to the scenario's file. Users are counted from the group's first."""
    begin_s: Annotated[float, Ge(0), Le(LARGEST)] = 0.0
    """The time of the recording at which an episode begins, in seconds. Updates before it are left
    out, and so are those at or after the end of the episode.
    """
    draws: ClassVar = False

    def __post_init__(self) -> None:
        """Read the file. Raises ValueError with file and line if it is not such a table."""
        self._table()

    def problems(self, users: int, services: Sequence[str]) -> list[str]:
        """Return the problems of the file: users that the group does not have."""
        return [
            f"{self.file}:{line}: user: {user}: must be from 0 to {users - 1}"
            for user, _, line in self._table()
            if user >= users
        ]

    def expected_draws(self, users: int, required_s: float, horizon_s: float) -> float:
        """Return the number of recorded updates."""
        return len(self._table())

    def requests(
        self, users: int, services: Catalogue, streams: Streams, horizon_us: int
    ) -> Requests:
        """Return the recorded updates of an episode, which are the same in every episode."""
        (service,) = np.flatnonzero(np.diff(services.share, prepend=0.0))
        by_user: list[list[list[int]]] = [[] for _ in range(users)]
        own = services.values[service, :, 0].tolist()
        for user, t_s, _ in self._table():
            due_us = round(t_s * US) - round(self.begin_s * US)
            if 0 <= due_us < horizon_us:
                by_user[user].append([due_us, int(service), *own])
        rows = [row for each in by_user for row in sorted(each)]
        offsets = np.cumsum([0, *map(len, by_user)])
        width = DRAWN + services.draws
        return Requests(np.array(rows, np.int64).reshape(-1, width), offsets, after_previous=False)

    def doubts(self, users: int, horizon_s: float) -> Iterator[str]:
        """Yield how many updates an episode leaves out that lasts so long."""
        times_us = [round(t_s * US) - round(self.begin_s * US) for _, t_s, _ in self._table()]
        left_out = sum(not 0 <= due < round(horizon_s * US) for due in times_us)
        if left_out:
            yield f"{self.file}: {left_out} of {len(times_us)} updates are not within an episode"

    def _table(self) -> list[tuple[Any, ...]]:
        columns: dict[str, Callable[[str], Any]] = {"user": index, "t_s": quantity}
        return read_table(self.file, columns)
