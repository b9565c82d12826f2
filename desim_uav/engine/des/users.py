"""Users: each is a SimPy process. It asks, waits for the end of its request, thinks, asks again.

Who asks only once in an episode has nothing to wait for: that is a bare call.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from desim_uav.engine.des.agenda import Agenda, Due, Life
from desim_uav.engine.des.airlink import REQUEST_KEY, AirLink
from desim_uav.model.demand import DUE_US, Requests

Row = list[int]
"""What a user will ask for: due_us or think_us, service, required_us, bandwidth_bps."""


class Users:
    """Lets users ask; what they ask for is read once where all episodes have the same requests."""

    def __init__(self, horizon_us: int) -> None:
        self.horizon_us = horizon_us
        self._requests: Requests | None = None
        self._asking: list[tuple[int, list[Row]]] = []

    def start(self, agenda: Agenda, airlink: AirLink, requests: Requests) -> None:
        """Let each user begin who asks for something in this episode, with its first request."""
        if requests is not self._requests:
            self._requests, self._asking = requests, list(self._who_asks(requests))
        start_us, life = agenda.now, _ask_and_think if requests.after_previous else _ask_on_arrival
        for user, own in self._asking:
            first_us, place = start_us + own[0][DUE_US], REQUEST_KEY + user
            if len(own) == 1:
                agenda.call(_ask_once, (airlink, user, own[0]), first_us, place)
            else:
                due = agenda.at(first_us, place)
                agenda.process(life(agenda, airlink, user, own), begins=due)

    def _who_asks(self, requests: Requests) -> Iterator[tuple[int, list[Row]]]:
        """Each user who asks for something before the horizon, and for what."""
        rows = requests.rows.tolist()
        for user, (first, last) in enumerate(pairwise(requests.offsets.tolist())):
            own = rows[first:last]
            if not requests.after_previous:
                own = [row for row in own if row[DUE_US] < self.horizon_us]
            if own and own[0][DUE_US] < self.horizon_us:
                yield user, own


def _ask_once(asked: tuple[AirLink, int, Row]) -> None:
    airlink, user, (_, service, required_us, bandwidth_bps) = asked
    airlink.ask(user, service, required_us, bandwidth_bps)


def _ask_and_think(agenda: Agenda, airlink: AirLink, user: int, rows: list[Row]) -> Life:
    """A closed loop: the next request comes a think time after the end of the one before."""
    for (_, service, required_us, bandwidth_bps), (think_us, *_) in pairwise(rows):
        again = Due()
        airlink.ask(user, service, required_us, bandwidth_bps, think_us, again)
        yield again
    _, service, required_us, bandwidth_bps = rows[-1]
    airlink.ask(user, service, required_us, bandwidth_bps)


def _ask_on_arrival(agenda: Agenda, airlink: AirLink, user: int, rows: list[Row]) -> Life:
    """An open loop: requests arrive at their times; those during an open one are dropped.

    The next arrival is on the agenda before one is dealt with: admissions of an instant come after
    all its arrivals.
    """
    start_us, place = agenda.now - rows[0][0], REQUEST_KEY + user
    for row, (next_us, *_) in pairwise(rows):
        arrival = agenda.at(start_us + next_us, place)
        _ask_if_idle(airlink, user, row)
        yield arrival
    _ask_if_idle(airlink, user, rows[-1])


def _ask_if_idle(airlink: AirLink, user: int, row: Row) -> None:
    if airlink.open[user] is None:
        _, service, required_us, bandwidth_bps = row
        airlink.ask(user, service, required_us, bandwidth_bps)
    else:
        airlink.log.suppressed += 1
