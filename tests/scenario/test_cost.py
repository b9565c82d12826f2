"""What an episode costs is foreseen within a factor of 4, and what is too much is refused."""

import math
import os
import resource
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from desim_uav import available
from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import check_engine, make_engine
from desim_uav.engine.compiled.pack import lacking
from desim_uav.errors import ScenarioError
from desim_uav.experiment.command import prepare
from desim_uav.experiment.run import run
from desim_uav.model.geometry.coverage import MOST_BUCKETS, bucket_grid
from desim_uav.policies import load_policy
from desim_uav.sample_path import draw
from desim_uav.scenario import cost as costs
from desim_uav.scenario.cost import check_cost, cost
from desim_uav.scenario.load import load, loads
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.selection import at_length

FACTOR = 4.0

LARGE = {
    "a long episode": ("des", "episode.steps=1000"),
    "many users": ("des", "users.count=5000", "episode.steps=2"),
    "short legs": ("des", "users.mobility.leg_s=1"),
    "many requests": ("des", "demand.think_time_s=1", "users.count=400"),
    "users and drones": ("batch", "users.count=2000", "drones.count=60", "episode.steps=2"),
    "many cells": ("batch", "map.cells=[60,60]", "map.dimensions=2", "episode.steps=2"),
}


def case8(*overrides):
    return load(scenario_path("case8"), overrides)


def played(scenario, engine, policy="baseline", **options):
    world = build_world(scenario, 0)
    return run(world, load_policy(policy), policy, 0, engine=engine, **options)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name",
    [
        *(name for name in LARGE if name != "many users"),
        pytest.param("many users", marks=pytest.mark.slow),
    ],
)
def test_memory(name):
    engine, *overrides = LARGE[name]
    played(case8("episode.steps=2"), engine)  # what is compiled first is no cost of the scenario
    scenario = case8(*overrides)
    tracemalloc.start()
    try:
        played(scenario, engine)
        used = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    foreseen = cost(scenario, engine).memory_bytes
    assert used / FACTOR < foreseen < used * FACTOR, (used, foreseen)


def sensors(count, buffer):
    reading = "{kind: collect, updates: {kind: poisson, mean_s: 60}, size_mbit: [1], buffer: %d}"
    return loads(
        "drones: {radio: {kind: link_classes, sharing: equal}}\n"
        f"services: {{reading: {reading % buffer}}}\n"
        "demand: {kind: sensing, service: reading}\n"
        f"users: {{count: {count}}}\nreward: {{kind: age}}\nepisode: {{steps: 1}}"
    )


@pytest.mark.thorough
@pytest.mark.parametrize("engine", ["batch", "des"])
def test_memory_of_buffers(engine):
    played(sensors(100, 1), engine)  # what is compiled first is no cost of the scenario
    tracemalloc.start()
    try:
        played(sensors(100, 2000), engine)
        used = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    foreseen = cost(sensors(100, 2000), engine).memory_bytes
    assert used / FACTOR < foreseen < used * FACTOR, (used, foreseen)


@pytest.mark.thorough
@pytest.mark.parametrize("engine", at_length("batch", "des"))
def test_memory_of_the_event_log(engine):
    scenario = case8("users.count=1500", "drones.count=12", "episode.steps=10")
    used = {}
    for kept in (False, True):
        played(case8("episode.steps=2"), engine, keep_events=kept)
        tracemalloc.start()
        try:
            played(scenario, engine, keep_events=kept)
            used[kept] = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    whole, without = (cost(scenario, engine, kept).memory_bytes for kept in (True, False))
    foreseen, measured = whole - without, used[True] - used[False]
    assert measured / FACTOR < foreseen < measured * FACTOR, (measured, foreseen)


@pytest.mark.parametrize(
    "overrides",
    [
        (),
        ("users.count=300",),
        ("drones.count=12",),
        ("users.mobility={kind: static}", "drones.battery=null"),
        ("demand={kind: poisson, rate_per_hour: 60}",),
        ("demand={kind: continuous}", "users.mobility.leg_s=2"),
        ("drones.footprint_radius_m=100", "users.count=300"),
        ("users.mobility={kind: random_waypoint, speed_mps: [5, 15]}",),
        *(
            pytest.param((f"users.mobility={{kind: {kind}}}",), marks=pytest.mark.thorough)
            for kind in ("gauss_markov", "manhattan", "group", "levy")
        ),
        ("demand={kind: profile, profiles: [[[0, 20], [0.25, 60]], [[0, 9]]]}",),
    ],
)
def test_events(overrides):
    """Rows of the event log, and the legs of users, which no log has."""
    scenario = case8(*overrides)
    results = played(scenario, "des", keep_events=True)
    happened = len(results.events) + len(results.users) + len(results.legs)
    foreseen = cost(scenario).event_count
    assert happened / FACTOR < foreseen < happened * FACTOR, (happened, foreseen)


