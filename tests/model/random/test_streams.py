"""The streams are NumPy's own, and nobody's draws depend on another."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from desim_uav.model.catalogue import catalogue
from desim_uav.model.demand.demand import Dynamic, Poisson, Static
from desim_uav.model.mobility.mobility import Area, RandomWalk
from desim_uav.model.random.streams import (
    Purpose,
    Stream,
    Streams,
    apart,
    begin_stream,
    next_uniform,
    next_word,
    uniform,
)
from desim_uav.model.services import PAPER
from desim_uav.rowcode.rows import blank
from desim_uav.sample_path import draw
from desim_uav.scenario.load import loads
from desim_uav.world import build_world
from tests.verification.figure import check
from tests.verification.streams import SEEDS, changed, drawn, each, figures, hashes, numpys

HORIZON_US = 1_800_000_000


class TestNumPys:
    @given(
        st.integers(0, 2**63 - 1) | st.sampled_from(SEEDS),
        st.sampled_from(Purpose),
        st.integers(-(2**31), 2**31 - 1),
        st.integers(1, 12),
    )
    @example(2**32, Purpose.WORLD, 0, 12)
    @example(2**63 - 1, Purpose.LEARNER, -1, 12)
    @example(0, Purpose.DEMAND, -(2**31), 12)
    @settings(max_examples=150, deadline=None)
    def test_the_kernels_give_the_same_numbers(self, seed, purpose, episode, entities):
        states = Streams(seed, purpose, episode).states(entities)
        for entity in range(entities):
            expected = numpys(seed, int(purpose), entity, episode).random(5)
            assert [next_uniform(states[entity]) for _ in range(5)] == expected.tolist()

    @pytest.mark.parametrize("seed", SEEDS)
    @pytest.mark.parametrize("episode", [0, 1, 6999, -1, -2])
    def test_so_do_the_generators(self, seed, episode):
        for entity in (0, 1, 999_999):
            ours = Streams(seed, Purpose.MOBILITY, episode).generator(entity).random(20)
            theirs = numpys(seed, 2, entity, episode).random(20)
            assert ours.tolist() == theirs.tolist()

    def test_far_along_and_for_many_entities(self):
        check(figures())

    def test_words_are_the_raw_ones(self):
        states = Streams(3, Purpose.RESPAWN, 1).states(1)
        raw = numpys(3, 5, 0, 1).bit_generator.random_raw(100)
        assert [int(next_word(states[0])) for _ in range(100)] == raw.tolist()

    def test_a_stream_that_is_turned_apart_says_nothing_of_what_it_was(self):
        """It is NumPy's SFC64 from the changed state, after twelve words."""
        states = Streams(3, Purpose.MOBILITY, 1).states(400)
        stream, pairs = blank(Stream), []
        for state in states.tolist():
            begin_stream(stream, state, 0)
            first = uniform(stream)
            begin_stream(stream, state, 0)
            apart(stream)
            pairs.append((first, uniform(stream)))
            generator = np.random.SFC64(0)
            words = np.array([state[0] ^ 0x9E3779B97F4A7C15, *state[1:3], 1], np.uint64)
            generator.state = {**generator.state, "state": {"state": words}}
            expected = np.random.Generator(generator).random(13)[-1]
            assert pairs[-1][1] == expected
        assert abs(np.corrcoef(np.array(pairs).T)[0, 1]) < 4 / 400**0.5

    def test_no_two_streams_are_alike(self):
        first = {
            Streams(seed, purpose, episode).generator(entity).random()
            for seed in (0, 1, 2**32)
            for purpose in Purpose
            for episode in (-1, 0, 1)
            for entity in (0, 1, 2)
        }
        assert len(first) == 3 * len(Purpose) * 3 * 3

    def test_the_purposes(self):
        assert {purpose.name: int(purpose) for purpose in Purpose} == {
            "WORLD": 0,
            "PLACEMENT": 1,
            "MOBILITY": 2,
            "DEMAND": 3,
            "POSITION_NOISE": 4,
            "RESPAWN": 5,
            "LEARNER": 6,
            "LINK": 7,
            "TASK": 8,
            "PLANNER": 9,
        }


