"""Checks of services: whether their stages can be served, and their amounts be counted."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from desim_uav.model.admission import RowAdmission
from desim_uav.model.energy.battery import in_joules
from desim_uav.model.services import (
    LARGEST_UBIT,
    MOST_BPS,
    MOST_REQUIRED,
    PROCESSOR,
    Service,
    Stage,
    amount_of,
    computes,
    largest_product,
    problems_of,
    rates_bps,
    terms_of,
)
from desim_uav.registry import kind_name
from desim_uav.rowcode.components import works_on_rows
from desim_uav.scenario.finding import Finding
from desim_uav.scenario.processor import MOST_W, Processor
from desim_uav.scenario.schema import Scenario
from desim_uav.scenario.yaml12 import KeyPath


def stages_can_be_served(scenario: Scenario) -> Iterator[Finding]:
    """Services whose stages or values are none, or have amounts that cannot be counted."""
    for name, service in scenario.services.items():
        path, problems = ("services", name), problems_of(service)
        yield from (Finding(path, problem) for problem in problems)
        for number, stage in enumerate(() if problems else service.stages()):
            rates, (limit, unit) = rates_bps(service, stage), _limit_of(stage)
            if not 0 <= np.min(rates) <= np.max(rates) <= MOST_BPS:
                key = _key_of_list(name, service, stage.rate)
                yield Finding(key, f"in bit/s, it must be from 0 to {MOST_BPS:,}")
            problem = _of_amount(service, stage, limit, unit)
            if problem:
                key = _key_of_list(name, service, stage.amount)
                yield Finding(key, problem, (_key_of_list(name, service, stage.times),))
            elif number:
                alike = [one for one in service.stages() if _limit_of(one) == (limit, unit)]
                total = sum(amount_of(service, one).most for one in alike)
                if total > limit:
                    yield Finding(path, f"its stages need {total:,} {unit}, above {limit:,}")


def _of_amount(service: Service, stage: Stage, limit: int, unit: str) -> str:
    """Return why the amounts of a stage cannot be counted, or ""."""
    least, _, most = amount_of(service, stage)
    lowest, product = int(len(service.stages()) == 1), largest_product(service, stage)
    if most > limit and stage.times is not None:
        return f"times the largest of {stage.times}, it is {most:,} {unit}; at most {limit:,}"
    if not lowest <= least <= most <= limit:
        return f"in {unit}, it must be from {lowest} to {limit:,}"
    if product > MOST_REQUIRED:
        what = f"before it is divided by {stage.per:,}, its largest amount is {product:,}"
        return f"{what}; at most {MOST_REQUIRED:,}"
    return ""


def _limit_of(stage: Stage) -> tuple[int, str]:
    """Return the largest amount of a stage, and the unit in which it is measured."""
    if stage.resource == PROCESSOR:
        return MOST_REQUIRED, "thousandths of a cycle"
    if stage.timed:
        return MOST_REQUIRED, "microseconds"
    return LARGEST_UBIT, "millionths of a bit"


_NO_TASKS = "is for services that have tasks (kind: compute)"
_NOTHING = "computes nothing: no service has tasks (kind: compute)"


def tasks_find_processors(scenario: Scenario) -> Iterator[Finding]:
    """Drones and access points without a processor that a service needs, or with one for none."""
    needing = [
        name
        for name, service in scenario.services.items()
        if not problems_of(service) and computes(service)
    ]
    senders: list[tuple[KeyPath, Any]] = list(zip(scenario.fleet_keys, scenario.fleet, strict=True))
    senders += [(("access_points", k), one) for k, one in enumerate(scenario.access_points)]
    for key, sender in senders:
        if needing and sender.processor is None:
            yield Finding(
                (*key, "processor"),
                f"is needed by services.{needing[0]}, for example {{cores: 4, ghz: 2.5}}",
                (key, ("services", needing[0])),
            )
        elif sender.processor is not None and not needing:
            yield Finding((*key, "processor"), _NOTHING, (("services",),))
        elif sender.processor and sender.processor.clock < scenario.user_count:
            least = scenario.user_count / 1e6
            message = (
                f"must be at least {least:g}, so that {scenario.user_count} users can share it"
            )
            yield Finding((*key, "processor", "ghz"), message, (("users",),))


def backhauls_can_be_shared(scenario: Scenario) -> Iterator[Finding]:
    """Backhauls whose shares would be rounded down to none, or of which admission knows nothing."""
    senders: list[tuple[KeyPath, Any]] = list(zip(scenario.fleet_keys, scenario.fleet, strict=True))
    senders += [(("access_points", k), one) for k, one in enumerate(scenario.access_points)]
    for key, sender in senders:
        if sender.backhaul is None:
            continue
        if sender.backhaul.capacity_bps < scenario.user_count:
            least = scenario.user_count / 1000
            message = (
                f"must be at least {least:g}, so that {scenario.user_count} users can share it"
            )
            yield Finding((*key, "backhaul", "kbps"), message, (("users",),))
        admission = getattr(sender, "admission", scenario.fleet[0].admission)
        if not works_on_rows(admission, RowAdmission):
            yield Finding(
                (*key, "backhaul"),
                f"is for admission rules over rows (scan_rows); {kind_name(admission)} is told "
                "the free bandwidth only",
                ((*key, "admission"), (*scenario.fleet_keys[0], "admission")),
            )


def users_can_compute(scenario: Scenario) -> Iterator[Finding]:
    """Users who have to compute tasks themselves without a processor, or have one for nothing."""
    offloading = scenario.offloading
    groups = list(zip(scenario.user_keys, scenario.user_groups, strict=True))
    services = [one for one in scenario.services.values() if not problems_of(one)]
    if not any(map(computes, services)):
        for key, users in groups:
            if users.processor is not None:
                yield Finding((*key, "processor"), _NOTHING, (("services",),))
        if offloading != Scenario.model_fields["offloading"].default:
            yield Finding(("offloading",), _NO_TASKS, (("services",),))
    elif offloading.alone and all(users.processor is None for _, users in groups):
        yield Finding(
            (*groups[0][0], "processor"),
            f"is needed by offloading: {kind_name(offloading)}, for example {{ghz: 1.0}}",
            (("offloading",),),
        )


def tasks_are_paid_and_observed(scenario: Scenario) -> Iterator[Finding]:
    """Rewards for deadlines that no service has, and backlogs of processors without tasks."""
    services = [one for one in scenario.services.values() if not problems_of(one)]
    if getattr(scenario.reward, "deadline", 0.0) and all(
        terms_of(one).deadline_us is None for one in services
    ):
        message = "is for services that have a deadline_s"
        yield Finding(("reward", "deadline"), message, (("services",),))
    if getattr(scenario.observation, "backlog_s", 0.0) and not any(map(computes, services)):
        yield Finding(("observation", "backlog_s"), _NO_TASKS, (("services",),))


def processors_draw_from_energy(scenario: Scenario) -> Iterator[Finding]:
    """Powers of processors that are too large, or beside a battery that holds no energy."""
    for key, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        processor = drones.processor
        if processor is None:
            continue
        if in_joules(drones.battery):
            most_w = processor.most_uw / 1e6
            if most_w > MOST_W:
                yield Finding(
                    (*key, "processor"),
                    f"would draw {most_w:.4g} W if all cores were busy (kappa times the "
                    f"cube of the clock each, and electronics_w); at most {MOST_W:,.0f} W",
                )
            continue
        for name in ("kappa", "electronics_w"):
            if getattr(processor, name) != Processor.model_fields[name].default:
                yield Finding(
                    (*key, "processor", name),
                    "is for batteries that hold energy, for example battery: {kind: rotary_wing}",
                    ((*key, "battery"),),
                )


def _key_of_list(name: str, service: Service, values: str | None) -> KeyPath:
    """Return the key of a list of a service, or that of the service if its fields lack the list."""
    own = (values,) if values is not None and hasattr(service, values) else ()
    return ("services", name, *own)