class TestRefused:
    def test_too_many_events(self):
        with pytest.raises(ScenarioError) as caught:
            check_cost(
                case8("users.count=1000000", "demand.think_time_s=0.001", "episode.steps=100000")
            )
        message = str(caught.value)
        assert "events; at most 1e+10 can be simulated" in message
        assert "users.count, episode.steps, episode.step_s, demand" in message
        assert caught.value.exit_code == 3

    def test_too_much_memory(self, monkeypatch):
        """An episode of a million steps fits no machine of some gigabytes."""
        monkeypatch.setattr(costs, "available_bytes", lambda: 4e9)
        with pytest.raises(ScenarioError) as caught:
            build_world(case8("episode.steps=1000000"), 0)
        message = str(caught.value)
        assert "GB of memory, but 4 GB are available" in message
        assert "for the walks of users (users.count, episode.steps" in message
        build_world(case8("episode.steps=10000"), 0)

    def test_large_buffers_of_many_sensors(self):
        """A hundred million places for updates take some 13 GB, whether they are used or not."""
        scenario = sensors(1000, 100_000)
        (part,) = (one for one in cost(scenario).memory if "sensors" in one.what)
        assert part.amount > 1e10
        assert part.keys == ("users.count", "services.reading.buffer")
        assert not [one for one in cost(case8()).memory if "sensors" in one.what]

    def test_by_one_engine_alone(self, monkeypatch):
        """Tables of users by drones are the compiled engine's."""
        monkeypatch.setattr(costs, "available_bytes", lambda: 2e9)
        scenario = case8("users.count=20000", "drones.count=5000", "episode.steps=2")
        check_cost(scenario)
        check_cost(scenario, "des")
        with pytest.raises(ScenarioError, match=r"users in footprints \(users.count, drones.count"):
            check_cost(scenario, "batch")

    @pytest.mark.parametrize("engine", ["des", "batch"])
    def test_with_its_event_log_alone(self, monkeypatch, engine):
        """The same run fits without the log, which is asked for by an option and not by a key."""
        scenario = case8("users.count=500", "drones.count=10", "episode.steps=100")
        without, whole = (cost(scenario, engine, kept).memory_bytes for kept in (False, True))
        monkeypatch.setattr(costs, "PROGRAM", 0)
        monkeypatch.setattr(costs, "available_bytes", lambda: (without + whole) / 2)
        prepare(scenario, "baseline", engine)
        with pytest.raises(ScenarioError, match=r"for the event log that is kept \(episode.steps"):
            prepare(scenario, "baseline", engine, keep_events=True)

    def test_the_nine_cases_are_not(self, monkeypatch):
        monkeypatch.setattr(costs, "available_bytes", lambda: 1e8)
        for number in range(1, 10):
            check_cost(load(scenario_path(f"case{number}")), "batch")
            check_cost(load(scenario_path(f"case{number}")), "des")

    def test_ways_back_from_very_many_places(self):
        world = build_world(case8("map.cells=[300,300]", "map.dimensions=2"), 0)
        problem = "map.cells, map.levels: ways back from 90,000 places take too long"
        assert lacking(world) == [problem]
        with pytest.raises(ScenarioError, match="--engine des runs it"):
            check_engine("batch", world)
        check_engine("des", world)


