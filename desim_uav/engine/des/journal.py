"""The clock and the log of one episode, shared by all that happens in it."""

from __future__ import annotations

from desim_uav.engine.base import EpisodeLog, Event, FlownLeg
from desim_uav.engine.des.agenda import Agenda


class Journal:
    """What is written of an episode."""

    def __init__(self, agenda: Agenda, log: EpisodeLog) -> None:
        self.agenda = agenda
        self.log = log

    def emit(self, event: Event) -> None:
        """Keep an event, where events are kept."""
        if self.log.events is not None:
            self.log.events.append(event)

    def flown(self, leg: FlownLeg) -> None:
        """Keep a leg, where events are kept."""
        if self.log.events is not None:
            self.log.legs.append(leg)