class TestOneMore:
    def test_user_walks(self):
        homes = np.random.default_rng(1).uniform(0.0, 1000.0, (9, 2))
        streams, area = Streams(5, Purpose.MOBILITY, 2), Area(1000.0, 1000.0)
        eight, nine = (
            each(*RandomWalk().walks(homes[:n], streams, area, HORIZON_US)) for n in (8, 9)
        )
        assert eight == nine[:8]
        assert len(set(nine)) == 9

    @pytest.mark.parametrize("demand", [Static(none=0.1), Dynamic(none=0.1), Poisson(60.0)])
    def test_user_asks(self, demand):
        services = catalogue(PAPER, demand.mix)
        streams = Streams(5, Purpose.DEMAND, 2)
        some, more = (
            each(*demand.requests(n, services, streams, HORIZON_US)[:2]) for n in (20, 21)
        )
        assert some == more[:20]


class TestWholeSamplePaths:
    def test_everybody_differs_and_the_same_is_the_same(self):
        one = hashes(*drawn())
        assert one == hashes(*drawn())
        for purpose, found in one.items():
            assert len(set(found)) == len(found), purpose

    @pytest.mark.parametrize("episode", [0, 3, -1])
    def test_everything_is_drawn_from_the_stream_of_its_purpose(self, episode):
        world, path = drawn(episode, seed=6, world_seed=2**33)
        coverage = numpys(2**33, 0, 0, 0).uniform(0.05, 0.15)
        assert abs(np.count_nonzero(world.grid.height_m) - 100 * coverage) <= 3.5
        for cluster, (*_, radius) in enumerate(world.clusters):
            assert radius == numpys(2**33, 0, 1 + cluster, 0).uniform(240.0, 480.0)
        for user, (x, y, _) in enumerate(world.homes):
            centre, radius = world.clusters[user % 4, :2], world.clusters[user % 4, 2]
            offsets = numpys(2**33, 1, user, 0).normal(0.0, radius / 2, (20, 2))
            assert (centre + offsets == (x, y)).all(axis=1).any()
            heading = 2.0 * numpys(6, 2, user, episode).random((20, 2)) - 1.0
            heading = heading[np.hypot(*heading.T) <= 1.0][0]
            leg = path.walks.legs[path.walks.offsets[user]]
            assert [leg.vx_mps, leg.vy_mps] == pytest.approx(1.4 * heading / np.hypot(*heading))
            row = path.requests.rows[path.requests.offsets[user]]
            share = numpys(6, 3, user, episode).random(2)[1]
            assert row[1] == np.searchsorted([5 / 9, 7.5 / 9], share, side="right")
        for drone in range(3):
            mistaken = numpys(6, 4, drone, episode).random((31, 2)) < 0.5
            assert ((path.position_error[drone] != 0.0) == mistaken).all()
            stations = np.floor(3 * numpys(6, 5, drone, episode).random(31))
            assert path.respawn[drone].tolist() == stations.tolist()

    def test_one_more_user_or_drone(self):
        one = hashes(*drawn())
        user, drone = hashes(*drawn(users__count=13)), hashes(*drawn(drones__count=4))
        assert changed(one, user) == changed(one, drone) == []
        assert len(user["placement"]) == len(one["placement"]) + 1
        assert len(drone["noise"]) == len(drone["respawn"]) == 4

    def test_one_more_cluster(self):
        one, other = hashes(*drawn()), hashes(*drawn(users__clusters__count=5))
        assert other["clusters"][:4] == one["clusters"]
        for purpose in ("buildings", "demand", "noise", "respawn"):
            assert other[purpose] == one[purpose], purpose

    def test_another_demand_or_mobility_or_no_noise(self):
        one = hashes(*drawn())
        other = hashes(*drawn(demand="{kind: poisson, rate_per_hour: 6}"))
        assert [p for p in one if one[p] != other[p]] == ["demand"]
        other = hashes(*drawn(users__mobility="{kind: static}"))
        assert [p for p in one if one[p] != other[p]] == ["mobility"]

    def test_a_new_seed_is_another_run_in_the_same_world(self):
        one, other = hashes(*drawn(seed=1)), hashes(*drawn(seed=2))
        same = [p for p in one if one[p] == other[p]]
        assert same == ["buildings", "clusters", "placement"]
        for purpose in ("mobility", "noise", "respawn"):
            assert not set(one[purpose]) & set(other[purpose]), purpose

    @pytest.mark.parametrize("episode", [1, -1])
    def test_a_new_episode_too(self, episode):
        one, other = hashes(*drawn()), hashes(*drawn(episode=episode))
        assert [p for p in one if one[p] == other[p]] == ["buildings", "clusters", "placement"]

    def test_a_world_seed_of_its_own(self):
        one, other = hashes(*drawn()), hashes(*drawn(world_seed=12))
        for purpose in ("buildings", "clusters", "placement"):
            assert not set(one[purpose]) & set(other[purpose]), purpose
        for purpose in ("demand", "noise", "respawn"):
            assert one[purpose] == other[purpose], purpose

    def test_more_steps_only_go_on(self):
        # The walks and requests of a longer episode begin with those of the shorter.
        one, other = drawn()[1], drawn(episode__steps=31)[1]
        for user in range(12):
            short = one.walks.legs[one.walks.offsets[user] : one.walks.offsets[user + 1]]
            start = other.walks.offsets[user]
            assert (other.walks.legs[start : start + len(short)] == short).all()
            short = one.requests.rows[one.requests.offsets[user] : one.requests.offsets[user + 1]]
            start = other.requests.offsets[user]
            assert (other.requests.rows[start : start + len(short)] == short).all()
        assert (other.respawn[:, :31] == one.respawn).all()


