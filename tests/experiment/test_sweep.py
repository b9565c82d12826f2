"""Sweeps: jobs and their identity, the dataset, what ends them and how they go on."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.des import Simulation
from desim_uav.errors import UsageError
from desim_uav.experiment.evaluate import evaluate
from desim_uav.experiment.statistics import estimate
from desim_uav.experiment.sweep import job, run
from desim_uav.experiment.sweep.grid import axes
from desim_uav.experiment.sweep.pictures import plot_sweep, sweep_report
from desim_uav.experiment.sweep.plan import SweepPlan, arms, policy_digest
from desim_uav.lock import held
from desim_uav.measures.known import ALWAYS as MEASURES
from desim_uav.policies.tabular import read_table
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from tests.command_line import IN_TROUBLE, runner, with_plug_ins

ROOT = Path(__file__).parents[2]
GRID = ("-S", "drones.footprint_radius_m=150,250", "-S", "episode.steps=3:4")
SHORT = ("--episodes", 2, "--warmup", 1)
PLUG_INS = f'''{IN_TROUBLE}

class Slow(Hover):
    """Takes its time, if it is asked to."""

    def begin(self, world, streams, carried=False):
        if Path("slow").exists():
            time.sleep(0.1)
'''


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """An empty working folder, with policies that can be imported."""
    yield from with_plug_ins("swept", PLUG_INS, tmp_path, monkeypatch)


@pytest.fixture
def swept(capsys, monkeypatch):
    """Sweep the tiny scenario in this process, a few short episodes."""
    run = runner(capsys, monkeypatch)
    return lambda *arguments, out="out", scenario="tiny": run(
        "sweep", scenario, *SHORT, "--out", out, *arguments
    )


def dataset(out):
    return pd.read_parquet(Path(out) / "results").sort_values("job").reset_index(drop=True)


def files(out):
    """The rows' files, and when they were written."""
    return {file.name: file.stat().st_mtime_ns for file in (Path(out) / "results").iterdir()}


def manifest(out):
    return json.loads((Path(out) / "manifest.json").read_text())


def jobs(policies, values, seeds, episodes, warmup):
    """The jobs of a sweep of the tiny scenario."""
    asked = SweepPlan(scenario_path("tiny"), values, policies, False, None, seeds, episodes, warmup)
    return job.jobs(asked, arms(asked, axes(values)))


