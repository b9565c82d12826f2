"""Comparisons: what they measure, that seeds pair, what they refuse, how they are printed."""

import copy
import csv
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.des import Simulation
from desim_uav.errors import PolicyError, ScenarioError
from desim_uav.experiment import compare
from desim_uav.experiment.evaluate import evaluate
from desim_uav.experiment.processes import run_each
from desim_uav.experiment.run import run
from desim_uav.experiment.statistics import estimate, paired
from desim_uav.measures.known import ALWAYS as MEASURES
from desim_uav.policies import load_policy
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.command_line import IN_TROUBLE, START, runner, with_plug_ins
from tests.selection import by_default

ROOT = Path(__file__).parents[2]
SMALL = ("-S", "users.count=12", "-S", "episode.steps=8")
SHORT = ("--episodes", 2, "--warmup", 1)
JOBS = by_default([1], [1, 2])
PLUG_INS = f'''{IN_TROUBLE}

class Same(Hover):
    """Hover under another name."""


class Trained(Hover):
    """Knows a world."""

    world_seed = 7


class Endless(OnSeedTwo):
    def begin(self, world, streams, carried=False):
        if world.seed == 3:
            Path("last").write_text(str(os.getpid()))
        super().begin(world, streams, carried)

    def do(self):
        Path("reached").touch()
        time.sleep(600)
'''


@pytest.fixture(autouse=True)
def somewhere(tmp_path, monkeypatch):
    """An empty working folder, with policies that can be imported."""
    yield from with_plug_ins("compared", PLUG_INS, tmp_path, monkeypatch)


@pytest.fixture
def cli_run(capsys, monkeypatch):
    """Run a command in this process."""
    return runner(capsys, monkeypatch)


@pytest.fixture(scope="module")
def said():
    """What comparisons printed that several tests look at."""
    return {}


