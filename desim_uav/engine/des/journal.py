"""The clock and the log of the episode under way, shared by all that happens in it."""

from __future__ import annotations

from collections.abc import Callable

from desim_uav.engine.base import EpisodeLog, Event
from desim_uav.engine.des.agenda import Agenda


class Journal:
    """What is written of an episode; its time 0 is ``origin_us`` of the agenda."""

    def __init__(self, agenda: Agenda) -> None:
        self.agenda = agenda
        self.begin(EpisodeLog(0))

    def begin(self, log: EpisodeLog) -> None:
        """An episode begins now."""
        self.log = log
        self.origin_us = self.agenda.now
        self.emit: Callable[[Event], None] = _forget if log.events is None else log.events.append

    def now_us(self) -> int:
        """The time since the episode began."""
        return self.agenda.now - self.origin_us


def _forget(event: Event) -> None:
    """Where events are not kept."""
