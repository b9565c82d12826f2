"""The tables of a run: their columns, their types, and what stands in them."""

import json
import math

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from desim_uav import qoe
from desim_uav.columns import arrow_schema, misfit, to_frame
from desim_uav.engine.base import EpisodeLog, Step
from desim_uav.experiment.tables import steps_table
from desim_uav.model.motion.motion import travelled
from desim_uav.model.rules import US, Action, Mode
from desim_uav.records import EPISODES, EVENTS, REQUESTS, STEPS, TABLES, USERS
from desim_uav.scenario.load import load, loads
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.run_to_folder import run_to_folder

SMALL = ("users.count=16", "episode.steps=12", "drones.battery.autonomy_min=6")
OF_A_RUN = ("requests", "steps", "episodes", "users", "events", "legs")
NULLABLE = {
    "requests": {"t_first_service_s", "completion_s", "qoe1_feasible"},
    "steps": {"battery_s", "n_b_s", "action"},
    "episodes": {
        "qoe1_percent",
        "qoe2_iterations",
        "qoe3_active_percent",
        "qoe1_feasible_percent",
        "bandwidth_percent",
        "fairness",
    },
    "users": set(),
    "events": {"drone", "user", "request_id", "station"},
    "legs": set(),
}
RUNS = {
    "busy": ("case8", "baseline", SMALL),
    "crashing": ("case8", "hover", (*SMALL, "drones.battery.respawn_after_min=2")),
    "noisy": ("case9", "random", SMALL),
    "unlimited": ("tiny", "baseline", ()),
    "still": ("case6", "random", ("episode.steps=8",)),
    "silent": ("case8", "baseline", (*SMALL, "demand={kind: static, none: 1.0}")),
}


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A run of each kind: one warm-up episode, two counted ones."""
    where = tmp_path_factory.mktemp("runs")
    for name, (scenario, policy, overrides) in RUNS.items():
        run_to_folder(
            load(scenario_path(scenario), overrides),
            policy,
            episodes=2,
            warmup=1,
            keep_events=True,
            out=where / name,
            command=[],
        )
    return where


@pytest.fixture(params=RUNS)
def run(request, folders):
    """Each run in turn."""
    return folders / request.param


def table(run, name):
    return pd.read_parquet(run / f"{name}.parquet")


class TestTypes:
    @pytest.mark.parametrize("name", OF_A_RUN)
    def test_the_file_has_these_columns_and_types_whatever_its_rows(self, run, name):
        held = pq.read_schema(run / f"{name}.parquet")
        assert held.remove_metadata().equals(arrow_schema(TABLES[name]))

    @pytest.mark.parametrize("name", OF_A_RUN)
    def test_it_reads_back_as_these_types(self, run, name):
        frame = table(run, name)
        assert {column: str(dtype) for column, dtype in frame.dtypes.items()} == {
            column: ("object" if dtype == "str" and frame[column].dtype == object else dtype)
            for column, dtype in TABLES[name].items()
        }

    @pytest.mark.parametrize("name", OF_A_RUN)
    def test_only_what_can_be_missing_is_null_and_nothing_is_infinite(self, run, name):
        held = pq.read_table(run / f"{name}.parquet")
        for column in held.column_names:
            assert held[column].null_count == 0 or column in NULLABLE[name], column
            if pa.types.is_floating(held[column].type):
                values = held[column].drop_null().to_numpy()
                assert np.isfinite(values).all(), column

    @pytest.mark.parametrize("name", OF_A_RUN)
    def test_the_warm_up_has_negative_numbers_in_every_table(self, run, name):
        if name in ("requests",) and run.name == "silent":
            assert table(run, name).empty
        else:
            assert sorted(table(run, name)["episode"].unique()) == [-1, 0, 1]


class TestSteps:
    def test_a_row_a_step_and_drone(self, run):
        steps, scenario = table(run, "steps"), load(run / "scenario.yaml")
        number, drones = scenario.episode.steps, scenario.drones.count
        assert len(steps) == 3 * number * drones
        assert not steps.duplicated(["episode", "step", "drone"]).any()
        assert steps["step"].between(0, number - 1).all()
        assert (steps["t_s"] == (steps["step"] + 1) * scenario.episode.step_s).all()
        assert set(steps["mode"]) <= {mode.name.lower() for mode in Mode}
        assert set(steps["action_taken"]) <= {action.name.lower() for action in Action}
        assert (steps["crashed"] == (steps["mode"] == "crashed")).all()

    def test_who_is_landed_or_down_has_no_reward(self, run):
        steps = table(run, "steps")
        idle = steps["mode"].isin(["queued", "charging", "charged", "crashed"])
        assert (steps["reward"][idle] == 0).all()
        assert steps["reward"].between(-1, 1).all()
        assert (steps["reward"] != 0).any()

    def test_the_reward_of_an_episode_is_the_mean_of_its_drones(self, run):
        steps, episodes = table(run, "steps"), table(run, "episodes").set_index("episode")
        of_drones = steps.groupby(["episode", "drone"])["reward"].sum()
        mean = of_drones.groupby("episode").mean()
        assert episodes["reward"].to_numpy() == pytest.approx(mean.loc[episodes.index].to_numpy())

    def test_the_rewards_of_tiny_by_hand(self, folders):
        # Around the edge from (120, 360): nobody at (120, 600) and (360, 600); at (600, 600) the
        # third user, at (600, 360) the second one too, at (600, 120) nobody.
        steps = table(folders / "unlimited", "steps")
        assert steps["reward"].tolist() == 3 * [0.0, 0.0, 1 / 3, 2 / 3, 0.0]
        assert table(folders / "unlimited", "episodes")["reward"].tolist() == 3 * [1.0]

    def test_an_unlimited_battery_has_no_charge_and_no_way_home(self, folders):
        steps = table(folders / "unlimited", "steps")
        assert steps["battery_s"].isna().all()
        assert steps["n_b_s"].isna().all()

    def test_a_battery_is_between_empty_and_full(self, folders):
        steps = table(folders / "crashing", "steps")
        assert steps["battery_s"].between(0, 360).all()
        assert steps["crashed"].any()
        assert steps[~steps["crashed"]]["n_b_s"].notna().any()

    @pytest.mark.parametrize(
        ("return_drain", "charge", "action", "expected"),
        [
            (math.inf, 5_000_000, Action.UP, (None, 5.0, "up")),
            (None, None, None, (None, None, None)),
            (0.0, 0, Action.HOVER, (0.0, 0.0, "hover")),
            (1_500_000.0, 1, Action.LEFT, (1.5, 1e-6, "left")),
        ],
    )
    def test_what_is_unknown_or_without_end_is_null(self, return_drain, charge, action, expected):
        step = Step(
            *(0, 60_000_000, 0, 1.0, 2.0, 3.0, charge, Mode.FLYING, action, Action.HOVER),
            *(0, 0, 96_000, return_drain, 0, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0),
        )
        world = build_world(loads("seed: 0"), 0)
        row = steps_table([EpisodeLog(0, steps=[step])], world).iloc[0]
        found = [
            None if pd.isna(row[name]) else row[name] for name in ("n_b_s", "battery_s", "action")
        ]
        assert tuple(found) == expected
        assert (row["t_s"], row["bandwidth_khz"], row["reward"]) == (60.0, 96.0, 0.25)

    def test_bandwidth_within_the_drones(self, folders):
        assert table(folders / "busy", "steps")["bandwidth_khz"].between(0, 5000).all()


class TestUsers:
    def test_first_and_last_way_points_are_there(self, run):
        users, scenario = table(run, "users"), load(run / "scenario.yaml")
        horizon_s = scenario.episode.steps * scenario.episode.step_s
        for _, walk in users.groupby(["episode", "user"]):
            assert walk["t_s"].iloc[0] == 0.0
            assert walk["t_s"].iloc[-1] == horizon_s
            assert (np.diff(walk["t_s"]) > 0).all()

    def test_every_user_has_a_walk_in_every_episode(self, run):
        users, scenario = table(run, "users"), load(run / "scenario.yaml")
        assert users.groupby("episode")["user"].nunique().tolist() == 3 * [scenario.users.count]

    def test_who_stays_has_two_way_points(self, folders):
        users = table(folders / "unlimited", "users")
        assert len(users) == 3 * 3 * 2
        assert users.groupby("user")[["x_m", "y_m"]].nunique().eq(1).all(axis=None)

    def test_who_walks_does_so_at_the_speed_of_the_scenario(self, folders):
        users = table(folders / "busy", "users")
        for _, walk in users.groupby(["episode", "user"]):
            speed = np.hypot(np.diff(walk["x_m"]), np.diff(walk["y_m"])) / np.diff(walk["t_s"])
            assert speed.max() <= 1.4 + 1e-6

    def test_homes_are_those_of_the_world(self, folders):
        users = table(folders / "still", "users")
        homes = json.loads((folders / "still" / "world.json").read_text())["users"]
        first = users[(users["episode"] == 0) & (users["t_s"] == 0)]
        assert first[["x_m", "y_m", "z_m"]].to_numpy().tolist() == homes


class TestRequests:
    def test_outcomes_say_what_was_served(self, run):
        requests = table(run, "requests")
        done = requests["outcome"] == "completed"
        never = requests["outcome"] == "never_served"
        assert requests["outcome"].isin(qoe.OUTCOMES).all()
        assert (requests["served_s"] <= requests["requested_s"]).all()
        assert (done == (requests["served_s"] == requests["requested_s"])).all()
        assert (done == requests["completion_s"].notna()).all()
        assert (never == (requests["served_s"] == 0)).all()
        assert (never == requests["t_first_service_s"].isna()).all()
        assert (never == (requests["drones"].map(len) == 0)).all()

    def test_times_are_in_order_and_within_the_episode(self, run):
        requests, scenario = table(run, "requests"), load(run / "scenario.yaml")
        horizon_s = scenario.episode.steps * scenario.episode.step_s
        first = requests["t_first_service_s"].fillna(requests["t_end_s"])
        assert requests["t_request_s"].between(0, horizon_s).all()
        assert (requests["t_request_s"] <= first).all()
        assert (first <= requests["t_end_s"]).all()
        assert (requests["t_end_s"] <= horizon_s).all()
        assert (requests["served_s"] <= requests["attached_s"]).all()
        assert (
            requests["attached_s"] <= requests["t_end_s"] - requests["t_request_s"] + 1e-6
        ).all()

    def test_the_derived_columns_follow_from_the_others(self, run):
        requests, scenario = table(run, "requests"), load(run / "scenario.yaml")
        step_s = scenario.episode.step_s
        basic = requests.drop(
            columns=["wait_s", "completion_s", "qoe1", "qoe1_feasible", "qoe2_iterations"]
        )
        again = qoe.derive(basic, scenario.episode.steps * step_s, step_s)
        pd.testing.assert_frame_equal(again[list(REQUESTS)], requests)

    def test_ids_are_unique_and_nobody_has_two_at_a_time(self, run):
        requests = table(run, "requests")
        assert not requests.duplicated(["episode", "request_id"]).any()
        for _, own in requests.sort_values("t_request_s").groupby(["episode", "user"]):
            assert (own["t_request_s"].to_numpy()[1:] >= own["t_end_s"].to_numpy()[:-1]).all()

    def test_drones_are_a_list_without_repetition_in_a_row(self, folders):
        lists = table(folders / "busy", "requests")["drones"]
        assert lists.map(len).max() > 1
        for drones in lists:
            assert (np.diff(drones) != 0).all()
            assert set(drones) <= {0, 1, 2}

    def test_handovers_are_counted_from_the_drones(self, folders):
        requests = table(folders / "busy", "requests")
        assert (requests["handovers"] == (requests["drones"].map(len) - 1).clip(lower=0)).all()


class TestEpisodes:
    def test_each_is_the_summary_of_its_requests(self, run):
        requests, episodes = table(run, "requests"), table(run, "episodes")
        for row in episodes.to_dict("records"):
            found = qoe.summary(requests[requests["episode"] == row["episode"]])
            for name in set(found) & set(row):
                assert row[name] == pytest.approx(found[name] or 0) or pd.isna(row[name])
                assert pd.isna(row[name]) == (found[name] is None)

    def test_shares_are_percent(self, run):
        episodes = table(run, "episodes")
        for name in (name for name in EPISODES if name.endswith("_percent")):
            assert episodes[name].dropna().between(0, 100 + 1e-9).all()

    def test_unlimited_bandwidth_has_no_used_share(self, folders):
        assert table(folders / "unlimited", "episodes")["bandwidth_percent"].isna().all()
        assert table(folders / "busy", "episodes")["bandwidth_percent"].gt(0).all()

    def test_crashes_are_those_of_the_events(self, folders):
        events, episodes = (
            table(folders / "crashing", "events"),
            table(folders / "crashing", "episodes"),
        )
        counted = events[events["kind"] == "crash"].groupby("episode").size()
        assert counted.sum() > 0
        assert episodes.set_index("episode")["crashes"].to_dict() == counted.to_dict()

    def test_one_request_for_the_whole_episode_makes_qoe1_and_qoe3_one(self, folders):
        episodes = table(folders / "unlimited", "episodes")
        assert episodes["qoe1_percent"].to_numpy() == pytest.approx(episodes["qoe3_percent"])
        unserved = 5 * (1 - episodes["qoe1_percent"] / 100)
        assert episodes["qoe2_iterations"].to_numpy() == pytest.approx(unserved.to_numpy())


class TestEvents:
    def test_in_order_of_time_phase_drone_and_user(self, run):
        events = table(run, "events")
        for _, own in events.groupby("episode"):
            keys = own[["t_us", "phase", "drone", "user"]].fillna(-1).astype("int64")
            keys = list(keys.itertuples(index=False, name=None))
            assert keys == sorted(keys)

    def test_every_request_is_an_event(self, run):
        events, requests = table(run, "events"), table(run, "requests")
        asked = events[events["kind"] == "request"]
        assert set(zip(asked["episode"], asked["request_id"], strict=True)) == set(
            zip(requests["episode"], requests["request_id"], strict=True)
        )
        assert asked["drone"].isna().all()
        assert asked["user"].notna().all()


class TestLegs:
    def test_lead_to_where_the_steps_say(self, request, folders, run):
        world = build_world(load(run / "scenario.yaml"), 0)
        legs, steps = table(run, "legs"), table(run, "steps")
        flown = 0
        for (episode, drone), own in steps.groupby(["episode", "drone"]):
            mine = legs[(legs["episode"] == episode) & (legs["drone"] == drone)]
            assert mine["t_s"].iloc[0] <= 0, "where it begins is told"
            for step in own.itertuples():
                begun = mine[(mine["t_s"] < step.t_s) | (mine["mode"] == "crashed")]
                leg = begun[begun["t_s"] <= step.t_s].iloc[-1]
                place = place_on(leg, step.t_s, world)
                assert place == pytest.approx((step.x_m, step.y_m, step.z_m), abs=1e-6)
                flown += leg["duration_s"] > 0
        assert flown > 0 or request.node.callspec.params["run"] == "crashing"

    def test_a_leg_departs_and_arrives(self, run):
        events, legs = table(run, "events"), table(run, "legs")
        flown = legs[(legs["duration_s"] > 0) & (legs["t_s"] >= 0)]
        departed = events[events["kind"] == "depart"]
        assert [*zip(flown["episode"], flown["drone"], flown["t_s"] * US, strict=True)] == [
            *zip(departed["episode"], departed["drone"], departed["t_us"], strict=True)
        ]


def place_on(leg, t_s, world):
    """x, y, z at a time: along the leg as its motion says, then at its end."""
    start, end = (np.array([leg[f"{axis}_{side}_m"] for axis in "xyz"]) for side in ("from", "to"))
    elapsed_s = t_s - leg["t_s"]
    if elapsed_s >= leg["duration_s"]:
        return tuple(end)
    length_m = np.abs(end - start).sum()
    motion = world.scenario.drones.motion
    if leg["mode"] == "flying":
        transit = motion.epoch_transit(length_m, world.step_us / US)
    else:
        transit = motion.fastest_transit(length_m)
    assert transit.duration_us / US == leg["duration_s"]
    return tuple(start + (end - start) * travelled(transit.rows, elapsed_s) / length_m)


class TestToFrame:
    @pytest.mark.parametrize("columns", TABLES.values(), ids=TABLES)
    def test_no_rows_have_the_types_of_rows(self, columns):
        frame = to_frame(columns, [])
        assert list(frame.columns) == list(columns)
        assert len(frame) == 0
        full = [
            (None if dtype == "Int64" else [] if dtype == "object" else 0)
            for dtype in columns.values()
        ]
        pd.testing.assert_series_equal(frame.dtypes, to_frame(columns, [tuple(full)]).dtypes)

    def test_none_is_null(self):
        frame = to_frame(EVENTS, [(0, 1, 2, "land", 3, None, None, None)])
        assert frame["user"].isna().all()
        assert frame["drone"].tolist() == [3]
        assert to_frame(USERS, [(0, 0, 0.0, 1.0, 2.0, None)])["z_m"].isna().all()
        assert to_frame({"action": "str"}, [(None,), ("up",)])["action"].isna().tolist() == [
            True,
            False,
        ]

    def test_a_row_of_another_length_is_refused(self):
        with pytest.raises(ValueError, match="zip"):
            to_frame(USERS, [(0, 0)])


MIXED = {"n": "int64", "x": "float64", "on": "bool", "name": "str", "who": "object"}


class TestMisfit:
    def table(self, **changes):
        columns = {
            "n": pa.array([1, 2]),
            "x": pa.array([0.5, None]),
            "on": pa.array([True, False]),
            "name": pa.array(["a", None]),
            "who": pa.array([[1], []], pa.list_(pa.int64())),
        }
        return pa.table({name: a for name, a in (columns | changes).items() if a is not None})

    def test_a_fitting_table(self):
        assert misfit(MIXED, self.table()) is None

    @pytest.mark.parametrize(
        "changes",
        [
            {"n": pa.array([1, 2], pa.int32())},
            {"name": pa.array(["a", "b"], pa.large_string())},
            {"who": pa.array([[1], []], pa.large_list(pa.int64()))},
            {"x": pa.array([None, None])},
            {"more": pa.array([1, 2])},
        ],
    )
    def test_what_other_tools_write_fits_too(self, changes):
        assert misfit(MIXED, self.table(**changes)) is None

    @pytest.mark.parametrize(
        ("changes", "problem"),
        [
            ({"n": None}, "no column 'n'"),
            ({"n": pa.array(["1", "2"])}, "column 'n' holds string, not int64"),
            ({"n": pa.array([1.5, 2.0])}, "column 'n' holds double, not int64"),
            ({"n": pa.array([1, None])}, "column 'n' has empty values"),
            ({"x": pa.array(["a", "b"])}, "column 'x' holds string, not double"),
            ({"x": pa.array([0.5, np.inf])}, "column 'x' has infinite values"),
            ({"x": pa.array([True, False])}, "column 'x' holds bool, not double"),
            ({"on": pa.array([None, True])}, "column 'on' has empty values"),
            ({"on": pa.array([0, 1])}, "column 'on' holds int64, not bool"),
            ({"name": pa.array([1, 2])}, "column 'name' holds int64, not string"),
            ({"who": pa.array([1, 2])}, "column 'who' holds int64, not list<"),
        ],
    )
    def test_what_does_not_fit_is_named(self, changes, problem):
        assert misfit(MIXED, self.table(**changes)).startswith(problem)


def test_the_columns_of_the_contract_come_first():
    """Others read these names; what is beyond them stands behind."""
    assert list(REQUESTS)[:-1] == [
        *("episode", "request_id", "user", "service", "t_request_s", "t_first_service_s"),
        *("t_end_s", "requested_s", "served_s", "bandwidth_kbps", "wait_s", "completion_s"),
        *("interruptions", "handovers", "drones", "outcome"),
        *("qoe1", "qoe1_feasible", "qoe2_iterations"),
    ]
    assert list(STEPS) == [
        *("episode", "step", "t_s", "drone", "x_m", "y_m", "z_m", "battery_s", "mode", "action"),
        *("action_taken", "attached_users", "served_requests", "bandwidth_khz", "n_b_s"),
        *("crashed", "reward"),
    ]
    assert list(EPISODES)[:8] == [
        *("episode", "qoe1_percent", "qoe2_iterations", "qoe3_percent", "qoe3_active_percent"),
        *("crashes", "requests", "reward"),
    ]
    assert list(USERS) == ["episode", "user", "t_s", "x_m", "y_m", "z_m"]
    assert list(EVENTS) == [
        *("episode", "t_us", "phase", "kind", "drone", "user", "request_id", "station")
    ]
