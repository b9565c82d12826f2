"""The changes of class on a sender's leg, where they are those of rings around it."""

from __future__ import annotations

from typing import Any

from desim_uav.model.geometry.coverage import (
    SEEN_ROWS,
    Buckets,
    DroneLeg,
    Users,
    look_around,
    sort_into_buckets,
)
from desim_uav.model.geometry.crossings import crossings, crossings_near
from desim_uav.model.radio.between import Climb, class_changes_between
from desim_uav.model.radio.fits import TERM_COLUMNS
from desim_uav.model.radio.links import changes_at
from desim_uav.model.radio.nested import class_changes
from desim_uav.rowcode.kernels import kernel, rare_rule, rule
from desim_uav.rowcode.rows import Table, shaped
from desim_uav.sky.flights import pieces_of
from desim_uav.sky.memory import scene_at, sky_at, walks_at
from desim_uav.sky.order import sort_last_first, spread_last_first
from desim_uav.sky.rows import Change, LegRow, Propagation, Scene, Sky


@kernel
def foresee_discs(
    scene: int,
    sky: int,
    out: int,
    room: int,
    walks: int,
    legs: int,
    begins: int,
    sender: int,
    start_us: int,
    until_us: int,
) -> int:
    """Write all changes on a leg to ``out``, if each footprint is one circle for all users.

    ``out`` is the address of memory for a number of changes, ``room``.
    For the users' walks, from ``walks`` to ``begins``, see ``memory.walks_at``. The sender's leg
    begins at ``start_us`` and lasts until ``until_us``. The changes are written with the latest
    first; of those at one time, rises come before falls, and higher users before lower ones.
    Returns the number of changes, of which only so many are written as there is memory for.
    """
    at, own, span = scene_at(scene), sky_at(sky), (start_us, until_us)
    users = _users_of(at, own, walks, legs, begins)
    _look(at, own, users, span)
    changes = changes_at(out, room)
    count = _cross_disc(at, own, users, own.legs[sender], span, changes)
    sort_last_first(changes, min(count, room))
    return count


@kernel
def foresee_rings(
    scene: int,
    sky: int,
    out: int,
    room: int,
    walks: int,
    legs: int,
    begins: int,
    sender: int,
    start_us: int,
    until_us: int,
) -> int:
    """Write all changes on a leg to ``out``, and return their number.

    This is what ``foresee_discs`` does, where links have several classes, or classes are those of
    one height only.
    """
    at, own = scene_at(scene), sky_at(sky)
    leg, span = own.legs[sender], (start_us, until_us)
    rings, users = at.radios[leg.radio], _users_of(at, own, walks, legs, begins)
    _look(at, own, users, span)
    changes = changes_at(out, room)
    if not _is_between(rings, leg) and _is_disc(rings, leg):
        count = _cross_disc(at, own, users, leg, span, changes)
    else:
        count = _cross_rings(at, own, users, leg, span, changes)
    rows = min(count, room)
    if rings.classes == 1:
        sort_last_first(changes, rows)
    else:
        spread_last_first(own.found, rows, own.order, changes)
    return count


@rule
def _look(scene: Scene, sky: Sky, users: Users, span_us: tuple[int, int]) -> None:
    """Find how users walk in a span, if that is not known yet."""
    if sky.from_us != span_us[0] or sky.to_us != span_us[1]:
        look_around(users, span_us[0], span_us[1])
        sky.from_us, sky.to_us = span_us
        if len(sky.heads) > 0:
            sky.far_m = sort_into_buckets(users.seen, _buckets_of(scene, sky))


@rule
def _cross_disc(
    scene: Scene, sky: Sky, users: Users, leg: LegRow, span_us: tuple[int, int], out: Table[Change]
) -> int:
    """Write the entries and exits on a leg, and return their number."""
    rings = scene.radios[leg.radio]
    flown = _flown(scene, leg, span_us, rings.radii_m[leg.level * _circles(rings)])
    if len(sky.heads) > 0:
        return crossings_near(flown, users, _buckets_of(scene, sky), sky.far_m, out)
    return crossings(flown, users, out)


@rare_rule
def _cross_rings(
    scene: Scene,
    sky: Sky,
    users: Users,
    leg: LegRow,
    span_us: tuple[int, int],
    changes: Table[Change],
) -> int:
    """Write the changes of class on a leg, and return their number.

    They are written to ``Sky.found`` if links have several classes, and else to ``changes``.
    """
    rings = scene.radios[leg.radio]
    levels, groups = rings.levels, _circles(rings) // rings.classes
    radii_m = shaped(rings.radii_m, (levels, groups, rings.classes))
    own_m = radii_m[leg.level]
    flown = _flown(scene, leg, span_us, own_m[0, 0])
    out = sky.found if rings.classes > 1 else changes
    if _is_between(rings, leg):
        lower, shape = min(leg.level, leg.to_level), (groups, rings.classes)
        bounds_m = shaped(rings.bounds_m, (levels - 1, 2, *shape))[lower]
        ranges = (levels - 1, groups, rings.slabs, 2, rings.classes)
        climb = Climb(
            1.0 if leg.to_level > leg.level else 0.0,
            (own_m, radii_m[leg.to_level]),
            bounds_m[0],
            bounds_m[1],
            shaped(rings.terms, (levels - 1, *shape, rings.slabs, TERM_COLUMNS))[lower],
            shaped(rings.ranges, ranges)[lower],
            sky.windows,
        )
        return class_changes_between(flown, climb, users, scene.groups, out)
    return class_changes(flown, users, own_m, scene.groups, out)


@rule
def _is_between(rings: Propagation, leg: LegRow) -> bool:
    """Return whether a leg leads between two levels where the rings are known."""
    return leg.level != leg.to_level and len(rings.terms) > 0


@rule
def _circles(rings: Propagation) -> int:
    """Return the number of circles of a radio on each level."""
    return len(rings.radii_m) // rings.levels


@rule
def _is_disc(rings: Propagation, leg: LegRow) -> bool:
    """Return whether one circle is the same for all users: at one height a footprint is."""
    return _circles(rings) == 1 and rings.radii_m[leg.level] >= 0.0


@rule
def _users_of(scene: Scene, sky: Sky, walks: int, legs: int, begins: int) -> Any:
    """Return the users' walks, and what is known of them in the present span."""
    count = len(scene.groups)
    own_legs, legs_at = walks_at(walks, legs, begins, count)
    return Users(own_legs, legs_at, shaped(sky.seen, (SEEN_ROWS, count)))


@rule
def _buckets_of(scene: Scene, sky: Sky) -> Any:
    """Return the buckets into which users are sorted by their places."""
    return Buckets(
        (scene.buckets_x, scene.buckets_y),
        (scene.bucket_x_m, scene.bucket_y_m),
        sky.heads,
        sky.following,
    )


@rule
def _flown(scene: Scene, leg: LegRow, span_us: tuple[int, int], radius_m: float) -> Any:
    """Return a leg in a span, with the radius of the sender's footprint."""
    return DroneLeg(
        pieces_of(scene, leg),
        (leg.x0_m, leg.y0_m, leg.x1_m, leg.y1_m),
        span_us,
        radius_m,
        leg.serving == 0,
        leg.z1_m - leg.z0_m,
    )
