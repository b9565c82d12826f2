"""Changes of classes and of levels, where they are not those of rings."""

from __future__ import annotations

from typing import Any

import numpy as np

from desim_uav.model.mobility.walks import LEG_COLUMNS
from desim_uav.model.radio.air import (
    FOUND,
    FOUND_AT,
    FOUND_COLUMNS,
    FOUND_ROOM,
    class_changes_in_air,
    class_changes_of_all,
    pair_changes,
)
from desim_uav.model.radio.links import LINK_COLUMNS, LINK_WORDS, LOOKED, LOOKED_COLUMNS, LOOKS
from desim_uav.model.radio.marks import CHANGE_COLUMNS as SEEN_COLUMNS
from desim_uav.model.radio.marks import MARK_COLUMNS, VISIT_COLUMNS, Memory, Sight, marks_of
from desim_uav.model.radio.scene import (
    BEGUN_US,
    LOSS_COLUMNS,
    PLACE_COLUMNS,
    RADIO,
    RADIO_COLUMNS,
    SENDER_COLUMNS,
    TRANSIT,
    VALUES_AT,
    X0,
    X1,
    Y0,
    Y1,
    Z0,
    Z1,
    Air,
)
from desim_uav.model.radio.sight import Buffers, Buildings
from desim_uav.model.radio.tracks import TRACK_COLUMNS, Flight
from desim_uav.rowcode.compiled_rows import as_array, entries_at, pointer_to
from desim_uav.rowcode.kernels import kernel, rule
from desim_uav.sky.order import CHANGE_COLUMNS, sort_last_first
from desim_uav.sky.rows import Scene, Sky

PIECE_COLUMNS, MOST_PASSED = 4, 64
"""The most rows of a pair of levels that are kept; only the first of them counts."""

NEVER = 2**62
"""A time after all others, in microseconds."""

scene_at: Any = pointer_to(Scene)
sky_at: Any = pointer_to(Sky)
floats_at, ints_at = entries_at(float), entries_at(int)


@kernel
def foresee_in_air(
    scene: int,
    sky: int,
    out: int,
    room: int,
    walks: int,
    numbers: int,
    begins: int,
    sender: int,
    start_us: int,
    until_us: int,
) -> int:
    """Write all changes on a sender's leg to ``out``, and return their number.

    ``Sky.air`` must have the legs of all senders, the classes that the links have now, and all
    marks until then. For the rest see ``foresee.foresee_discs``.
    """
    at, own = scene_at(scene), sky_at(sky)
    changes = as_array(ints_at(out, CHANGE_COLUMNS * room), (room, CHANGE_COLUMNS))
    users = len(at.heights_m)
    held = as_array(own.air.held, (len(own.legs), users))[sender]
    air = _air_of(at, own, (walks, numbers, begins))
    count = class_changes_in_air(air, sender, (start_us, until_us), held, False, changes)
    sort_last_first(changes[: min(count, room)])
    return count


@kernel
def foresee_all(
    scene: int, sky: int, walks: int, numbers: int, begins: int, start_us: int, until_us: int
) -> int:
    """Write all changes of the senders that are ``sought`` to ``Sky.changes``.

    Each sender has the same part of this table. The numbers of changes are written to
    ``Sky.air.found``; the largest of them is returned.
    """
    at, own = scene_at(scene), sky_at(sky)
    senders, most = len(own.legs), 0
    room = len(own.changes) // senders
    changes = as_array(own.changes, (senders, room, CHANGE_COLUMNS))
    found = as_array(own.air.found, (senders, FOUND_COLUMNS))
    held = as_array(own.air.held, (senders, len(at.heights_m)))
    for d in range(senders):
        found[d, FOUND_AT], found[d, FOUND_ROOM], found[d, FOUND] = 0, room, 0
        if own.air.sought[d]:
            found[d, FOUND_AT] = changes[d].ctypes.data
    air = _air_of(at, own, (walks, numbers, begins))
    class_changes_of_all(air, (start_us, until_us), held, found)
    for d in range(senders):
        if own.air.sought[d]:
            most = max(most, found[d, FOUND])
            sort_last_first(changes[d, : min(found[d, FOUND], room)])
    return most


@kernel
def better_us(
    scene: int,
    sky: int,
    walks: int,
    numbers: int,
    begins: int,
    user: int,
    one: int,
    other: int,
    start_us: int,
    until_us: int,
    better: int,
    margin_db: float,
) -> int:
    """Return when one sender becomes better than another one (see ``rules.association``)."""
    at, own = scene_at(scene), sky_at(sky)
    passed = as_array(own.air.passed, (MOST_PASSED, 2))
    air, span = _air_of(at, own, (walks, numbers, begins)), (start_us, until_us)
    rows = pair_changes(air, user, one, other, margin_db, span, better, passed)
    return passed[0, 0] if rows > 0 else NEVER


