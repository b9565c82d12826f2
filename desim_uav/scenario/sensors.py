"""Checks of sensors: whether they find their service, and nobody else asks for it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice

from desim_uav.errors import did_you_mean
from desim_uav.model.demand.demand import drawn_by, is_sensed
from desim_uav.model.services import collecting_of
from desim_uav.scenario.components import place_of_problem
from desim_uav.scenario.finding import Finding
from desim_uav.scenario.schema import Scenario

MOST_PROBLEMS = 10
"""How many problems of a recording are reported."""


def sensors_find_their_service(scenario: Scenario) -> Iterator[Finding]:
    """Sensors without a service whose updates they send, and updates that do not fit the users."""
    collects = _collecting(scenario)
    for key, demand, counts in scenario.asking:
        if not is_sensed(demand):
            continue
        path, name = (*key, "service"), demand.service  # type: ignore[attr-defined]
        if name in collects:
            law = drawn_by(demand, scenario.services)
            problems = getattr(law, "problems", None)
            own = problems(min(counts), collects) if problems else []
            where = ("services", name, "updates", *place_of_problem(law))
            yield from (Finding(where, one, (path,)) for one in islice(own, MOST_PROBLEMS))
        elif name in scenario.services:
            yield Finding(
                path, "is not of kind collect, so that it has no updates", (("services",),)
            )
        else:
            allowed = ", ".join(collects) or "the scenario has none of kind collect"
            hint = did_you_mean(name, collects)
            yield Finding(path, f"no such service{hint}; allowed: {allowed}", (("services",),))


def only_sensors_send_updates(scenario: Scenario) -> Iterator[Finding]:
    """Demands of users who are no sensors, in whose mix there is a service that collects."""
    collects = _collecting(scenario)
    for key, demand, _ in scenario.asking:
        mix = getattr(demand, "mix", None)
        if is_sensed(demand) or not isinstance(mix, Mapping):
            continue
        for name in collects:
            if mix.get(name, 0.0) > 0.0:
                yield Finding(
                    (*key, "mix", name),
                    "its updates are for users whose demand is sensing: write "
                    f"{{kind: sensing, service: {name}}}",
                    (("services", name),),
                )


def _collecting(scenario: Scenario) -> list[str]:
    """Return the names of the services whose updates sensors send."""
    return [name for name, one in scenario.services.items() if collecting_of(one) is not None]