class TestDataset:
    @pytest.mark.thorough
    def test_a_row_is_what_its_evaluation_gives(self, swept):
        assert swept(*GRID, "--policies", "hover,random", "--seeds", 3).code == 0
        found = dataset("out")
        assert list(found) == [
            *("job", "drones.footprint_radius_m", "episode.steps", "policy", "algorithm"),
            *("seed", "world_seed", *MEASURES),
        ]
        assert len(found) == found["job"].nunique() == 2 * 2 * 2 * 3
        assert found["drones.footprint_radius_m"].dtype == "int64"
        for row in found.to_dict("records"):
            keys = ("drones.footprint_radius_m", "episode.steps")
            scenario = load(scenario_path("tiny"), [f"{key}={row[key]}" for key in keys])
            measured = evaluate(scenario, row["policy"], row["seed"], 2, 1)
            assert {name: row[name] for name in MEASURES} == pytest.approx(measured, rel=0)
            assert pd.isna(row["algorithm"]) and row["world_seed"] == row["seed"]

    def test_a_world_for_all_seeds(self, swept):
        flags = ("--policies", "hover", "--seeds", 2, "--first-seed", 5)
        assert swept(*flags, "-S", "world_seed=9").code == 0
        found = dataset("out")
        assert sorted(found["seed"]) == [5, 6] and set(found["world_seed"]) == {9}

    def test_the_baseline_unless_told(self, swept):
        assert swept("--seeds", 1).code == 0
        assert list(dataset("out")["policy"]) == ["baseline"]

    def test_values_of_several_kinds(self, swept):
        walks = "{kind: static},{kind: random_walk, speed_mps: 2.5, leg_s: 60}"
        flags = ("--policies", "hover", "--seeds", 1, "-S", "map.size_m=[720,720]")
        assert swept(*flags, "-S", f"users.mobility={walks}", "-S", "world_seed=null,3").code == 0
        found = dataset("out")
        assert set(found["map.size_m"]) == {"[720, 720]"}
        assert set(found["users.mobility"]) == {
            '{"kind": "static"}',
            '{"kind": "random_walk", "speed_mps": 2.5, "leg_s": 60}',
        }
        assert sorted(found["world_seed"]) == [0, 0, 3, 3]

    @pytest.mark.thorough
    def test_the_number_of_processes_and_the_engine_change_nothing(self, swept, monkeypatch):
        flags = (*GRID, "--policies", "random,swept:Slow", "--seeds", 2)
        with monkeypatch.context() as patched:
            patched.setattr(BatchSimulation, "__init__", lambda *_: pytest.fail("compiled"))
            assert swept(*flags, "--engine", "des", out="des").code == 0
        assert swept(*flags, "-j", 2, out="two").code == 0
        monkeypatch.setattr(Simulation, "__init__", lambda *_: pytest.fail("not compiled"))
        assert swept(*flags, out="one").code == 0
        for out in ("two", "one"):
            pd.testing.assert_frame_equal(dataset(out), dataset("des"))

    def test_what_has_no_kernel_is_run_by_simpy(self, swept):
        own = ("-S", "drones.admission.kind=first_come,swept:Own", "--seeds", 1)
        done = swept(*own, "--policies", "hover,random")
        assert done.code == 0
        assert done.err.count("is not compiled") == 1, "once for all combinations and policies"
        assert (
            "the SimPy engine (des) is used, which is slower: drones.admission: 'Own'" in done.err
        )
        table = dataset("out").sort_values("drones.admission.kind")
        for _, of_policy in table.groupby("policy"):
            first, second = of_policy[list(MEASURES)].to_dict("records")
            assert first == pytest.approx(second, nan_ok=True)
        refused = swept(*own, "--policies", "hover", "--engine", "batch", out="batch")
        refused.failed(3, "swept:Own", "(with drones.admission.kind=swept:Own)")
        assert not Path("batch").exists()

    @pytest.mark.thorough
    def test_trainings(self, swept):
        flags = ("--train", "--algorithm", "q_learning,sarsa", "--seeds", 2, "--policies", "hover")
        assert swept(*flags, "-S", "learning.episodes=5,9").code == 0
        found = dataset("out")
        assert len(found) == 2 * 3 * 2
        assert set(found["policy"]) == {"q_learning", "sarsa", "hover"}
        assert found["algorithm"].isna().sum() == 4
        learned = found[found["algorithm"].notna()]
        assert (learned["algorithm"] == learned["policy"]).all()
        assert len(list(Path("out/policies").iterdir())) == len(learned)
        for row in learned.to_dict("records"):
            file = Path("out/policies") / f"{row['job']}.npz"
            about = read_table(file).about
            assert about["algorithm"] == row["algorithm"] and about["seed"] == row["seed"]
            assert about["episodes"] == row["learning.episodes"]
            measured = evaluate(load(scenario_path("tiny")), str(file), row["seed"], 2, 1)
            assert {name: row[name] for name in MEASURES} == pytest.approx(measured, rel=0)

    @pytest.mark.thorough
    def test_energy_per_bit_where_batteries_hold_energy(self, swept):
        batteries = "drones.battery={kind: rotary_wing, capacity_wh: 30},{autonomy_min: 30}"
        keys = ("demand={kind: dynamic}", "stations.count=1")
        flags = ("--policies", "hover", "--seeds", 2, "--engine", "des")
        flags += tuple(flag for key in keys for flag in ("-S", key))
        ended = swept(*flags, "-S", batteries, out="both")
        assert ended.code == 0, ended.err
        found = dataset("both")
        assert list(found)[-1] == "j_per_mbit"
        in_joules = found["drones.battery"].str.contains("rotary_wing")
        assert found["j_per_mbit"].notna().tolist() == in_joules.tolist()
        for row in found[in_joules].to_dict("records"):
            battery = f"drones.battery={row['drones.battery']}"
            scenario = load(scenario_path("tiny"), [*keys, battery])
            measured = evaluate(scenario, "hover", row["seed"], 2, 1)
            assert row["j_per_mbit"] == pytest.approx(measured["j_per_mbit"], rel=0)
        assert "J per Mbit" in ended.out and "J per Mbit" in Path("both/table.md").read_text()
        assert "4 of 4 jobs" in swept(*flags, "-S", batteries, "--resume", out="both").err
        assert "J per Mbit" in sweep_report(Path("both"), None)
        (axes,) = plot_sweep(Path("both"), ["j_per_mbit"]).axes
        assert axes.get_title(loc="left") == "J per Mbit"
        assert swept("--policies", "hover", "--seeds", 1, "--engine", "des").code == 0
        with pytest.raises(UsageError, match="not all batteries are measured in Wh"):
            plot_sweep(Path("out"), ["j_per_mbit"])

    @pytest.mark.thorough
    def test_the_scenarios_own_algorithm(self, swept):
        swept("--train", "-S", "learning.algorithm=sarsa,double_q", "-S", "learning.episodes=3")
        assert set(dataset("out")["algorithm"]) == {"sarsa", "double_q"}


