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

    ``sight`` is the kind of line of sight (``model.radio.marks``), and ``los_shadow_db`` and
    ``nlos_shadow_db`` are the standard deviations of the shadowing.
    ``radii_m`` has the radii of all classes from 1 on, by level and then by the groups into which
    users fall by their heights; an access point has one level. ``terms`` to ``bounds_m`` are the
    fits between levels, with so many ``slabs`` between two of them (``model.radio.fits.Fits``), or
    empty.
    """

    classes: int
    levels: int
    sight: int
    los_shadow_db: float
    nlos_shadow_db: float
    radii_m: Table[float]
    slabs: int
    terms: Table[float]
    ranges: Table[float]
    bounds_m: Table[float]


@row
class Scene(Row):
    """What does not change in a run: transits, rings, users' heights, and a least distance.

    ``transits`` are those of ``rules.rows.Constants``, and ``rings`` those of its ``radios``.
    ``groups`` are those of the users by height. Users are sorted by place into buckets. What
    ``model.radio.air`` needs to know is from ``heights_m`` (those of users) to ``profiles_at``:
    the thresholds of all radios, of which radio r has those from ``thresholds_at[r]`` on, and the
    ``profiles`` of all transits. The buildings that block lines of sight are from ``corners_m`` to
    ``tallest_m`` (see ``model.radio.sight.Buildings``): building b has the corners from
    ``corners_at[b]`` on, and bucket k the buildings ``built`` from ``built_at[k]`` on.
    """

    separation_m: float
    buckets_x: int
    buckets_y: int
    bucket_x_m: float
    bucket_y_m: float
    transits: Table[TransitRow]
    rings: Table[Rings]
    groups: Table[int]
    heights_m: Table[float]
    thresholds_db: Table[float]
    thresholds_at: Table[int]
    profiles: Table[float]
    profiles_at: Table[int]
    nx: int
    ny: int
    cell_x_m: float
    cell_y_m: float
    corners_m: Table[float]
    corners_at: Table[int]
    roofs_m: Table[float]
    built_at: Table[int]
    built: Table[int]
    tallest_m: float


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
class AirTables(Row):
    """What ``model.radio.air`` knows of drones, and the memory in which it works.

    For ``ways`` (places) to ``looks`` see ``model.radio.scene.Air``. ``chances`` are the addresses
    of the radios' probabilities of line of sight. ``sought`` says whether changes of a sender are
    sought. ``held`` are the classes of the links to each sender before a span, ``found`` says where
    their changes are written (``model.radio.air.FOUND_COLUMNS``), and ``passed`` are the rows of a
    pair of levels. ``marks`` has ``mark_rows`` rows for each sender; ``marks_lost`` says that they
    were too few, or the memory in which marks are made (``model.radio.marks.Memory``), from
    ``flown`` (tracks) to ``visited``. In free flight, ``pieces`` has ``Scene.profiles`` and then
    the profile of each sender, of four rows, which drones in free flight use.
    """

    ways: Table[float]
    senders: Table[int]
    losses: Table[int]
    radios: Table[float]
    marks: Table[float]
    marks_at: Table[int]
    tracks: Table[float]
    table: Table[float]
    bound_db: Table[float]
    link_words: Table[int]
    looks: Table[float]
    chances: Table[int]
    sought: Table[int]
    held: Table[int]
    found: Table[int]
    passed: Table[int]
    mark_rows: int
    marks_lost: int
    flown: Table[float]
    borders_s: Table[float]
    visits: Table[float]
    seen: Table[int]
    times: Table[float]
    stretches: Table[float]
    visited: Table[int]
    pieces: Table[float]
    pieces_at: Table[int]


@row
class Sky(Row):
    """The legs of senders, by their index, and what is found of them.

    ``seen`` is what is known of the users' walks from ``from_us`` to ``to_us``
    (``coverage.SEEN_ROWS``), and ``heads`` and ``following`` are the users in buckets, of whom none
    moves farther than ``far_m`` along an axis. ``changes`` are those on a leg. ``windows``,
    ``found`` and ``order`` are memory if links have classes. ``tracks`` is memory for the tracks of
    two legs (``model.radio.tracks``), and ``turns`` are those of a pair of drones. Both are empty
    if drones need not keep a distance. ``air`` is for links whose changes are not those of rings.
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
    air: AirTables
