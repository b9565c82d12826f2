"""Energy, wind, free flight and decisions by event against the simulator with fixed time steps.

It is that of ``convergence.py``, with random scenarios of each of these features.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from tests.verification.convergence import (
    COARSE_S,
    DTS_S,
    MEASURES,
    Scenarios,
    asked_by_event,
    energetic,
    slopes,
    windy,
)
from tests.verification.figure import Figure
from tests.verification.freely import freely, freely_by_event
from tests.verification.links import MEASURES as OF_LINKS
from tests.verification.links import linked_by_event

DECIDED = ("served_s", "qoe1", "qoe2", "qoe3", "decided_s")
"""What goes with ``dt`` if decisions are by event. Batteries at decisions converge faster. Rewards
are paid for users at an instant, so few scenarios are wrong at all: those in which a user comes or
goes within ``dt`` of a decision epoch."""


@dataclass(frozen=True)
class Flights:
    """Scenarios of a feature, and the measures whose errors have to go with ``dt``.

    ``soon`` are those for which few scenarios and coarse steps are enough: of two things that
    happen nearly at once, none is decided by which comes first.
    """

    scenarios: Scenarios
    seeds: range
    measures: Sequence[str] = MEASURES
    soon: Sequence[str] = ("qoe3",)
    few: int = 10

    def orders(self) -> list[Figure]:
        """Return the order of the error of each measure in ``dt``."""
        return list(slopes(self.seeds, 0.35, DTS_S, self.scenarios, self.measures))

    def quick_orders(self) -> list[Figure]:
        """Return the orders of what a few scenarios show, if there is anything."""
        if not self.soon:
            return []
        return list(slopes(self.seeds[: self.few], 0.35, COARSE_S, self.scenarios, self.soon))


ENERGY = Flights(energetic, range(24), ("battery_s",))
WIND = Flights(windy, range(24), soon=("qoe3", "battery_s"))
FREE = Flights(freely, range(20, 44))
BY_EVENT = Flights(asked_by_event, range(24), (*DECIDED, "gained"))
FREE_BY_EVENT = Flights(freely_by_event, range(20, 44), DECIDED, ("served_s", "qoe3"), few=16)
LINKS_BY_EVENT = Flights(linked_by_event, range(24), OF_LINKS, soon=())
"""Few scenarios at coarse steps show nothing: at 1 s the order of qoe3 is about 0.5 in 12 or 20."""
EVERY = {
    "energy": ENERGY,
    "wind": WIND,
    "free flight": FREE,
    "decisions by event": BY_EVENT,
    "free flight by event": FREE_BY_EVENT,
    "links by event": LINKS_BY_EVENT,
}


def figures(quick: bool = False) -> Iterator[Figure]:
    """The slope of the error over dt, log over log, for each feature."""
    for name, flights in EVERY.items():
        for figure in flights.quick_orders() if quick else flights.orders():
            yield replace(figure, what=f"{name}: {figure.what}")