class TestTheNoiseAndTheRespawns:
    def test_position_errors(self):
        # Replications are drones: 2,000 of them, 31 epochs, 2 coordinates.
        _, path = drawn(drones__count=2000, position_noise__sigma_cells=2.0, users__count=1)
        error = path.position_error
        assert error.shape == (2000, 31, 2)
        mistaken = error != 0.0
        for axis in range(2):
            share = mistaken[:, :, axis].mean(axis=1)
            assert abs(share.mean() - 0.5) < 4 * share.std(ddof=1) / np.sqrt(2000)
            values = error[:, :, axis][mistaken[:, :, axis]]
            assert abs(values.mean()) < 4 * 2.0 / np.sqrt(len(values))
            assert abs(values.var() - 4.0) < 4 * 4.0 * np.sqrt(2.0 / len(values))
        both = mistaken.all(axis=2).mean(axis=1)
        assert abs(both.mean() - 0.25) < 4 * both.std(ddof=1) / np.sqrt(2000)

    def test_respawn_stations(self):
        world, path = drawn(drones__count=3000, users__count=1)
        assert path.respawn.shape == (3000, 31)
        for station in range(len(world.stations)):
            share = (path.respawn == station).mean(axis=1)
            assert abs(share.mean() - 1 / 3) < 4 * share.std(ddof=1) / np.sqrt(3000)
        assert set(np.unique(path.respawn)) == {0, 1, 2}

    def test_without_noise_and_without_stations(self):
        scenario = loads(
            "name: plain", overrides=["drones.battery=null", "stations.count=0", "users.count=2"]
        )
        path = draw(build_world(scenario, 0), 0, 0)
        assert path.position_error is None
        assert path.respawn.shape == (3, 0)
