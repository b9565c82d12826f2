"""The sample path of an episode."""

from __future__ import annotations

from desim_uav.rowcode.rows import Row, Table, row


@row
class Ask(Row):
    """A request to come; ``due_us`` is its time or a think time (see ``demand.Requests``)."""

    due_us: int
    service: int


@row
class Path(Row):
    """The sample path of an episode (see ``SamplePath``).

    ``asks``, the values that each of them has ``drawn`` (``Constants.draws`` numbers each) and
    ``legs`` (five numbers each) are ordered by user. If users walk ``stepwise``, the
    compiled engine has the initial states of their random streams (four words each) instead of
    legs. ``respawns`` holds ``respawns_drawn`` stations per drone, and ``errors`` the position
    errors in x and y, in cells, per drone and decision epoch, or nothing without noise.
    ``link_key`` holds the key of the draws of links (``model.random.philox``); the compiled engine
    has nothing there if there are no such draws. A user ``follows`` if the times of its asks count
    from the end of its previous request (1), and not from the start of the episode (0).
    """

    stepwise: int
    respawns_drawn: int
    asks: Table[Ask]
    drawn: Table[int]
    asks_at: Table[int]
    legs: Table[float]
    legs_at: Table[int]
    streams: Table[int]
    respawns: Table[int]
    errors: Table[float]
    link_key: Table[int]
    follows: Table[int]
