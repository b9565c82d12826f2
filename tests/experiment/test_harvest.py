"""Missions that harvest data: how they are drawn and flown, and where the drones go."""

import importlib.util
import json
import math
from pathlib import Path

import numpy as np
import pytest

from desim_uav.experiment.papers import bayerlein_2021, harvester
from desim_uav.experiment.papers.harvest import (
    GROUNDS,
    LAND,
    SCENARIO,
    Ground,
    Mission,
    Sight,
    Town,
    drawn,
)
from desim_uav.experiment.papers.harvester import FEATURES, Harvester, in_order
from desim_uav.experiment.papers.simulated import scenario_of
from desim_uav.world import build_world

NONE = dict.fromkeys(FEATURES, 0.0)


@pytest.fixture(scope="module")
def town():
    return Town(build_world(scenario_of(SCENARIO), 0))


@pytest.fixture(scope="module")
def ground():
    return Ground(GROUNDS["no shadowing"])


def policy(town, cells, drones=1, **weights):
    devices = np.array([town.number[cell] for cell in cells])
    return Harvester(in_order(NONE | weights), town, devices, drones)


def sight(town, at, steps, units):
    cells = np.array([town.number[cell] for cell in at])
    return Sight(cells, np.array(steps), np.ones(len(at), bool), np.array(units, float))


class TestTown:
    def test_ways_lead_around_blocks(self, town):
        assert len(town.cells) == 32 * 32 - 25 * 9
        west, east = town.number[4, 6], town.number[8, 6]
        assert town.number[5, 6] == -1
        assert town.steps[west, east] == 4 + 2 * 2  # past a block, and two cells aside
        assert town.home[town.number[0, 31]] == 0
        assert town.home[town.number[0, 0]] == 29  # to either corner
        assert sorted(town.beside[town.number[0, 0]].tolist()) == sorted(
            [town.number[cell] for cell in ((0, 0), (0, 0), (0, 1), (1, 0))]
        )

    def test_missions_are_drawn_from_the_papers_ranges(self, town):
        missions = [drawn(town, seed) for seed in range(300)]
        assert {len(one.starts) for one in missions} == {1, 2, 3}
        assert {len(one.devices) for one in missions} == set(range(3, 11))
        steps = np.concatenate([one.steps for one in missions])
        assert steps.min() == 50 and steps.max() == 150
        units = np.concatenate([one.units for one in missions])
        assert 5.0 <= units.min() < 5.2 and 19.8 < units.max() <= 20.0
        for one in missions:
            assert len({*one.devices.tolist()}) == len(one.devices)
            assert (town.home[one.starts] == 0).all() and (town.home[one.devices] > 0).all()


class TestHarvester:
    def test_it_takes_the_shortest_way_to_the_best_device(self, town):
        chooses = policy(town, [(4, 8), (20, 3)], way=-1.0)
        assert chooses(sight(town, [(4, 4)], [100], [5, 20])) == [town.number[4, 5]]
        chooses = policy(town, [(4, 8), (20, 3)], units=1.0)
        assert chooses(sight(town, [(4, 4)], [100], [5, 20])) != [town.number[4, 5]]

    def test_it_hovers_above_a_device_until_that_has_no_more(self, town):
        chooses = policy(town, [(4, 8), (4, 12)], way=-1.0)
        assert chooses(sight(town, [(4, 8)], [100], [5, 20])) == [town.number[4, 8]]
        assert chooses(sight(town, [(4, 8)], [100], [0, 20])) == [town.number[4, 9]]

    @pytest.mark.parametrize(("steps", "goes"), [(22, (3, 8)), (21, (3, 9)), (20, (3, 9))])
    def test_it_goes_home_in_time(self, town, steps, goes):
        """From the device (3, 8) home are 22 steps - 1; with the landing, there is just enough."""
        home = int(town.home[town.number[3, 8]])
        assert home == 22
        chooses = policy(town, [(3, 8)], way=-1.0)
        (to,) = chooses(sight(town, [(3, 8)], [steps + 2], [20]))
        assert to == town.number[goes]

    def test_it_lands_when_nothing_is_left(self, town):
        chooses = policy(town, [(4, 8)], way=-1.0)
        assert chooses(sight(town, [(0, 29)], [100], [0])) == [LAND]

    def test_it_leaves_devices_to_nearer_drones_that_can_reach_them(self, town):
        cells, at = [(4, 8), (4, 24)], [(4, 14), (4, 10)]
        chooses = policy(town, cells, 2, way=-1.0, others=-5.0)
        far, near = chooses(sight(town, at, [100, 100], [5, 5]))
        assert (far, near) == (town.number[4, 15], town.number[4, 9])
        far, _ = chooses(sight(town, at, [100, 5], [5, 5]))
        assert far == town.number[4, 13]


