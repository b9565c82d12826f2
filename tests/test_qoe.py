"""The measures of quality of experience, on requests made by hand."""

import itertools
import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desim_uav import qoe
from desim_uav.columns import to_frame
from desim_uav.records import REQUESTS

DURATION_S, STEP_S = 1800.0, 60.0
DERIVED = ("wait_s", "completion_s", "handovers", "qoe1", "qoe1_feasible", "qoe2_iterations")
BASIC = {name: dtype for name, dtype in REQUESTS.items() if name not in DERIVED}


def request(t_s, requested_s, *services, end_s=None, attached_s=None, **other):
    """A request served in ``services``, each (drone, from, to): as an engine would log it."""
    served_s = sum(to - since for _, since, to in services)
    done = served_s == requested_s
    if end_s is None:
        end_s = services[-1][2] if done else DURATION_S
    gaps = [(end, start) for (_, _, end), (_, start, _) in itertools.pairwise(services)]
    if services and not done:
        gaps.append((services[-1][2], end_s))
    drones = [
        drone for k, (drone, *_) in enumerate(services) if k == 0 or services[k - 1][0] != drone
    ]
    return {
        "episode": 0,
        "request_id": 0,
        "user": 0,
        "service": "throughput",
        "t_request_s": t_s,
        "t_first_service_s": services[0][1] if services else None,
        "t_end_s": end_s,
        "requested_s": requested_s,
        "served_s": served_s,
        "bandwidth_kbps": 96.0,
        "interruptions": sum(to > since for since, to in gaps),
        "drones": drones,
        "outcome": "completed" if done else "unfinished" if services else "never_served",
        "attached_s": served_s if attached_s is None else attached_s,
    } | other


def frame(*requests):
    rows = [tuple(request[name] for name in BASIC) for request in requests]
    return qoe.derive(to_frame(BASIC, rows), DURATION_S, STEP_S)


def one(*args, **other):
    return frame(request(*args, **other)).iloc[0]


class TestOneRequest:
    def test_served_at_once_and_whole(self):
        found = one(100.0, 180.0, (0, 100.0, 280.0))
        assert (found.qoe1, found.qoe1_feasible, found.qoe2_iterations) == (1.0, 1.0, 0.0)
        assert (found.wait_s, found.completion_s, found.handovers) == (0.0, 180.0, 0)

    def test_thirty_minutes_served_at_once_cost_no_iterations(self):
        assert one(0.0, 1800.0, (0, 0.0, 1800.0)).qoe2_iterations == 0.0

    def test_never_served(self):
        found = one(600.0, 180.0)
        assert (found.qoe1, found.qoe1_feasible) == (0.0, 0.0)
        assert found.wait_s == 1200.0
        assert found.qoe2_iterations == 20.0
        assert math.isnan(found.completion_s)
        assert found.handovers == 0

    def test_served_late(self):
        found = one(0.0, 180.0, (0, 90.0, 270.0))
        assert (found.qoe1, found.wait_s, found.qoe2_iterations) == (1.0, 90.0, 1.5)
        assert found.completion_s == 270.0

    def test_interrupted(self):
        found = one(0.0, 180.0, (0, 0.0, 60.0), (0, 120.0, 240.0))
        assert (found.wait_s, found.qoe2_iterations, found.completion_s) == (0.0, 1.0, 240.0)
        assert found.handovers == 0

    def test_handed_over_without_a_gap(self):
        found = one(0.0, 180.0, (0, 0.0, 60.0), (1, 60.0, 180.0))
        assert (found.qoe2_iterations, found.handovers) == (0.0, 1)

    def test_back_to_a_drone_it_had_is_another_handover(self):
        found = one(0.0, 180.0, (0, 0.0, 60.0), (1, 60.0, 120.0), (0, 120.0, 180.0))
        assert found.handovers == 2

    def test_unfinished(self):
        found = one(0.0, 900.0, (2, 300.0, 600.0))
        assert found.qoe1 == pytest.approx(1 / 3)
        assert found.qoe1_feasible == pytest.approx(1 / 3)
        assert found.qoe2_iterations == 25.0
        assert math.isnan(found.completion_s)

    def test_a_late_request_is_measured_by_what_was_left(self):
        found = one(1740.0, 360.0, (0, 1740.0, 1800.0))
        assert found.qoe1 == pytest.approx(1 / 6)
        assert found.qoe1_feasible == 1.0

    def test_no_time_left_at_all_has_no_feasible_share(self):
        found = one(1800.0, 360.0)
        assert (found.qoe1, found.qoe2_iterations) == (0.0, 0.0)
        assert math.isnan(found.qoe1_feasible)

    def test_an_iteration_is_a_step(self):
        requests = to_frame(BASIC, [tuple(request(0.0, 60.0, (0, 60.0, 120.0)).values())])
        assert qoe.derive(requests, 100.0, 30.0).qoe2_iterations[0] == 2.0

    def test_each_row_can_have_its_own_duration(self):
        rows = [tuple(request(0.0, 100.0, end_s=end).values()) for end in (50.0, 80.0)]
        found = qoe.derive(to_frame(BASIC, rows), pd.Series([50.0, 80.0]), STEP_S)
        served = found.assign(served_s=[50.0, 40.0])
        again = qoe.derive(served, pd.Series([50.0, 80.0]), STEP_S)
        assert again.qoe1_feasible.tolist() == [1.0, 0.5]

    def test_microseconds_leave_no_dust(self):
        found = one(0.1, 0.2, (0, 0.3, 0.5))
        assert found.wait_s == 0.2
        assert found.completion_s == 0.4

    def test_the_given_frame_stays_as_it_is(self):
        requests = to_frame(BASIC, [tuple(request(0.0, 60.0, (0, 0.0, 60.0)).values())])
        before = requests.copy(deep=True)
        qoe.derive(requests, DURATION_S, STEP_S)
        pd.testing.assert_frame_equal(requests, before)