class TestPrinted:
    def test_a_table_of_means_and_intervals(self, swept):
        ended = swept(*GRID, "--policies", "random", "--seeds", 4)
        assert ended.err == "" and ended.out.rstrip().endswith("out/results")
        lines = [line.split() for line in ended.out.splitlines()]
        (line,) = [line for line in lines if line[:3] == ["150", "3", "random"]]
        found = dataset("out")
        chosen = found[(found["drones.footprint_radius_m"] == 150) & (found["episode.steps"] == 3)]
        reward = estimate(chosen["reward_mean"])
        assert line[3] == "4"
        assert line[-3:] == [f"{reward.mean:.2f}", "±", f"{reward.half_width:.2f}"]
        written = Path("out/table.md").read_text()
        assert f"| 150 | 3 | random | 4 | {estimate(chosen['qoe1_percent']):.1f} |" in written

    def test_json(self, swept):
        found = swept(*GRID, "--policies", "hover,random", "--seeds", 2, "--json").json
        assert (found["scenario"], found["episodes"], found["warmup"]) == ("tiny", 2, 1)
        assert (found["failed"], found["interrupted"]) == ([], False)
        rows = pd.DataFrame(found["rows"]).sort_values("job").reset_index(drop=True)
        there = dataset("out").drop(columns="algorithm")  # of which there is none
        pd.testing.assert_frame_equal(rows.drop(columns="algorithm"), there, check_dtype=False)
        assert len(found["estimates"]) == 8
        for row in found["estimates"]:
            keys = ["drones.footprint_radius_m", "episode.steps", "policy"]
            mine = rows[(rows[keys] == [row[key] for key in keys]).all(axis=1)]
            expected = estimate(mine["reward_mean"])
            assert row["measures"]["reward_mean"] == {
                "n": 2,
                "mean": expected.mean,
                "half_width": expected.half_width,
            }

    def test_quiet(self, swept):
        ended = swept("-S", "episode.steps=2,3", "--seeds", 1, "-q")
        assert (ended.code, ended.out, ended.err) == (0, "", "")

    def test_the_manifest(self, swept):
        swept(*GRID, "--policies", "hover", "--seeds", 2)
        found = manifest("out")
        assert found["scenario"]["name"] == "tiny" and len(found["scenario"]["sha256"]) == 64
        assert found["seeds"] == [0, 1] and found["policies"] == ["hover"]
        assert [c["settings"] for c in found["combinations"]] == [
            [f"drones.footprint_radius_m={radius}", f"episode.steps={steps}"]
            for radius in (150, 250)
            for steps in (3, 4)
        ]
        assert len({c["scenario_hash"] for c in found["combinations"]}) == 4
        assert set(found["jobs"]) == set(dataset("out")["job"])
        assert found["command"][:3] == ["desim-uav", "sweep", "tiny"]
        assert "numpy" in found["versions"]

    def test_a_table_in_another_world_is_warned_of(self, swept):
        trained = ("--train", "--seeds", 1, "-S", "learning.episodes=3")
        swept(*trained, out="trained")
        (file,) = Path("trained/policies").iterdir()
        ended = swept("--policies", file, "--seeds", 2)
        assert ended.code == 0 and "was learned in world 0" in ended.message


