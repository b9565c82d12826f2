"""The clock and the log of one episode, shared by all that happens in it."""

from __future__ import annotations

from collections.abc import Callable

from desim_uav.engine.base import EpisodeLog, Event
from desim_uav.engine.des.agenda import Agenda


class Journal:
    """What is written of an episode."""

    def __init__(self, agenda: Agenda, log: EpisodeLog) -> None:
        self.agenda = agenda
        self.log = log
        self.emit: Callable[[Event], None] = _forget if log.events is None else log.events.append


def _forget(event: Event) -> None:
    """Where events are not kept."""
