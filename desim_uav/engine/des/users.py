"""Users: each who may ask more than once is a SimPy process: it asks, waits, thinks, asks again."""

from __future__ import annotations

from itertools import pairwise

from desim_uav.engine.des.agenda import Agenda, Due, Life, key
from desim_uav.engine.des.airlink import AirLink
from desim_uav.model.demand import Requests
from desim_uav.model.rules import Phase

Ask = tuple[int, int, int, int]
"""(user, service, required_us, bandwidth_bps)."""


def start_asking(agenda: Agenda, airlink: AirLink, requests: Requests, horizon_us: int) -> None:
    """Let all users begin who ask for something in this episode."""
    rows = requests.rows.tolist()
    offsets = requests.offsets.tolist()
    own_rows = [rows[first:last] for first, last in pairwise(offsets)]
    if requests.after_previous and max(map(len, own_rows)) <= 1:
        _ask_once(agenda, airlink, own_rows, horizon_us)
        return
    loop = _ask_and_think if requests.after_previous else _ask_on_arrival
    for user, own in enumerate(own_rows):
        if own:
            agenda.process(loop(agenda, airlink, user, own, horizon_us))


def _ask_once(
    agenda: Agenda, airlink: AirLink, own_rows: list[list[list[int]]], horizon_us: int
) -> None:
    """Nobody asks twice: that takes no process. Those who ask at one instant do so in one call."""
    asks: dict[int, list[Ask]] = {}
    for user, own in enumerate(own_rows):
        for due_us, service, required_us, bandwidth_bps in own:
            if due_us < horizon_us:
                asks.setdefault(due_us, []).append((user, service, required_us, bandwidth_bps))

    def ask(at_once: list[Ask]) -> None:
        for user, service, required_us, bandwidth_bps in at_once:
            airlink.ask(user, service, required_us, bandwidth_bps)

    for due_us, at_once in asks.items():
        agenda.call(ask, at_once, agenda.now + due_us, key(Phase.REQUEST))


def _ask_and_think(
    agenda: Agenda, airlink: AirLink, user: int, rows: list[list[int]], horizon_us: int
) -> Life:
    """A closed loop: the next request comes a think time after the end of the one before."""
    end_us = agenda.now + horizon_us
    think_us, *_ = rows[0]
    if agenda.now + think_us >= end_us:
        return
    yield agenda.at(agenda.now + think_us, Phase.REQUEST, user=user)
    for (_, service, required_us, bandwidth_bps), (think_us, *_) in pairwise(rows):
        again = Due()
        airlink.ask(user, service, required_us, bandwidth_bps, think_us, again)
        yield again
    _, service, required_us, bandwidth_bps = rows[-1]
    airlink.ask(user, service, required_us, bandwidth_bps)


def _ask_on_arrival(
    agenda: Agenda, airlink: AirLink, user: int, rows: list[list[int]], horizon_us: int
) -> Life:
    """An open loop: requests arrive at their times; those during an open one are dropped."""
    start_us = agenda.now
    for due_us, service, required_us, bandwidth_bps in rows:
        yield agenda.at(start_us + due_us, Phase.REQUEST, user=user)
        if airlink.open[user] is None:
            airlink.ask(user, service, required_us, bandwidth_bps)
        else:
            airlink.log.suppressed += 1
