"""Antennas: gains and rings by hand and by samples, the paper's disc as a cone, both engines."""

import math

import numpy as np
import pytest

import desim_uav as du
from desim_uav.errors import ScenarioError
from desim_uav.model.radio.antenna import Cone, Element, Isotropic, RowAntenna, received
from desim_uav.model.radio.levels import problem_of_bounds
from desim_uav.model.radio.link import LinkBudget, LinkClass
from desim_uav.model.radio.path_loss import AlHourani, FreeSpace, LogDistance
from desim_uav.model.radio.rings import rings
from desim_uav.model.radio.three_gpp import Aerial
from desim_uav.scenario.load import from_mapping, scenario_hash
from tests.engine.random_aerial import aimed_world_of, unlike
from tests.engine.random_radio import audited
from tests.selection import by_default

URBAN = AlHourani("urban")
WIDE = Cone(math.degrees(math.atan(6.0)), 0.0, -200.0)


@pytest.mark.parametrize(
    "angle, gain", [(0, 8), (32.5, 5), (65, -4), (90, 8 - 12 * (90 / 65) ** 2)]
)
def test_the_element_of_tr_38901(angle, gain):
    assert Element().gain_at(angle) == pytest.approx(gain, abs=1e-12)


def test_an_element_of_a_narrow_beam_has_a_least_gain():
    assert Element(beamwidth_deg=50.0).gain_at(90.0) == -22.0
    assert Element(beamwidth_deg=50.0).gain_at(50.0) == -4.0


@pytest.mark.parametrize("loss", [URBAN, FreeSpace(), LogDistance(3.0, 38.0), Aerial("umi")])
@pytest.mark.parametrize("branch", ["los_db", "nlos_db", "mean_db"])
def test_gains_are_subtracted_from_losses(loss, branch):
    """100 m up and 75 m away, a user sees the drone 36.87 degrees from straight down."""
    before_db = getattr(loss, branch)(75.0, 100.0, 2.0)
    with_element = getattr(received(loss, Element()), branch)(75.0, 100.0, 2.0)
    angle = math.degrees(math.asin(0.6))
    assert before_db - with_element == pytest.approx(8 - 12 * (angle / 65) ** 2, abs=1e-9)
    assert received(loss, Element()).p_los(50.0) == loss.p_los(50.0)
    assert received(loss, Isotropic()) is loss


@pytest.mark.parametrize("away_m, gain", [(0.0, 3.0), (173.205, 3.0), (173.206, -20.0)])
def test_a_cone_ends_at_h_tan_of_its_half_angle(away_m, gain):
    model = received(URBAN, Cone(60.0, 3.0, -20.0))
    expected_db = URBAN.mean_db(away_m, 100.0, 2.0) - gain
    assert model.mean_db(away_m, 100.0, 2.0) == pytest.approx(expected_db, abs=1e-9)


@pytest.mark.parametrize("height_m", [50.0, 100.0, 300.0])
def test_rings_of_a_cone_end_at_its_edge(height_m):
    """The first class reaches beyond the cone, the second to its edge, the third nowhere."""
    budget = LinkBudget(40.0, 1.0)
    classes = [LinkClass(snr_db, k + 1.0) for k, snr_db in enumerate((0.0, 45.0, 100.0))]
    found = rings(received(FreeSpace(), Cone(45.0, 0.0, -40.0)), 2.0, height_m, budget, classes)
    far_m, edge_m, none_m = found.mean_m
    # 40 dBm - 40 dB above a noise of -107 dBm are 107 dB, of which 38.468383 are over 1 m.
    slant_m = 10.0 ** ((107.0 - 38.468383) / 20.0)
    assert far_m == pytest.approx(math.sqrt(slant_m**2 - height_m**2), rel=1e-6)
    assert edge_m == pytest.approx(height_m, abs=1e-5)
    assert none_m == 0.0


@pytest.mark.parametrize("antenna", [Element(), Element(12.0, 30.0, 12.0), Cone(70.0, 3.0, -9.0)])
@pytest.mark.parametrize("height_m", [30.0, 100.0, 280.0])
def test_a_class_holds_within_its_ring_and_nowhere_else(antenna, height_m):
    model, budget = received(URBAN, antenna), LinkBudget(20.0, 1.0)
    classes = [LinkClass(9.0 * k, k + 1.0) for k in range(5)]
    distances = np.linspace(0.0, 6000.0, 6001)
    losses = np.array([model.mean_db(d, height_m, 2.0) for d in distances.tolist()])
    means_m = rings(model, 2.0, height_m, budget, classes).mean_m
    for one, radius_m in zip(classes, means_m, strict=True):
        holds = budget.power_dbm - losses - budget.noise_dbm >= one.snr_db
        assert (holds == (distances <= radius_m)).all()