@kernel
def mark(
    scene: int,
    sky: int,
    walks: int,
    numbers: int,
    begins: int,
    key: int,
    words: int,
    sender: int,
    number: int,
    start_us: int,
    until_us: int,
) -> int:
    """Make the marks of all links to a sender in a span, and return 0 if there is memory for them.

    ``key`` is the address of so many ``words`` of the key of draws, and ``number`` that of the
    sender in them. If there is too little memory, there are no marks, and the number of rows that
    is needed is returned; below 0, it is minus the number of stretches (``model.radio.marks``).
    """
    at, own = scene_at(scene), sky_at(sky)
    air, users = own.air, len(at.heights_m)
    first = sender * air.mark_rows
    out = as_array(air.marks, (len(air.marks) // MARK_COLUMNS, MARK_COLUMNS))
    out = out[: first + air.mark_rows]
    out_at = as_array(air.marks_at, (len(own.legs), users + 1))[sender]
    out_at[0] = first
    sight = _sight_of(at, own, (walks, numbers, begins), (key, words), sender)
    end = marks_of(sight, number, (start_us, until_us), out, out_at)
    if 0 <= end <= len(out):
        return 0
    out_at[:] = first
    return end - first if end > 0 else end


@rule
def _walks_of(scene: Scene, walks: tuple[int, int, int]) -> Any:
    """Return the legs of the users' walks, and the first one of each user."""
    at, numbers, begins = walks
    legs = as_array(floats_at(at, numbers), (numbers // LEG_COLUMNS, LEG_COLUMNS))
    users = len(scene.groups)
    return legs, as_array(ints_at(begins, users + 1), (users + 1,))


@rule
def _profiles_of(scene: Scene, sky: Sky) -> Any:
    """Return the profiles of all transits, and the first row of each."""
    rows, begins = scene.profiles, scene.profiles_at
    if len(sky.air.pieces) > 0:
        rows, begins = sky.air.pieces, sky.air.pieces_at
    pieces = as_array(rows, (len(rows) // PIECE_COLUMNS, PIECE_COLUMNS))
    return pieces, as_array(begins, (len(begins),))


@rule
def _sight_of(
    scene: Scene, sky: Sky, walks: tuple[int, int, int], key: tuple[int, int], sender: int
) -> Any:
    """Return what decides on the marks of links to a sender."""
    own, (legs, legs_at) = sky.air, _walks_of(scene, walks)
    place = as_array(own.ways, (len(sky.legs), PLACE_COLUMNS))[sender]
    flown = as_array(own.senders, (len(sky.legs), SENDER_COLUMNS))[sender]
    radio, transit = scene.rings[flown[RADIO]], flown[TRANSIT]
    pieces, pieces_at = _profiles_of(scene, sky)
    profile = pieces[pieces_at[transit] : pieces_at[transit + 1]]
    route = (place[X0], place[Y0], place[Z0], place[X1], place[Y1], place[Z1])
    cells, cell_m = (scene.nx, scene.ny), (scene.cell_x_m, scene.cell_y_m)
    return Sight(
        radio.sight,
        as_array(ints_at(key[0], key[1]), (key[1],)).view(np.uint64),
        (radio.los_shadow_db, radio.nlos_shadow_db),
        cell_m,
        cells,
        legs,
        legs_at,
        as_array(scene.heights_m, (len(scene.heights_m),)),
        Flight(profile, route, flown[BEGUN_US]),
        own.chances[flown[RADIO]],
        own.losses[flown[RADIO] * LOSS_COLUMNS + VALUES_AT],
        Buildings(
            as_array(scene.corners_m, (len(scene.corners_m) // 2, 2)),
            as_array(scene.corners_at, (len(scene.corners_at),)),
            as_array(scene.roofs_m, (len(scene.roofs_m),)),
            cells,
            cell_m,
            as_array(scene.built_at, (len(scene.built_at),)),
            as_array(scene.built, (len(scene.built),)),
            scene.tallest_m,
        ),
        Memory(
            as_array(own.flown, (len(own.flown) // TRACK_COLUMNS, TRACK_COLUMNS)),
            as_array(own.borders_s, (len(own.borders_s),)),
            as_array(own.visits, (len(own.visits) // VISIT_COLUMNS, VISIT_COLUMNS)),
            as_array(own.seen, (len(own.seen) // SEEN_COLUMNS, SEEN_COLUMNS)),
            Buffers(
                as_array(own.times, (len(own.times),)),
                as_array(own.stretches, (len(own.stretches) // 2, 2)),
                as_array(own.visited, (len(own.visited),)),
            ),
        ),
    )


@rule
def _air_of(scene: Scene, sky: Sky, walks: tuple[int, int, int]) -> Any:
    """Return what kernels know of senders and users."""
    own, senders, radios = sky.air, len(sky.legs), len(scene.rings)
    legs, legs_at = _walks_of(scene, walks)
    pieces, pieces_at = _profiles_of(scene, sky)
    return Air(
        as_array(own.ways, (senders, PLACE_COLUMNS)),
        as_array(own.senders, (senders, SENDER_COLUMNS)),
        pieces,
        pieces_at,
        as_array(own.losses, (radios, LOSS_COLUMNS)),
        as_array(own.radios, (radios, RADIO_COLUMNS)),
        as_array(scene.thresholds_db, (len(scene.thresholds_db),)),
        as_array(scene.thresholds_at, (len(scene.thresholds_at),)),
        legs,
        legs_at,
        as_array(scene.heights_m, (len(scene.heights_m),)),
        as_array(own.marks, (len(own.marks) // MARK_COLUMNS, MARK_COLUMNS)),
        as_array(own.marks_at, (len(own.marks_at),)),
        as_array(own.tracks, (len(own.tracks) // TRACK_COLUMNS, TRACK_COLUMNS)),
        as_array(own.table, (senders, LINK_COLUMNS)),
        as_array(own.link_words, (senders, LINK_WORDS)),
        as_array(own.looks, (LOOKS, LOOKED + LOOKED_COLUMNS * senders)),
        as_array(own.bound_db, (1,)),
    )
