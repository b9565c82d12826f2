"""Measures of small tables, worked out by hand."""

import pandas as pd
import pytest

from desim_uav.measures.tally import Tally, grouped, headline


def sensors(*rows):
    """Rows of the table: episode, user, service, age, mean peak, falls, time above the limit."""
    names = ["episode", "user", "service", "age_s", "peak_age_s", "falls", "violation_s"]
    frame = pd.DataFrame(rows, columns=names).astype({"peak_age_s": float, "violation_s": float})
    counts = {"updates": frame["falls"] + 2, "delivered": frame["falls"], "dropped": 1, "lost": 1}
    return frame.assign(**counts)


def episodes(*durations_s, first=0):
    """Episodes of these lengths in which nothing else happens."""
    rows = [
        {"episode": first + k, "duration_s": s, "suppressed": 0, "crashes": 0}
        | {"qoe3_percent": 0.0, "reward": 0.0}
        for k, s in enumerate(durations_s)
    ]
    return pd.DataFrame(rows)


def task(user=0, t_end_s=1.0, outcome="completed", late=False, **others):
    """A request for a task that was made at 0 s."""
    row = {"episode": 0, "user": user, "service": "vision", "t_request_s": 0.0, "t_end_s": t_end_s}
    row |= {"attached_s": 0.0, "wait_s": 0.0, "interruptions": 0, "handovers": 0, "restarts": 0}
    row |= {"completion_s": t_end_s if outcome == "completed" else float("nan"), "qoe1": 1.0}
    row |= {"qoe1_feasible": 1.0, "qoe2_iterations": 0.0, "outcome": outcome, "late": late}
    row |= {"waiting_s": 0.1, "sending_s": 0.2, "computing_s": 0.3, "own_s": 0.0}
    return row | {"gigacycles": 1.0, "delivered_mbit": 2.0, "user_j": 0.5} | others


def tasks(*rows):
    return pd.DataFrame(rows).astype({"late": "boolean"})


NO_TASKS = tasks(task()).iloc[:0]


def test_ages_are_means_over_time_not_over_episodes():
    """A sensor has an age of 10 s for 100 s, and of 40 s for 300 s: 32.5 s, not 25 s."""
    found = headline(
        NO_TASKS,
        episodes(100.0, 300.0),
        sensors((0, 5, "reading", 10.0, 20.0, 1, 0.0), (1, 5, "reading", 40.0, 60.0, 3, 30.0)),
    )
    assert found["age_s"] == found["worst_age_s"] == pytest.approx(32.5)
    assert found["peak_age_s"] == pytest.approx((20.0 + 3 * 60.0) / 4)
    assert found["age_violation_percent"] == pytest.approx(100 * 30 / 400)
    counts = ("updates", "updates_delivered", "updates_dropped", "updates_lost")
    assert [found[name] for name in counts] == [8, 4, 2, 2]


def test_the_worst_sensor_is_the_one_with_the_largest_mean_over_all_episodes():
    """Each of two sensors is the worst one of an episode; both have 25 s and 20 s altogether."""
    rows = [(0, 0, "reading", 40.0, None, 0, None), (1, 0, "reading", 10.0, None, 0, None)]
    rows += [(0, 1, "reading", 5.0, None, 0, None), (1, 1, "reading", 35.0, None, 0, None)]
    found = headline(NO_TASKS, episodes(100.0, 100.0), sensors(*rows))
    assert found["worst_age_s"] == pytest.approx(25.0)
    assert found["age_s"] == pytest.approx(22.5)
    assert found["peak_age_s"] is None, "no age fell"
    assert found["age_violation_percent"] is None, "there is no limit"


def test_warm_up_does_not_count():
    rows = (-1, 0, "reading", 99.0, 99.0, 9, 0.0), (0, 0, "reading", 1.0, 2.0, 1, 0.0)
    found = headline(NO_TASKS, episodes(10.0, 10.0, first=-1), sensors(*rows))
    assert (found["age_s"], found["updates_delivered"]) == (1.0, 1)


