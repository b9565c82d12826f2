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
class Rings(Row):
    """Where the links of a radio have their classes, while nothing interferes.

    ``radii_m`` has the radii of all classes from 1 on, by level and then by the groups into which
    users fall by their heights; an access point has one level. ``terms`` to ``bounds_m`` are the
    fits between levels, with so many ``slabs`` between two of them (``model.radio.fits.Fits``), or
    empty.
    """

    classes: int
    levels: int
    radii_m: Table[float]
    slabs: int
    terms: Table[float]
    ranges: Table[float]
    bounds_m: Table[float]


@row
class Scene(Row):
    """What does not change in a run: transits, rings, users' heights, and a least distance.

    ``transits`` are those of ``rules.rows.Constants``, and ``rings`` those of its ``radios``.
    ``groups`` are those of the users by height. Users are sorted by place into buckets.
    """

    separation_m: float
    buckets_x: int
    buckets_y: int
    bucket_x_m: float
    bucket_y_m: float
    transits: Table[TransitRow]
    rings: Table[Rings]
    groups: Table[int]


@row
class Leg(Row):
    """The leg of a sender since ``since_us``: a straight flight by a transit, and then a hover.

    ``transit`` is the number of one of ``Scene.transits``, or below 0 if the ``pieces`` of the leg
    are its own, in free flight. ``level`` and ``to_level`` are those at its ends, ``radio`` is the
    number of the sender's radio, and ``serving`` says whether it has served users before.
    """

    x0_m: float
    y0_m: float
    z0_m: float
    x1_m: float
    y1_m: float
    z1_m: float
    since_us: int
    transit: int
    level: int
    to_level: int
    radio: int
    serving: int
    pieces: Table[Piece]


@row
class Change(Row):
    """The change of a link between a sender and a user to another class.

    ``change`` is the new class if the link rises to it, and minus the new class if it falls to it.
    Class 0 is no link. With the paper's disc, which has one class, 1 is the entry of a user into
    the footprint and 0 its exit.
    """

    t_us: int
    user: int
    change: int


@row
class Turn(Row):
    """The time at which a pair of drones comes too ``near`` (1) or parts (0)."""

    t_us: int
    near: int


@row
class Sky(Row):
    """The legs of senders, by their index, and what is found of them.

    ``seen`` is what is known of the users' walks from ``from_us`` to ``to_us``
    (``coverage.SEEN_ROWS``), and ``heads`` and ``following`` are the users in buckets, of whom none
    moves farther than ``far_m`` along an axis. ``changes`` are those on a leg. ``windows``,
    ``found`` and ``order`` are memory if links have classes. ``tracks`` is memory for the tracks of
    two legs (``model.radio.tracks``), and ``turns`` are those of a pair of drones. Both are empty
    if drones need not keep a distance.
    """

    legs: Table[Leg]
    from_us: int
    to_us: int
    far_m: float
    seen: Table[float]
    heads: Table[int]
    following: Table[int]
    changes: Table[Change]
    windows: Table[float]
    found: Table[Change]
    order: Table[int]
    tracks: Table[float]
    turns: Table[Turn]