@pytest.fixture
def compared(cli_run, said):
    """Compare policies in a small case 8, as JSON; the same comparison is made once."""

    def run(policies, *arguments, seeds=3, code=0):
        asked = (policies, *arguments, seeds, code)
        if asked not in said or "--out" in arguments:
            flags = ("--policies", policies, "--seeds", seeds, *SMALL, *SHORT, "--json")
            ended = cli_run("compare", "case8", *flags, *arguments)
            assert ended.code == code, ended.err
            said[asked] = ended.json
        return copy.deepcopy(said[asked])

    return run


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A folder for runs that several tests look at."""
    return tmp_path_factory.mktemp("kept")


@pytest.fixture
def played(cli_run, kept):
    """Run a policy in a small case 8; a copy of its folder. The same run is made once."""

    def run(policy, seed, *arguments):
        name = "_".join(map(str, (policy, seed, *arguments)))
        flags = ("--policy", policy, "--seed", seed, *SMALL, *SHORT, "--out", kept / name)
        if not (kept / name).exists():
            assert cli_run("run", "case8", *flags, *arguments).code == 0
        copies = len(list(Path().glob("runs/*")))
        return str(shutil.copytree(kept / name, Path("runs", f"{copies}_{name}")))

    return run


def idle(file):
    """Does the process whose number stands in a file wait for something? Linux knows."""
    if not Path(file).exists() or not (number := Path(file).read_text()):
        return False
    status = Path("/proc", number, "status")
    return not status.exists() or "State:\tS" in status.read_text()


def small(*overrides):
    return load(scenario_path("case8"), ["users.count=12", "episode.steps=8", *overrides])


def values(found, policy, measure):
    return [row[measure] for row in found["replications"] if row["policy"] == policy]


def test_energy_per_bit_is_compared_if_batteries_hold_energy(cli_run):
    """The energy and what was served are those of all episodes of a seed."""
    energy = ("-S", "drones.battery={kind: rotary_wing}", *SMALL)
    done = cli_run(
        *("compare", "case8", "--policies", "hover,random", "--seeds", 2, *energy, *SHORT),
    )
    assert done.code == 0 and "J per Mbit" in done.out, done.err
    scenario = small("drones.battery={kind: rotary_wing}")
    world = build_world(scenario.model_copy(update={"seed": 1}), 1)
    episodes = run(world, load_policy("hover"), "hover", 1, 2, 1).episodes
    counted = episodes[episodes["episode"] >= 0]
    found = evaluate(scenario, "hover", 1, 2, 1)
    assert tuple(found) == (*MEASURES, "j_per_mbit")
    expected = 3600 * counted["energy_wh"].sum() / counted["served_mbit"].sum()
    assert found["j_per_mbit"] == pytest.approx(expected)


class TestEvaluate:
    def test_is_what_a_run_says(self, played, cli_run):
        found = evaluate(small(), "random", 3, 2, 1)
        assert tuple(found) == MEASURES
        run = cli_run("qoe", played("random", 3), "--json").json
        assert found["reward_mean"] == run["reward_mean"]
        assert found.pop("crashes_per_drone_episode") == run["crashes"] / (2 * 3)
        assert found == {name: run[name] for name in found}

    def test_crashes_are_per_drone_and_episode(self):
        """A battery lasts 30 minutes, so each drone that hovers falls once in 45."""
        falls = ["episode.steps=45", "episode.carry_over=false", "drones.battery.on_crash=remove"]
        assert evaluate(small(*falls), "hover", 0, 2, 0)["crashes_per_drone_episode"] == 1.0
        assert evaluate(small(), "hover", 0, 2, 0)["crashes_per_drone_episode"] == 0.0

    def test_a_seed_draws_the_world_unless_the_scenario_gives_one(self):
        assert evaluate(small("seed=5"), "hover", 3, 1, 0) == evaluate(small(), "hover", 3, 1, 0)
        fixed = small("world_seed=3")
        assert evaluate(fixed, "hover", 3, 1, 0) == evaluate(small(), "hover", 3, 1, 0)
        assert evaluate(fixed, "hover", 4, 1, 0) != evaluate(small(), "hover", 4, 1, 0)

    def test_what_there_is_nothing_of_is_none(self):
        silent = small("demand={kind: static, none: 1.0}")
        found = evaluate(silent, "hover", 0, 1, 0)
        assert [name for name, value in found.items() if value is None] == [
            *("qoe1_percent", "qoe1_feasible_percent", "qoe2_iterations", "qoe3_active_percent")
        ]

    def test_half_a_replication_is_none(self):
        with pytest.raises(KeyboardInterrupt):
            evaluate(small(), "compared:Interrupted", 2, 5, 0)

    @pytest.mark.parametrize("jobs", JOBS)
    def test_errors_come_as_they_are(self, jobs):
        def trial(policy, *overrides):
            return small(*overrides), policy, 0, 1, 0

        unknown = [trial("hover"), trial("nobody")]
        with pytest.raises(PolicyError, match="unknown policy 'nobody'"):
            list(run_each(evaluate, unknown, jobs))
        tight = ["map.size_m=[20, 20]", "map.cells=[2, 2]", "stations.count=0"]
        tight += ["drones.battery=null", "users.clusters.radius_m=[9e5, 1e6]"]
        with pytest.raises(ScenarioError, match="map is too small"):
            list(run_each(evaluate, [trial("hover"), trial("hover", *tight)], jobs))

    @pytest.mark.thorough
    def test_more_processes_than_tasks(self):
        tasks = [(small(), "hover", seed, 1, 0) for seed in range(2)]
        assert dict(run_each(evaluate, tasks, 5)) == {
            k: evaluate(*task) for k, task in enumerate(tasks)
        }
        assert list(run_each(evaluate, [], 5)) == []


class TestComparison:
    def test_content(self, compared):
        found = compared("baseline,random,hover")
        assert list(found) == [
            *("scenario", "episodes", "warmup", "confidence", "against", "interrupted"),
            *("better", "policies", "differences", "replications"),
        ]
        assert (found["scenario"], found["episodes"], found["warmup"]) == ("case8", 2, 1)
        assert (found["confidence"], found["interrupted"]) == (0.95, False)
        assert found["against"] == "baseline"
        assert [row["policy"] for row in found["policies"]] == ["baseline", "random", "hover"]
        assert [row["policy"] for row in found["differences"]] == ["random", "hover"]
        assert [list(row) for row in found["replications"]] == 9 * [
            ["policy", "seed", "world_seed", *MEASURES]
        ]
        for row in found["policies"] + found["differences"]:
            assert row["seeds"] == [0, 1, 2]
            assert tuple(row["measures"]) == MEASURES

    def test_estimates_are_over_seeds(self, compared):
        found = compared("baseline,random")
        for name in MEASURES:
            ours, reference = (values(found, p, name) for p in ("random", "baseline"))
            mean, minus = estimate(ours), paired(ours, reference)
            assert found["policies"][1]["measures"][name] == {
                "n": 3,
                "mean": mean.mean,
                "half_width": mean.half_width,
                "low": mean.low,
                "high": mean.high,
            }
            assert found["differences"][0]["measures"][name] == {
                "n": 3,
                "mean": minus.mean,
                "half_width": minus.half_width,
                "low": minus.low,
                "high": minus.high,
                "excludes_zero": minus.excludes_zero,
            }

    def test_each_replication_is_its_evaluation(self, compared):
        for row in compared("random,hover", seeds=2)["replications"]:
            found = evaluate(small(), row["policy"], row["seed"], 2, 1)
            assert row == {
                "policy": row["policy"],
                "seed": row["seed"],
                "world_seed": row["seed"],
                **found,
            }

    def test_pairing_narrows(self, compared):
        found = compared("baseline,random", "-S", "episode.steps=20", seeds=6)
        apart = [row["measures"]["qoe1_percent"]["half_width"] for row in found["policies"]]
        minus = found["differences"][0]["measures"]["qoe1_percent"]["half_width"]
        assert minus < math.hypot(*apart)

    def test_one_policy_under_two_names_does_not_differ(self, compared):
        found = compared("hover,compared:Same")
        for name, difference in found["differences"][0]["measures"].items():
            assert (difference["mean"], difference["half_width"]) == (0.0, 0.0), name
            assert difference["excludes_zero"] is False

    def test_against(self, compared):
        found = compared("baseline,random,hover", "--against", "random")
        minus = [(row["policy"], row["against"]) for row in found["differences"]]
        assert minus == [("baseline", "random"), ("hover", "random")]
        back = compared("random,baseline")["differences"][0]["measures"]
        assert found["differences"][0]["measures"] == back

    def test_one_policy_alone(self, compared):
        assert compared("hover")["differences"] == []

    def test_first_seed(self, compared):
        found = compared("hover", "--first-seed", 2, seeds=2)
        assert found["policies"][0]["seeds"] == [2, 3]
        assert values(found, "hover", "world_seed") == [2, 3]
        assert (
            values(found, "hover", "reward_mean")
            == values(compared("hover", seeds=4), "hover", "reward_mean")[2:]
        )

    def test_a_world_for_all_seeds(self, compared):
        found = compared("hover", "--world-seed", 9)
        assert values(found, "hover", "world_seed") == [9, 9, 9]
        assert compared("hover", "-S", "world_seed=9") == found

    @pytest.mark.thorough
    def test_the_number_of_processes_changes_nothing(self, compared):
        policies = "baseline,random,compared:Same"
        assert compared(policies, "-j", 2) == compared(policies)

    @pytest.mark.parametrize("jobs", JOBS)
    @pytest.mark.parametrize("case", by_default(["case9"], ["case1", "case9"]))
    def test_the_engine_changes_nothing(self, cli_run, monkeypatch, case, jobs):
        command = ("compare", case, "--policies", "baseline,random", "--seeds", 2, *SHORT, "--json")
        with monkeypatch.context() as patched:
            patched.setattr(BatchSimulation, "__init__", lambda *_: pytest.fail("compiled"))
            found = cli_run(*command, "--engine", "des")
        assert cli_run(*command).out == found.out
        monkeypatch.setattr(Simulation, "__init__", lambda *_: pytest.fail("not compiled"))
        assert (found.code, len(found.json["replications"])) == (0, 4)
        assert cli_run(*command, "--engine", "batch", "-j", jobs).out == found.out

    def test_one_seed_has_no_interval(self, compared, cli_run):
        found = compared("hover,random", seeds=1)
        for row in found["policies"] + found["differences"]:
            for measure in row["measures"].values():
                assert measure["n"] == 1
                assert measure["half_width"] is measure["low"] is measure["high"] is None
        assert found["differences"][0]["measures"]["reward_mean"]["excludes_zero"] is None
        flags = ("--policies", "hover", "--seeds", 1, *SMALL, *SHORT)
        out = " ".join(cli_run("compare", "case8", *flags).out.split())
        assert "no interval from a single seed" in out
        assert "values of one seed" in out and "t-interval" not in out and "±" not in out

    def test_what_is_missing_is_left_out(self, compared, cli_run):
        silent = ("-S", "demand={kind: static, none: 1.0}")
        found = compared("hover,random", *silent)
        assert values(found, "hover", "qoe1_percent") == [None] * 3
        for row in (found["policies"][0], found["differences"][0]):
            assert row["measures"]["qoe1_percent"]["n"] == 0
            assert row["measures"]["qoe1_percent"]["mean"] is None
            assert row["measures"]["qoe3_percent"]["n"] == 3
        flags = ("--policies", "hover,random", "--seeds", 2, *SMALL, *SHORT)
        assert cli_run("compare", "case8", *flags, *silent).code == 0


class TestRuns:
    def test_are_what_the_scenario_gives(self, compared, played, cli_run):
        folders = [played(policy, seed) for policy in ("baseline", "random") for seed in (1, 0, 2)]
        assert cli_run("compare", *folders, "--json").json == compared("baseline,random")
        back = cli_run("compare", *folders, "--against", "random", "--json").json
        assert back == compared("baseline,random", "--against", "random")

    def test_pairs_are_of_common_seeds(self, played, cli_run):
        folders = [*(played("hover", k) for k in (0, 1, 2)), *(played("random", k) for k in (1, 3))]
        found = cli_run("compare", *folders, "--json").json
        assert [row["seeds"] for row in found["policies"]] == [[0, 1, 2], [1, 3]]
        assert found["differences"][0]["seeds"] == [1]

    def test_pairs_are_of_common_worlds(self, played, cli_run):
        folders = [played("hover", 0), played("random", 0, "--world-seed", 9)]
        found = cli_run("compare", *folders, "--json").json
        assert found["differences"][0]["seeds"] == []
        assert found["differences"][0]["measures"]["reward_mean"]["n"] == 0
        said = "random and hover have no seed and world in common"
        assert said in cli_run("compare", *folders).out

    def test_a_name_and_the_seeds_do_not_make_a_scenario(self, played, cli_run):
        folders = [played("hover", 0), played("random", 0, "-S", "name=other")]
        assert cli_run("compare", *folders).code == 0
        folders = [played("hover", 0, "--world-seed", 4), played("hover", 1, "--world-seed", 4)]
        assert cli_run("compare", *folders, "--json").json["policies"][0]["seeds"] == [0, 1]

    def test_another_scenario(self, played, cli_run):
        one = played("hover", 0)
        other = played("random", 0, "-S", "stations.pads=2")
        cli_run("compare", one, other).failed(
            4, f"{other}: its scenario is not that of {one}: stations.pads is 2, not 1"
        )

    @pytest.mark.parametrize(
        ("flags", "said"),
        [(("--episodes", 3), "3 episode(s) after 1"), (("--warmup", 2), "2 episode(s) after 2")],
    )
    def test_another_length(self, played, cli_run, flags, said):
        folders = [played("hover", 0), played("random", 0, *flags)]
        cli_run("compare", *folders).failed(4, f"{folders[1]}: {said} of warm-up", "2 after 1")

    def test_one_seed_twice(self, played, cli_run):
        folders = [played("hover", 0), played("random", 0), played("hover", 0)]
        cli_run("compare", *folders).failed(
            4,
            f"{folders[2]}: hover on seed 0 is given twice; "
            f"{folders[0]} has the same policy and seed",
        )
        cli_run("compare", folders[0], folders[0]).failed(4, "hover on seed 0 is given twice")

    def test_no_run(self, played, cli_run):
        cli_run("compare", "nope").failed(4, "nope: no such run folder")
        cli_run("compare", "case8").failed(4, "case8: no such run folder", "--policies")
        cli_run("compare", ".").failed(4, "requests.parquet: no such table")
        cli_run("compare", played("hover", 0), "nope").failed(4, "nope: no such run folder")

    @pytest.mark.parametrize(
        "name", ["requests.parquet", "episodes.parquet", "manifest.json", "scenario.yaml"]
    )
    def test_a_damaged_file_is_named(self, played, cli_run, name):
        folder = played("hover", 0)
        file = Path(folder) / name
        file.write_bytes(b"{" + file.read_bytes()[:100])
        cli_run("compare", folder).failed(4, f"{folder}/{name}:")
        file.unlink()
        cli_run("compare", folder).failed(4, f"{folder}/{name}")

    def test_runs_are_as_they_are(self, played, cli_run):
        folder = played("hover", 0)
        numbers = ("--seeds", "--first-seed", "--world-seed", "--episodes", "--warmup", "-j")
        given = [*((flag, 2) for flag in numbers), ("-S", "seed=1"), ("--engine", "des")]
        for flag, value in given:
            cli_run("compare", folder, flag, value).failed(2, f"{flag} goes with a scenario")


class TestRefused:
    @pytest.mark.parametrize(
        ("arguments", "code", "part"),
        [
            ((), 2, "Missing argument"),
            (("case8", "tiny", "--policies", "hover"), 2, "give one scenario, not 2"),
            (("case8", "--policies", ""), 2, "a name is empty"),
            (("case8", "--policies", "hover,,random"), 2, "none can contain a comma"),
            (("case8", "--policies", "hover, hover"), 2, "'hover' is given twice"),
            (("case8", "--policies", "hover", "--against", "hovr"), 2, "did you mean 'hover'?"),
            (("case8", "--policies", "hover", "--seeds", 0), 2, "--seeds"),
            (("case8", "--policies", "hover", "--seeds", "0,3"), 2, "--seeds"),
            (("case8", "--policies", "hover", "--episodes", 0), 2, "--episodes"),
            (("case8", "--policies", "hover", "-j", 0), 2, "-j"),
            (("case8", "--policies", "hover", "-S", "seed"), 2, "must be key.path=value"),
            (("cse8", "--policies", "hover"), 3, "did you mean 'case8'?"),
            (("case8", "--policies", "hover", "-S", "sede=1"), 3, "did you mean 'seed'?"),
            (("case8", "--policies", "hover,rndom"), 4, "did you mean 'random'?"),
            (("case8", "--policies", "hover,script:nope.csv"), 4, "nope.csv: No such file"),
        ],
    )
    def test_with_its_exit_code(self, cli_run, arguments, code, part):
        cli_run("compare", *arguments).failed(code, part)

    @pytest.mark.parametrize("jobs", JOBS)
    def test_a_script_that_does_not_fit(self, cli_run, jobs):
        Path("s.csv").write_text("step,drone,action\n0,9,up\n")
        flags = ("--policies", "hover,script:s.csv", "--seeds", 2, *SHORT, "-j", jobs)
        cli_run("compare", "case8", *flags).failed(4, "s.csv:2: drone: 9")

    @pytest.mark.parametrize("jobs", JOBS)
    def test_a_policy_that_fails(self, cli_run, jobs):
        flags = ("--policies", "hover,compared:Broken", "--seeds", 4, *SHORT, "-j", jobs)
        cli_run("compare", "case8", *flags).failed(
            1, "policy 'compared:Broken' failed in episode -1: KeyError: 'boom'"
        )

    @pytest.mark.thorough
    def test_a_process_that_dies(self, cli_run):
        flags = ("--policies", "hover,compared:Killed", "--seeds", 4, *SHORT, "-j", 2)
        cli_run("compare", "case8", *flags).failed(1, "a process has died", "(-j)")

    @pytest.mark.parametrize("jobs", JOBS)
    def test_a_component_without_a_kernel(self, cli_run, jobs):
        own = ("-S", "drones.admission={kind: 'compared:Own'}", "--engine", "batch", "-j", jobs)
        flags = ("--policies", "hover,random", "--seeds", 2, *SHORT, "--out", "v.csv")
        cli_run("compare", "case8", *flags, *own).failed(
            3,
            "drones.admission: 'Own' is not compiled: it does not work on rows; "
            "--engine des runs it",
        )
        assert list(Path.cwd().iterdir()) == []

    def test_a_world_that_cannot_be_drawn(self, cli_run):
        Path("full.yaml").write_text(
            "name: full\nstations: {count: 0}\ndrones: {battery: null}\n"
            "map: {obstacles: {coverage: [0.9, 0.9]}}\n"
        )
        cli_run("compare", "full.yaml", "--policies", "hover").failed(
            3, "full.yaml: map.obstacles: none of 101 drawn maps (world seed 0)"
        )


class TestAnotherWorld:
    def test_is_warned_of_once(self, cli_run):
        flags = ("--policies", "hover,compared:Trained", "--seeds", 3, *SMALL, *SHORT, "--json")
        ended = cli_run("compare", "case8", *flags)
        assert ended.err == (
            "desim-uav: compared:Trained was learned in world 7 and is compared in a world for "
            "each seed; set the world seed to 7 to compare it in its own world\n"
        )
        assert len(ended.json["replications"]) == 6
        ended = cli_run("compare", "case8", *flags, "-S", "world_seed=5")
        assert "was learned in world 7 and is compared in world 5" in ended.err

    def test_its_own_is_not(self, cli_run):
        flags = ("--policies", "hover,compared:Trained", "--seeds", 2, *SMALL, *SHORT)
        assert cli_run("compare", "case8", *flags, "--world-seed", 7).err == ""


class TestOut:
    def test_is_the_values_of_each_seed(self, compared):
        found = compared("hover,random", "--out", "deep/values.csv")
        with Path("deep/values.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert list(rows[0])[:4] == ["scenario", "episodes", "warmup", "policy"]
        assert len(rows) == 6
        for row, replication in zip(rows, found["replications"], strict=True):
            assert (row["scenario"], row["episodes"], row["warmup"]) == ("case8", "2", "1")
            assert row["policy"] == replication["policy"]
            for name in ("seed", "world_seed", *MEASURES):
                assert float(row[name]) == replication[name]

    def test_what_is_missing_is_empty(self, compared):
        compared("hover", "--out", "v.csv", "-S", "demand={kind: static, none: 1.0}", seeds=1)
        assert Path("v.csv").read_text().splitlines()[1].startswith("case8,2,1,hover,0,0,,,,")

    def test_takes_the_place_of_the_one_before(self, compared):
        Path("v.csv").write_text("old")
        compared("hover", "--out", "v.csv")
        assert "old" not in Path("v.csv").read_text()
        assert [path.name for path in Path.cwd().iterdir()] == ["v.csv"]

    def test_of_runs(self, compared, played, cli_run):
        compared("hover", "--out", "one.csv", seeds=2)
        cli_run("compare", played("hover", 0), played("hover", 1), "--out", "two.csv")
        assert Path("one.csv").read_text() == Path("two.csv").read_text()

    def test_is_looked_at_before_anything_runs(self, cli_run, monkeypatch):
        monkeypatch.setattr(compare, "compare_policies", lambda *_, **__: pytest.fail("ran"))
        Path("file").touch()
        flags = ("compare", "case8", "--policies", "hover", "--out")
        cli_run(*flags, ".").failed(2, "--out .: exists and is not a file")
        cli_run(*flags, "file/v.csv").failed(2, "--out file/v.csv:")
        cli_run(*flags, "v.parquet").failed(2, "--out v.parquet: the file's name must end in .csv")

    def test_stays_where_the_comparison_fails(self, cli_run):
        Path("v.csv").write_text("old")
        flags = ("--policies", "compared:Broken", "--seeds", 4, *SHORT, "--out", "v.csv")
        assert cli_run("compare", "case8", *flags).code == 1
        assert Path("v.csv").read_text() == "old"


class TestTable:
    def test_mean_interval_and_difference(self, compared, cli_run):
        flags = ("--policies", "hover,random", "--seeds", 3, *SMALL, *SHORT)
        ended = cli_run("compare", "case8", *flags)
        found = compared("hover,random")
        assert ended.err == ""
        means, differences = ended.out.split("difference from hover, paired by seed")
        shown = found["policies"][0]["measures"]["qoe1_percent"]
        line = next(line for line in means.splitlines() if "QoE1 %" in line)
        assert line.split() == [
            *("QoE1", "%", "hover", "3", f"{shown['mean']:.2f}", "±", f"{shown['half_width']:.2f}"),
            *(f"[{shown['low']:.2f},", f"{shown['high']:.2f}]"),
        ]
        for name, label in (("qoe1_percent", "QoE1 %"), ("reward_mean", "reward")):
            line = next(line for line in differences.splitlines() if label in line)
            difference = found["differences"][0]["measures"][name]
            word = "better" if difference["mean"] > 0 else "worse"
            assert line.rstrip().endswith(f"≠ 0, {word}") is difference["excludes_zero"]

    def test_fits_100_columns(self, cli_run, monkeypatch):
        Path("a" * 60 + ".csv").write_text("step,drone,action\n")
        policies = "hover,script:" + "a" * 60 + ".csv"
        flags = ("--policies", policies, "--seeds", 2, *SMALL, *SHORT)
        lines = cli_run("compare", "case8", *flags).out.splitlines()
        assert max(map(len, (line.rstrip() for line in lines))) <= 100


class TestInterrupted:
    def test_what_has_ended_is_shown(self, cli_run):
        flags = ("--policies", "hover,compared:Interrupted", "--seeds", 5, *SMALL, *SHORT)
        ended = cli_run("compare", "case8", *flags, "--json", "--out", "v.csv")
        assert ended.code == 130
        assert ended.message == "desim-uav: interrupted; what had ended is shown"
        assert ended.json["interrupted"] is True
        seeds = [row["seeds"] for row in ended.json["policies"]]
        assert seeds == [[0, 1, 2], [0, 1]]
        assert ended.json["differences"][0]["seeds"] == [0, 1]
        assert len(Path("v.csv").read_text().splitlines()) == 6
        assert cli_run("compare", "case8", *flags).code == 130

    def test_where_nothing_has(self, cli_run):
        flags = ("--policies", "compared:Interrupted", "--seeds", 5, "--first-seed", 2, *SHORT)
        cli_run("compare", "case8", *flags, "--out", "v.csv").failed(130, "no run has ended")
        assert not Path("v.csv").exists()

    @pytest.mark.parametrize("number", by_default([], [signal.SIGTERM, signal.SIGINT], at_most=1))
    def test_processes_end_with_it(self, number):
        """Ctrl-C reaches the whole group: one answer, and nobody stays."""
        flags = ("--policies", "hover,compared:Endless", "--seeds", "4", "-j", "2", *SMALL)
        program = [sys.executable, "-c", START, "compare", "case8", *flags, *map(str, SHORT)]
        process = subprocess.Popen(
            [*program, "--json", "-q"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        begun = time.monotonic()
        while not (Path("reached").exists() and idle("last")) and time.monotonic() < begun + 240:
            time.sleep(0.05)
        time.sleep(1)  # for the command to be told of what the other process has finished
        os.killpg(process.pid, number)
        out, err = process.communicate(timeout=120)
        assert (process.returncode, err) == (
            130,
            "desim-uav: interrupted; what had ended is shown\n",
        )
        seeds = [row["seeds"] for row in json.loads(out)["policies"]]
        assert seeds == [[0, 1, 2, 3], [0, 1, 3]]
        with pytest.raises(ProcessLookupError):
            for _ in range(100):
                os.killpg(process.pid, 0)
                time.sleep(0.05)
