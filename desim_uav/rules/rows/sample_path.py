"""The sample path of an episode."""

from __future__ import annotations

from desim_uav.model.geometry.coverage import WalkLeg
from desim_uav.rowcode.rows import Fitted, Row, Table, row


@row
class Path(Row):
    """The sample path of an episode (see ``SamplePath``).

    Requests to come are ordered by user: ``due_us`` is the time of each, or a think time (see
    ``demand.Requests``), ``services`` is its service, and of the values that are ``drawn`` it has
    ``Constants.draws``. The users' ``legs`` are in order, too. If users walk ``stepwise``, the
    compiled engine has the initial states of their random streams (four words each) instead of
    legs. ``respawns`` holds ``respawns_drawn`` stations per drone, and ``errors`` the position
    errors in x and y, in cells, per drone and decision epoch, or nothing without noise.
    ``link_key`` holds the key of the draws of links (``model.random.philox``); the compiled engine
    has nothing there if there are no such draws. A user ``follows`` if the times of its asks count
    from the end of its previous request (1), and not from the start of the episode (0).
    """

    stepwise: int
    respawns_drawn: int
    due_us: Table[Fitted]
    services: Table[Fitted]
    drawn: Table[Fitted]
    asks_at: Table[Fitted]
    legs: Table[WalkLeg]
    legs_at: Table[int]
    streams: Table[int]
    respawns: Table[Fitted]
    errors: Table[float]
    link_key: Table[int]
    follows: Table[Fitted]