class TestSummary:
    def test_the_unserved_count_as_nothing(self):
        found = qoe.summary(frame(request(0.0, 60.0, (0, 0.0, 60.0)), request(0.0, 60.0)))
        assert found["requests"] == 2
        assert found["qoe1_percent"] == 50.0
        assert found["qoe1_feasible_percent"] == 50.0
        assert found["qoe2_iterations"] == 15.0
        assert found["wait_s"] == 900.0

    def test_qoe1_is_of_requests_not_of_seconds(self):
        long, short = request(0.0, 1000.0, (0, 0.0, 1000.0)), request(0.0, 10.0)
        assert qoe.summary(frame(long, short))["qoe1_percent"] == 50.0

    def test_completion_is_of_the_completed(self):
        found = qoe.summary(frame(request(0.0, 60.0, (0, 30.0, 90.0)), request(0.0, 60.0)))
        assert found["completion_s"] == 90.0

    def test_outcomes_interruptions_and_handovers_are_counted(self):
        found = qoe.summary(
            frame(
                request(0.0, 180.0, (0, 0.0, 60.0), (1, 90.0, 210.0)),
                request(0.0, 180.0, (0, 0.0, 60.0)),
                request(0.0, 180.0),
                request(0.0, 180.0),
            )
        )
        assert [found[name] for name in qoe.OUTCOMES] == [1, 1, 2]
        assert sum(found[name] for name in qoe.OUTCOMES) == found["requests"]
        assert found["interruptions"] == 2
        assert found["handovers"] == 1

    def test_qoe3_active_is_the_attached_share_of_the_time_open(self):
        requests = frame(
            request(0.0, 60.0, (0, 40.0, 100.0), attached_s=100.0),
            request(0.0, 500.0, end_s=300.0, attached_s=0.0),
        )
        assert qoe.summary(requests)["qoe3_active_percent"] == 25.0

    def test_no_requests_no_measures(self):
        found = qoe.summary(frame())
        assert found["requests"] == 0
        assert [found[name] for name in qoe.OUTCOMES] == [0, 0, 0]
        measures = ("qoe1_percent", "qoe1_feasible_percent", "qoe2_iterations", "fairness")
        assert all(found[name] is None for name in (*measures, "wait_s", "completion_s"))
        assert found["qoe3_active_percent"] is None

    def test_open_for_no_time_at_all(self):
        found = qoe.summary(frame(request(1800.0, 60.0)))
        assert found["qoe1_percent"] == 0.0
        assert found["qoe1_feasible_percent"] is None
        assert found["qoe3_active_percent"] is None

    def test_plain_numbers_only(self):
        found = qoe.summary(frame(request(0.0, 60.0, (0, 0.0, 60.0)), request(0.0, 60.0)))
        assert {type(value) for value in found.values()} <= {int, float, type(None)}

    def test_a_request_that_is_continuous_for_the_whole_episode(self):
        """One request a user for the whole episode: QoE1 = QoE3 and QoE2 = 30 (1 - QoE1)."""
        users = ((0, 0.0, 450.0),), ((1, 600.0, 1800.0),), ()
        found = qoe.summary(frame(*(request(0.0, DURATION_S, *services) for services in users)))
        assert found["qoe1_percent"] == pytest.approx(found["qoe3_active_percent"])
        assert found["qoe2_iterations"] == pytest.approx(30 * (1 - found["qoe1_percent"] / 100))