class TestIdentity:
    def jobs(self, policies="hover", *overrides, seed=0, episodes=2, warmup=1):
        found = jobs(policies.split(","), overrides, range(seed, seed + 1), episodes, warmup)
        return [one.id for one in found]

    def test_is_the_same_each_time(self):
        assert self.jobs() == self.jobs()
        assert (
            self.jobs("hover", "episode.steps=3,4")[0] == self.jobs("hover", "episode.steps=3")[0]
        )

    def test_is_another_for_another_job(self):
        found = [
            *self.jobs("hover,random"),
            *self.jobs(seed=1),
            *self.jobs(episodes=3),
            *self.jobs(warmup=0),
            *self.jobs("hover", "episode.steps=3,4"),
            *self.jobs("hover", "name=a,b"),
            *self.jobs("swept:Slow,swept:Broken"),
        ]
        assert len(set(found)) == len(found) == 11

    def test_is_of_a_policys_content(self, here):
        script = here / "fly.csv"
        script.write_text("step,drone,action\n0,0,right\n")
        before = self.jobs("script:fly.csv")
        script.write_text("step,drone,action\n0,0,left\n")
        after = self.jobs("script:fly.csv")
        script.write_text("step,drone,action\n0,0,right\n")
        assert before != after and self.jobs("script:fly.csv") == before

    @pytest.mark.parametrize("name", ["rollout:{}", "rollout:{}+samples=1+horizon=1"])
    def test_is_of_the_content_of_a_base(self, here, name):
        script = here / "fly.csv"
        script.write_text("step,drone,action\n0,0,right\n")
        before = self.jobs(name.format("script:fly.csv"))
        script.write_text("step,drone,action\n0,0,left\n")
        assert before != self.jobs(name.format("script:fly.csv"))

    def test_is_of_the_code_of_a_base(self, here):
        assert policy_digest("rollout:swept:Slow+samples=1") == policy_digest("swept:Slow") != ""
        assert policy_digest("rollout:hover+samples=1") == ""

    @pytest.mark.parametrize(
        ("name", "source"),
        [
            ("script:fly.csv", "script:{}/fly.csv"),
            ("rollout:script:fly.csv", "rollout:script:{}/fly.csv"),
            ("rollout:script:fly.csv+samples=1", "rollout:script:{}/fly.csv+samples=1"),
            ("rollout:north.py:North+samples=1", "rollout:{}/north.py:North+samples=1"),
            ("north.py:North", "{}/north.py:North"),
            ("rollout:case8.npz", "rollout:case8.npz"),
            ("rollout:greedy+samples=1", "rollout:greedy+samples=1"),
        ],
    )
    def test_is_run_from_any_folder(self, here, name, source):
        (here / "fly.csv").write_text("step,drone,action\n0,0,right\n")
        (here / "north.py").write_text(
            "from desim_uav.policies.hover import Hover\nclass North(Hover):\n    pass\n"
        )
        (one,) = arms(
            SweepPlan(scenario_path("case8"), [], [name], False, None, range(1), 1, 0), []
        )
        assert one.source == source.format(here)

    def test_is_of_the_version(self, monkeypatch):
        before = self.jobs()
        monkeypatch.setattr(job, "__version__", "9.9.9")
        assert self.jobs() != before

    def test_another_version_refuses_a_job(self):
        (one,) = jobs(["hover"], [], range(1), 1, 0)
        assert job.run_job(one).failure == ""
        assert "9.9.9" in job.run_job(one, "9.9.9").failure


def test_warnings_of_scenarios_are_told_once():
    given = {"stations": {"count": 3, "radius_m": 1e6}, "episode": {"steps": 2}}
    axes_of_it, said = axes({"users.count": [3, 4]}), list[str]()
    arms(SweepPlan(given, [], ["hover"], False, None, range(1), 1, 0), axes_of_it, said.append)
    (line,) = said
    assert line.startswith("warning: stations.radius_m: 1e+06: the circle leaves")


