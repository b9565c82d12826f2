"""Users: each asks, waits for the end of its request, thinks, and asks again."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

from desim_uav.engine.des.agenda import Agenda, key
from desim_uav.engine.des.airlink import AirLink
from desim_uav.model.demand import Requests
from desim_uav.model.rules import Phase

REQUEST_KEY = key(Phase.REQUEST, user=0)


class Users:
    """All users who ask for something in an episode.

    ``ahead`` holds what each of them will still ask for, (due_us, service, required_us,
    bandwidth_bps), the next one last.
    """

    def __init__(
        self, agenda: Agenda, airlink: AirLink, requests: Requests, horizon_us: int
    ) -> None:
        self.agenda = agenda
        self.airlink = airlink
        self.end_us = agenda.now + horizon_us
        self.start_us = agenda.now
        rows = requests.rows[::-1].tolist()
        ends = (len(rows) - requests.offsets).tolist()
        self.ahead = [rows[last:first] for first, last in pairwise(ends)]
        self.after_previous = requests.after_previous

    def start(self) -> None:
        """Let all users begin; those of a closed loop who ask at once do so in one call."""
        loop = self._ask_and_think if self.after_previous else self._ask_on_arrival
        at_once = []
        for user, ahead in enumerate(self.ahead):
            if ahead:
                due_us = ahead[-1][0]
                if due_us == 0 and self.after_previous:
                    at_once.append(user)
                else:
                    self._ask_at(self.start_us + due_us, user, loop)
        if at_once:
            self.agenda.call(self._ask_at_once, at_once, self.start_us, REQUEST_KEY)

    def _ask_at(self, t_us: int, user: int, loop: Callable[[int], None]) -> None:
        if t_us < self.end_us:
            self.agenda.call(loop, user, t_us, REQUEST_KEY + user)

    def _ask_at_once(self, users: list[int]) -> None:
        for user in users:
            self._ask(user)
        self.airlink.settle_asked()

    def _ask_and_think(self, user: int) -> None:
        """A closed loop: the next request comes a think time after the end of the one before."""
        self._ask(user)
        self.airlink.settle_asked()

    def _ask(self, user: int) -> None:
        ahead = self.ahead[user]
        _, service, required_us, bandwidth_bps = ahead.pop()
        if ahead:
            think_us = ahead[-1][0]
            self.airlink.ask(
                user, service, required_us, bandwidth_bps, think_us, self._ask_and_think
            )
        else:
            self.airlink.ask(user, service, required_us, bandwidth_bps)

    def _ask_on_arrival(self, user: int) -> None:
        """An open loop: requests arrive at their times; those during an open one are dropped."""
        ahead = self.ahead[user]
        _, service, required_us, bandwidth_bps = ahead.pop()
        if ahead:
            self._ask_at(self.start_us + ahead[-1][0], user, self._ask_on_arrival)
        if self.airlink.open[user] is None:
            self.airlink.ask(user, service, required_us, bandwidth_bps)
            self.airlink.settle_asked()
        else:
            self.airlink.log.suppressed += 1
