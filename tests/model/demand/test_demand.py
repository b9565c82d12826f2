"""Requests: the laws they are drawn from, and the same draws made by hand."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from scipy import stats

from desim_uav.model.catalogue import catalogue
from desim_uav.model.demand.asking import RowDraws
from desim_uav.model.demand.demand import Continuous, Dynamic, Poisson, Static, Trace
from desim_uav.model.demand.requests import joined_episodes, joined_requests
from desim_uav.model.random.streams import Purpose, states_of
from desim_uav.model.services import PAPER, UniformChoice
from tests.verification.demand import (
    BANDWIDTH,
    DUE,
    HORIZON_US,
    MIX,
    REQUIRED,
    SERVICE,
    US,
    ask,
    drawn,
)
from tests.verification.figure import check

# Minutes and kbit/s of the table of services.
TABLE = [
    ([1, 2, 3, 4, 5, 6], [96, 160, 200, 320, 750, 1000, 2500]),
    ([3], [10, 20, 30, 40, 50]),
    ([2], [24, 48, 72, 96, 192]),
]


def within(values, expected, errors=4.0):
    """Is the mean of independent values within so many standard errors of what it should be?"""
    values = np.asarray(values, float)
    return abs(values.mean() - expected) <= errors * values.std(ddof=1) / math.sqrt(len(values))


class TestContinuous:
    def test_everybody_once_for_the_whole_episode(self):
        rows, follow = ask(Continuous(), 3)
        assert follow
        assert [r.tolist() for r in rows] == [[[0, 0, HORIZON_US, 0]]] * 3


class TestStatic:
    def test_everybody_once_at_the_start(self):
        rows, follow = ask(Static(), 500)
        assert follow
        assert all(len(r) == 1 and r[0, DUE] == 0 for r in rows)

    def test_none_asks_for_nothing(self):
        rows, _ = ask(Static(none=0.1), 20_000)
        assert within([1 - len(r) for r in rows], 0.1)
        assert not any(len(r) for r in ask(Static(none=1.0), 50)[0])

    def test_shares_of_the_mix_are_renormalised(self):
        drawn = np.concatenate(ask(Static(), 30_000)[0])[:, SERVICE]
        for service, weight in enumerate(MIX.values()):
            assert within(drawn == service, weight / 0.9)

    def test_a_service_of_no_weight_is_never_asked_for(self):
        rows, _ = ask(Static(mix={"throughput": 0.0, "data_gathering": 3.0}), 2000)
        assert set(np.concatenate(rows)[:, SERVICE]) == {2}

    def test_values_come_from_the_lists_each_as_likely(self):
        rows = np.concatenate(ask(Static(), 40_000)[0])
        for service, (minutes, kbps) in enumerate(TABLE):
            own = rows[rows[:, SERVICE] == service]
            for column, values, unit in ((REQUIRED, minutes, 60 * US), (BANDWIDTH, kbps, 1000)):
                found, counts = np.unique(own[:, column], return_counts=True)
                assert found.tolist() == [value * unit for value in values]
                assert len(values) == 1 or stats.chisquare(counts).pvalue > 1e-3
        own = rows[rows[:, SERVICE] == 0]
        table = stats.contingency.crosstab(own[:, REQUIRED], own[:, BANDWIDTH]).count
        assert stats.chi2_contingency(table).pvalue > 1e-3


class TestDynamic:
    def test_think_times_are_exponential(self):
        # The second to the fifth request of each user, in a day in which all of them fall.
        rows, follow = ask(Dynamic(), 4000, seed=3, horizon_us=86_400 * US)
        assert follow
        assert min(map(len, rows)) > 5
        thinks = np.concatenate([r[1:6, DUE] for r in rows]) / US
        assert stats.kstest(thinks, stats.expon(scale=300.0).cdf).pvalue > 1e-3

    def test_nothing_is_another_think_time(self):
        # A geometric sum of exponentials is exponential: mean 300 / (1 - none).
        rows, _ = ask(Dynamic(think_time_s=60.0, none=0.25), 4000, seed=4, horizon_us=86_400 * US)
        gaps = np.concatenate([r[1:6, DUE] for r in rows]) / US
        assert stats.kstest(gaps, stats.expon(scale=80.0).cdf).pvalue > 1e-3
        first = np.array([r[0, DUE] for r in rows])
        assert within(first == 0, 0.75)
        assert stats.kstest(first[first > 0] / US, stats.expon(scale=80.0).cdf).pvalue > 1e-3

    def test_think_times_say_nothing_of_one_another_or_of_the_request(self):
        rows, _ = ask(Dynamic(), 20_000, seed=5, horizon_us=86_400 * US)
        table = np.array([[r[0, REQUIRED], r[1, DUE], r[2, DUE]] for r in rows], float)
        deviations = (table - table.mean(axis=0)) / table.std(axis=0)
        for a, b in ((0, 1), (1, 2)):
            assert within(deviations[:, a] * deviations[:, b], 0.0)

    @pytest.mark.parametrize("none", [0.0, 0.4])
    def test_drawn_until_the_horizon_is_passed_and_no_further(self, none):
        rows, _ = ask(Dynamic(think_time_s=100.0, none=none), 300, seed=6)
        longer, _ = ask(Dynamic(think_time_s=100.0, none=none), 300, seed=6, horizon_us=10**10)
        for own, more in zip(rows, longer, strict=True):
            # At the earliest, one request begins when those before and its own thinking are over.
            earliest = np.cumsum(more[:, DUE]) + np.cumsum(more[:, REQUIRED]) - more[:, REQUIRED]
            assert own.tolist() == more[earliest < HORIZON_US].tolist()
            assert earliest[-1] > HORIZON_US

    def test_the_first_is_at_the_start(self):
        rows, _ = ask(Dynamic(), 200)
        assert all(r[0, DUE] == 0 and (r[1:, DUE] > 0).all() for r in rows)

    def test_the_kth_request_is_the_same_whatever_came_of_those_before(self):
        # The attributes do not depend on the think time's mean, the times do not on the mix.
        quick, _ = ask(Dynamic(think_time_s=30.0), 50)
        slow, _ = ask(Dynamic(think_time_s=300.0), 50)
        for a, b in zip(quick, slow, strict=True):
            assert len(a) >= len(b)
            assert a[: len(b), SERVICE:].tolist() == b[:, SERVICE:].tolist()
            assert b[:, DUE] == pytest.approx(10 * a[: len(b), DUE], abs=5)


class TestPoisson:
    USERS = 5000

    def test_counts(self):
        check(drawn(self.USERS))
        assert not ask(Poisson(60.0), 1)[1]

    def test_arrivals_are_uniform_and_ascend_before_the_horizon(self):
        rows, _ = ask(Poisson(30.0), self.USERS, seed=8)
        times = np.concatenate([r[:, DUE] for r in rows])
        assert stats.kstest(times / HORIZON_US, "uniform").pvalue > 1e-3
        assert times.max() < HORIZON_US
        assert all((np.diff(r[:, DUE]) >= 0).all() for r in rows)

    def test_counts_of_disjoint_times_are_uncorrelated(self):
        rows, _ = ask(Poisson(60.0), self.USERS, seed=9)
        half = np.array([(r[:, DUE] < HORIZON_US // 2).sum() for r in rows])
        rest = np.array([len(r) for r in rows]) - half
        assert within((half - 15.0) * (rest - 15.0), 0.0)


# The draws again, with NumPy's generators and no loop in common.


class Drawn(NamedTuple):
    nothing: bool
    service: int
    required_us: int
    bandwidth_bps: int
    gap_us: int


def draws(generator, none, shares, mean_s):
    """The draws of a user without end: five uniform numbers each."""
    while True:
        asks, which, lasts, takes, gap = generator.random(5)
        service = next(k for k, share in enumerate(np.cumsum(shares)) if which < share)
        minutes, kbps = TABLE[service]
        yield Drawn(
            asks < none,
            service,
            minutes[math.floor(lasts * len(minutes))] * 60 * US,
            kbps[math.floor(takes * len(kbps))] * 1000,
            round(-math.log(1.0 - gap) * mean_s * 1e6),
        )


def asked_once(draw):
    """Static demand."""
    return [] if draw.nothing else [[0, draw.service, draw.required_us, draw.bandwidth_bps]]


def asked_in_turn(sequence):
    """Dynamic demand: think, ask, be served at once."""
    clock = thought = 0
    for draw in sequence:
        if clock >= HORIZON_US:
            return
        if draw.nothing:
            thought, clock = thought + draw.gap_us, clock + draw.gap_us
        else:
            yield [thought, draw.service, draw.required_us, draw.bandwidth_bps]
            thought, clock = draw.gap_us, clock + draw.required_us + draw.gap_us


def asked_on_arrival(first_us, sequence):
    """Poisson arrivals, the first of them given."""
    clock = first_us
    for draw in sequence:
        if clock >= HORIZON_US:
            return
        if not draw.nothing:
            yield [clock, draw.service, draw.required_us, draw.bandwidth_bps]
        clock += draw.gap_us


@pytest.mark.parametrize("none", [0.0, 0.1, 0.6])
@pytest.mark.parametrize("kind", ["static", "dynamic", "poisson"])
@pytest.mark.parametrize(("seed", "episode"), [(0, 0), (2**35 + 1, 12), (5, -2)])
def test_an_independent_draw_is_the_same(kind, none, seed, episode):
    demand, mean_s = {
        "static": (Static(none=none), 1.0),
        "dynamic": (Dynamic(none=none), 300.0),
        "poisson": (Poisson(30.0, none=none), 120.0),
    }[kind]
    shares = [weight / sum(MIX.values()) for weight in MIX.values()]
    for user, own in enumerate(ask(demand, 60, seed=seed, episode=episode)[0]):
        sequence = np.random.SeedSequence(seed, spawn_key=(3, user, episode % 2**32))
        generator = np.random.Generator(np.random.SFC64(sequence))
        if kind == "poisson":
            first_us = round(-math.log(1.0 - generator.random()) * mean_s * 1e6)
            expected = list(asked_on_arrival(first_us, draws(generator, none, shares, mean_s)))
        elif kind == "dynamic":
            expected = list(asked_in_turn(draws(generator, none, shares, mean_s)))
        else:
            expected = asked_once(next(draws(generator, none, shares, mean_s)))
        assert own[:, SERVICE:].tolist() == [row[1:] for row in expected]
        # log and log1p may differ in their last bit, which is a microsecond once in a while.
        assert np.abs(own[:, DUE] - [row[0] for row in expected]).max(initial=0) <= 2


class TestTrace:
    HEADER = "user,t_s,service,required_s,bandwidth_kbps\n"

    def trace(self, tmp_path, text):
        file = tmp_path / "requests.csv"
        file.write_text(self.HEADER + text, encoding="utf-8")
        return Trace(file)

    def test_each_users_own_in_order_of_time(self, tmp_path):
        trace = self.trace(
            tmp_path,
            "2,60,data_gathering,0.5,12.5\n0,5,throughput,60,96\n2,1.25,edge_computing,180,0\n"
            "0,1800,throughput,60,96\n0,1799.9,throughput,60,96\n",
        )
        rows, follow = ask(trace, 3)
        assert not follow
        assert [r.tolist() for r in rows] == [
            [[5 * US, 0, 60 * US, 96_000], [1_799_900_000, 0, 60 * US, 96_000]],
            [],
            [[1_250_000, 1, 180 * US, 0], [60 * US, 2, 500_000, 12_500]],
        ]

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("0,0,throughput,0,5\n", r"requests\.csv:2: required_s: must be above 0"),
            ("0,0,throughput,1,5\n0,0,throughput,1,x\n", r"requests\.csv:3: bandwidth_kbps: 'x'"),
            ("0,inf,throughput,1,5\n", r"requests\.csv:2: t_s"),
        ],
    )
    def test_what_is_no_trace(self, tmp_path, text, message):
        with pytest.raises(ValueError, match=message):
            self.trace(tmp_path, text)

    def test_what_does_not_fit_a_scenario(self, tmp_path):
        trace = self.trace(tmp_path, "7,0,throughput,1,5\n0,0,thruput,1,5\n")
        user, service = trace.problems(7, list(PAPER))
        assert "requests.csv:2: user: 7" in user
        assert "requests.csv:3: service: 'thruput': unknown (did you mean 'throughput'?)" in service


class TestManyEpisodes:
    def draws(self, per_hour, episodes=3, users=4):
        own = RowDraws(Poisson(per_hour), catalogue(PAPER, MIX), HORIZON_US)
        return own, states_of(7, Purpose.DEMAND, range(episodes), users)

    def test_further_episodes_are_drawn_once(self, monkeypatch):
        own, states = self.draws(120.0)
        calls, draw = [], RowDraws._draw
        monkeypatch.setattr(RowDraws, "_draw", lambda *args: calls.append(1) or draw(*args))
        first = own.of(states)
        assert first.offsets[0, -1] > 4 * 16 and len(calls) == 2
        again = own.of(states)
        assert len(calls) == 3
        assert all(np.array_equal(a.rows, b.rows) for a, b in zip(first, again, strict=True))

    def test_groups_are_joined_episode_by_episode(self):
        groups = [own.of(states) for own, states in map(self.draws, (120.0, 6.0))]
        joined = joined_episodes(groups)
        assert len(joined) == 3
        for k, found in enumerate(joined):
            expected = joined_requests([own[k] for own in groups])
            assert found.rows.tolist() == expected.rows.tolist()
            assert found.offsets.tolist() == expected.offsets.tolist()
            assert found.follows.tolist() == expected.follows.tolist()


class TestCatalogue:
    def test_the_papers(self):
        found = catalogue(PAPER, MIX)
        assert found.names == ("throughput", "edge_computing", "data_gathering")
        assert found.share == pytest.approx([5 / 9, 7.5 / 9, 1.0])
        assert found.share[-1] == 1.0
        for service, (minutes, kbps) in enumerate(TABLE):
            assert found.sizes[service].tolist() == [len(minutes), len(kbps)]
            lasts = found.values[service, 0, : len(minutes)]
            assert lasts.tolist() == [m * 60 * US for m in minutes]
            takes = found.values[service, 1, : len(kbps)]
            assert takes.tolist() == [k * 1000 for k in kbps]

    def test_every_share_can_be_reached_and_none_beyond(self):
        found = catalogue(PAPER, {"throughput": 0.1, "edge_computing": 0.2})
        last = np.searchsorted(found.share, np.nextafter(1.0, 0.0), side="right")
        assert last == 1
        assert found.share[1:].tolist() == [1.0, 1.0]

    def test_parts_of_a_minute(self):
        values = UniformChoice((0.5, 1e-7), (0.5,)).values()
        assert values["duration_min"].tolist() == [30 * US, 6]
        assert values["bandwidth_kbps"].tolist() == [500]
