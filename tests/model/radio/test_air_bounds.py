"""Bounds of how fast levels and ratios change, and path losses without them."""

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest

from desim_uav.errors import ScenarioError
from desim_uav.model.radio.bounds import bound_levels, bound_ratio
from desim_uav.model.radio.functions import log10, slant_range_m
from desim_uav.model.radio.levels import RateRow, compiled_loss
from desim_uav.model.radio.links import look
from desim_uav.model.radio.path_loss import AlHourani, FreeSpace, free_space_db
from desim_uav.model.radio.stretches import relate, take_first_rows, take_rows
from desim_uav.rowcode.compiled_rows import call
from desim_uav.rowcode.kernels import kernel
from desim_uav.rowcode.rows import address
from desim_uav.sky.links import _begin_links, scene_at, sky_at
from tests.model.radio.airs import RADIOS, USER_M, TwoSlopes, kept_loss, random_sky, stroll

RATES = RateRow.words


@kernel
def write_rates(at, values, branch, distances_m, heights_m, withins_m, rates):
    for k in range(len(rates)):
        row = rates.ctypes.data + 8 * RATES * k
        call(at, (values, 2.0, branch, distances_m[k], heights_m[k], withins_m[k], row))


def nearby(rng, centres, withins):
    """Random places, each at most so far away from a centre."""
    off = rng.normal(size=centres.shape)
    off /= np.linalg.norm(off, axis=1)[:, None]
    return centres + off * (withins * rng.random(len(withins)) ** 0.2)[:, None]


@pytest.mark.parametrize("radio", RADIOS)
def test_no_level_changes_faster_between_two_places(radio):
    rng, count, loss = np.random.default_rng(3), 20_000, kept_loss(radio.path_loss)
    centres = rng.normal(size=(count, 3)) * 10 ** rng.uniform(0.0, 3.5, (count, 1))
    withins = np.linalg.norm(centres, axis=1) * 10 ** rng.uniform(-4.0, 0.0, count) * 0.999
    one, other = nearby(rng, centres, withins), nearby(rng, centres, withins)
    away = np.hypot(*other.T[:2]) - np.hypot(*one.T[:2])
    moved = np.column_stack([away, other[:, 2] - one[:, 2]])
    for branch in range(3):
        rates = np.empty((count, RATES))
        distances, heights = np.hypot(*centres.T[:2]), centres[:, 2].copy()
        write_rates(loss.rates, loss.values, branch, distances, heights, withins, rates)
        products = np.stack([rates[:, 0::2] * moved, rates[:, 1::2] * moved])
        low, high = products.min(axis=0).sum(axis=1), products.max(axis=0).sum(axis=1)
        change = radio.level(other, np.full(count, branch))
        change -= radio.level(one, np.full(count, branch))
        assert (change >= low - 1e-9).all() and (change <= high + 1e-9).all()
        assert ((change - low) < 0.25 * (high - low)).any()
        write_rates(loss.rates, loss.values, branch, distances, heights, 0.0 * withins, rates)
        assert np.allclose(rates[:, 1::2], rates[:, 0::2], rtol=1e-12, atol=0.0)
        step = 1e-6 * np.linalg.norm(centres, axis=1)
        for column, along in enumerate(((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))):
            places = np.column_stack([distances, np.zeros(count), heights])
            ends = [places + sign * step[:, None] * np.array(along) for sign in (-1.0, 1.0)]
            below, above = (radio.level(end, np.full(count, branch)) for end in ends)
            steepness = (above - below) / (2.0 * step)
            assert np.allclose(rates[:, 2 * column], steepness, rtol=1e-4, atol=1e-6)


@kernel
def begun(scene, sky, used, span_us, place, walk):
    """Begin all links to a user, and return until when nothing begins, in seconds."""
    own = sky_at(sky)
    air = own.air
    air.used = used
    for k in range(used):
        air.links[k].sender = k
    _begin_links(scene_at(scene), own, span_us)
    take_first_rows(air, 1, 0)
    until = take_rows(air, 0.0)[0]
    relate(air, 0.0, place, walk)
    return until


@kernel
def bounds_of(sky, since, until):
    """Return the range in which the first ratio changes in a time, in dB/s."""
    air = sky_at(sky).air
    look(air, 1, since)
    look(air, 0, until)
    bound_levels(air, 1)
    return bound_ratio(air, 0)


def bounded(sky, rng):
    """A time in which nothing begins, and the range in which the ratio changes in it, in dB/s."""
    air, place = sky.air(), (*sky.walks[0].points[0].tolist(), USER_M)
    own, walk = address(air.sky), tuple(sky.walks[0].velocities[0].tolist())
    until = min(begun(address(air.scene), own, len(sky.legs), sky.span_us, place, walk), sky.span_s)
    since = rng.uniform(0.0, until)
    until = min(until, since + 10 ** rng.uniform(-2.0, 1.5))
    return (since, until), bounds_of(own, since, until)


def test_no_ratio_changes_faster_between_two_times():
    rng, tight = np.random.default_rng(4), 0
    for number in range(150):
        sky = random_sky(rng, 1 + number % 4, 1)
        walk = stroll(*rng.uniform(-300.0, 300.0, 2), *rng.uniform(-8.0, 8.0, 2))
        sky = replace(sky, walks=[walk], marks={}, bands=[0] * 4, serves=[1] * 4)
        (since, until), (least, most) = bounded(sky, rng)
        t = np.sort(rng.uniform(since, until, (2, 500)), axis=0)
        values = sky.ratio_db(0, 0, t.ravel()).reshape(2, 500)
        change, lasts = values[1] - values[0], t[1] - t[0]
        assert (change >= least * lasts - 1e-10).all() and (change <= most * lasts + 1e-10).all()
        tight += most - least < 0.5 * max(-least, most)
    assert tight > 30


