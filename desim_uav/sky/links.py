"""Changes of classes and of levels, where they are not those of rings."""

from __future__ import annotations

from typing import Any

import numpy as np

from desim_uav.model.radio.air import find_better, find_classes
from desim_uav.model.radio.buildings import Buffers, Buildings
from desim_uav.model.radio.chances import Odds
from desim_uav.model.radio.links import OTHER, SIGNAL, begin_user, changes_at
from desim_uav.model.radio.marks import DRAWN, Marks, Memory, Sight, marks_of
from desim_uav.model.radio.slopes import DB
from desim_uav.model.radio.tracks import Walkers, fly
from desim_uav.model.radio.visits import Cells
from desim_uav.model.rules import NEVER
from desim_uav.rowcode.compiled_rows import array_at
from desim_uav.rowcode.kernels import kernel, rule
from desim_uav.rowcode.rows import address
from desim_uav.sky.flights import flight_of
from desim_uav.sky.memory import scene_at, sky_at, walks_at
from desim_uav.sky.order import sort_last_first
from desim_uav.sky.rows import LegRow, Scene, Sky

MOST_PASSED = 64
"""The most changes of a pair of levels that are kept; only the first of them counts."""

NO_ROWS: Any = np.int64(0)
"""A number of rows; for a literal one, Numba would compile functions anew."""

key_at = array_at(np.uint64)


