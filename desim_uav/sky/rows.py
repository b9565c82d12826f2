"""The rows that the kernels of the sky read and write; both engines have them in memory.

A ``Scene`` does not change in a run. A ``Sky`` belongs to an environment, and is derived from the
state of its episode: before a kernel is called, the rules write the legs that it looks at.
"""

from __future__ import annotations

from desim_uav.model.geometry.relative import Change
from desim_uav.model.motion.motion import PieceRow
from desim_uav.model.radio.between import Window
from desim_uav.model.radio.buildings import Corner, Stretch
from desim_uav.model.radio.curves import Curve
from desim_uav.model.radio.links import Air
from desim_uav.model.radio.tracks import TrackRow, Turn
from desim_uav.model.radio.visits import Visit
from desim_uav.rowcode.rows import Int16, Int32, Row, Table, row


@row
class TransitRow(Row):
    """A flight of a drone from rest to rest (see ``model.motion.motion.Transit``)."""

    duration_us: int
    distance_m: float
    rises: float
    tail_mps: float
    side_mps: float
    pieces: Table[PieceRow]


@row
class Propagation(Row):
    """How the signals of a radio are received, and where links have their classes.

    ``sight`` is the kind of line of sight (``model.radio.marks``), and ``los_shadow_db`` and
    ``nlos_shadow_db`` are the standard deviations of the shadowing. ``level``, ``rates`` and
    ``p_los`` are the addresses of functions of the path loss (``model.radio.levels``), and
    ``loss_values`` is that of its fields. ``lowest`` is the number of the radio's first threshold
    in ``Air.thresholds_db``, and ``ratios`` are its thresholds as ratios of powers.

    While nothing interferes, classes hold within circles. ``radii_m`` has the radii of all classes
    from 1 on, by level and then by the groups into which users fall by their heights; an access
    point has one level. ``terms`` to ``bounds_m`` are the fits between levels, with so many
    ``slabs`` between two of them (``model.radio.fits.Fits``), or empty. With interference, there
    may be ``curves`` of the gain (``model.radio.curves``).
    """

    classes: int
    levels: int
    sight: int
    los_shadow_db: float
    nlos_shadow_db: float
    carrier_ghz: float
    power_dbm: float
    noise_dbm: float
    level: int
    rates: int
    p_los: int
    loss_values: int
    lowest: int
    ratios: Table[float]
    radii_m: Table[float]
    slabs: int
    terms: Table[float]
    ranges: Table[float]
    bounds_m: Table[float]
    curves: Table[Curve]


@row
class Scene(Row):
    """What does not change in a run: transits, radios, users' heights, and a least distance.

    No other scene in this process has its ``number``. ``transits`` and ``radios`` have the numbers
    of those of ``rules.rows.Constants``. ``groups`` are those of the users by height, and
    ``heights_m`` their heights, if a search needs them (``model.radio.air``). If links are drawn,
    users are ``drawn_as`` these numbers. Users are sorted by place into buckets. The buildings that
    block lines of sight are from ``built_x`` to ``tallest_m`` (see ``model.radio.buildings``):
    building b has the corners from ``corners_at[b]`` on, and bucket k the buildings ``built`` from
    ``built_at[k]`` on.
    """

    number: int
    separation_m: float
    buckets_x: int
    buckets_y: int
    bucket_x_m: float
    bucket_y_m: float
    transits: Table[TransitRow]
    radios: Table[Propagation]
    groups: Table[int]
    heights_m: Table[float]
    drawn_as: Table[int]
    nx: int
    ny: int
    cell_x_m: float
    cell_y_m: float
    built_x: int
    built_y: int
    built_x_m: float
    built_y_m: float
    corners: Table[Corner]
    corners_at: Table[int]
    roofs_m: Table[float]
    built_at: Table[int]
    built: Table[int]
    tallest_m: float


@row
class LegRow(Row):
    """The leg of a sender since ``since_us``: a straight flight by a transit, and then a hover.

    ``transit`` is the number of one of ``Scene.transits``, or below 0 if the ``pieces`` of the leg
    are its own, in free flight. ``level`` and ``to_level`` are those at its ends. The sender has a
    ``radio`` of a number and transmits in a ``band``, and ``serving`` says whether it has served
    users before. Its marks count since ``marked_us``. If all changes of it are ``sought``
    (``links.foresee_all``), so many ``changes`` are found.
    """

    x0_m: float
    y0_m: float
    z0_m: float
    x1_m: float
    y1_m: float
    z1_m: float
    since_us: int
    transit: Int32
    level: Int32
    to_level: Int32
    radio: Int16
    band: Int16
    serving: Int16
    marked_us: int
    sought: Int16
    changes: Int32
    pieces: Table[PieceRow]


@row
class Making(Row):
    """The memory in which marks are made (``model.radio.marks.Memory``)."""

    scratch = ("tracks", "borders_s", "visits", "turns", "times_s", "blocked")
    tracks: Table[TrackRow]
    borders_s: Table[float]
    visits: Table[Visit]
    turns: Table[Turn]
    times_s: Table[float]
    blocked: Table[Stretch]
    visited: Table[int]


@row
class Sky(Row):
    """The legs of senders, by their index, and what is found of them.

    ``seen`` is what is known of the users' walks from ``from_us`` to ``to_us``
    (``coverage.SEEN_ROWS``), and ``heads`` and ``following`` are the users in buckets, of whom none
    moves farther than ``far_m`` along an axis. ``changes`` are those on a leg. ``windows``,
    ``found`` and ``order`` are memory if links have classes. ``tracks`` is memory for the tracks of
    two legs, and ``turns`` are those of a pair of drones, whose state is 1 while they are too near.
    Both are empty if drones need not keep a distance.

    The rest is for links whose changes are not those of rings: the classes ``held`` before a span,
    by sender and user; the changes by which one level ``passed`` another; and memory for marks, of
    which each sender has ``mark_rows``. ``marks_lost`` says that they were too few, or the memory
    in which they are made. What is known of legs is at the address ``leg_memory``, in memory of the
    thread (``sky.leg_memory``). In the compiled engine, scratch (``engine.compiled.scratch``) is
    ``scratch_at`` bytes behind the state, which needs ``scratch_words`` of it.
    """

    scratch = (
        *("seen", "heads", "following", "changes", "windows", "found", "order", "tracks"),
        *("turns", "held", "passed"),
    )
    scratch_at: int
    scratch_words: int
    leg_memory: int
    legs: Table[LegRow]
    from_us: int
    to_us: int
    far_m: float
    seen: Table[float]
    heads: Table[int]
    following: Table[int]
    changes: Table[Change]
    windows: Table[Window]
    found: Table[Change]
    order: Table[int]
    tracks: Table[TrackRow]
    turns: Table[Turn]
    air: Air
    held: Table[int]
    passed: Table[Change]
    mark_rows: Int32
    marks_lost: Int16
    making: Making