class TestGroups:
    def requests(self):
        return frame(
            request(0.0, 60.0, (0, 0.0, 60.0), user=7, service="throughput", episode=0),
            request(0.0, 60.0, user=10, service="edge", episode=1),
            request(0.0, 60.0, (0, 0.0, 30.0), user=7, service="edge", episode=10),
            request(0.0, 60.0, (0, 0.0, 60.0), user=9, service="edge", episode=2),
        )

    @pytest.mark.parametrize(
        ("by", "values"),
        [
            ("service", ["edge", "throughput"]),
            ("episode", [0, 1, 2, 10]),
            ("user", [7, 9, 10]),
            ("outcome", ["completed", "never_served", "unfinished"]),
        ],
    )
    def test_a_row_for_each_value_in_order(self, by, values):
        rows = qoe.grouped(self.requests(), by)
        assert [row[by] for row in rows] == values
        assert {type(row[by]) for row in rows} == {qoe.GROUPS[by]}

    @pytest.mark.parametrize("by", sorted({*qoe.GROUPS} - {"group"}))
    def test_a_group_is_summed_up_like_any_requests(self, by):
        requests = self.requests()
        for row in qoe.grouped(requests, by):
            assert row == {by: row[by]} | qoe.summary(requests[requests[by] == row[by]])

    @pytest.mark.parametrize("by", sorted({*qoe.GROUPS} - {"group"}))
    def test_the_groups_make_up_the_whole(self, by):
        rows, whole = qoe.grouped(self.requests(), by), qoe.summary(self.requests())
        assert sum(row["requests"] for row in rows) == whole["requests"]
        mean = sum(row["qoe1_percent"] * row["requests"] for row in rows) / whole["requests"]
        assert mean == pytest.approx(whole["qoe1_percent"])

    @pytest.mark.parametrize("by", sorted({*qoe.GROUPS} - {"group"}))
    def test_no_requests_no_groups(self, by):
        assert qoe.grouped(frame(), by) == []


class TestCoveredOnce:
    DURATIONS = pd.Series({0: DURATION_S, 1: DURATION_S})
    ALWAYS = (0.0, DURATION_S)

    def of(self, *requests, users=2, durations=DURATIONS):
        return qoe.covered_once(frame(*requests), durations, users).tolist()

    def test_users_that_ask_all_the_time(self):
        # In episode 0 user 0 is attached for a second and user 1 never; in episode 1 both are.
        requests = [
            request(*self.ALWAYS, attached_s=1.0, user=0),
            request(*self.ALWAYS, attached_s=0.0, user=1),
            request(*self.ALWAYS, (0, 0.0, 9.0), user=0, episode=1),
            request(*self.ALWAYS, attached_s=0.001, user=1, episode=1),
        ]
        assert self.of(*requests) == [50.0, 100.0]

    def test_one_attachment_in_any_request_will_do(self):
        requests = [
            request(0.0, 60.0, (0, 0.0, 60.0), user=0),
            request(600.0, 60.0, user=0),
            request(*self.ALWAYS, attached_s=0.0, user=1),
        ]
        assert self.of(*requests, durations=self.DURATIONS[:1]) == [50.0]

    @pytest.mark.parametrize(
        "second",
        [
            [],  # it asks for nothing
            [request(1.0, DURATION_S, user=1)],  # only from 1 s on
            [request(0.0, DURATION_S, end_s=1799.0, user=1)],  # its request is refused
        ],
    )
    def test_of_a_user_that_does_not_ask_all_the_time_requests_do_not_tell(self, second):
        first = request(*self.ALWAYS, attached_s=1.0, user=0)
        (share,) = self.of(first, *second, durations=self.DURATIONS[:1])
        assert math.isnan(share)

    def test_nobody_asks(self):
        assert all(math.isnan(share) for share in self.of())

    def test_events_tell_of_everybody(self):
        # User 0 is handed over and comes back; user 1 is attached for 0 us; user 2 never is.
        rows = [(5, "attach", 0), (7, "detach", 0), (7, "attach", 0), (9, "detach", 0)]
        rows += [(5, "request", 1), (5, "attach", 1), (5, "detach", 1), (8, "enter", 2)]
        events = pd.DataFrame(rows, columns=["t_us", "kind", "user"]).assign(episode=0)
        shares = qoe.covered_once_by_events(events, self.DURATIONS, 4)
        assert shares.tolist() == [25.0, 0.0]


