"""Between levels whose classes have no smooth radii, there are no fits of them."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from desim_uav.model.radio.fits import NONE, _fits, fits_of
from desim_uav.model.radio.functions import log10, slant_range_m
from desim_uav.model.radio.link import LinkBudget, LinkClass
from desim_uav.model.radio.path_loss import AlHourani, LogDistance, RowPathLoss

LEVELS_M = (40.0, 60.0)


@dataclass(frozen=True)
class Bent(RowPathLoss):
    """A loss that rises with the height above a kink."""

    kink_m: float

    def los_db(self, distance_m, height_m, carrier_ghz):
        return 20.0 * log10(slant_range_m(distance_m, height_m)) + max(
            0.5 * (height_m - self.kink_m), 0.0
        )

    def slope(self, distance_m, height_m, within_m):
        nearest = slant_range_m(distance_m, height_m) - within_m
        return (9.0 / nearest, 9.0 / nearest + 0.5) if nearest > 0.0 else (np.inf, np.inf)


def fits(path_loss, largest_db, levels_m=LEVELS_M):
    return _fits(path_loss, 2.0, tuple(largest_db), levels_m, (0.0,))


@pytest.mark.parametrize(("kink_m", "known"), [(30.0, True), (51.3, False), (70.0, True)])
def test_a_kink_between_the_levels(kink_m, known):
    assert (fits(Bent(kink_m), [60.0]) is not NONE) == known


@pytest.mark.parametrize(
    ("metres", "known"), [(39.0, True), (50.0, False), (59.0, False), (61.0, True)]
)
def test_a_class_that_holds_on_part_of_the_way(metres, known):
    """One that holds within a distance in space does not where the drone is higher than that."""
    found = fits(LogDistance(2.0, 0.0), [60.0, 20.0 * np.log10(metres)])
    assert (found is not NONE) == known
    if known:
        nowhere = metres < 40.0
        assert (found.bounds_m[0, :, 0, 1] == -1.0).all() == nowhere
        assert (found.bounds_m[0, :, 0, 0] > 900.0).all()


def test_bounds_hold_radii_of_free_space():
    """At a height h, a class holds within the root of d² - h²."""
    found = fits(LogDistance(2.0, 0.0), [40.0])  # within 100 m
    least_m, most_m = found.bounds_m[0, :, 0, 0]
    assert 79.9 < least_m <= 80.0 + 1e-9 and np.sqrt(8400.0) - 1e-9 <= most_m < 91.8


def test_levels_of_a_real_town_have_fits():
    assert fits(AlHourani("urban"), [100.0, 90.0, 80.0]) is not NONE


def test_equal_numbers_of_other_types_have_fits_of_their_own():
    """To Python they are equal, and so are path losses with them."""
    one = LinkClass(0.0, 1.0)
    known = _fits.cache_info().misses
    for at_1m_db in (1, 1.0, 0.0, -0.0):
        loss, budget = LogDistance(2.0, at_1m_db), LinkBudget(0.0, 5.0, 7.0, -174.0)
        radio = SimpleNamespace(loss=loss, carrier_ghz=2.0, budget=budget, ladder=[one])
        fits_of(radio, LEVELS_M, (0.0,))
    assert _fits.cache_info().misses == known + 4