class TestResume:
    @pytest.mark.thorough
    def test_a_kill_changes_nothing(self, swept, here):
        """The rows there were are kept, and the dataset is that of a sweep left in peace."""
        flags = (*GRID, "--policies", "swept:Slow,random", "--seeds", 3)
        assert swept(*flags, out="undisturbed").code == 0
        (here / "slow").touch()
        process = started(*flags, "-j", 2, "-q")
        until(lambda: len(whole("out")) > 2)
        process.kill()
        process.communicate()
        kept = whole("out")
        assert len(kept) < 24
        (here / "slow").unlink()
        ended = swept(*flags, "--resume")
        said = f"desim-uav: {len(kept)} of 24 jobs had ended before"
        assert (ended.code, ended.message) == (0, said)
        assert kept.items() <= files("out").items()
        pd.testing.assert_frame_equal(dataset("out"), dataset("undisturbed"))

    @pytest.mark.parametrize("scenario", ["tiny", "harvest", "edge"])
    def test_finished_jobs_are_not_run_again(self, swept, monkeypatch, scenario):
        flags = ("-S", "episode.steps=1,2", "--policies", "hover", "--seeds", 1)
        first = swept(*flags, scenario=scenario)
        monkeypatch.setattr(job, "evaluate", lambda *_: pytest.fail("run again"))
        again = swept(*flags, "--resume", scenario=scenario)
        assert (again.code, again.out) == (0, first.out)
        assert "J per Mbit" in sweep_report(Path("out"), None) or scenario != "harvest"

    @pytest.mark.thorough
    @pytest.mark.parametrize("damage", ["cut", "flipped", "other", "empty"])
    def test_a_damaged_row_is_made_again(self, swept, damage):
        flags = (*GRID, "--policies", "random", "--seeds", 2)
        swept(*flags)
        before = dataset("out")
        file, other = sorted(Path("out/results").iterdir())[:2]
        content = file.read_bytes()
        place = content.index(b"random")
        flipped = content[:place] + b"rendom" + content[place + 6 :]
        made = {"cut": content[:-9], "flipped": flipped, "empty": b"", "other": other.read_bytes()}
        file.write_bytes(made[damage])
        ended = swept(*flags, "--resume")
        assert "7 of 8 jobs had ended before" in ended.message
        pd.testing.assert_frame_equal(dataset("out"), before)

    def test_a_sweep_can_grow(self, swept):
        swept("-S", "episode.steps=3", "--policies", "hover", "--seeds", 2)
        before = files("out")
        grown = ("-S", "episode.steps=3,4", "--policies", "hover,random", "--seeds", 3, "--resume")
        assert "2 of 12 jobs had ended before" in swept(*grown).message
        assert before.items() <= files("out").items()
        assert len(dataset("out")) == len(manifest("out")["jobs"]) == 12

    def test_ctrl_c_keeps_what_was_finished(self, swept):
        ended = swept(*GRID, "--policies", "swept:Interrupted", "--seeds", 4, "-q")
        ended.failed(130, "interrupted; 8 of 16 jobs are kept; --resume goes on")
        assert sorted(set(dataset("out")["seed"])) == [0, 1]
        assert Path("out/table.md").exists()

    @pytest.mark.thorough
    def test_ctrl_c_from_outside(self, swept, here):
        (here / "slow").touch()
        flags = ("--policies", "swept:Slow", "--seeds", 40, "-j", 2)
        process = started(*flags, "--json")
        until(lambda: len(whole("out")) > 1)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
        assert process.returncode == 130 and "--resume goes on" in err and "Traceback" not in err
        found = json.loads(out)
        assert found["interrupted"] and 1 < len(found["rows"]) < 40
        assert len(dataset("out")) == len(found["rows"])