@pytest.mark.parametrize("antenna", [Element(), Element(12.0, 20.0, 12.0), Element(5.0, 300.0)])
@pytest.mark.parametrize("loss", [URBAN, FreeSpace(), LogDistance(3.0, 38.0)])
def test_no_level_changes_faster_than_its_bounds(antenna, loss):
    assert problem_of_bounds(received(loss, antenna), 2.0) == ""


class TestCalm(RowAntenna):
    """Gain that is said to fall more slowly than it does."""

    __test__ = False

    def gain_at(self, angle: float) -> float:
        return -0.1 * angle

    def steepest_db(self, low: float, high: float) -> float:
        return 0.01


def test_bounds_that_are_too_narrow_are_found():
    assert "changes faster than its slope says" in problem_of_bounds(
        received(FreeSpace(), TestCalm()), 2.0
    )


PLAIN = {
    "map": {
        "size_m": [2400, 2400],
        "cells": [10, 10],
        "dimensions": 2,
        "levels": {"min_altitude_m": 100},
    },
    "users": {"count": 60, "mobility": {"kind": "random_walk"}},
    "demand": {"kind": "dynamic"},
    "episode": {"steps": 20},
}


def events_of(engine: str, **drones: object) -> list:
    """The crossings of a flight with the baseline policy, in order."""
    config = PLAIN | {"drones": {"count": 2, **drones}}
    events = du.run(config, policy="baseline", engine=engine, events=True, episodes=1).events
    own = events[events["kind"].isin(["enter", "exit"])]
    return list(zip(own["t_us"], own["kind"], own["drone"], own["user"], strict=True))


@pytest.mark.parametrize("engine", ["des", "batch"])
def test_the_papers_disc_is_a_cone(engine):
    """600 m at 100 m above the ground are a half angle of 80.54 degrees."""
    assert round(WIDE.half_angle_deg, 2) == 80.54
    cone = {"kind": "cone", "half_angle_deg": WIDE.half_angle_deg, "gain_dbi": 0, "side_dbi": -200}
    radio = {
        "kind": "link_classes",
        "antenna": cone,
        "classes": [{"snr_db": -20, "bit_s_hz": 1}],
    }
    of_disc = events_of(engine, footprint_radius_m=600)
    of_cone = events_of(engine, radio=radio)
    assert len(of_disc) > 50
    assert [event[1:] for event in of_cone] == [event[1:] for event in of_disc]
    apart = [abs(one[0] - other[0]) for one, other in zip(of_cone, of_disc, strict=True)]
    assert max(apart) <= 1


@pytest.mark.parametrize(
    "radio, problem",
    [
        ({"line_of_sight": "drawn"}, "the antenna cone needs line_of_sight: mean and no shadowing"),
        (
            {"antenna": {"kind": "cone", "half_angle_deg": 90, "gain_dbi": 1, "side_dbi": 0}},
            "at most 89",
        ),
        (
            {"antenna": {"kind": "cone", "half_angle_deg": 9, "gain_dbi": 1, "side_dbi": 2}},
            "side_dbi must not be above gain_dbi: 2 > 1",
        ),
        ({"antenna": "horn"}, "unknown antenna 'horn'"),
    ],
)
def test_what_is_refused(radio, problem):
    cone = {"kind": "cone", "half_angle_deg": 60, "gain_dbi": 3, "side_dbi": -9}
    with pytest.raises(ScenarioError, match=problem):
        from_mapping({"drones": {"radio": {"kind": "link_classes", "antenna": cone, **radio}}})


def test_a_scenario_without_an_antenna_has_the_hash_that_it_had():
    made = [{"kind": "link_classes"}, {"kind": "link_classes", "antenna": "isotropic"}]
    hashes = {scenario_hash(from_mapping({"drones": {"radio": each}})) for each in made}
    assert len(hashes) == 1
    other = {"drones": {"radio": {"kind": "link_classes", "antenna": "element"}}}
    assert scenario_hash(from_mapping(other)) not in hashes


def test_levels_and_maps_have_the_gain():
    """Of a drone with an element, 8 dB more below it than without one."""
    maps = []
    for antenna in ("isotropic", "element"):
        drones = {"count": 1, "radio": {"kind": "link_classes", "antenna": antenna}}
        result = du.run(PLAIN | {"drones": drones}, policy="baseline", episodes=1)
        frame = result.map(5, points=120)
        maps.append(frame["level_dbm"].max())
    assert 7.5 < maps[1] - maps[0] <= 8.0


@pytest.mark.parametrize("seed", by_default([0, 1], range(0, 60)))
def test_both_engines_are_equal_and_keep_the_rules(seed):
    world = aimed_world_of(seed)
    assert unlike(world, seed) == []
    audited(world)
