"""Services of one's own whose stages or values are wrong are refused, with the reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from desim_uav.errors import ScenarioError
from desim_uav.model.services import Stage, amount_of, problems_of
from desim_uav.scenario.load import from_mapping
from tests.staged import Survey

TIMES = Stage("lasts", rate="takes", timed=True)
STAGES: dict[str, tuple[Stage, ...]] = {
    "none": (),
    "unknown": (Stage("last", rate="takes", timed=True),),
    "cloud": (Stage("lasts", rate="takes", timed=True, resource="cloud"),),
    "timed": (Stage("lasts", rate="takes", timed=True, resource="processor"),),
    "up": (Stage("lasts", up=True, resource="processor"),),
    "scale": (Stage("lasts", scale=0, resource="processor"),),
    "no rate": (Stage("lasts", timed=True),),
    "per": (Stage("lasts", rate="takes", per=0),),
    "empty": (Stage("void", rate="takes"),),
    "nothing": (Stage("zero", rate="takes"), Stage("zero", rate="takes")),
    "below": (Stage("negative", rate="takes", timed=True), TIMES),
    "above": (TIMES, Stage("huge", rate="takes", timed=True)),
    "together": (Stage("large", rate="takes", timed=True),) * 2,
}


@dataclass(frozen=True)
class Odd:
    """A service with one of these tuples of stages."""

    which: str = "none"

    def values(self) -> dict[str, Any]:
        lists = {"lasts": [5, 9], "takes": [1000], "zero": [0], "negative": [-1]}
        lists |= {"huge": [2**62 + 1], "large": [2**61 + 1]}
        lists |= {"void": []} if self.which == "empty" else {}
        return {name: np.array(values, np.int64) for name, values in lists.items()}

    def stages(self) -> tuple[Stage, ...]:
        return STAGES[self.which]


@pytest.mark.parametrize(
    ("which", "problem"),
    [
        ("none", "stages must have at least one stage"),
        ("unknown", "stages: 0: amount: 'last' must be one of lasts, takes"),
        ("cloud", "stages: 0: resource: 'cloud' must be one of link, processor"),
        ("timed", "stages: 0: a processor has neither timed nor up nor a rate"),
        ("up", "stages: 0: a processor has neither timed nor up nor a rate"),
        ("scale", "stages: 0: scale: 0 must be at least 1"),
        ("no rate", "stages: 0: needs a rate, because its amount is a time"),
        ("per", "stages: 0: per: 0 must be at least 1"),
        ("empty", "values: 'void' is empty"),
        ("nothing", "stages: one of them must always have an amount above 0"),
        ("below", "in microseconds, it must be from 0 to 4,611,686,018,427,387,904"),
        ("above", "in microseconds, it must be from 0 to 4,611,686,018,427,387,904"),
        ("together", "its stages need 4,611,686,018,427,387,906 microseconds, above"),
    ],
)
def test_what_cannot_be_served_is_refused(which: str, problem: str) -> None:
    mapping = {"services": {"odd": {"kind": f"{__name__}:Odd", "which": which}}}
    with pytest.raises(ScenarioError) as refused:
        from_mapping({**mapping, "demand": {"mix": {"odd": 1}}})
    assert f'services.odd: {{"kind": "{__name__}:Odd", "which": "{which}"}}: {problem}' in str(
        refused.value
    )


def test_amounts_are_products_of_drawn_values() -> None:
    service = Survey(duration_s=(10.0, 30.0), bit_min=(60, 120))
    _, sent, _ = service.stages()
    assert problems_of(service) == []
    assert amount_of(service, sent) == (10**7, 3e7, 6 * 10**7)


@pytest.mark.parametrize(
    ("demand", "problem"),
    [
        ({"kind": "continuous"}, "asks for the whole episode; the first service, rounds, asks for"),
        ({"kind": "static", "mix": {"rounds": 1}}, None),
    ],
)
def test_demand_for_one_time_has_no_stages(demand: dict[str, Any], problem: str | None) -> None:
    mapping = {"services": {"rounds": {"kind": "tests.staged:Rounds"}}, "demand": demand}
    if problem is None:
        assert from_mapping(mapping).services
    else:
        with pytest.raises(ScenarioError, match=f"{problem} several times"):
            from_mapping(mapping)
