"""Walks: on the map, joined, mirrored at its edge, and drawn as the model says."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from desim_uav.model.mobility.mobility import Area, RandomWalk, Static
from desim_uav.model.mobility.recorded_walks import Trace
from desim_uav.model.random.streams import Purpose, Streams
from tests.verification.walked import starts_of, velocities_of

US = 1_000_000
HORIZON_US = 1800 * US


def streams(seed=0, episode=0):
    return Streams(seed, Purpose.MOBILITY, episode)


def own_legs(walks):
    """The legs of each user."""
    assert walks.offsets[0] == 0
    assert walks.offsets[-1] == len(walks.legs)
    return [walks.legs[a:b] for a, b in pairwise(walks.offsets)]


def ends(legs, horizon_us):
    """Where each leg ends."""
    stops = np.append(legs["begin_us"][1:], horizon_us)
    return starts_of(legs) + velocities_of(legs) * ((stops - legs["begin_us"]) * 1e-6)[:, None]


def position(legs, t_us):
    leg = legs[legs["begin_us"] <= t_us][-1]
    return starts_of(leg) + velocities_of(leg) * (t_us - leg.begin_us) * 1e-6


# The random walk again: NumPy's generator, straight on forever, and the plane folded onto the map.


def headings(generator, count):
    """Unit vectors, by rejection in the square."""
    found = []
    while len(found) < count:
        x, y = 2.0 * generator.random() - 1.0, 2.0 * generator.random() - 1.0
        if 1e-6 < x * x + y * y <= 1.0:
            found.append(np.array([x, y]) / math.hypot(x, y))
    return found


def folded(value, size):
    """(position, sign of the direction) on 0 … size for a place on the unfolded line."""
    turns, rest = divmod(value, size)
    return (rest, 1) if turns % 2 == 0 else (size - rest, -1)


class Unfolded:
    """One user's walk, leg by drawn leg, as straight lines in the unfolded plane."""

    def __init__(self, home, generator, walk, size, horizon_us):
        self.size, self.speed = size, walk.speed_mps
        self.leg_us = round(walk.leg_s * US)
        self.corners, self.velocities = [np.array(home, float)], []
        for heading in headings(generator, -(-horizon_us // self.leg_us)):
            signs = [folded(p, s)[1] for p, s in zip(self.corners[-1], size, strict=True)]
            # A heading drawn on the map goes the other way where the fold has turned it.
            self.velocities.append(walk.speed_mps * heading * signs)
            self.corners.append(self.corners[-1] + self.velocities[-1] * self.leg_us * 1e-6)

    def position(self, t_us):
        k = min(int(t_us // self.leg_us), len(self.velocities) - 1)
        line = self.corners[k] + self.velocities[k] * (t_us - k * self.leg_us) * 1e-6
        return np.array([folded(p, s)[0] for p, s in zip(line, self.size, strict=True)])

    def walls(self, horizon_us):
        """How many walls the walk meets."""
        met = 0
        for k, velocity in enumerate(self.velocities):
            lasts = (min((k + 1) * self.leg_us, horizon_us) - k * self.leg_us) * 1e-6
            line = np.array([self.corners[k], self.corners[k] + velocity * lasts]) / self.size
            met += int(np.abs(np.diff(np.floor(line), axis=0)).sum())
        return met


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("walk", "size"),
    [
        (RandomWalk(), (2400.0, 2400.0)),
        (RandomWalk(), (300.0, 200.0)),
        (RandomWalk(speed_mps=12.0, leg_s=37.5), (150.0, 400.0)),
        (RandomWalk(speed_mps=40.0, leg_s=11.0), (60.0, 90.0)),
    ],
)
def test_an_independent_walk_is_the_same(walk, size):
    homes = np.random.default_rng(3).uniform(0.0, size, (25, 2))
    walls = 0
    walks = walk.walks(homes, streams(9, 4), Area(*size), HORIZON_US)
    for user, legs in enumerate(own_legs(walks)):
        sequence = np.random.SeedSequence(9, spawn_key=(2, user, 4))
        generator = np.random.Generator(np.random.SFC64(sequence))
        expected = Unfolded(homes[user], generator, walk, np.array(size), HORIZON_US)
        met = expected.walls(HORIZON_US)
        # A mirror rounds its time to a microsecond: half of one off, to either side.
        drift_m = 1e-6 + 2e-6 * walk.speed_mps * math.sqrt(met)
        for t_us in range(0, HORIZON_US, 7_300_001):
            assert position(legs, t_us) == pytest.approx(expected.position(t_us), abs=drift_m)
        starts = legs[np.isin(legs["begin_us"], np.arange(0, HORIZON_US, expected.leg_us))]
        assert len(starts) == len(expected.velocities)
        speeds = np.abs(velocities_of(legs))
        drawn = np.abs(expected.velocities)
        for leg, velocity in zip(starts, drawn, strict=True):
            assert np.abs(velocities_of(leg)) == pytest.approx(velocity, rel=1e-14)
        # A mirror turns a velocity and changes nothing else of it.
        which = (legs["begin_us"] // expected.leg_us).astype(int)
        assert speeds == pytest.approx(drawn[which], rel=1e-14)
        assert len(legs) == pytest.approx(len(drawn) + met, abs=1)
        walls += met
    assert walls > 0


@given(
    st.integers(0, 2**63 - 1),
    st.tuples(st.floats(1.0, 3000.0), st.floats(1.0, 3000.0)),
    st.floats(0.01, 50.0),
    st.floats(1.0, 100.0),
    st.integers(1, 600 * US),
)
@settings(max_examples=60, deadline=None)
def test_walks_stay_on_the_map_and_join(seed, size, speed, leg_s, horizon_us):
    rng = np.random.default_rng(seed)
    homes = rng.uniform(0.0, size, (4, 2))
    # On an edge and in two corners, where a walk may be mirrored at once.
    homes = np.concatenate([homes, [(0.0, 0.0), size, (size[0], 0.5 * size[1])]])
    walk = RandomWalk(speed, leg_s)
    walks = walk.walks(homes, streams(seed), Area(*size), horizon_us)
    for user, legs in enumerate(own_legs(walks)):
        assert legs["begin_us"][0] == 0
        assert starts_of(legs[0]).tolist() == homes[user].tolist()
        assert (np.diff(legs["begin_us"]) > 0).all()
        assert (legs["begin_us"] == np.floor(legs["begin_us"])).all()
        assert legs["begin_us"][-1] < horizon_us
        assert np.hypot(legs["vx_mps"], legs["vy_mps"]) == pytest.approx(speed, rel=1e-14)
        lasts = np.diff(legs["begin_us"], append=horizon_us)
        assert lasts.max() <= round(leg_s * US)
        stops = ends(legs, horizon_us)
        assert stops[:-1] == pytest.approx(starts_of(legs[1:]), abs=1e-4)
        for points in (starts_of(legs), stops):
            assert points.min() >= -1e-4
            assert (points <= np.array(size) + 1e-4).all()


def test_a_leg_is_split_just_where_it_is_mirrored():
    walk, size = RandomWalk(speed_mps=10.0, leg_s=60.0), (200.0, 200.0)
    homes = np.full((50, 2), 100.0)
    mirrors = 0
    for legs in own_legs(walk.walks(homes, streams(2), Area(*size), 600 * US)):
        for before, leg in pairwise(legs):
            if leg.begin_us % (60 * US) == 0:
                continue
            turned = np.flatnonzero(np.sign(velocities_of(before)) != np.sign(velocities_of(leg)))
            assert len(turned) >= 1
            for axis in turned:
                outward = velocities_of(before)[axis] > 0
                assert starts_of(leg)[axis] == (size[axis] if outward else 0.0)
            mirrors += 1
    assert mirrors > 500


def test_headings_are_uniform():
    # One heading a user and leg: all independent draws.
    homes = np.full((4000, 2), 5e5)
    walks = RandomWalk().walks(homes, streams(17), Area(1e6, 1e6), 5 * 60 * US)
    assert len(walks.legs) == 20_000
    angles = np.arctan2(walks.legs["vy_mps"], walks.legs["vx_mps"])
    assert stats.kstest(angles, stats.uniform(-math.pi, 2 * math.pi).cdf).pvalue > 1e-3
    for k in (1, 2, 4):
        # Corners of the square, seen as a resultant of the k-fold angle.
        for part in (np.cos(k * angles), np.sin(k * angles)):
            assert abs(part.mean()) < 4 * part.std(ddof=1) / math.sqrt(len(part))


def test_headings_of_one_leg_say_nothing_of_the_next():
    homes = np.full((20_000, 2), 5e5)
    walks = RandomWalk().walks(homes, streams(18), Area(1e6, 1e6), 2 * 60 * US)
    first, second = walks.legs[::2], walks.legs[1::2]
    cosine = (velocities_of(first) * velocities_of(second)).sum(axis=1) / 1.4**2
    assert abs(cosine.mean()) < 4 * cosine.std(ddof=1) / math.sqrt(len(cosine))


def test_the_paper_walks_at_a_walking_pace():
    walk = RandomWalk()
    assert (walk.speed_mps, walk.leg_s) == (1.4, 60.0)
    walks = walk.walks(np.full((3, 2), 1200.0), streams(), Area(2400.0, 2400.0), HORIZON_US)
    legs = own_legs(walks)[0]
    assert legs["begin_us"].tolist() == [k * 60 * US for k in range(30)]
    assert np.hypot(*ends(legs, HORIZON_US)[0] - 1200.0) == pytest.approx(84.0, rel=1e-12)


def test_no_speed_is_no_walk():
    homes = np.array([(0.0, 7.0)])
    walks = RandomWalk(speed_mps=0.0).walks(homes, streams(), Area(9.0, 9.0), HORIZON_US)
    assert (starts_of(walks.legs) == (0.0, 7.0)).all()
    assert (velocities_of(walks.legs) == 0.0).all()


def test_a_new_episode_is_a_new_walk_from_home():
    homes = np.array([(100.0, 100.0), (50.0, 60.0)])
    area = Area(2000.0, 2000.0)
    one, other = (RandomWalk().walks(homes, streams(3, e), area, HORIZON_US) for e in (0, 1))
    for first, second in zip(own_legs(one), own_legs(other), strict=True):
        assert starts_of(first[0]).tolist() == starts_of(second[0]).tolist()
        assert first["vx_mps"][0] != second["vx_mps"][0]


def test_static():
    homes = np.array([(1.0, 2.0), (3.0, 4.0)])
    walks = Static().walks(homes, streams(), Area(5.0, 5.0), HORIZON_US)
    assert walks.legs.tolist() == [(0, 1, 2, 0, 0), (0, 3, 4, 0, 0)]
    assert walks.offsets.tolist() == [0, 1, 2]


class TestTrace:
    def trace(self, tmp_path, text):
        file = tmp_path / "walks.csv"
        file.write_text(text, encoding="utf-8")
        return Trace(file)

    def test_from_way_point_to_way_point(self, tmp_path):
        trace = self.trace(
            tmp_path,
            "t_s,user,x_m,y_m\n10,1,100,0\n0,2,5,6\n30,1,140,60\n31.5,1,140,0\n0.25,2,5,6\n",
        )
        homes = np.array([(9.0, 9.0), (8.0, 8.0), (7.0, 7.0)])
        walks = trace.walks(homes, streams(), Area(200.0, 200.0), HORIZON_US)
        home, one, two = own_legs(walks)
        assert home.tolist() == [(0, 9, 9, 0, 0)]
        assert one.tolist() == [
            (0, 100, 0, 0, 0),
            (10 * US, 100, 0, 2, 3),
            (30 * US, 140, 60, 0, -40),
            (31.5 * US, 140, 0, 0, 0),
        ]
        assert two.tolist() == [(0, 5, 6, 0, 0), (0.25 * US, 5, 6, 0, 0)]

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("user,t_s,x_m\n", r"walks\.csv:1: no column 'y_m'"),
            ("user,t_s,x_m,y_m\n0,0,1,1\n0,0,2,2\n", r"csv:3: t_s: user 0: times must increase"),
            ("user,t_s,x_m,y_m\n0,5,1,1\n1,9,1,1\n0,4,2,2\n", r"walks\.csv:4: t_s: user 0"),
            ("user,t_s,x_m,y_m\n0,0,nan,1\n", r"walks\.csv:2: x_m: 'nan'"),
            ("user,t_s,x_m,y_m\n-1,0,1,1\n", r"walks\.csv:2: user: '-1'"),
            ("user,t_s,x_m,y_m\n0,-2,1,1\n", r"walks\.csv:2: t_s: '-2'"),
            ("user,t_s,x_m,y_m\n0,0,1\n", r"walks\.csv:2: y_m"),
        ],
    )
    def test_what_is_no_trace(self, tmp_path, text, message):
        with pytest.raises(ValueError, match=message):
            self.trace(tmp_path, text)

    def test_no_file(self, tmp_path):
        with pytest.raises(ValueError, match=r"none\.csv"):
            Trace(tmp_path / "none.csv")

    def test_what_does_not_fit_a_scenario(self, tmp_path):
        trace = self.trace(tmp_path, "user,t_s,x_m,y_m\n0,0,1,1\n3,0,1,1\n1,0,1,201\n")
        user, place = sorted(trace.problems(3, Area(200.0, 200.0)), key=lambda p: "off" in p)
        assert "walks.csv:3: user: 3" in user
        assert "walks.csv:4: (1, 201) m is off the map" in place
        assert trace.problems(4, Area(200.0, 201.0)) == []