class TestFailures:
    def test_are_listed_and_the_others_kept(self, swept):
        flags = ("-S", "episode.steps=3,4", "--policies", "hover,swept:Broken", "--seeds", 4)
        ended = swept(*flags)
        assert ended.code == 1
        said = "episode.steps=3, swept:Broken, seed 2: policy 'swept:Broken' failed in episode -1:"
        assert f"{said} KeyError: 'boom'" in ended.message
        assert "2 of 16 jobs failed, see out/failed.json" in ended.message
        failed = json.loads(Path("out/failed.json").read_text())
        assert [row["seed"] for row in failed] == [2, 2]
        assert sorted(row["episode.steps"] for row in failed) == [3, 4]
        found = dataset("out")
        assert len(found) == 14 and not set(found["job"]) & {row["job"] for row in failed}
        lines = [line.split()[:3] for line in ended.out.splitlines()]
        assert ["3", "swept:Broken", "3"] in lines and ["3", "hover", "4"] in lines

    def test_are_tried_again(self, swept, tmp_path):
        flags = ("--policies", "swept:Broken", "--seeds", 3)
        assert swept(*flags).code == 1
        ended = swept(*flags, "--resume", "-q")
        ended.failed(1, "2 of 3 jobs had ended before", "1 of 3 jobs failed")

    def test_leave_no_list_once_there_are_none(self, swept, monkeypatch):
        with monkeypatch.context() as patched:
            patched.setattr(job, "evaluate", lambda *_, **__: 1 / 0)
            ended = swept("--policies", "hover", "--seeds", 2, "-q")
            ended.failed(1, "hover, seed 0: ZeroDivisionError: division by zero")
            assert not list(Path("out/results").iterdir())
        assert swept("--policies", "hover", "--seeds", 2, "--resume").code == 0
        assert not Path("out/failed.json").exists() and len(dataset("out")) == 2

    def test_many_are_told_in_short(self, swept, monkeypatch):
        monkeypatch.setattr(job, "evaluate", lambda *_, **__: 1 / 0)
        ended = swept("--policies", "hover", "--seeds", 25, "-q")
        assert len(ended.err.splitlines()) == 13 and "and 15 more" in ended.message
        assert len(json.loads(Path("out/failed.json").read_text())) == 25

    @pytest.mark.thorough
    def test_a_process_that_dies_ends_its_job_only(self, swept):
        ended = swept("--policies", "swept:Killed,swept:Broken", "--seeds", 4, "-j", 2)
        assert ended.code == 1 and "swept:Killed, seed 2: a process has died" in ended.message
        assert "swept:Broken, seed 2: policy 'swept:Broken' failed" in ended.message
        assert sorted(dataset("out")["seed"]) == [0, 0, 1, 1, 3, 3]

    def test_a_policy_that_changes_meanwhile(self, swept, here, monkeypatch):
        script = here / "fly.csv"
        script.write_text("step,drone,action\n0,0,right\n")
        real = job.run_job

        def changed(one, version, measures):
            script.write_text("step,drone,action\n0,0,left\n")
            return real(one, version, measures)

        monkeypatch.setattr(run, "run_job", changed)
        ended = swept("--policies", "script:fly.csv", "--seeds", 1, "-q")
        ended.failed(1, "script:fly.csv: the file has changed since the sweep began")