class TestAvailable:
    def test_is_some_of_this_machine(self):
        assert 1e6 < available.available_bytes() < 1e15

    def test_a_control_group_limits_it(self, tmp_path: Path, monkeypatch):
        limit, used = tmp_path / "memory.max", tmp_path / "memory.current"
        monkeypatch.setattr(available, "MOUNT", tmp_path)
        whole = available.available_bytes()
        assert math.isfinite(whole)
        limit.write_text("max\n")
        used.write_text("1000\n")
        assert available.available_bytes() > 1e6
        limit.write_text("501000\n")
        assert available.available_bytes() == 500_000

    @pytest.mark.parametrize("version", [1, 2, "hybrid"])
    @pytest.mark.parametrize("where", ["/slurm/job_7/step_0", "/slurm/job_7", "/slurm", "/"])
    def test_the_smallest_limit_of_its_group_and_those_above(
        self, version, where: str, tmp_path: Path, monkeypatch
    ):
        """A batch system makes a group for a job, in which each step has one."""
        names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
        names = names if version == 1 else ("memory.max", "memory.current", "inactive_file")
        first = {1: "4:cpuset,memory:", 2: "0::", "hybrid": "0::"}[version]
        mount = tmp_path / {1: "memory", 2: ".", "hybrid": "unified"}[version]
        groups = tmp_path / "cgroup"
        groups.write_text(f"9:name=systemd:/x\n{first}/slurm/job_7/step_0\n")
        for path in ("slurm/job_7/step_0", "slurm/job_7", "slurm", "."):
            limit = 700_000 if f"/{path}".rstrip(".") == where else 9223372036854771712
            (mount / path).mkdir(parents=True, exist_ok=True)
            (mount / path / names[0]).write_text(f"{limit}\n")
            (mount / path / names[1]).write_text("300000\n")
            (mount / path / "memory.stat").write_text(f"anon 7\n{names[2]} 100000\n")
        monkeypatch.setattr(available, "MOUNT", tmp_path)
        monkeypatch.setattr(available, "GROUPS", groups)
        assert available.available_bytes() == 500_000  # copies of files are free at once

    @pytest.mark.parametrize("kind", ["RLIMIT_AS", "RLIMIT_DATA"])
    def test_ulimit_limits_it(self, kind: str, monkeypatch):
        limits = {resource.RLIMIT_AS: -1, resource.RLIMIT_DATA: -1}
        limits[getattr(resource, kind)] = 2**46
        monkeypatch.setattr(resource, "getrlimit", lambda of: (limits[of], -1))
        monkeypatch.setattr(available, "_of_machine", lambda: math.inf)
        monkeypatch.setattr(available, "MOUNT", Path("/nowhere"))
        assert 2**45 < available.available_bytes() < 2**46

    @pytest.mark.parametrize(
        ("files", "allowed"),
        [
            ({"job/cpu.max": "150000 100000"}, 1.5),
            ({"job/cpu.max": "max 100000", "cpu.max": "300000 100000"}, 3.0),
            ({"cpu/job/cpu.cfs_quota_us": "50000", "cpu/job/cpu.cfs_period_us": "100000"}, 0.5),
            ({"cpu/job/cpu.cfs_quota_us": "-1", "cpu/job/cpu.cfs_period_us": "100000"}, math.inf),
            ({}, math.inf),
        ],
    )
    def test_the_time_of_processors(self, files, allowed, tmp_path: Path, monkeypatch):
        for name, content in files.items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(f"{content}\n")
        (tmp_path / "cgroup").write_text("1:cpu,cpuacct:/job\n0::/job\n")
        monkeypatch.setattr(available, "MOUNT", tmp_path)
        monkeypatch.setattr(available, "GROUPS", tmp_path / "cgroup")
        monkeypatch.setattr(os, "sched_getaffinity", lambda pid: range(8))
        assert available.quota() == allowed
        assert available.processors() == max(1, math.ceil(min(8, allowed)))


def test_a_tiny_footprint_takes_no_more_memory_than_another():
    """Users were sorted into as many buckets as footprints fit the map: 42 TiB of them."""
    assert bucket_grid(2400.0, 2400.0, 1e-3) == (MOST_BUCKETS, MOST_BUCKETS)
    assert bucket_grid(2400.0, 2400.0, 100.0) == (24, 24)
    assert bucket_grid(2400.0, 2400.0, 600.0) == (0, 0)


@pytest.mark.parametrize(
    ("key", "value", "problem"),
    [
        ("drones.bandwidth_kbps", "1e-6", "must be at least 0.001"),
        ("map.size_m.0", "5e-324", "must be at least 1"),
        ("drones.footprint_radius_m", "1e-9", "must be at least 0.001"),
        ("demand.think_time_s", "5e-324", "must be at least 0.001"),
        ("demand.none", "0.999999999999", "must be at most 0.999"),
        ("drones.motion.max_speed_mps", "5e-324", "must be at least 0.001"),
        ("drones.motion.max_acceleration_mps2", "1e9", "must be at most 10,000"),
        ("map.levels.step_m", "1e-9", "must be at least 0.001"),
        ("users.mobility.speed_mps", "201", "must be at most 200"),
    ],
)
def test_a_number_has_bounds(key, value, problem):
    with pytest.raises(ScenarioError) as caught:
        loads("name: x", overrides=[f"{key}={value}"])
    assert str(caught.value) == f"override {key}={value}: {problem}"


RINGS = {
    "map.cells": "[5, 5]",
    "map.size_m": "[1200, 1200]",
    "map.dimensions": "2",
    "drones.count": "3",
    "drones.battery": "null",
    "stations.count": "0",
    "users.count": "60",
}
"""Three drones whose links have 15 classes, with radii of 34 to 188 m."""


def with_rings(*overrides, **radio):
    links = {"kind": "link_classes", "power_dbm": -4, **radio}
    text = ", ".join(f"{key}: {value}" for key, value in links.items())
    rings = [f"{k}={v}" for k, v in RINGS.items()]
    return loads("name: rings", overrides=[*rings, f"drones.radio={{{text}}}", *overrides])


