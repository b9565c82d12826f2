"""Marks of links: line of sight by draws and past buildings, and shadowing."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from desim_uav.model.motion.motion import BangCoastBang
from desim_uav.model.radio.buildings import cells_as_prisms
from desim_uav.model.radio.chances import compiled_chance
from desim_uav.model.radio.functions import elevation_deg, exp
from desim_uav.model.radio.marks import BUILDINGS, DRAWN, KINDS, MEAN_LOSS
from desim_uav.model.radio.path_loss import LOS, MEAN, NLOS, AlHourani, FreeSpace
from tests.model.radio.looking import Seen, moving
from tests.model.radio.making import START_US, Leg, flying, hovering
from tests.model.radio.marking import Street, random_street, still
from tests.model.radio.test_link_sight import Caster, random_cells
from tests.model.sampler import Walk


def survey(streets, seed, oblique=False):
    rng, seen = np.random.default_rng(seed), Seen()
    for number in range(streets):
        street = random_street(rng, oblique=oblique)
        for user, rows in enumerate(street.marks()):
            check_form(rows, street.span_s)
            seen.add(rows[1:], *street.hold(user, rows), (number, user))
    return seen


def check_form(rows, span_s):
    """Marks begin at 0, later ones later, and each differs from the one before."""
    assert rows[0][0] == 0.0
    assert rows[-1][0] <= span_s + 1e-9
    for (before_s, *before), (t, *mark) in pairwise(rows):
        assert t > before_s
        assert mark != before
        assert t == round(t * 1e6) * 1e-6


def check(seen):
    assert seen.wrong == []
    assert seen.rows > seen.legs
    assert seen.unclear <= 0.01 * seen.rows


class TestDrawn:
    @pytest.mark.thorough
    def test_a_sampler_sees_the_same(self):
        check(survey(10, 1))

    @pytest.mark.slow
    def test_a_sampler_sees_the_same_on_2000_legs(self):
        check(survey(2000, 2))

    @pytest.mark.thorough
    @pytest.mark.parametrize("town", ["suburban", "urban", "dense_urban", "high_rise"])
    def test_how_often_users_see_a_drone(self, town):
        loss, users = AlHourani(town), 1500
        for number, angle in enumerate(np.linspace(2.0, 88.0, 20)):
            away = 100.0 / np.tan(np.radians(angle))
            street = Street(
                hovering((500.0, 500.0, 101.5)),
                [still(500.0 + away, 500.0)] * users,
                1.0,
                town=(loss.a, loss.b),
                number=number,
            )
            rows = street.marks()
            assert all(len(own) == 1 for own in rows)
            share = np.mean([branch == LOS for ((_, branch, _),) in rows])
            expected = 1.0 / (1.0 + loss.a * np.exp(-loss.b * (angle - loss.a)))
            error = np.sqrt(expected * (1.0 - expected) / users)
            assert abs(share - expected) <= 4.0 * error + 1.0 / users

    def test_without_obstacles_all_is_seen(self):
        chance = compiled_chance(FreeSpace())
        street = Street(hovering((500.0, 500.0, 50.0)), [still(9000.0, 0.0)] * 3, 60.0)
        sight = street.sight()
        odds = sight.odds._replace(p_los=chance.p_los, values=chance.values)
        sight = sight._replace(odds=odds)
        assert marks_by(sight, street) == [[(0.0, LOS, 0.0)]] * 3

    def test_a_cone_by_hand(self):
        # The user walks straight away below the drone: LoS ends at r = h / tan(least).
        leg, walk = hovering((500.0, 500.0, 101.5)), walking(500.0, 500.0, 3.0, 0.0)
        street = Street(leg, [walk], 3000.0)
        least, *_ = street.draws(0, 12)
        ((start, end),) = street.marks()
        assert start == (0.0, LOS, 0.0)
        assert end[0] == pytest.approx(100.0 / np.tan(np.radians(least)) / 3.0, abs=1e-6)
        assert end[1:] == (NLOS, 0.0)

    def test_a_drone_climbs_into_sight(self):
        transit = BangCoastBang(5.0, 1.0, "minimum_time").fastest_transit(200.0)
        leg = Leg((500.0, 500.0, 1.5), (500.0, 500.0, 201.5), transit, None)
        street = Street(leg, [still(400.0, 500.0)], 60.0)
        least, *_ = street.draws(0, 12)
        ((_, (t, branch, _)),) = street.marks()
        # After 5 s and 12.5 m it climbs at 5 m/s.
        high = 100.0 * np.tan(np.radians(least))
        assert 12.5 < high < 187.5
        assert t == pytest.approx(5.0 + (high - 12.5) / 5.0, abs=1e-6)
        assert branch == LOS

    def test_the_draws_of_a_cell_stay_the_same(self):
        # On whatever leg: within a cell, a user sees the drone above one elevation, not below.
        rng, seen, blocked = np.random.default_rng(4), {}, {}
        walk = still(500.0, 500.0)
        for _ in range(80):
            start, stop = rng.uniform((100.0, 100.0, 30.0), (900.0, 900.0, 150.0), (2, 3))
            street = Street(flying(rng, start, stop, 60.0), [walk], 60.0)
            (rows,) = street.marks()
            for (since, branch, _), (until, *_) in pairwise([*rows, (60.0, 0, 0.0)]):
                for t in np.linspace(since + 1e-5, until - 1e-5, 20):
                    at = np.array([t])
                    x, y, z = street.leg.trip.at(at)[0]
                    cell = int(street.cell(at)[0])
                    angle = elevation_deg(np.hypot(x - 500.0, y - 500.0), z - 1.5)
                    if branch == LOS:
                        seen[cell] = min(seen.get(cell, 90.0), angle)
                    else:
                        blocked[cell] = max(blocked.get(cell, 0.0), angle)
        assert len(seen.keys() & blocked.keys()) >= 10
        for cell in seen.keys() & blocked.keys():
            assert blocked[cell] < seen[cell]


def walking(x, y, vx, vy):
    return Walk(np.zeros(1), np.array([(x, y)], float), np.array([(vx, vy)], float))


def marks_by(sight, street):
    class With(Street):
        def sight(self):
            return sight

    return With(street.leg, street.walks, street.span_s).marks()


class TestIndependence:
    def test_the_same_numbers_in_another_order(self):
        rng = np.random.default_rng(5)
        streets = [random_street(rng, users=4) for _ in range(10)]
        first = [street.marks() for street in streets]
        assert [street.marks() for street in reversed(streets)] == first[::-1]

    def test_one_more_user(self):
        rng = np.random.default_rng(6)
        for _ in range(10):
            street = random_street(rng, users=5)
            fewer = replace(street, walks=street.walks[:4])
            assert street.marks()[:4] == fewer.marks()

    def test_users_and_drones_have_draws_of_their_own(self):
        street = Street(hovering((500.0, 500.0, 60.0)), [still(350.0, 500.0)] * 40, 1.0)
        drones = [replace(street, number=number, shadow_db=(3.0, 3.0)) for number in range(-5, 5)]
        extra = [rows[0][2] for drone in drones for rows in drone.marks()]
        branches = [rows[0][1] for drone in drones for rows in drone.marks()]
        assert len(set(extra)) == len(extra)
        assert {LOS, NLOS} == set(branches)
        other = replace(drones[0], key=(1, 2)).marks()
        assert [rows[0][2] for rows in other] != extra[:40]

    @pytest.mark.parametrize("kind", [DRAWN, BUILDINGS])
    def test_two_spans_are_one(self, kind):
        rng, changes = np.random.default_rng(7), 0
        buildings, _, size = random_cells(rng)
        for _ in range(30):
            street = random_street(rng, users=3, kind=kind)
            if kind == BUILDINGS:
                walks = [
                    Walk(one.times, one.points % np.array(size), one.velocities)
                    for one in street.walks
                ]
                street = replace(street, buildings=buildings, walks=walks)
            begin, end = street.span_us
            middle = int(rng.integers(begin + 1, end))
            whole = street.marks()
            one, other = street.marks((begin, middle)), street.marks((middle, end))
            changes += sum(len(rows) - 1 for rows in whole)
            for rows, before, after in zip(whole, one, other, strict=True):
                shift = (middle - begin) * 1e-6
                later = [(t + shift, branch, extra) for t, branch, extra in after]
                joined = before + (later[1:] if later[0][1:] == before[-1][1:] else later)
                assert [mark[1:] for mark in joined] == [mark[1:] for mark in rows]
                assert np.allclose([m[0] for m in joined], [m[0] for m in rows], atol=1.5e-6)
        assert changes > 30


class TestShadowing:
    def test_mean_and_variance(self):
        users, los_db, nlos_db = 4000, 4.0, 6.5
        street = Street(
            hovering((500.0, 500.0, 60.0)),
            [still(400.0, 500.0)] * users,
            1.0,
            shadow_db=(los_db, nlos_db),
        )
        marks = [own[0] for own in street.marks()]
        for branch, deviation in ((LOS, los_db), (NLOS, nlos_db)):
            extra = np.array([own[2] for own in marks if own[1] == branch])
            assert len(extra) > 500
            assert abs(extra.mean()) < 4 * deviation / np.sqrt(len(extra))
            error = 4 * deviation**2 * np.sqrt(2 / len(extra))
            assert abs((extra**2).mean() - deviation**2) < error

    def test_it_stays_the_same_in_a_cell(self):
        rng, found = np.random.default_rng(8), {}
        walks = [still(*rng.uniform(200.0, 800.0, 2)) for _ in range(3)]
        for _ in range(60):
            start, stop = rng.uniform((100.0, 100.0, 30.0), (900.0, 900.0, 150.0), (2, 3))
            leg = flying(rng, start, stop, 60.0)
            street = Street(leg, walks, 60.0, shadow_db=(4.0, 6.0))
            for user, rows in enumerate(street.marks()):
                for (since, branch, extra), (until, *_) in pairwise([*rows, (60.0, 0, 0.0)]):
                    cell = int(street.cell(np.array([0.5 * (since + until)]))[0])
                    found.setdefault((user, cell, branch), set()).add(extra)
        assert len(found) > 60
        assert all(len(extra) == 1 for extra in found.values())
        assert len(set.union(*found.values())) == len(found)

    def test_none_on_one_branch(self):
        users = [still(400.0, 500.0)] * 300
        street = Street(hovering((500.0, 500.0, 60.0)), users, 1.0, shadow_db=(0.0, 3.0))
        for ((_, branch, extra),) in street.marks():
            assert (extra == 0.0) == (branch == LOS)

    def test_the_level_does_not_matter(self):
        street = Street(hovering((500.0, 500.0, 60.0)), [still(500.0, 500.0)] * 50, 1.0)
        low = replace(street, shadow_db=(4.0, 4.0), kind=BUILDINGS)
        high = replace(low, leg=hovering((550.0, 450.0, 260.0)))
        assert low.marks() == high.marks()


class TestBuildings:
    @staticmethod
    def survey(maps, seed):
        rng, seen = np.random.default_rng(seed), Seen()
        for number in range(maps):
            buildings, plain, size = random_cells(rng)
            span_s = round(rng.uniform(5.0, 60.0), 6)
            top = max([roof for _, roof in plain], default=10.0)
            start, stop = rng.uniform(-0.2, 1.2, (2, 3)) * (*size, 0.0)
            start[2], stop[2] = rng.uniform(0.4 * top, 1.3 * top, 2)
            leg = hovering(start) if rng.random() < 0.2 else flying(rng, start, stop, span_s)
            scale, middle = np.array(size) / 750.0, np.array(size) / 2.0
            around = [moving(rng, span_s, 4, speed=20.0) for _ in range(2)]
            street = Street(
                leg,
                [
                    Walk(one.times, one.points * scale + middle, one.velocities * scale)
                    for one in around
                ],
                span_s,
                BUILDINGS,
                shadow_db=(4.0, 6.0) if rng.random() < 0.5 else (0.0, 0.0),
                cell_m=tuple(buildings.side_m),
                cells=buildings.shape,
                buildings=buildings,
            )
            for user, rows in enumerate(street.marks()):
                check_form(rows, span_s)
                caster = Caster(street.walks[user], street.height_m, leg.trip, plain)
                wrong = street.hold(user, rows, lambda t, caster=caster: -caster(t), 1e-9)
                seen.add(rows[1:], *wrong, (number, user))
        return seen

    def test_a_ray_caster_sees_the_same(self):
        check(self.survey(6, 3))

    @pytest.mark.slow
    def test_a_ray_caster_sees_the_same_on_200_maps(self):
        check(self.survey(200, 4))

    def test_a_house_by_hand(self):
        house = cells_as_prisms(20.0 * np.eye(9)[4].reshape(3, 3), (10.0, 10.0))
        street = Street(
            hovering((15.0, 40.0, 10.0)),
            [walking(0.0, 0.0, 1.0, 0.0), still(15.0, 30.0)],
            30.0,
            BUILDINGS,
            buildings=house,
            height_m=0.0,
        )
        behind = [(0.0, LOS, 0.0), (5.0, NLOS, 0.0), (25.0, LOS, 0.0)]
        assert street.marks() == [behind, [(0.0, LOS, 0.0)]]

    def test_memory_that_is_too_short_is_said(self):
        house = cells_as_prisms(20.0 * np.eye(9)[4].reshape(3, 3), (10.0, 10.0))
        street = Street(
            hovering((15.0, 40.0, 10.0)),
            [walking(0.0, 0.0, 1.0, 0.0)],
            30.0,
            BUILDINGS,
            buildings=house,
            height_m=0.0,
            stretches=0,
        )
        assert street.marks() == -1
        assert len(replace(street, stretches=1).marks()[0]) == 3


class TestRows:
    def test_the_mean_loss_is_one_mark(self):
        street = random_street(np.random.default_rng(9), users=4, kind=MEAN_LOSS)
        assert replace(street, shadow_db=(0.0, 0.0)).marks() == [[(0.0, MEAN, 0.0)]] * 4

    def test_names(self):
        assert KINDS == {"mean": MEAN_LOSS, "drawn": DRAWN, "buildings": BUILDINGS}

    def test_a_table_that_is_too_short_is_said(self):
        rng = np.random.default_rng(10)
        for _ in range(10):
            street = random_street(rng, users=5)
            whole = street.marks()
            needed = sum(map(len, whole))
            said = street.marks(rows=needed - 1)
            assert said >= needed
            assert street.marks(rows=said) == whole

    def test_a_span_without_length(self):
        street = random_street(np.random.default_rng(11), users=3)
        begun = street.marks((START_US, START_US))
        assert [rows[0][1:] for rows in begun] == [rows[0][1:] for rows in street.marks()]
        assert all(len(rows) == 1 for rows in begun)

    def test_a_probability_that_falls_is_refused(self):
        class Falls(AlHourani):
            def p_los(self, elevation):
                return exp(-elevation)

        with pytest.raises(ValueError, match="must rise with the elevation"):
            compiled_chance(Falls("urban"))