class TestRefused:
    def test_every_problem_of_every_combination_once(self, swept):
        grid = ("-S", "drones.footprint_radius_m=0,150", "-S", "drones.count=1:3")
        ended = swept(*grid, "-S", "nope=1", "-S", "map.cells=[3,3],[0,3]", "--seeds", 2)
        ended.failed(3)
        lines = [line.removeprefix("desim-uav: ") for line in ended.err.splitlines()]
        assert len(lines) == len(set(lines)) == 5
        radius, unknown, cells, two, three = lines
        assert radius.startswith("override drones.footprint_radius_m=0: must be at least 0.001")
        assert radius.endswith("(with drones.footprint_radius_m=0)")
        assert unknown.startswith("override nope=1: unknown key") and "(with" not in unknown
        assert "map.cells.0: 0: must be at least 1 (with map.cells=[0,3])" in cells
        assert "2, not 1 (with drones.count=2)" in two and two.startswith("override drones.count=2")
        assert "3, not 1 (with drones.count=3)" in three
        assert not Path("out").exists()

    def test_combinations_that_share_nothing_alone(self, swept):
        """Two of four are wrong, and no value of a key tells them from the others."""
        text = "name: mine\nusers: {count: 4}\nstations: {count: 0}\n"
        Path("mine.yaml").write_text(text + "drones: {battery: null, start_cells: [[0, 1]]}\n")
        grid = ("-S", "drones.count=1,2", "-S", "drones.start_cells=[[0, 1]],[[0, 1],[1, 1]]")
        ended = swept(*grid, scenario="mine.yaml")
        ended.failed(3, "1, not 2 (with drones.count=1, drones.start_cells=[[0, 1],[1, 1]])")
        assert "2, not 1 (with drones.count=2, drones.start_cells=[[0, 1]])" in ended.message

    def test_a_world_that_cannot_be_drawn(self, swept):
        wide = ("-S", "users.clusters.radius_m=[240,480],[9e5,1e6]", "-S", "episode.steps=3,4")
        ended = swept(*wide, "--policies", "hover", scenario="case1")
        ended.failed(
            3, "override users.clusters.radius_m=", "(with users.clusters.radius_m=[9e5,1e6])"
        )
        assert not Path("out").exists()

    def test_a_policy_that_does_not_fit(self, swept):
        ended = swept("--policies", "hover,case8.npz", "-S", "episode.steps=3,4")
        ended.failed(4, "case8.npz: the policy was learned with drones 3; the scenario has 1")
        assert len(ended.err.splitlines()) == 1 and not Path("out").exists()

    @pytest.mark.parametrize(
        ("flags", "code", "said"),
        [
            (("-S", "seed=1,2"), 2, "choose the first seed and the number of seeds"),
            (("-S", "episode.steps"), 2, "must be key.path=value"),
            (("-S", "episode.steps=3", "-S", "episode.steps=4"), 2, "given twice"),
            (("-S", "episode.steps=5:3"), 2, "contains no value"),
            (("--policies", ""), 2, "a name is empty"),
            (("--policies", "hover,hover"), 2, "is given twice"),
            (("--policies", "nobody"), 4, "unknown policy 'nobody'"),
            (("--algorithm", "sarsa"), 2, "--algorithm needs --train"),
            (("--train", "--algorithm", "sarsa,"), 2, "a name is empty"),
            (("--train", "--algorithm", "sarsa,sarsa"), 2, "is given twice"),
            (("--train", "--algorithm", "nope"), 3, "unknown algorithm"),
            (
                ("--train", "--algorithm", "sarsa", "-S", "learning.algorithm=sarsa"),
                2,
                "--algorithm sets this key already",
            ),
            (("--backend", "slurm"), 2, "'slurm'; allowed: local, ray"),
            (("--address", "auto"), 2, "--address needs --backend ray"),
            (("--engine", "fast"), 2, "'fast'; allowed: auto, des, batch"),
            (
                ("-S", "episode.steps=3,4", "--seeds", 10**6),
                2,
                "2000000 jobs are too many; at most 1000000",
            ),
        ],
    )
    def test_what_cannot_be_asked(self, swept, flags, code, said):
        swept(*flags).failed(code, said)
        assert not Path("out").exists()

    def test_ray_is_an_extra(self, swept, monkeypatch):
        monkeypatch.setitem(sys.modules, "ray", None)
        swept("--backend", "ray").failed(5, 'pip install -e ".[ray]"')


