"""Users: each is a SimPy process. It asks, waits for the end of its request, thinks, asks again.

Who asks only once in an episode has nothing to wait for: that is a bare call.
"""

from __future__ import annotations

from itertools import pairwise

from desim_uav.engine.des.agenda import Agenda, Due, Life
from desim_uav.engine.des.airlink import REQUEST_KEY, AirLink
from desim_uav.model.demand import DUE_US, Requests

Row = list[int]
"""What a user will ask for: due_us or think_us, service, required_us, bandwidth_bps."""


def start_asking(agenda: Agenda, airlink: AirLink, requests: Requests, horizon_us: int) -> None:
    """Let each user begin who asks for something in this episode, with its first request."""
    rows, start_us = requests.rows.tolist(), agenda.now
    after_previous = requests.after_previous
    life = _ask_and_think if after_previous else _ask_on_arrival
    for user, (first, last) in enumerate(pairwise(requests.offsets.tolist())):
        own = rows[first:last]
        if not after_previous:
            own = [row for row in own if row[DUE_US] < horizon_us]
        if own and own[0][DUE_US] < horizon_us:
            first_us, place = start_us + own[0][DUE_US], REQUEST_KEY + user
            if len(own) == 1:
                agenda.call(_ask_once, (airlink, user, own[0]), first_us, place)
            else:
                due = agenda.at(first_us, place)
                agenda.process(life(agenda, airlink, user, own), begins=due)


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