def test_the_channel_is_the_papers():
    """Each class carries log2(1 + SNR) in its middle; the sides of a class are 1.5 dB apart."""
    radio = scenario_of(SCENARIO).drones.radio
    middles = [one.snr_db + 0.75 for one in radio.classes]
    assert np.diff(middles) == pytest.approx(1.5, abs=1e-5)
    for middle, one in zip(middles, radio.classes, strict=True):
        assert one.bit_s_hz == pytest.approx(math.log2(1.0 + 10.0 ** (middle / 10.0)), abs=2e-6)
    above_db = radio.power_dbm - radio.path_loss.los_db(0.0, 10.0, 2.0)
    assert above_db == pytest.approx(-25.0 + 22.7 * math.log10(16.0 * math.sqrt(2.0)), abs=1e-5)
    assert min(abs(above_db - middle) for middle in middles) < 1e-5


def test_the_weights_that_come_with_the_package():
    content = json.loads(harvester.WEIGHTS.read_text(encoding="utf-8"))
    assert [*content["weights"]] == [*FEATURES]
    assert content["training"]["generations"] >= 10


@pytest.mark.thorough
def test_a_drone_above_a_device_gets_what_the_formula_says():
    assert bayerlein_2021.slot_flown() == pytest.approx(bayerlein_2021.slot(), abs=2e-6)


@pytest.mark.thorough
def test_who_never_goes_home_crashes(ground):
    """It sees one step less at each step, though it has hovered all the time."""
    cell, seen = ground.town.number[[0], [28]], []

    def hover(sees):
        seen.extend(sees.steps.tolist())
        return sees.at.tolist()

    outcome = ground.flown(Mission(cell, np.array([5.0]), cell, np.array([50])), 0, hover)
    assert not outcome.landed and outcome.collected == pytest.approx(1.0, abs=1e-9)
    assert seen == [*range(50, 0, -1)]


@pytest.mark.thorough
def test_both_engines_fly_a_mission_alike(ground):
    """Also with the battery that just lasts for the way to the device and back."""
    town, simpy = ground.town, Ground(GROUNDS["no shadowing"], "des")
    device, start = town.number[[4], [20]], town.number[[2], [29]]
    tight = int(2 * town.steps[start[0], device[0]] + 2)
    for steps, least in ((tight, 0.5), (tight - 4, 0.0)):
        mission = Mission(device, np.array([20.0]), start, np.array([steps]))
        outcomes = [
            one.flown(mission, 3, Harvester(in_order(NONE), town, device, 1))
            for one in (ground, simpy)
        ]
        assert outcomes[0] == outcomes[1]
        assert outcomes[0].landed and outcomes[0].collected >= least


@pytest.mark.thorough
def test_a_training_improves_and_is_written(tmp_path):
    script = Path(__file__).parents[2] / "policies" / "harvest.py"
    spec = importlib.util.spec_from_file_location("harvest_script", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    out = tmp_path / "weights.json"
    options = ["--generations", "1", "--population", "4", "--missions", "2", "--out", str(out)]
    assert module.main(options) == 0
    written = json.loads(out.read_text(encoding="utf-8"))
    assert [*written["weights"]] == [*FEATURES] and any(written["weights"].values())
    assert written["training"]["generations"] == 1


@pytest.mark.thorough
def test_the_learned_weights_collect_more_than_weights_of_0():
    ground = Ground({})
    first = 800_000
    learned, zero = (
        bayerlein_2021.missions(ground, weights, 120, first).percent("collected and landed")
        for weights in (harvester.learned(), np.zeros(len(FEATURES)))
    )
    more = learned - zero
    assert more.mean() > 2.0 * more.std(ddof=1) / math.sqrt(len(more))
