"""Margins of fading against scipy's distributions, and the rings that they leave."""

import pytest
from scipy.stats import gamma, ncx2

from desim_uav.errors import ScenarioError
from desim_uav.model.radio.fading import Nakagami, NoFading, Rayleigh, Rician
from desim_uav.model.radio.radio import LinkClasses
from desim_uav.scenario.load import loads
from desim_uav.testing import compare_engines

OUTAGES = (1e-6, 1e-3, 0.05, 0.1, 0.5)


def power_of(fading):
    return 10.0 ** (-fading.margin_db() / 10.0)


def test_rayleigh():
    assert Rayleigh().margin_db() == pytest.approx(9.77, abs=0.005)  # 1 / 0.10536
    for outage in OUTAGES:
        assert gamma.cdf(power_of(Rayleigh(outage)), 1.0) == pytest.approx(outage, rel=1e-8)
        assert Nakagami(1.0, outage).margin_db() == pytest.approx(Rayleigh(outage).margin_db())
        weak = Rician(-30.0, outage).margin_db()
        assert weak == pytest.approx(Rayleigh(outage).margin_db(), abs=0.01)


@pytest.mark.parametrize("m", [0.5, 0.9, 2.0, 3.5, 20.0, 100.0])
def test_nakagami(m):
    for outage in OUTAGES:
        power = power_of(Nakagami(m, outage))
        assert gamma.cdf(power, m, scale=1.0 / m) == pytest.approx(outage, rel=1e-7)


@pytest.mark.parametrize("k_db", [-10.0, 0.0, 5.0, 15.0, 30.0])
def test_rician(k_db):
    factor = 10.0 ** (k_db / 10.0)
    for outage in OUTAGES:
        power = power_of(Rician(k_db, outage))
        share = ncx2.cdf(2.0 * (1.0 + factor) * power, 2, 2.0 * factor)
        assert share == pytest.approx(outage, rel=1e-6)


def test_a_class_holds_where_the_mean_is_so_much_higher():
    plain, faded = LinkClasses(), LinkClasses(fading=Rician(10.0, 0.05))
    margin_db = Rician(10.0, 0.05).margin_db()
    weaker = LinkClasses(power_dbm=30.0 - margin_db)
    assert margin_db > 3.0
    assert faded.radii_m(100.0, 0.0) == pytest.approx(weaker.radii_m(100.0, 0.0), rel=1e-9)
    rings = zip(faded.radii_m(100.0, 0.0), plain.radii_m(100.0, 0.0), strict=True)
    assert all(narrower < wider for narrower, wider in rings)
    assert LinkClasses(fading=NoFading()).ladder == plain.ladder
    assert faded.efficiencies() == plain.efficiencies()


@pytest.mark.thorough
def test_both_engines():
    scenario = {"drones.radio.fading": {"kind": "nakagami", "m": 2}, "episode.steps": 5}
    compare_engines("urban_downlink", scenario, episodes=1)


@pytest.mark.parametrize(
    ("fading", "message"),
    [
        ("rayleigh, interference: co_channel", "fading needs interference: none"),
        ("raileigh", "did you mean 'rayleigh'"),
        ("{kind: nakagami, m: 0.1}", "0.5"),
        ("{kind: rician, k_db: 3, outage: 0.9}", "0.5"),
    ],
)
def test_what_is_refused(fading, message):
    with pytest.raises(ScenarioError, match=message):
        loads(f"drones: {{radio: {{kind: link_classes, fading: {fading}}}}}")
