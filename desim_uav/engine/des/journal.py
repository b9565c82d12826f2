"""The clock and the log of one episode, shared by all that happens in it."""

from __future__ import annotations

from typing import NamedTuple

from desim_uav.engine.base import EpisodeLog
from desim_uav.engine.des.agenda import Agenda


class Journal(NamedTuple):
    """What an episode happens by, and what is written of it."""

    agenda: Agenda
    log: EpisodeLog