class TestFairness:
    def of(self, *shares):
        return qoe.fairness(pd.DataFrame({"user": range(len(shares)), "qoe1": shares}))

    def test_all_alike(self):
        assert self.of(0.3, 0.3, 0.3) == pytest.approx(1.0)

    @pytest.mark.parametrize("users", [1, 2, 10])
    def test_one_has_it_all(self, users):
        assert self.of(0.8, *[0.0] * (users - 1)) == pytest.approx(1 / users)

    def test_two_to_one(self):
        assert self.of(1.0, 0.5) == pytest.approx(1.5**2 / (2 * 1.25))

    def test_it_is_of_users_not_of_requests(self):
        requests = pd.DataFrame({"user": [0, 0, 1], "qoe1": [1.0, 0.0, 0.5]})
        assert qoe.fairness(requests) == pytest.approx(1.0)

    def test_the_worst_tenth_of_users(self):
        """Of 11 users two are the worst tenth: 10 % and 20 %."""
        qoe1 = [0.9] * 9 + [0.1, 0.2]
        users = qoe.Fairness().add(pd.DataFrame({"user": range(11), "qoe1": qoe1}))
        assert users.worst_tenth_percent() == pytest.approx(15.0)
        assert qoe.Fairness().worst_tenth_percent() is None

    def test_nobody_served_or_nobody_there(self):
        assert self.of(0.0, 0.0) is None
        assert self.of() is None

    @settings(deadline=None)
    @given(st.lists(st.floats(0.01, 1.0), min_size=1, max_size=30), st.floats(0.1, 1.0))
    def test_between_1_over_n_and_1_whatever_the_unit(self, shares, unit):
        found = self.of(*shares)
        assert 1 / len(shares) - 1e-9 <= found <= 1 + 1e-9
        assert self.of(*(unit * share for share in shares)) == pytest.approx(found)


def test_times_that_are_rounded_make_no_share_above_100_percent():
    """A request that is open, and attached, for 4 µs: 1000.000007 - 1000.000003 is below 4e-6."""
    requests = frame(
        request(
            1000.000003, 4e-6, (0, 1000.000003, 1000.000007), end_s=1000.000007, attached_s=4e-6
        )
    )
    assert float(requests["t_end_s"].iloc[0] - requests["t_request_s"].iloc[0]) < 4e-6
    assert qoe.summary(requests)["qoe3_active_percent"] == 100.0


@settings(deadline=None)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 1_800_000_000),  # asked, in microseconds
            st.integers(1, 2_000_000_000),  # needed
            st.integers(0, 1_800_000_000),  # waited, at most
            st.floats(0, 1),  # of the rest, served
        ),
        max_size=20,
    )
)
def test_bounds_of_any_requests(drawn):
    """0 <= QoE1 <= feasible QoE1 <= 1; what was open was served, or counts in QoE2."""
    requests = []
    for asked, needed, waited, share in drawn:
        start = min(asked + waited, 1_800_000_000)
        served = min(needed, int(share * (1_800_000_000 - start)))
        services = [(0, start / 1e6, (start + served) / 1e6)] if served else []
        made = request(asked / 1e6, needed / 1e6, *services)
        made |= {"served_s": served / 1e6, "attached_s": served / 1e6}
        made |= {"outcome": "completed"} if served == needed else {"t_end_s": DURATION_S}
        requests.append(made | ({"t_end_s": (start + served) / 1e6} if served == needed else {}))
    found = frame(*requests)
    feasible = found.qoe1_feasible.dropna()
    assert ((found.qoe1 >= 0) & (found.qoe1 <= 1)).all()
    assert ((feasible >= found.qoe1[feasible.index]) & (feasible <= 1 + 1e-6)).all()
    assert (found.qoe2_iterations >= 0).all()
    assert (found.wait_s >= 0).all()
    open_s = found.t_end_s - found.t_request_s
    assert np.allclose(found.served_s + STEP_S * found.qoe2_iterations, open_s, atol=1e-5)
    whole = qoe.summary(found)
    assert whole["requests"] == len(found)
    assert all(value is None or math.isfinite(value) for value in whole.values())
