"""Users: each a SimPy process that asks, waits for the end of its request, thinks, asks again."""

from __future__ import annotations

from collections.abc import Generator

import simpy

from desim_uav.engine.des.agenda import Agenda
from desim_uav.engine.des.airlink import AirLink
from desim_uav.model.demand import Requests
from desim_uav.model.rules import Phase

Life = Generator[simpy.Event, None, None]


def start_asking(agenda: Agenda, airlink: AirLink, requests: Requests, horizon_us: int) -> None:
    """Start the request loops of all users who ask for something in this episode."""
    rows = requests.rows.tolist()
    offsets = requests.offsets.tolist()
    loop = _ask_and_think if requests.after_previous else _ask_on_arrival
    for user in range(len(offsets) - 1):
        own = rows[offsets[user] : offsets[user + 1]]
        if own:
            agenda.process(loop(agenda, airlink, user, own, horizon_us))


def _ask_and_think(
    agenda: Agenda, airlink: AirLink, user: int, rows: list[list[int]], horizon_us: int
) -> Life:
    """A closed loop: the next request comes a think time after the end of the one before."""
    end_us = agenda.now + horizon_us
    last = len(rows) - 1
    for k, (think_us, service, required_us, bandwidth_bps) in enumerate(rows):
        if agenda.now + think_us >= end_us:
            return
        yield agenda.at(agenda.now + think_us, Phase.REQUEST, user=user)
        request = airlink.ask(user, service, required_us, bandwidth_bps, think=k < last)
        if request.closed is not None:
            yield request.closed


def _ask_on_arrival(
    agenda: Agenda, airlink: AirLink, user: int, rows: list[list[int]], horizon_us: int
) -> Life:
    """An open loop: requests arrive at their times; those during an open one are dropped."""
    start_us = agenda.now
    for due_us, service, required_us, bandwidth_bps in rows:
        yield agenda.at(start_us + due_us, Phase.REQUEST, user=user)
        if airlink.open[user] is None:
            airlink.ask(user, service, required_us, bandwidth_bps, think=False)
        else:
            airlink.log.suppressed += 1
