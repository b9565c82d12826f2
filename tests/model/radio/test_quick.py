"""Curves of gains with their bounds, and the search that decides by them, held against levels."""

from dataclasses import replace

import numpy as np
import pytest

from desim_uav.model.radio.curve_looks import SPARE
from desim_uav.model.radio.curves import CELLS
from desim_uav.model.radio.slopes import DB
from tests.model.radio.airs import RADIOS, USER_M, Sky
from tests.model.radio.looking import moving
from tests.model.radio.making import flying, hovering
from tests.model.radio.test_air_together import ROOM, found_in, together

REACH_M = 3000.0


def level_sky(rng, users, radios=RADIOS):
    """A sky of up to four drones that keep their heights and serve in one band."""
    span_s, drones = round(rng.uniform(5.0, 70.0), 6), int(rng.integers(1, 5))
    legs = []
    for _ in range(drones):
        start = np.array([*rng.uniform(-600.0, 600.0, 2), rng.choice([20.0, 100.0])])
        stop = start + np.array([*rng.uniform(-400.0, 400.0, 2), 0.0])
        legs.append(hovering(start) if rng.random() < 0.2 else flying(rng, start, stop, span_s))
    radio, same = radios[rng.integers(len(radios))], rng.random() < 0.7
    sky = Sky(
        legs,
        [radio if same else radios[rng.integers(len(radios))] for _ in legs],
        list(rng.uniform(10.0, 33.0, drones)),
        [0] * drones,
        [1] * drones,
        [moving(rng, span_s, 4) for _ in range(users)],
        rng.uniform(-110.0, -90.0),
        np.zeros(0),
        span_s,
    )
    middle_db = rng.uniform(-5.0, 20.0)
    return replace(sky, thresholds=np.sort(rng.uniform(middle_db - 12.0, middle_db + 12.0, 14)))


def hold_changes(seed, count):
    """Compare all changes, to the microsecond, with those that levels alone decide."""
    rng, changes, tried = np.random.default_rng(seed), 0, 0
    for _ in range(count):
        sky = level_sky(rng, 3)
        drones = len(sky.legs)
        held = rng.integers(0, 15, (drones, 3))
        sought = rng.random(drones) < 0.8
        most, found, rows = together(sky, held, sought)
        air = sky.air(ROOM, REACH_M)
        quick = found_in(air, sky, held, sought)
        assert most == quick[0]
        assert np.array_equal(found, quick[1]) and np.array_equal(rows, quick[2])
        changes += found.sum()
        tried += any(link.looks[SPARE].power_mw > 0.0 for link in air.sky.air.links)
    assert changes > 5 * count and tried > 0.5 * count


def test_curves_change_nothing():
    hold_changes(1, 15)


@pytest.mark.thorough
def test_curves_change_nothing_in_many_skies():
    hold_changes(3, 600)


@pytest.mark.parametrize("radio", RADIOS)
def test_levels_are_within_the_errors_of_their_curve(radio):
    rng = np.random.default_rng(4)
    sky = replace(level_sky(rng, 1, [radio]), legs=[hovering((0.0, 0.0, 20.0 + USER_M))])
    curve = sky.air(reach_m=REACH_M).scene.radios[0].curves[0]
    distances_m = np.sort(rng.uniform(0.0, 0.999 * REACH_M, 2000))
    loss_db = radio.path_loss.mean_db
    levels_db = np.array([-loss_db(r, 20.0, 2.0) for r in distances_m])
    at = distances_m * curve.per_m
    cells, s = curve.cells.array[at.astype(int)], at % 1.0
    gains = cells["c0"] + s * (cells["c1"] + s * (cells["c2"] + s * cells["c3"]))
    errors_db = np.abs(levels_db - DB * np.log(gains))
    assert (errors_db <= cells["error_db"]).all() and curve.error_db < 0.06
    assert cells["error_db"].max() <= curve.error_db and np.median(cells["error_db"]) < 3e-9
    # The slope between two places of a range of cells is that of a place between them.
    steps = np.diff(levels_db) / np.diff(distances_m)
    slopes = curve.slopes.array
    firsts, lasts = CELLS + at[:-1].astype(int), CELLS + at[1:].astype(int)
    while (firsts != lasts).any():
        firsts, lasts = np.where(firsts != lasts, [firsts // 2, lasts // 2], [firsts, lasts])
    assert (slopes["least"][firsts] - 1e-7 <= steps).all()
    assert (steps <= slopes["most"][firsts] + 1e-7).all()