class Steeper(AlHourani):
    """A loss whose bounds are not those of the class that it is derived from."""

    def nlos_db(self, distance_m, height_m, carrier_ghz):
        return 2.0 * (free_space_db(distance_m, height_m, carrier_ghz) + self.eta_nlos_db)


class Alike(TwoSlopes):
    """A loss with a kink, whose bounds have to be sampled."""

    def los_db(self, distance_m, height_m, carrier_ghz):
        slant_m = slant_range_m(distance_m, height_m)
        return 40.0 + 20.0 * log10(slant_m) + max(15.0 * log10(slant_m / self.kink_m), 0.0)


def test_a_path_loss_without_bounds_has_sampled_ones():
    """They hold, and are not much wider than need be: less than three times those of formulas."""
    assert AlHourani.is_bounded() and TwoSlopes.is_bounded() and not Steeper.is_bounded()
    rng, count = np.random.default_rng(4), 300
    distances, heights = 10 ** rng.uniform(0.0, 3.5, count), 10 ** rng.uniform(0.5, 2.5, count)
    withins = np.hypot(distances, heights) * 10 ** rng.uniform(-4.0, -0.2, count)
    own, known = np.empty((count, RATES)), np.empty((count, RATES))
    for path_loss, formulas in ((Steeper("urban"), None), (Alike(250.0), TwoSlopes(250.0))):
        loss = compiled_loss(path_loss)
        for branch in range(3):
            write_rates(loss.rates, loss.values, branch, distances, heights, withins, own)
            level_db = (path_loss.mean_db, path_loss.los_db, path_loss.nlos_db)[branch]
            places = np.column_stack([distances, heights])
            for place, within, rates in zip(places, withins, own, strict=True):
                for share in (0.2, 0.7, 0.99):
                    angle = rng.uniform(0.0, 2.0 * np.pi)
                    move = share * within * np.array([np.cos(angle), np.sin(angle)])
                    other = np.maximum(place + move, 0.01)
                    rise = level_db(*place, 2.0) - level_db(*other, 2.0)
                    moved = other - place
                    least = sum(min(rates[2 * k : 2 * k + 2] * moved[k]) for k in range(2))
                    most = sum(max(rates[2 * k : 2 * k + 2] * moved[k]) for k in range(2))
                    assert least - 1e-9 <= rise <= most + 1e-9
            if formulas:
                bound = compiled_loss(formulas)
                write_rates(bound.rates, bound.values, branch, distances, heights, withins, known)
                assert (own[:, 3] <= 3.0 * known[:, 3]).all()


def test_sampled_bounds_are_those_at_the_carrier():
    """A loss whose exponent rises with the carrier has bounds that do."""
    loss, rates = compiled_loss(ByCarrier()), np.empty(RATES)
    found = []
    for carrier_ghz in (1.0, 3.0):
        call_once(loss.rates, (loss.values, carrier_ghz, 1, 300.0, 100.0, 1.0, rates.ctypes.data))
        found.append(rates[0])
    assert found[1] == pytest.approx(3.0 * found[0])


@kernel
def call_once(at, arguments):
    call(at, arguments)


@dataclass(frozen=True)
class ByCarrier(FreeSpace):
    """A loss that rises faster at a higher carrier."""

    def los_db(self, distance_m, height_m, carrier_ghz):
        slant_m = slant_range_m(distance_m, height_m)
        return 10.0 + 10.0 * carrier_ghz * log10(slant_m)


@dataclass(frozen=True)
class TooFlat(TwoSlopes):
    """A loss that rises faster than it says."""

    def slope(self, distance_m, height_m, within_m):
        return 8.0 / distance_m, 8.0 / distance_m


@dataclass(frozen=True)
class Unbounded(TwoSlopes):
    """A loss without a bound near the drone, and with none elsewhere."""

    def slope(self, distance_m, height_m, within_m):
        return np.inf, np.inf


def test_bounds_that_levels_exceed_are_refused():
    with pytest.raises(ScenarioError, match="TooFlat': its loss changes faster") as refused:
        compiled_loss(TooFlat(250.0))
    assert "from a distance of 100 m and a height of 20 m to " in str(refused.value)
    assert re.search(
        r"by los_db changes by (-[\d.]+) dB, but by the slope .* by (-[\d.]+) dB",
        str(refused.value),
    )
    with pytest.raises(ScenarioError, match="Unbounded': its slope must be finite"):
        compiled_loss(Unbounded(250.0))


@dataclass(frozen=True)
class NotCompiled(FreeSpace):
    """A loss that only Python can compute."""

    def los_db(self, distance_m, height_m, carrier_ghz):
        return {"slant": 40.0 + 20.0 * log10(np.hypot(distance_m, height_m))}["slant"]

    def slope(self, distance_m, height_m, within_m):
        far_m = np.hypot(distance_m, height_m)
        return (9.0 / (far_m - within_m),) * 2


def test_a_path_loss_that_cannot_be_compiled_is_refused():
    with pytest.raises(ScenarioError, match="test_air_bounds:NotCompiled': must be compiled where"):
        compiled_loss(NotCompiled())


def test_python_has_the_same_bounds():
    own, place = np.empty((1, RATES)), (np.array([600.0]), np.array([100.0]), np.array([50.0]))
    for path_loss in (AlHourani("urban"), TwoSlopes(250.0)):
        loss = compiled_loss(path_loss)
        for branch in range(3):
            write_rates(loss.rates, loss.values, branch, *place, own)
            assert tuple(own[0]) == path_loss.rates(branch, 600.0, 100.0, 50.0)