@kernel
def foresee_in_air(
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
    """Write all changes on a sender's leg to ``out``, and return their number.

    The sky must have the legs of all senders, the classes that the links have now, and all marks
    until then. For the rest see ``foresee.foresee_discs``. All other senders of the same band that
    serve interfere.
    """
    at, own, span = scene_at(scene), sky_at(sky), (start_us, until_us)
    air, users, band = own.air, _walkers_of(at, walks, legs, begins), own.legs[sender].band
    air.links[SIGNAL].sender, air.used = sender, 1
    for other in range(len(own.legs)):
        if other != sender and _interferes(own.legs[other], band):
            air.links[air.used].sender = other
            air.used += 1
    _begin_links(at, own, span)
    signal, first = air.links[SIGNAL], sender * len(at.heights_m)
    signal.out, signal.room = out, room
    for user in range(len(at.heights_m)):
        begin_user(signal, own.held[first + user])
        find_classes(air, users, span, user)
    sort_last_first(changes_at(out, room), min(signal.rows, room))
    return int(signal.rows)


@kernel
def foresee_all(
    scene: int, sky: int, walks: int, legs: int, begins: int, start_us: int, until_us: int
) -> int:
    """Write all changes of the senders that are ``sought`` to ``Sky.changes``.

    Each sender has the same part of this table. The numbers of changes are written to their legs;
    the largest of them is returned. Senders of one band share the levels and the bounds that are
    computed for a user.
    """
    at, own, span = scene_at(scene), sky_at(sky), (start_us, until_us)
    users, senders, most = _walkers_of(at, walks, legs, begins), len(own.legs), 0
    room = len(own.changes) // senders
    for one in range(senders):
        own.legs[one].changes = 0
    for one in range(senders):
        if _begin_band(own, one):
            _begin_links(at, own, span)
            _find_in_band(own, users, span, room)
    for one in range(senders):
        leg = own.legs[one]
        if leg.sought:
            most = max(most, leg.changes)
            changes = changes_at(address(own.changes[one * room]), room)
            sort_last_first(changes, min(leg.changes, room))
    return most


@rule
def _begin_band(sky: Sky, one: int) -> bool:
    """Take all senders that serve in the band of one, and return whether it is the first one."""
    air, band = sky.air, sky.legs[one].band
    air.used = 0
    for other in range(len(sky.legs)):
        if _interferes(sky.legs[other], band):
            air.links[air.used].sender = other
            air.used += 1
    return bool(air.used > 0 and air.links[SIGNAL].sender == one)


@rule
def _find_in_band(sky: Sky, users: Walkers, span_us: tuple[int, int], room: int) -> None:
    """Write the changes of all senders in a band that are sought."""
    air, count = sky.air, len(users.heights_m)
    for k in range(air.used):
        link = air.links[k]
        if sky.legs[link.sender].sought:
            link.out, link.room = address(sky.changes[link.sender * room]), room
    for user in range(count):
        for k in range(air.used):
            begin_user(air.links[k], sky.held[air.links[k].sender * count + user])
        find_classes(air, users, span_us, user)
    for k in range(air.used):
        sky.legs[air.links[k].sender].changes = air.links[k].rows


@kernel
def better_us(
    scene: int,
    sky: int,
    walks: int,
    legs: int,
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
    at, own, span = scene_at(scene), sky_at(sky), (start_us, until_us)
    air, users = own.air, _walkers_of(at, walks, legs, begins)
    air.links[SIGNAL].sender, air.links[OTHER].sender, air.used = one, other, 2
    _begin_links(at, own, span)
    signal, last = air.links[SIGNAL], len(air.thresholds_db) - 1
    signal.noise_dbm, air.thresholds_db[last] = -np.inf, margin_db
    signal.lowest, signal.top = last, last + 1
    signal.out, signal.room = address(own.passed), len(own.passed)
    begin_user(signal, better)
    air.links[OTHER].sought = 0
    find_better(air, users, span, user, margin_db)
    return own.passed[0].t_us if signal.rows > 0 else NEVER


@rule
def _interferes(leg: LegRow, band: int) -> bool:
    """Return whether a sender interferes with others in a band."""
    return bool(leg.serving and leg.band == band)


@kernel
def _begin_links(scene: Scene, sky: Sky, span_us: tuple[int, int]) -> None:
    """Begin the links whose senders are known: write their tracks, and what is called for them."""
    air, end = sky.air, NO_ROWS
    air.start_us = span_us[0]
    for k in range(air.used):
        link = air.links[k]
        leg = sky.legs[link.sender]
        radio = scene.radios[leg.radio]
        link.first = end
        end = fly(flight_of(scene, leg), span_us, air.tracks, end)
        link.after, link.radio = end, leg.radio
        link.level, link.rates_of, link.values = radio.level, radio.rates, radio.loss_values
        link.carrier_ghz, link.power_dbm = radio.carrier_ghz, radio.power_dbm
        link.mw = np.exp(radio.power_dbm / DB)
        link.curves, link.curve_count = address(radio.curves), len(radio.curves)
        link.noise_dbm, link.noise_mw = radio.noise_dbm, np.exp(radio.noise_dbm / DB)
        link.lowest, link.top = radio.lowest, radio.lowest + radio.classes
        link.ratios = address(radio.ratios)
        link.marked_us = leg.marked_us - span_us[0]
        link.out = link.rows = 0


@kernel
def mark(
    scene: int,
    sky: int,
    walks: int,
    legs: int,
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
    air, users, first = own.air, _walkers_of(at, walks, legs, begins), sender * own.mark_rows
    leg, count = own.legs[sender], len(at.heights_m)
    radio = at.radios[leg.radio]
    sight = Sight(
        radio.sight,
        Odds(
            key_at(key, words),
            at.drawn_as,
            number,
            (radio.los_shadow_db, radio.nlos_shadow_db),
            radio.p_los if radio.sight == DRAWN else 0,
            radio.loss_values,
        ),
        Cells((at.cell_x_m, at.cell_y_m), (at.nx, at.ny)),
        users,
        flight_of(at, leg),
        _buildings_of(at),
        _memory_of(own),
    )
    begins_at = sender * (count + 1)
    out = Marks(air.marks, air.marks_at, begins_at, first + own.mark_rows)
    air.marks_at[begins_at] = first
    end = marks_of(sight, (start_us, until_us), out)
    if 0 <= end <= out.end:
        return 0
    for user in range(count + 1):
        air.marks_at[begins_at + user] = first
    return end - first if end > 0 else end


@rule
def _walkers_of(scene: Scene, walks: int, legs: int, begins: int) -> Walkers:
    """Return the walks and the heights of the users."""
    own, legs_at = walks_at(walks, legs, begins, len(scene.groups))
    return Walkers(own, legs_at, scene.heights_m)


@rule
def _buildings_of(scene: Scene) -> Buildings:
    """Return the buildings that block lines of sight."""
    return Buildings(
        scene.corners,
        scene.corners_at,
        scene.roofs_m,
        (scene.built_x, scene.built_y),
        (scene.built_x_m, scene.built_y_m),
        scene.built_at,
        scene.built,
        scene.tallest_m,
    )


@rule
def _memory_of(sky: Sky) -> Memory:
    """Return the memory in which marks are made."""
    own = sky.making
    buffers = Buffers(own.times_s, own.blocked, own.visited)
    return Memory(own.tracks, own.borders_s, own.visits, own.turns, buffers)