def test_ages_by_service_and_by_episode():
    rows = [(0, 0, "fast", 10.0, 20.0, 1, 0.0), (0, 1, "slow", 50.0, None, 0, None)]
    rows += [(1, 0, "fast", 30.0, 20.0, 1, 0.0), (1, 1, "slow", 70.0, None, 0, None)]
    tables = tasks(task(service="fast")), episodes(100.0, 300.0), sensors(*rows)
    fast, slow = grouped("service", *tables)
    assert (fast["age_s"], slow["age_s"]) == (pytest.approx(25.0), pytest.approx(65.0))
    assert (fast["requests"], slow["requests"]) == (1, 0)
    assert slow["completion_p95_s"] is None, "it has no requests"
    assert [row["age_s"] for row in grouped("episode", *tables)] == [30.0, 50.0]
    (completed,) = grouped("outcome", *tables)
    assert completed["age_s"] is None, "a sensor has no outcome"


def test_delays_deadlines_and_energy():
    """Delays of 1 to 20 s: their 95th percentile lies at 1 + 0.95 x 19 = 19.05 s."""
    rows = [task(k, float(k + 1), late=k >= 15) for k in range(20)]
    rows += [task(0, 50.0, "late", True), task(1, 60.0, "unfinished", None, user_j=1.5)]
    found = headline(tasks(*rows), episodes(100.0))
    assert found["completion_s"] == pytest.approx(10.5)
    assert found["completion_p95_s"] == pytest.approx(19.05)
    assert found["deadlines_met_percent"] == pytest.approx(100 * 15 / 21)
    assert (found["late"], found["completed"], found["unfinished"]) == (1, 20, 1)
    assert found["user_j_per_task"] == pytest.approx((21 * 0.5 + 1.5) / 20)
    assert found["throughput_mbps"] == pytest.approx(22 * 2.0 / 100)
    parts = [found[name] for name in ("waiting_s", "sending_s", "computing_s", "own_s")]
    assert parts == pytest.approx([0.1, 0.2, 0.3, 0.0])
    assert "age_s" not in found and "drone_j_per_task" not in found


def test_energy_of_drones_per_task():
    """Two episodes with 2 Wh and 1 Wh, and four tasks: 3 x 3600 / 4 J."""
    energy = {"energy_wh": [2.0, 1.0], "charged_wh": 0.0, "served_mbit": 8.0, "j_per_mbit": 1.0}
    of = episodes(10.0, 10.0).assign(**energy)
    requests = tasks(*(task(k) for k in range(4)), task(4, gigacycles=0.0))
    assert headline(requests, of)["drone_j_per_task"] == pytest.approx(2700.0)
    of = of.assign(j_per_mbit=[1.0, None])
    assert headline(requests, of)["drone_j_per_task"] is None, "the energy of some is not known"


def test_tasks_without_a_processor_of_the_user_are_not_divided_by():
    requests = tasks(task(0, user_j=3.0), task(1, user_j=None), task(2, user_j=1.0))
    assert headline(requests, episodes(10.0))["user_j_per_task"] == pytest.approx(2.0)


def test_throughput_of_an_episode_is_over_its_own_length():
    requests = tasks(task(), task(episode=1))
    rows = grouped("episode", requests, episodes(100.0, 400.0))
    assert [row["throughput_mbps"] for row in rows] == [0.02, 0.005]
    assert headline(requests, episodes(100.0, 400.0))["throughput_mbps"] == 0.008


def test_tables_in_parts_give_the_same():
    requests = tasks(task(0), task(1, 5.0), task(0, 9.0, "late", True, episode=1))
    rows = [(k, u, "reading", 10.0 * k + u, 3.0, k + 1, 1.0) for k in (0, 1) for u in (2, 3)]
    tables = requests, episodes(100.0, 300.0), sensors(*rows)
    whole, parts = Tally("service").add(*tables), Tally("service")
    for k in (1, 0):
        parts.add(*(table[table["episode"] == k] for table in tables))
    assert parts.headline() == pytest.approx(whole.headline())
    for one, other in zip(parts.groups(), whole.groups(), strict=True):
        assert one.pop("service") == other.pop("service")
        assert one == pytest.approx(other)


def test_without_tasks_volumes_and_sensors_nothing_is_said_of_them():
    old = tasks(task()).drop(columns=["late", "delivered_mbit"])
    found = headline(old, episodes(10.0))
    for name in ("completion_p95_s", "throughput_mbps", "age_s", "user_j_per_task"):
        assert name not in found
    (row,) = grouped("service", old, episodes(10.0))
    assert "age_s" not in row and "throughput_mbps" not in row