class TestLinks:
    @pytest.mark.thorough
    def test_changes_of_class(self):
        scenario = with_rings()
        results = played(scenario, "des", policy="random", episodes=2, keep_events=True)
        changes = results.events["kind"].isin(["enter", "exit", "class"]).sum() / 2
        (foreseen,) = (p for p in cost(scenario).events if "footprint" in p.what)
        assert changes / FACTOR < foreseen.amount < changes * FACTOR, (changes, foreseen)

    def test_searches_are_counted_where_classes_are_no_rings(self):
        searches = [
            sum(part.amount for part in cost(scenario).events if "searches" in part.what)
            for scenario in (
                with_rings(),
                with_rings(line_of_sight="drawn"),
                with_rings(interference="co_channel"),
                with_rings(interference="{reuse: 3}"),
            )
        ]
        links = 3 * 60 * 30
        assert searches == [0, *(costs.SEARCH * links * n for n in (1, 3, 1 + 2 / 3))]

    @pytest.mark.thorough
    @pytest.mark.parametrize("interference", ["none", "co_channel"])
    def test_looks_at_drones_that_are_asked_by_event(self, interference):
        """How often the SimPy engine looks at a drone and all users, for a leg or a part of it."""
        scenario = with_rings(
            "decisions={kind: event, patience_s: 30}",
            "episode={steps: 10, carry_over: false}",
            line_of_sight="drawn",
            interference=interference,
        )
        engine = make_engine("des", build_world(scenario, 0), RunSettings((True,) * 3, False))
        looks, constants, rng = [], engine.constants, np.random.default_rng(0)

        def counted(look, drones):
            def counting(*told):
                looks.append(drones)
                return look(*told)

            return counting

        constants.foresee_in_air = counted(constants.foresee_in_air, 1)
        constants.foresee_all = counted(constants.foresee_all, 3)
        shown = engine.reset(draw(engine.world, 0, 0))
        while not shown.truncated:
            shown = engine.step([int(rng.choice(np.flatnonzero(mask))) for mask in shown.masks])
        (foreseen,) = (part for part in cost(scenario).events if "searches" in part.what)
        others = 3 if interference == "co_channel" else 1
        looked = costs.SEARCH * sum(looks) * 60 * others
        assert looked / FACTOR < foreseen.amount < looked * FACTOR, (looked, foreseen)

    def test_what_would_take_too_long_is_refused(self):
        scenario = with_rings(interference="co_channel")
        users = scenario.users.model_copy(update={"count": 20_000})
        drones = scenario.drones.model_copy(update={"count": 200})
        with pytest.raises(ScenarioError, match="searches for changes of links") as caught:
            check_cost(scenario.model_copy(update={"users": users, "drones": drones}), "batch")
        assert "users.count, drones.count, access_points, episode.steps, drones.radio" in str(
            caught.value
        )


VOLUMES = """
drones: {count: 2, battery: null, radio: {kind: link_classes, sharing: %s}}
stations: {count: 0}
users: {count: 20}
services: {file: {kind: transfer, volume_mbit: [200, 900], bandwidth_kbps: %s}}
demand: {kind: dynamic, think_time_s: %s, mix: {file: 1}}
episode: {steps: 20}
"""


def test_volumes_are_not_asked_for_faster_than_they_can_be_delivered():
    """50 requests were refused as 546 GB, because the estimate looked at think times alone."""
    scenario = loads(VOLUMES % ("equal", "null", 0.001))
    assert cost(scenario, "batch").memory_bytes < 100e6
    drawn = build_world(scenario, 0).requests(0, 0)
    mean_s = 550e6 / scenario.most_bps
    assert len(drawn.rows) == pytest.approx(20 * 1200 / mean_s, rel=0.2)


@pytest.mark.parametrize("sharing", ["equal", "max_rate", "held"])
def test_all_requests_that_can_be_made_are_drawn(sharing, monkeypatch):
    """Without the bound on rates, more are drawn, and the same are made."""
    held = "[8000]" if sharing == "held" else "null"
    tables = []
    for bounded in (True, False):
        scenario = loads(VOLUMES % (sharing, held, 2.0))
        if not bounded:
            monkeypatch.setattr(type(scenario), "most_bps", 0)
        world = build_world(scenario, 0)
        engine = make_engine("batch", world, RunSettings((True,) * 2, False, keep_events=True))
        snapshot = engine.reset(draw(world, 3, 0))
        while not snapshot.truncated:
            snapshot = engine.step([4, 4])
        tables.append((len(world.requests(3, 0).rows), engine.log.events))
    assert tables[0][1] == tables[1][1]
    assert tables[0][0] < tables[1][0]
