"""The services of a scenario as arrays and rows (see ``model.services``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.services import (
    COMPUTING,
    MOST_BPS,
    MOST_REQUIRED,
    NO_TERMS,
    PROCESSOR,
    SHARING,
    WAITING,
    Collecting,
    Service,
    Stage,
    Terms,
    collecting_of,
    terms_of,
)
from desim_uav.rowcode.kernels import rule
from desim_uav.rowcode.rows import Row, row

FEWEST_DRAWS = 2
"""Each request draws so many numbers at least, of which those that it does not need are 0."""


@row
class StageRow(Row):
    """A stage as a row (see ``Stage``), in which lists of values have numbers; -1: there is none.

    ``line`` is the number of the line of a drone in which a request stands in this stage, and
    ``up`` the band of that line.
    """

    line: int
    timed: int
    amount: int
    times: int
    per: int
    rate: int
    up: int
    scale: int


@rule
def drawn_amount(stage: StageRow, values: Any, first: int) -> int:
    """Return the amount of a stage, given the values that are drawn, from number ``first`` on."""
    amount: int = values[first + stage.amount]
    if stage.times >= 0:
        amount = amount * values[first + stage.times]
    if stage.scale > 1:
        amount = amount * stage.scale
    if stage.per > 1:  # a division takes as long as the rest
        amount = amount // stage.per
    return amount


@dataclass(frozen=True, eq=False)
class Catalogue:
    """The services of a scenario as arrays, with one row per service in the order of ``names``.

    ``share``: (services,), the cumulative probabilities of the mix. ``values``: (services, lists,
    longest), of which list k of service s has ``sizes[s, k]`` equally likely values; ``least`` and
    ``most`` (services, lists) are the range of what a demand model may ask for instead.
    ``stages[s]`` are the stages of service s, as the fields of a ``StageRow``, and
    ``collecting[s]`` says how its updates are kept, if sensors send them. ``offered`` has the
    services by name.
    """

    names: tuple[str, ...]
    share: NDArray[np.float64]
    sizes: NDArray[np.int64]
    values: NDArray[np.int64]
    least: NDArray[np.int64]
    most: NDArray[np.int64]
    stages: tuple[tuple[tuple[int, ...], ...], ...]
    terms: tuple[Terms, ...]
    collecting: tuple[Collecting | None, ...]
    offered: Mapping[str, Service]

    @property
    def draws(self) -> int:
        """The largest number of values that a request draws."""
        return int(self.sizes.shape[1])

    @property
    def has_volumes(self) -> tuple[bool, ...]:
        """Whether requests for each service ask for a volume in one of their stages."""
        return tuple(
            any(line != COMPUTING and not timed for line, timed, *_ in own) for own in self.stages
        )

    @property
    def has_tasks(self) -> bool:
        """Whether requests for a service are tasks (see ``is_task``)."""
        return self.computes or any(terms != NO_TERMS for terms in self.terms)

    @property
    def migrates(self) -> bool:
        """Whether tasks can move from one processor to another."""
        return any(terms.migrates for terms in self.terms)

    @property
    def computes(self) -> bool:
        """Whether a request can need a processor."""
        return any(line == COMPUTING for own in self.stages for line, *_ in own)

    @property
    def to_ground(self) -> bool:
        """Whether there are updates of sensors that are delivered at the ground."""
        return any(keeps is not None and keeps.ground for keeps in self.collecting)

    @property
    def several_stages(self) -> bool:
        """Whether there is a service of more than one stage."""
        return any(len(own) > 1 for own in self.stages)

    @property
    def first_stages(self) -> list[int]:
        """The number of the first stage of each service, and at last that of all stages."""
        return list(accumulate(map(len, self.stages), initial=0))


def catalogue(services: Mapping[str, Service], mix: Mapping[str, float]) -> Catalogue:
    """Return the services as arrays; ``mix`` maps their names to weights, which are normalised."""
    names = tuple(services)
    weights = np.array([mix.get(name, 0.0) for name in names])
    share = np.cumsum(weights / weights.sum())
    share[np.flatnonzero(weights)[-1] :] = 1.0
    none = [np.zeros(1, np.int64)]
    lists = [list(service.values().values()) for service in services.values()]
    lists = [own + none * (FEWEST_DRAWS - len(own)) for own in lists]
    sizes = np.zeros((len(names), max(map(len, lists))), np.int64)
    values = np.zeros((*sizes.shape, max(len(one) for own in lists for one in own)), np.int64)
    for s, own in enumerate(lists):
        for k, one in enumerate(own):
            sizes[s, k], values[s, k, : len(one)] = len(one), one
    stages = tuple(_stage_rows(service) for service in services.values())
    least, most = np.zeros_like(sizes), np.full_like(sizes, MOST_BPS)
    for s, rows in enumerate(stages):
        for _, _, amount, *_ in rows:
            least[s, amount] = len(rows) == 1
            most[s, amount] = MOST_REQUIRED
        for _, _, amount, times, *_, scale in rows:
            multiplied = [amount, times] if times >= 0 else [amount] * (scale > 1)
            most[s, multiplied] = values[s, multiplied].max(axis=1)
    terms = tuple(map(terms_of, services.values()))
    collecting = tuple(map(collecting_of, services.values()))
    return Catalogue(names, share, sizes, values, least, most, stages, terms, collecting, services)


def _stage_rows(service: Service) -> tuple[tuple[int, ...], ...]:
    """Return the stages of a service as the fields of rows."""
    number = {name: k for k, name in enumerate(service.values())}
    number[""] = -1
    return tuple(
        (
            _line(stage),
            int(stage.timed),
            number[stage.amount],
            number[stage.times or ""],
            stage.per,
            number[stage.rate or ""],
            int(stage.up),
            stage.scale,
        )
        for stage in service.stages()
    )


def _line(stage: Stage) -> int:
    """Return the line in which requests stand in a stage."""
    if stage.resource == PROCESSOR:
        return COMPUTING
    return SHARING if stage.rate is None else WAITING
