"""Checks of services: whether their stages can be served, and their amounts be counted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from desim_uav.model.services import (
    LARGEST_UBIT,
    MOST_BPS,
    MOST_REQUIRED,
    Service,
    amount_of,
    problems_of,
    rates_bps,
)
from desim_uav.scenario.finding import Finding
from desim_uav.scenario.schema import Scenario
from desim_uav.scenario.yaml12 import KeyPath


def stages_can_be_served(scenario: Scenario) -> Iterator[Finding]:
    """Services whose stages or values are none, or have amounts that cannot be counted."""
    for name, service in scenario.services.items():
        path, problems = ("services", name), problems_of(service)
        yield from (Finding(path, problem) for problem in problems)
        for number, stage in enumerate(() if problems else service.stages()):
            rates, (least, _, most) = rates_bps(service, stage), amount_of(service, stage)
            if not 0 <= np.min(rates) <= np.max(rates) <= MOST_BPS:
                key = _key_of_list(name, service, stage.rate)
                yield Finding(key, f"in bit/s, it must be from 0 to {MOST_BPS:,}")
            limit = MOST_REQUIRED if stage.timed else LARGEST_UBIT
            unit = "microseconds" if stage.timed else "millionths of a bit"
            lowest = int(len(service.stages()) == 1)
            if not lowest <= least <= most <= limit:
                key = _key_of_list(name, service, stage.amount)
                yield Finding(key, f"in {unit}, it must be from {lowest} to {limit:,}")
            elif number:
                alike = [one for one in service.stages() if one.timed == stage.timed]
                total = sum(amount_of(service, one).most for one in alike)
                if total > limit:
                    yield Finding(path, f"its stages need {total:,} {unit}, above {limit:,}")


def _key_of_list(name: str, service: Service, values: str | None) -> KeyPath:
    """Return the key of a list of a service, or that of the service if its fields lack the list."""
    own = (values,) if values is not None and hasattr(service, values) else ()
    return ("services", name, *own)
