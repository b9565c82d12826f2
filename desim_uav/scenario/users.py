"""What a scenario says of the users, or of each group of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, NamedTuple, Self

from pydantic import Field, ValidationInfo, model_validator

from desim_uav.model.demand.demand import Demand
from desim_uav.model.mobility.mobility import Mobility, RandomWalk
from desim_uav.scenario.components import errors, strictly
from desim_uav.scenario.fields import Name, Point, RadiusRange
from desim_uav.scenario.named import named_items
from desim_uav.scenario.processor import UserProcessor
from desim_uav.scenario.section import Section
from desim_uav.scenario.slots import DEMAND, MOBILITY
from desim_uav.scenario.yaml12 import KeyPath

MOST_USERS, MOST_GROUPS = 1_000_000, 100
"""The largest number of users, and of groups of them."""


class Clusters(Section):
    """Where users live: how many clusters, and the range of their radii."""

    count: Annotated[int, Field(ge=1, le=10_000)] = 4
    """The number of clusters."""
    radius_m: RadiusRange = (240.0, 480.0)
    """The range from which the radius of each cluster is drawn, in metres. The default is for a
    map of 2400 m; it is scaled with the shorter side of the map.
    """


class Users(Section):
    """The users: drawn around clusters, or at given positions, and how they move."""

    later: ClassVar = ("processor",)

    count: Annotated[int, Field(ge=1, le=MOST_USERS)] = 48
    """The number of users."""
    clusters: Clusters | None = Clusters()
    """The clusters around which users live; null only beside `positions_m`."""
    positions_m: Annotated[tuple[Point, ...], Field(min_length=1)] | None = None
    """The home [x, y] of each user, in metres. It replaces `count` and `clusters`."""
    max_height_m: Annotated[float, Field(ge=0, le=1e4)] = 9.0
    """The greatest height of a user in a cell with a building, in metres."""
    mobility: Annotated[Mobility, MOBILITY] = RandomWalk()
    """How users move."""
    processor: UserProcessor | None = None
    """What each user computes tasks with that it does not offload; null means nothing."""

    @model_validator(mode="after")
    def _positions_decide(self) -> Users:
        if self.positions_m is None:
            if self.clusters is None:
                raise errors([(("clusters",), "may be null only beside positions_m", None)])
            return self
        problems: list[tuple[KeyPath, str, object]] = []
        if "count" in self.model_fields_set:
            problems.append((("count",), "not beside positions_m, which counts", self.count))
        if "clusters" in self.model_fields_set and self.clusters is not None:
            problems.append((("clusters",), "not beside positions_m", self.clusters))
        if problems:
            raise errors(problems)
        self._settle(count=len(self.positions_m), clusters=None)
        return self

    def on_map(self, share: float) -> Self:
        """Return these users with the default radii of clusters times ``share``."""
        clusters = self.clusters
        if clusters is None or "radius_m" in clusters.model_fields_set:
            return self
        low, high = clusters.radius_m
        return self._with(clusters=clusters._with(radius_m=(share * low, share * high)))


class NamedUsers(Users):
    """A group of users, if there are several of them: its name, and the keys of `users`."""

    name: Name
    """The name of the group, which no other group has."""
    demand: Annotated[Demand, DEMAND] | None = None
    """When the users of the group make requests, and for which services; null means as the key
    `demand` of the scenario says.
    """


class Asking(NamedTuple):
    """A demand, its key, and the number of users of each group that asks by it."""

    key: KeyPath
    demand: Demand
    counts: tuple[int, ...]


Groups = Annotated[tuple[NamedUsers, ...], Field(min_length=1, max_length=MOST_GROUPS)]


def as_groups(value: object, info: ValidationInfo) -> Any:
    """Return the users, or the groups of them, that a mapping or a list of mappings says."""
    if isinstance(value, Users | tuple):
        return value
    if isinstance(value, Mapping):
        return strictly(Users, dict(value), info.context)
    if not isinstance(value, list):
        raise ValueError("must be a mapping, or a list of mappings, one for each group of users")
    groups: tuple[NamedUsers, ...] = strictly(Groups, value, info.context)
    return named_items(groups, "users", MOST_USERS)