class TestFolder:
    def test_of_a_sweep_needs_resume(self, swept):
        swept("--seeds", 1)
        swept("--seeds", 1).failed(
            2, "--out out: the folder holds a sweep; continue it with --resume"
        )

    def test_of_something_else(self, swept):
        Path("out").mkdir()
        Path("out/thesis.tex").touch()
        for flags in ((), ("--resume",)):
            swept(*flags).failed(2, "--out out: the folder is not empty and holds no sweep")
        swept(out="out/thesis.tex").failed(2, "exists and is not a folder")
        assert [path.name for path in Path("out").iterdir()] == ["thesis.tex"]

    def test_of_a_sweep_that_goes_on(self, swept):
        swept("--seeds", 1)
        with held(Path("out")):
            swept("--seeds", 2, "--resume").failed(2, "out: process", "is writing to it")
        assert swept("--seeds", 2, "--resume", out="deep/er/out").code == 0
        assert (len(dataset("out")), len(dataset("deep/er/out"))) == (1, 2)

    def test_begun_and_no_more(self, swept):
        Path("out").mkdir()
        Path("out/.manifest.json-0123").touch()
        assert swept("--seeds", 1, "--resume").code == 0

    @pytest.mark.parametrize(
        ("flags", "said"),
        [
            (
                ("--seeds", 1),
                "2 of its 4 jobs are not among these 2 (values, policies, seeds or files differ)",
            ),
            (("-S", "episode.steps=3"), "2 of its 4 jobs are not among these 2"),
            (("--policies", "random"), "4 of its 4 jobs are not among"),
            (("--episodes", 3), "with --episodes 2, not 3"),
            (("--warmup", 0), "with --warmup 1, not 0"),
            (("-S", "drones.count=1"), "with columns job (string), episode.steps (int64)"),
            (("-S", "episode.steps=3,4,null"), "must be"),
        ],
    )
    def test_of_another_sweep(self, swept, flags, said):
        mine = ("-S", "episode.steps=3,4")
        swept(*mine, "--policies", "hover", "--seeds", 2)
        before = files("out"), manifest("out")
        first = () if any("episode.steps" in str(flag) for flag in flags) else mine
        common = () if "--policies" in flags else ("--policies", "hover")
        seeds = () if "--seeds" in flags else ("--seeds", 2)
        ended = swept(*first, *common, *seeds, *flags, "--resume")
        ended.failed(3 if said == "must be" else 4, said)
        assert (files("out"), manifest("out")) == before

    def test_of_another_scenario(self, swept):
        Path("mine.yaml").write_text(scenario_path("tiny").read_text())
        swept("--seeds", 1, scenario="mine.yaml")
        Path("mine.yaml").write_text(scenario_path("tiny").read_text() + "\n# said otherwise\n")
        assert swept("--seeds", 1, "--resume", scenario="mine.yaml").code == 0
        text = scenario_path("tiny").read_text().replace("steps: 5", "steps: 6")
        Path("mine.yaml").write_text(text)
        ended = swept("--seeds", 1, "--resume", scenario="mine.yaml")
        ended.failed(4, "out: the folder holds another sweep:", "(the scenario's file differ)")

    def test_of_another_version(self, swept, monkeypatch):
        swept("--seeds", 1)
        found = manifest("out")
        found["versions"]["desim-uav"] = "0.0.1"
        Path("out/manifest.json").write_text(json.dumps(found))
        swept("--seeds", 1, "--resume").failed(4, "another sweep: by desim-uav 0.0.1, not")

    @pytest.mark.parametrize("content", ["", "[]", "{}", '{"jobs": []}', "[" * 10**5])
    def test_with_a_manifest_that_is_none(self, swept, content):
        swept("--seeds", 1)
        Path("out/manifest.json").write_text(content)
        swept("--seeds", 1, "--resume").failed(4, "out/manifest.json: not")

    def test_with_a_file_in_between(self, swept):
        swept("--seeds", 1)
        Path("out/results/mine.parquet").touch()
        swept("--seeds", 1, "--resume").failed(
            4, "out/results/mine.parquet: not a row of this sweep"
        )


def whole(out):
    """The files of rows that are finished, and when they were written."""
    if not Path(out, "results").exists():
        return {}
    return {name: at for name, at in files(out).items() if name[0] != "."}


def started(*flags):
    """The same sweep in a process of its own."""
    command = [sys.executable, "-m", "desim_uav", "sweep", "tiny", *SHORT, "--out", "out", *flags]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([str(part) for part in command], **pipes)


def until(condition):
    begun = time.monotonic()
    while not condition():
        assert time.monotonic() < begun + 120
        time.sleep(0.05)
