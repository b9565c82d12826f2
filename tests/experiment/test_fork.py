"""Counterfactuals: two branches of a run, their folders, their replay and their errors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from typer.testing import CliRunner

import desim_uav as du
from desim_uav.cli import app
from desim_uav.measures.known import KNOWN, compared_in
from desim_uav.model.rules import Action
from desim_uav.policies.base import memory_of, remind
from desim_uav.policies.baseline import Baseline
from desim_uav.policies.random import Random

SMALL = {
    "users.count": 12,
    "episode.steps": 8,
    "drones.battery.autonomy_min": 6,
    "drones.battery.return_below": 0.7,
    "seed": 3,
}
SERVICES = Path(__file__).parents[1] / "measures" / "services.yaml"
TABLES = ("requests", "steps", "events", "legs", "users")


def forked(**changes: Any) -> du.Counterfactual:
    given = {"policy": "random", "to": "hover", "fork": (1, 4), "episodes": 3, "progress": False}
    return du.counterfactual("case8", SMALL, **(given | changes))


@pytest.fixture(scope="module")
def done() -> du.Counterfactual:
    return forked()


def before(result: du.RunResult, name: str) -> pd.DataFrame:
    """The rows of a table that are before the fork."""
    frame = getattr(result, name)
    if name == "users":
        return frame[frame["episode"] <= 1]
    at, limit = {
        "requests": ("t_request_s", 240),
        "steps": ("step", 4),
        "events": ("t_us", 240_000_000),
        "legs": ("t_s", 240),
    }[name]
    common = (frame["episode"] < 1) | ((frame["episode"] == 1) & (frame[at] < limit))
    return frame[common]


class TestBranches:
    def test_the_past_is_common_and_the_rest_is_not(self, done):
        for name in TABLES:
            own, other = before(done.original, name), before(done.other, name)
            if name == "requests":  # whose ends may come after the fork
                own, other = own[["request_id", "user"]], other[["request_id", "user"]]
            assert len(own) and own.reset_index(drop=True).equals(other.reset_index(drop=True))
        assert not done.original.steps.equals(done.other.steps)

    def test_the_original_is_the_run_without_a_fork(self, done):
        run = du.run("case8", SMALL, policy="random", episodes=3, events=True, progress=False)
        for name in (*TABLES, "episodes"):
            assert getattr(done.original, name).equals(getattr(run, name))

    def test_the_other_policy_commands_from_the_fork_on(self, done):
        steps = done.other.steps
        since = (steps["episode"] > 1) | ((steps["episode"] == 1) & (steps["step"] >= 4))
        asked = steps[since & (steps["mode"] == "flying")]["action"].dropna()
        assert set(asked) == {Action.HOVER.name.lower()}

    def test_both_engines_agree(self, done):
        other = forked(engine="batch")
        assert other.summary() == done.summary()
        for name in (*TABLES, "episodes"):
            assert getattr(other.other, name).equals(getattr(done.other, name))

    def test_the_same_policy_leads_to_the_same_end(self):
        same = forked(policy="hover", to="hover", fork="0:3")
        assert set(same.difference().values()) == {0}
        for name in (*TABLES, "episodes"):
            assert getattr(same.other, name).equals(getattr(same.original, name))

    @pytest.mark.parametrize("engine", ["des", pytest.param("batch", marks=pytest.mark.thorough)])
    def test_a_fork_between_two_steps(self, engine: str):
        """Drones that are asked by event: the step of the fork begins at a time of its own."""
        asked = {
            **SMALL,
            "decisions": {"kind": "event", "patience_s": 25},
            "drones.motion.timing": "minimum_time",
            "episode.carry_over": False,
        }
        found = du.counterfactual(
            "case8", asked, policy="random", to="hover", fork=(0, 9), engine=engine, progress=False
        )
        begins_us = found.summary()["t_us"]
        ends_us = [round(t_s * 1e6) for t_s in found.original.steps["t_s"].unique()]
        assert begins_us == ends_us[8] and begins_us % 60_000_000
        own, other = (
            each.events[each.events["t_us"] < begins_us] for each in (found.original, found.other)
        )
        assert len(own) and own.reset_index(drop=True).equals(other.reset_index(drop=True))
        assert not found.original.steps.equals(found.other.steps)
        since = found.other.steps[found.other.steps["step"] >= 9]
        assert set(since["action"].dropna()) == {"hover"}

    def test_measures_are_those_since_the_episode_of_the_fork(self, done):
        for branch, told in ((done.original, "original"), (done.other, "other")):
            episodes = branch.episodes[branch.episodes["episode"] >= 1]
            summary = done.summary()
            assert summary[told]["qoe3_percent"] == pytest.approx(episodes["qoe3_percent"].mean())
            assert summary[told]["requests"] == episodes["requests"].sum()
            assert list(summary[told]) == ["requests", *compared_in(du.load("case8", SMALL))]
        gain = done.difference()["qoe1_percent"]
        assert (
            gain
            == done.summary()["other"]["qoe1_percent"] - done.summary()["original"]["qoe1_percent"]
        )
        assert done.at == (1, 4) and "hover instead of random from 1:4" in repr(done)

    @pytest.mark.parametrize("engine", ["des", "batch"])
    @pytest.mark.parametrize(("policy", "to"), [("baseline", "random"), ("random", "baseline")])
    def test_a_ceiling_holds_if_both_policies_have_it(self, policy: str, to: str, engine: str):
        """A drone above the ceiling, or on its way back below it, flies on."""
        overrides = {**SMALL, "map.dimensions": 3, "map.obstacles.coverage": [0.3, 0.5]}
        for step in (2, 5):
            found = du.counterfactual(
                "case9",
                overrides,
                policy=policy,
                to=to,
                fork=(0, step),
                engine=engine,
                progress=False,
            )
            assert len(found.other.episodes) == 1

    def test_states_of_policies(self):
        world = du.build_world(du.load("case8"), 0)
        from desim_uav.model.random.streams import Purpose, Streams

        for cls in (Random, Baseline):
            one, other = cls(), cls()
            for each in (one, other):
                each.begin(world, Streams(0, Purpose.LEARNER, 0))
            mask, simulation = (True,) * 9, du.Simulation(world, du.RunSettings((True,) * 3, False))
            shown = simulation.reset(du.draw(world, 0, 0)).observations
            told = [one.act(each, mask) for _ in range(9) for each in shown]
            remind(other, json.loads(json.dumps(memory_of(one))))
            assert memory_of(other) == memory_of(one)
            assert [one.act(each, mask) for each in shown] == [
                other.act(each, mask) for each in shown
            ]
            assert len(told) == 27
        assert memory_of(du.load_policy("hover")) is None


def run(*words: object) -> Any:
    small = [part for key, value in SMALL.items() for part in ("-S", f"{key}={value}")]
    return CliRunner().invoke(app, ["run", "case8", *small, *map(str, words)])


class TestCommand:
    def test_writes_both_branches_and_a_replay(self, tmp_path: Path):
        out = tmp_path / "what-if"
        ended = run(
            "--policy", "baseline", "--fork", "0:3", "--to", "hover", "--out", out, "--json"
        )
        assert ended.exit_code == 0
        told = json.loads(ended.stdout)
        assert told["run_dir"] == str(out)
        kept = json.loads((out / "fork.json").read_text())
        assert kept == {key: value for key, value in told.items() if key != "run_dir"}
        assert {file.name for file in out.iterdir()} == {
            "original",
            "other",
            "fork.json",
            "SHA256SUMS",
        }
        for branch, policy in (("original", "baseline"), ("other", "baseline, then hover")):
            assert du.read_run(out / branch).policy == policy
        page = du.write_replay(out, progress=False)
        assert page.file == out / "replay.html" and page.episodes == [0]
        text = page.html
        assert text.count('"fork":{"episode":0,"t_us":180000000}') == 2
        with pytest.raises(du.DesimError, match="it has two branches"):
            du.write_replay(out, beside=out / "other")
        (out / "fork.json").write_text("{}")
        with pytest.raises(du.DesimError, match=r"fork\.json"):
            du.write_replay(out)

    def test_prints_both_and_their_difference(self, tmp_path: Path):
        ended = run(
            "--policy", "baseline", "--fork", "0:3", "--to", "hover", "--out", tmp_path / "o"
        )
        assert ended.exit_code == 0
        for word in ("hover instead of baseline from 0:3 on", "original", "difference", "QoE3"):
            assert word in ended.stdout

    @pytest.mark.thorough
    def test_services_have_their_measures(self, tmp_path: Path):
        """Those of a comparison; from the first step of the first episode on, they are a run's."""
        ended = CliRunner().invoke(
            app,
            [
                *("run", str(SERVICES), "--policy", "hover", "--fork", "0:0", "--to", "random"),
                *("--json", "--out", str(tmp_path / "o")),
            ],
        )
        told = json.loads(ended.stdout)
        names = compared_in(du.load(SERVICES))
        assert list(told["difference"]) == ["requests", *names]
        for branch in ("original", "other"):
            run = du.read_run(tmp_path / "o" / branch).summaries()[0]
            for name in set(names) & set(run):
                assert told[branch][name] == run[name], name
        assert told["original"]["age_s"] and told["other"]["deadlines_met_percent"]
        ended = CliRunner().invoke(
            app,
            ["run", str(SERVICES), "--fork", "0:0", "--to", "hover", "--out", str(tmp_path / "p")],
        )
        assert all(KNOWN[name].label in ended.stdout for name in names)

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("--fork", "3", "--to", "hover"), "--fork 3: must be EPISODE:STEP"),
            (("--fork", "-1:2", "--to", "hover"), "must be EPISODE:STEP"),
            (("--fork", "a:b", "--to", "hover"), "must be EPISODE:STEP"),
            (("--fork", "0:8", "--to", "hover"), "an episode has the steps 0 to 7"),
            (("--fork", "99999999:0", "--to", "hover"), "at most 1,000,000 episodes"),
            (("--fork", "0:3"), "--fork needs --to"),
            (("--to", "hover"), "--to needs --fork"),
        ],
    )
    def test_an_epoch_that_is_none(self, words: tuple[str, ...], message: str, tmp_path: Path):
        ended = run(*words, "--out", tmp_path / "o")
        assert isinstance(ended.exception, du.DesimError | SystemExit)
        told = str(ended.exception) if isinstance(ended.exception, du.DesimError) else ended.stderr
        assert message in told
        assert getattr(ended.exception, "exit_code", 2) == 2
        assert list(tmp_path.iterdir()) == []

    def test_an_episode_that_ends_before(self, tmp_path: Path):
        crash = ("-S", "drones.battery.on_crash=end_episode", "-S", "drones.battery.autonomy_min=3")
        ended = run(
            *crash, "--policy", "hover", "--fork", "0:6", "--to", "random", "--out", tmp_path / "o"
        )
        assert "episode 0 is over after" in str(ended.exception)
        assert list(tmp_path.iterdir()) == []
