"""Rings: where the classes of a link hold."""

import math
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desim_uav.model.radio.functions import elevation_deg
from desim_uav.model.radio.link import LADDERS, LinkBudget, LinkClass, thresholds_db
from desim_uav.model.radio.links import class_of
from desim_uav.model.radio.path_loss import AlHourani, FreeSpace, LogDistance, RowPathLoss
from desim_uav.model.radio.rings import (
    line_of_sight_ring_m,
    ring_m,
    rings,
)

URBAN = AlHourani("urban")
BUDGET = LinkBudget(30.0, 1.0)
MICROMETRE = 1e-6

environments = st.sampled_from([AlHourani(name) for name in ("suburban", "urban", "high_rise")])


def classes(*thresholds):
    return [LinkClass(snr_db, float(k + 1)) for k, snr_db in enumerate(thresholds)]


class TestAnchors:
    def test_urban_rings(self):
        """Al-Hourani urban, 2 GHz, 30 dBm, 1 MHz, a noise figure of 7 dB, 100 m up."""
        found = rings(URBAN, 2.0, 100.0, BUDGET, classes(0.65, 4.49, 10.03, 14.94, 18.97))
        assert [round(radius, 3) for radius in found.mean_m] == [
            *(8264.301, 5328.230, 2839.666, 1638.773, 1056.927)
        ]

    @pytest.mark.parametrize(
        "uniform, elevation, radius",
        [(0.1, 10.0199, 565.980), (0.5, 23.7525, 227.240), (0.9, 37.4852, 130.392)],
    )
    def test_line_of_sight_rings(self, uniform, elevation, radius):
        found = line_of_sight_ring_m(URBAN, 100.0, uniform)
        assert round(found, 3) == radius
        assert round(elevation_deg(found, 100.0), 4) == elevation
        closed = URBAN.a - math.log((1 / uniform - 1) / URBAN.a) / URBAN.b
        assert found == pytest.approx(100.0 / math.tan(math.radians(closed)), abs=1e-6)

    def test_free_space_by_hand(self):
        """100 dB of free-space loss at 2 GHz are 10^((100 - 38.468383)/20) m."""
        budget = LinkBudget(0.0, 1.0, 0.0, -160.0)  # noise of -100 dBm
        found = rings(FreeSpace(), 2.0, 100.0, budget, classes(0.0))
        slant = 299_792_458.0 / (4e9 * math.pi * 2.0) * 1e5
        assert found.los_m[0] == pytest.approx(math.sqrt(slant**2 - 1e4), abs=1e-6)
        assert found.los_m == found.nlos_m == found.mean_m


class TestEdges:
    def test_nothing_below_the_drone(self):
        assert rings(URBAN, 2.0, 900.0, LinkBudget(-40.0, 1.0), classes(0.0)).los_m == (0.0,)

    def test_just_below_the_drone(self):
        loss_db = FreeSpace().los_db(0.0, 100.0, 2.0)
        assert ring_m(lambda r: FreeSpace().los_db(r, 100.0, 2.0), loss_db) < 1e-4

    def test_whole_micrometres(self):
        for radius in rings(URBAN, 2.0, 100.0, BUDGET, LADDERS["cqi"]).mean_m:
            assert radius == round(radius * 1e6) / 1e6

    def test_sight_everywhere_and_nowhere(self):
        assert line_of_sight_ring_m(FreeSpace(), 100.0, 0.999999) == math.inf
        assert line_of_sight_ring_m(URBAN, 100.0, 0.02) == math.inf
        assert line_of_sight_ring_m(AlHourani("high_rise"), 100.0, 0.9) == 0.0


class TestRefusals:
    @pytest.mark.parametrize("height_m", [0.0, -5.0, math.nan, math.inf])
    def test_heights(self, height_m):
        with pytest.raises(ValueError, match="a drone must be above its users"):
            rings(URBAN, 2.0, height_m, BUDGET, classes(0.0))

    def test_a_ring_without_end(self):
        with pytest.raises(ValueError, match="not reached within 10,000 km"):
            rings(LogDistance(0.1, 0.0), 2.0, 100.0, BUDGET, classes(0.0))

    def test_a_loss_that_falls(self):
        @dataclass(frozen=True)
        class Odd(RowPathLoss):
            def los_db(self, distance_m, height_m, carrier_ghz):
                dip = 20.0 if 400.0 < distance_m < 500.0 else 0.0
                return FreeSpace().los_db(distance_m, height_m, carrier_ghz) - dip

        with pytest.raises(ValueError, match=r"Odd.los_db must rise with the distance, but"):
            rings(Odd(), 2.0, 100.0, LinkBudget(0.0, 1.0), classes(0.0))

    def test_a_loss_that_is_no_number(self):
        @dataclass(frozen=True)
        class Nan(RowPathLoss):
            def los_db(self, distance_m, height_m, carrier_ghz):
                return math.nan

        with pytest.raises(ValueError, match="it is nan dB"):
            rings(Nan(), 2.0, 100.0, BUDGET, classes(0.0))

    def test_a_probability_that_falls(self):
        @dataclass(frozen=True)
        class Odd(FreeSpace):
            def p_los(self, elevation):
                return 1.0 - elevation / 90.0

        with pytest.raises(ValueError, match="p_los must rise with the elevation"):
            line_of_sight_ring_m(Odd(), 100.0, 0.5)


@settings(deadline=None, max_examples=30)
@given(environments, st.floats(1.0, 500.0), st.floats(-10.0, 30.0), st.floats(0.1, 20.0))
def test_rings_shrink_as_the_threshold_rises(model, height_m, snr_db, step_db):
    found = rings(model, 2.0, height_m, BUDGET, classes(snr_db, snr_db + step_db))
    for outer, inner in found:
        assert outer >= inner
    assert found.nlos_m[0] <= found.mean_m[0] <= found.los_m[0]


@settings(deadline=None, max_examples=30)
@given(environments, st.floats(1.0, 500.0), st.sampled_from(sorted(LADDERS)), st.integers(0, 14))
def test_the_class_changes_at_the_ring(model, height_m, name, k):
    ladder = LADDERS[name]
    radius = rings(model, 2.0, height_m, BUDGET, ladder).mean_m[k]
    if radius > 0.01:  # nearer, a micrometre does not change the distance in space

        def found(distance_m):
            snr_db = BUDGET.snr_db(model.mean_db(distance_m, height_m, 2.0))
            return class_of(snr_db, thresholds_db(ladder), 0, len(ladder))

        assert found(radius - MICROMETRE) == k + 1
        assert found(radius + MICROMETRE) == k


@settings(deadline=None, max_examples=50)
@given(environments, st.floats(1.0, 500.0), st.floats(0.0, 0.999))
def test_the_user_sees_the_drone_within_the_ring(model, height_m, uniform):
    radius = line_of_sight_ring_m(model, height_m, uniform)
    if 0.01 < radius < 1e5:
        assert uniform < model.p_los(elevation_deg(radius - 10 * MICROMETRE, height_m))
        assert uniform >= model.p_los(elevation_deg(radius + 10 * MICROMETRE, height_m))
