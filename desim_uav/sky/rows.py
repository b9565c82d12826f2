"""The rows that the kernels of the sky read and write; both engines have them in memory.

A ``Scene`` does not change in a run. A ``Sky`` belongs to an environment, and is derived from the
state of its episode: before a kernel is called, the rules write the legs that it looks at.
"""

from __future__ import annotations

from desim_uav.rowcode.rows import Row, Table, row


@row
class Piece(Row):
    """A part of a transit with constant acceleration: time, distance and speed at its start."""

    start_s: float
    from_m: float
    speed_mps: float
    acceleration_mps2: float


@row
class TransitRow(Row):
    """A flight of a drone from rest to rest (see ``model.motion.motion.Transit``)."""

    duration_us: int
    distance_m: float
    rises: float
    tail_mps: float
    side_mps: float
    pieces: Table[Piece]


@row
class Scene(Row):
    """What does not change in a run: the transits of drones, and how far apart they have to keep.

    ``transits`` are those of ``rules.rows.Constants``.
    """

    separation_m: float
    transits: Table[TransitRow]


@row
class Leg(Row):
    """The leg of a sender since ``since_us``: a straight flight by a transit, and then a hover.

    ``transit`` is the number of one of ``Scene.transits``, or below 0 if the ``pieces`` of the leg
    are its own, in free flight.
    """

    x0_m: float
    y0_m: float
    z0_m: float
    x1_m: float
    y1_m: float
    z1_m: float
    since_us: int
    transit: int
    pieces: Table[Piece]


@row
class Turn(Row):
    """The time at which a pair of drones comes too ``near`` (1) or parts (0)."""

    t_us: int
    near: int


@row
class Sky(Row):
    """The legs of senders, by their index, and what is found of them.

    ``tracks`` is memory for the tracks of two legs (``model.radio.tracks``), and ``turns`` are
    those of a pair of drones. Both are empty if drones need not keep a distance.
    """

    legs: Table[Leg]
    tracks: Table[float]
    turns: Table[Turn]
