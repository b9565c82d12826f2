"""A group of users in a world: how its users walk and ask, each with a random stream of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.copies import Unchanging
from desim_uav.errors import SimulationError
from desim_uav.model.catalogue import Catalogue, catalogue
from desim_uav.model.demand.asking import RowDemand, RowDraws
from desim_uav.model.demand.demand import drawn_by, is_sensed, requests_of
from desim_uav.model.demand.requests import Requests
from desim_uav.model.mobility.mobility import Mobility, Static, walks_of
from desim_uav.model.mobility.streets import Streets
from desim_uav.model.mobility.walking import RowMobility, from_here
from desim_uav.model.mobility.walks import Area, Walks, in_rows
from desim_uav.model.random.streams import Purpose, Seeds, Streams, states_of
from desim_uav.model.rules import US
from desim_uav.rowcode.components import works_on_rows
from desim_uav.scenario.schema import Scenario
from desim_uav.scenario.users import Users
from desim_uav.scenario.yaml12 import KeyPath

APART = 2**24
"""The streams of a group's users begin so many numbers behind those of the group before it.

So they do not depend on how many users the other groups have.
"""


@dataclass(frozen=True, eq=False)
class UserGroup(Unchanging):
    """A group of users: it has a ``number`` in the list, and its users are those from ``first`` on.

    All users of a scenario without groups are one group.
    """

    scenario: Scenario
    number: int
    first: int

    @cached_property
    def keys(self) -> Users:
        """What the scenario says of the users."""
        return self.scenario.user_groups[self.number]

    @property
    def path(self) -> KeyPath:
        """The key of the group in the scenario."""
        return self.scenario.user_keys[self.number]

    @property
    def count(self) -> int:
        """The number of users."""
        return self.keys.count

    @cached_property
    def users(self) -> slice:
        """The numbers of the users."""
        return slice(self.first, self.first + self.count)

    @property
    def first_stream(self) -> int:
        """The number of the first user's random streams."""
        return APART * self.number

    @property
    def mobility(self) -> Mobility:
        """How the users move."""
        return self.keys.mobility

    @cached_property
    def demand(self) -> Any:
        """When the users make requests, and for which services."""
        return self.scenario.demands[self.number]

    @cached_property
    def law(self) -> Any:
        """What draws the users' requests: their demand, or the updates that sensors send."""
        return drawn_by(self.demand, self.scenario.services)

    @cached_property
    def services(self) -> Catalogue:
        """The services as arrays, with the probabilities of the demand's mix."""
        offered = self.scenario.services
        return catalogue(offered, getattr(self.demand, "mix", dict.fromkeys(offered, 1.0)))

    def states(self, purpose: Purpose, seed: Seeds, episodes: Sequence[int]) -> NDArray[np.uint64]:
        """Return the initial states of the users' random streams: (episodes, users, 4)."""
        return states_of(seed, purpose, episodes, self.count, self.first_stream)

    @property
    def senses(self) -> int:
        """The number of the service whose updates the users send as sensors; -1 if they do not."""
        names = self.services.names
        return names.index(self.demand.service) if is_sensed(self.demand) else -1

    @cached_property
    def _horizon_us(self) -> int:
        """The length of an episode, in microseconds."""
        return round(self.scenario.episode.step_s * US) * self.scenario.episode.steps

    @property
    def _area(self) -> Area:
        """The size of the map."""
        return Area(*self.scenario.map.size_m)

    def walks_of(
        self, homes: NDArray[np.float64], seed: Seeds, episodes: Sequence[int]
    ) -> Sequence[Walks]:
        """Draw the users' walks in several episodes; ``homes`` (users, 2) are those of all users.

        ``seed`` is that of all episodes, or a sequence with that of each.
        """
        own = np.ascontiguousarray(homes[self.users])
        drawn = (own, seed, episodes, self._area, self._horizon_us, self.first_stream)
        with self._named():
            return [walks.drawn() for walks in walks_of(self.mobility, *drawn)]

    def onward(self, at_m: NDArray[np.float64], streams: Streams) -> Walks:
        """Draw how the users walk on from where they are; ``at_m`` (users, 2) has all users.

        Nobody knows how recorded walks go on, so whose walks are not drawn stand still.
        """
        own = np.ascontiguousarray(at_m[self.users])
        if not getattr(self.mobility, "draws", True):
            return Static().walks(own, streams, self._area, self._horizon_us)
        begun, model = streams.beginning(self.first_stream), from_here(self.mobility)
        return in_rows(model.walks(own, begun, self._area, self._horizon_us))

    def requests_of(self, seed: Seeds, episodes: Sequence[int]) -> Sequence[Requests]:
        """Draw the users' requests in several episodes at once."""
        drawn = (seed, episodes, self._horizon_us, self.first_stream)
        with self._named():
            if self._row_draws is not None:
                return self._row_draws.of(self.states(Purpose.DEMAND, seed, episodes))
            return requests_of(self.law, self.count, self.services, *drawn)

    @cached_property
    def _row_draws(self) -> RowDraws | None:
        """The draws of a demand over rows."""
        if not works_on_rows(self.law, RowDemand):
            return None
        # What users compute themselves is sent nowhere, so that no rate bounds its time.
        alone = self.services.computes and self.scenario.offloading.alone
        most_bps = 0 if alone else self.scenario.most_bps
        return RowDraws(self.law, self.services, self._horizon_us, most_bps)

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Name the group in errors, if it has a name; users are counted from its first one."""
        names = self.scenario.group_names
        try:
            yield
        except SimulationError as error:
            if not names:
                raise
            raise SimulationError(f"group {names[self.number]!r}: {error}") from error


def groups_of(scenario: Scenario) -> tuple[UserGroup, ...]:
    """Return the groups of users, in the order of the scenario."""
    counts = [users.count for users in scenario.user_groups]
    firsts = accumulate(counts[:-1], initial=0)
    return tuple(UserGroup(scenario, number, first) for number, first in enumerate(firsts))


def shared_mobility(groups: Sequence[UserGroup]) -> Mobility | None:
    """Return the mobility by which the users of all groups can be walked together, or None.

    It is one for all, and where a user begins does not depend on other users, unless there is one
    group only.
    """
    first, *others = (group.mobility for group in groups)
    if not others:
        return first
    alone = getattr(type(first), "begin", None) is RowMobility.begin
    return first if alone and all(other == first for other in others) else None


def _street_files(scenario: Scenario) -> Iterator[Streets]:
    """Yield how the users of each group move who go along streets."""
    for keys in scenario.user_groups:
        if isinstance(keys.mobility, Streets):
            yield keys.mobility


def streets_of(scenario: Scenario) -> list[tuple[tuple[float, float], ...]]:
    """Return the streets along which users of any group go, as lines of points in metres."""
    return sorted({line for streets in _street_files(scenario) for line in streets.lines()})


def whose_streets(scenario: Scenario) -> list[str]:
    """Return the attributions of the files that have these streets."""
    return [streets.attribution for streets in _street_files(scenario)]
