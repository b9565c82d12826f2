"""``desim_uav.run``: what comes out of a policy in a scenario, in memory and in folders."""

import json
import os
import re
import signal
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import desim_uav as du
from desim_uav import cli
from desim_uav.errors import DesimError, NoEventsError, PolicyError, ScenarioError, UsageError
from desim_uav.model.rules import Action
from desim_uav.policies.hover import Hover
from desim_uav.scenario.load import from_mapping

TABLES = ("requests", "steps", "episodes", "users", "events", "legs")
SMALL = {"users.count": 12, "episode.steps": 6}


@pytest.fixture(autouse=True)
def _somewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def command(monkeypatch, capsys):
    """Run a command in this process."""

    def run(*arguments):
        monkeypatch.setattr("sys.argv", ["desim-uav", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        assert not end.value.code
        return capsys.readouterr().out

    return run


def east(observation, mask):
    return "right"


class TestLoad:
    def test_a_shipped_name_and_a_mapping_of_overrides(self):
        scenario = du.load("case8", {"users.count": 60, "learning.algorithm": "sarsa"})
        assert (scenario.name, scenario.users.count) == ("case8", 60)
        assert scenario.learning.algorithm == "sarsa"

    def test_a_mapping_says_what_the_command_line_says(self):
        texts = ["users.count=60", "users.clusters.radius_m=[100, 200]", "world_seed=null"]
        mapping = {"users.count": 60, "users.clusters.radius_m": (100, 200), "world_seed": None}
        assert du.load("case8", mapping) == du.load("case8", texts)

    def test_numbers_of_numpy(self):
        overrides = {"users.count": np.int64(7), "users.clusters.radius_m": np.array([50.0, 60.0])}
        assert du.load("case8", overrides).users.count == 7

    def test_a_file_goes_before_a_shipped_name(self):
        Path("case8").write_text("name: mine\n")
        assert du.load("case8").name == "mine"

    @pytest.mark.parametrize(
        ("name", "overrides", "part"),
        [
            ("cse8", {}, "did you mean 'case8'?"),
            ("case8", {"users.cont": 3}, "did you mean 'count'?"),
            ("case8", {"users.count": object()}, "users.count: a value of type object"),
            ("case8", {"users.count": float("nan")}, "users.count"),
        ],
    )
    def test_what_is_wrong(self, name, overrides, part):
        with pytest.raises(ScenarioError) as caught:
            du.load(name, overrides)
        assert part in str(caught.value)


class TestTables:
    def test_they_are_those_of_the_command_line(self, command):
        options = ("--episodes", 3, "--warmup", 1, "--events", "--seed", 4)
        flags = [part for key, value in SMALL.items() for part in ("-S", f"{key}={value}")]
        command("run", "case8", *flags, *options, "--policy", "random", "--out", "there", "-q")
        how = {"policy": "random", "seed": 4, "episodes": 3, "warmup": 1, "events": True}
        result = du.run("case8", SMALL, **how)
        assert os.listdir() == ["there"]  # noqa: PTH208
        for name in TABLES:
            there = pd.read_parquet(f"there/{name}.parquet")
            pd.testing.assert_frame_equal(getattr(result, name), there, check_dtype=False)
        assert result.save("here") == [Path("here")]
        names = sorted(path.name for path in Path("here").iterdir())
        assert names == sorted(path.name for path in Path("there").iterdir())
        for name in set(names) - {"manifest.json", "SHA256SUMS"}:
            assert Path("here", name).read_bytes() == Path("there", name).read_bytes(), name
        one, other = (json.loads(Path(f, "manifest.json").read_text()) for f in ("here", "there"))
        assert {key for key in one | other if one[key] != other[key]} == {
            *("command", "started", "finished")
        }
        said = "policy='random', seed=4, episodes=3, warmup=1, events=True"
        assert one["command"] == [f"desim_uav.run('case8', {SMALL}, {said})"]

    def test_a_changed_frame_changes_nothing_else(self):
        result = du.run("tiny")
        result.requests["qoe1"] = 0.0
        assert result.requests["qoe1"].sum() == 0
        result.save("here")
        assert du.read_run("here").requests["qoe1"].sum() > 0
        assert result.qoe()["qoe1_percent"] > 0

    def test_several_seeds_have_a_column(self):
        result = du.run("case8", SMALL, seeds=2, first_seed=3, episodes=2)
        assert result.seeds == [3, 4]
        for name in ("requests", "steps", "episodes", "users"):
            frame = getattr(result, name)
            assert frame.columns[0] == "seed"
            for seed in result.seeds:
                alone = getattr(du.run("case8", SMALL, seed=seed, episodes=2), name)
                of_seed = frame[frame["seed"] == seed].drop(columns="seed")
                pd.testing.assert_frame_equal(of_seed.reset_index(drop=True), alone)

    def test_seeds_can_be_named(self):
        assert du.run("tiny", seeds=[7, 2]).seeds == [7, 2]

    def test_events_that_were_not_kept(self):
        with pytest.raises(NoEventsError, match="events=True"):
            _ = du.run("tiny").events

    @pytest.mark.parametrize("engine", ["des", "batch"])
    def test_the_engine(self, engine):
        assert du.run("tiny", engine=engine).manifests[0]["engine"] == engine


class TestQoe:
    def test_it_is_that_of_the_command_line(self, command):
        command("run", "case8", "-S", "episode.steps=6", "--episodes", 2, "--out", "there", "-q")
        result = du.run("case8", {"episode.steps": 6}, episodes=2)
        said = json.loads(command("qoe", "there", "--by", "service", "--json"))
        assert result.qoe().to_dict() == {key: said[key] for key in result.qoe().index}
        assert du.read_run("there").qoe().equals(result.qoe())
        groups = result.qoe("service")
        for row in said["groups"]:
            for name in ("requests", "qoe1_percent", "completed"):
                assert groups.loc[row["service"], name] == row[name]

    def test_several_seeds_are_averaged(self):
        result = du.run("case8", SMALL, seeds=3, policy="random")
        by_seed = result.qoe("seed")
        assert by_seed.index.tolist() == [0, 1, 2]
        assert result.qoe()["qoe1_percent"] == pytest.approx(by_seed["qoe1_percent"].mean())
        alone = du.run("case8", SMALL, seed=1, policy="random").qoe()
        assert by_seed.loc[1, "qoe3_percent"] == alone["qoe3_percent"]

    @pytest.mark.parametrize("by", ["service", "episode", "user", "outcome", "seed"])
    def test_by(self, by):
        found = du.run("tiny", seeds=2, episodes=2).qoe(by)
        assert found.index.name == by
        assert len(found)

    def test_by_what_is_no_group(self):
        with pytest.raises(UsageError, match="did you mean 'service'"):
            du.run("tiny").qoe("servce")
        with pytest.raises(UsageError, match=r"^by: 'seed'; allowed: service, "):
            du.run("tiny").groups("seed")

    @pytest.mark.parametrize("case", ["case3", "case7", "case8"])
    def test_covered_once_is_more_than_covered_on_average(self, case, command):
        changes = {"episode.steps": 4, "drones.count": 1, "drones.footprint_radius_m": 300}
        result = du.run(case, changes, seeds=2, episodes=3, events=True, out="there")
        shares, average = result.covered_once(), result.qoe("seed")["qoe3_percent"]
        assert shares.index.equals(average.index)
        assert (shares > average).all() and (shares < 100).any()
        attached = result.events.query("kind == 'attach' and episode >= 0")
        users = attached.groupby(["seed", "episode"])["user"].nunique().groupby("seed").sum() / 3
        expected = 100 * users / result.scenario.users.count
        assert shares.tolist() == pytest.approx(expected.tolist())
        said = json.loads(command("qoe", "there/s1", "--covered-once", "--json"))
        assert said["covered_once_percent"] == shares[1]

    def test_covered_once_needs_events_if_some_do_not_ask(self):
        seldom = {"demand": {"kind": "poisson", "rate_per_hour": 1}, "episode.steps": 4}
        with pytest.raises(NoEventsError, match="the run kept no events"):
            du.run("case8", seldom).covered_once()
        result = du.run("case8", seldom, events=True)
        users = result.events.query("kind == 'attach'")["user"].nunique()
        assert result.covered_once().tolist() == pytest.approx([100 * users / 48])

    def test_a_run_without_requests(self):
        silent = {"demand": {"kind": "static", "none": 1.0, "mix": {"data_gathering": 1}}}
        result = du.run("tiny", silent)
        assert result.qoe()["requests"] == 0
        assert np.isnan(result.qoe()["qoe1_percent"])
        assert result.qoe("user").empty
        assert "QoE1 nan" in repr(result)
        assert "<table>" in result._repr_html_()


class TestPolicies:
    def test_a_function_chooses_by_name_index_or_action(self):
        def moved(choose):
            return du.run("tiny", policy=choose).steps["x_m"].tolist()

        by_name = moved(east)
        assert by_name == moved(lambda o, m: Action.RIGHT) == moved(lambda o, m: 2)
        assert by_name[0] < by_name[-1]

    def test_an_action_is_found_by_name_whatever_its_index(self):
        """Without levels, CHARGE has not the index that the enumeration gives it."""
        flat = du.load("case8", {"map.dimensions": 2, "drones.battery.return_below": 1} | SMALL)
        assert len(du.build_world(flat, 0).actions) < len(Action)
        away = du.run(flat, policy=lambda o, m: Action.RIGHT if o.step < 2 else Action.HOVER)
        back = du.run(
            flat,
            policy=lambda o, m: Action.RIGHT if o.step < 2 else Action.GOTO_CHARGING_STATION,
        )
        assert set(away.steps["action_taken"]) == {"right", "hover"}
        assert "goto_charging_station" in set(back.steps["action_taken"])

    def test_a_function_is_named_by_where_it_is_from(self):
        result = du.run("tiny", policy=east)
        assert result.policy == f"{__name__}:east"

    @pytest.mark.thorough
    @pytest.mark.parametrize("policy", ["hover", Hover, Hover()])
    def test_names_classes_and_objects(self, policy):
        hovering = du.run("tiny", policy=lambda o, m: "hover").steps
        pd.testing.assert_frame_equal(du.run("tiny", policy=policy).steps, hovering)

    def test_a_path(self):
        Path("east.csv").write_text("step,drone,action\n0,0,right\n")
        result = du.run("tiny", policy=Path("east.csv"))
        assert result.policy == "script:east.csv"
        assert result.steps["action_taken"].tolist()[0] == "right"

    def test_an_object_can_say_its_name(self):
        policy = Hover()
        policy.name = "still"
        result = du.run("tiny", policy=policy)
        assert result.policy == "still"
        assert result.save() == [Path("runs/tiny-still-s1")]

    @pytest.mark.parametrize(
        ("policy", "part"),
        [
            ("hoover", "did you mean 'hover'?"),
            (3, "no method 'begin'"),
            (object(), "no method 'begin'"),
            (lambda o, m: "rihgt", "'rihgt' is not an action of this scenario (did you mean"),
            (lambda o, m: Action.UP, "'up' is not an action"),
        ],
    )
    def test_what_is_no_policy(self, policy, part):
        with pytest.raises(PolicyError) as caught:
            du.run("tiny", policy=policy)
        assert part in str(caught.value)

    def test_a_policy_of_another_world_is_warned_of(self):
        with pytest.warns(du.DesimWarning, match="was learned in another world") as caught:
            du.run("case8", SMALL, policy="case8.npz")
        assert caught[0].filename == __file__


class TestScenarios:
    def test_a_mapping_a_loaded_one_and_a_file(self):
        mapping = {"name": "mine", "users": {"count": 3}, "episode": {"steps": 2}}
        Path("mine.yaml").write_text(json.dumps(mapping))
        found = [du.run(one, seed=3) for one in (mapping, from_mapping(mapping), "mine.yaml")]
        assert [one.scenario.name for one in found] == ["mine"] * 3
        for one in found[1:]:
            pd.testing.assert_frame_equal(one.steps, found[0].steps)
        assert du.run(from_mapping(mapping), {"users.count": 4}).scenario.users.count == 4

    def test_an_engine_that_cannot_run_it_names_the_file(self):
        admission = {"drones.admission": {"kind": f"{__name__}:Own"}}
        with pytest.raises(
            ScenarioError, match=r"^override drones\.admission=.*: drones\.admission: 'Own'"
        ):
            du.run("tiny", admission, engine="batch")


class Own:
    def scan(self, waiting, free_hz):
        return ()


class TestOverrides:
    @pytest.mark.parametrize(
        ("call", "overrides", "said"),
        [
            (du.run, {"users.count": 0}, "override users.count=0: must be at least 1"),
            (du.run, ["users.count"], "override users.count: must be key.path=value"),
            (du.load, {"users.cuont": 1}, "override users.cuont=1: unknown key"),
            (du.UavEnv, {"users": {"count": 0}}, "override users.count=0: must be at least 1"),
        ],
    )
    def test_a_message_names_no_option_of_the_command_line(self, call, overrides, said):
        with pytest.raises(DesimError) as caught:
            call("tiny", overrides)
        assert str(caught.value).startswith(said)


class TestFolders:
    def test_out_is_written_as_it_goes(self):
        result = du.run("tiny", out="there", episodes=2)
        assert result.folders == [Path("there")]
        pd.testing.assert_frame_equal(result.requests, du.run("tiny", episodes=2).requests)
        assert result.save("copy") == [Path("copy")]
        for file in Path("there").iterdir():
            assert file.read_bytes() == Path("copy", file.name).read_bytes()

    def test_out_as_the_command_line_would_choose(self):
        assert du.run("tiny", out=True).folders == [Path("runs/tiny-baseline-s1")]

    def test_a_folder_per_seed(self):
        assert du.run("tiny", seeds=2, out="one").folders == [Path("one/s0"), Path("one/s1")]
        assert du.run("tiny", seeds=2).save("two") == [Path("two/s0"), Path("two/s1")]
        assert du.run("tiny", seeds=2, out=True).folders == [
            *(Path("runs/tiny-baseline-s0"), Path("runs/tiny-baseline-s1"))
        ]

    def test_nothing_is_run_without_a_place(self, monkeypatch):
        Path("there/s1").mkdir(parents=True)
        Path("there/s1/file").touch()
        monkeypatch.setattr("desim_uav.experiment.command.write_run", lambda *_: pytest.fail("ran"))
        with pytest.raises(UsageError, match="the folder is not empty"):
            du.run("tiny", seeds=2, out="there")

    def test_no_run(self):
        with pytest.raises(PolicyError, match="no such run folder"):
            du.read_run("nope")


class TestReplay:
    def test_of_a_function_without_events(self):
        result = du.run("tiny", policy=east, episodes=2)
        page = result.replay(episodes="1")
        assert page.episodes == [1]
        assert page.html.startswith("<!")
        assert os.listdir() == []  # noqa: PTH208

    def test_a_file(self):
        du.run("tiny", events=True).replay("pages/one.html")
        assert Path("pages/one.html").read_text(encoding="utf-8").startswith("<!")

    def test_of_a_seed(self):
        result = du.run("tiny", seeds=2, events=True)
        assert '"seed":"1"' in result.replay(seed=1).html
        with pytest.raises(UsageError, match="the run has the seeds"):
            result.replay(seed=5)

    def test_beside_a_second_run(self):
        """Each policy is the object that flew: neither can be loaded by its name."""
        moving = du.run("tiny", policy=lambda o, m: "right", episodes=2)
        hovering = du.run("tiny", policy=lambda o, m: "hover", episodes=2)
        page = moving.replay("both.html", beside=hovering, episodes="1")
        assert page.episodes == [1]
        assert re.findall(r'id="(episode-\d-\d)"', page.html) == ["episode-0-0", "episode-1-0"]
        assert os.listdir() == ["both.html"]  # noqa: PTH208

    def test_beside_the_folder_of_a_second_run(self):
        du.run("tiny", policy="hover", out="hovering", events=True)
        page = du.run("tiny", events=True).replay(beside="hovering")
        written = du.write_replay(*du.run("tiny", out="base").folders, beside=Path("hovering"))
        assert page.html == written.file.read_text(encoding="utf-8")

    def test_beside_what_is_not_on_its_seeds(self):
        runs = du.run("tiny", seeds=2, events=True)
        with pytest.raises(UsageError, match=r"beside: the run has the seeds \[5\], not 1"):
            runs.replay(seed=1, beside=du.run("tiny", seed=5, events=True))
        other = du.run("tiny", {"episode.steps": 3}, seed=1, policy="hover", events=True)
        with pytest.raises(PolicyError, match=r"tiny-hover-s1-\S+ cannot.*episode.steps: 5 and 3"):
            runs.replay(seed=1, beside=other)

    def test_a_notebook_shows_it_in_a_frame(self):
        shown = du.run("tiny", events=True).replay()._repr_html_()
        assert shown.startswith("<iframe")
        assert shown.count('"') == 2 * 3

    def test_a_policy_that_acts_otherwise_the_second_time(self):
        actions = iter(["right"] * 5 + ["left"] * 5)
        result = du.run("tiny", policy=lambda o, m: next(actions))
        with pytest.raises(NoEventsError, match="differs from what is computed now"):
            result.replay()


class TestOptions:
    @pytest.mark.parametrize(
        ("options", "part"),
        [
            ({"episodes": 0}, "episodes: 0: must be a whole number from 1"),
            ({"warmup": -1}, "warmup: -1"),
            ({"episodes": 1.5}, "episodes: 1.5"),
            ({"seeds": 0}, "seeds: 0"),
            ({"seeds": []}, "at least one seed"),
            ({"seeds": [1, 1]}, "none twice"),
            ({"seeds": 2, "seed": 3}, "seed and seeds exclude each other"),
            ({"engine": "bathc"}, "bathc"),
        ],
    )
    def test_what_cannot_be_asked_for(self, options, part):
        with pytest.raises(UsageError) as caught:
            du.run("tiny", **options)
        assert part in str(caught.value)

    def test_a_seed_that_is_none(self):
        with pytest.raises(UsageError, match="seed: -1: must be a whole number from 0"):
            du.run("tiny", seed=-1)


class TestInterrupted:
    class Interrupting(Hover):
        """Ctrl-C in the third episode."""

        episode = -1

        def begin(self, world, streams, carried=False):
            self.episode += 1

        def act(self, observation, mask):
            if (self.episode, observation.step) == (2, 1):
                os.kill(os.getpid(), signal.SIGINT)
            return super().act(observation, mask)

    def test_what_had_ended_is_in_the_error(self):
        with pytest.raises(du.Interrupted) as caught:
            du.run("tiny", policy=self.Interrupting, episodes=9)
        result = caught.value.result
        assert result.qoe()["episodes"] == 3
        assert result.requests.equals(du.run("tiny", policy="hover", episodes=3).requests)

    def test_it_is_a_keyboard_interrupt(self):
        with pytest.raises(KeyboardInterrupt):
            du.run("tiny", policy=self.Interrupting, warmup=9)


def test_a_notebook_shows_the_table():
    shown = du.run("case8", SMALL, seeds=3)._repr_html_()
    assert "case8, baseline, 3 seeds: 1 episode per seed" in shown
    assert shown.count("<tr>") == 1 + 1 + 3
    assert all(f">{s}<" in shown for s in ("all", "data_gathering", "edge_computing", "throughput"))
    assert "±" in shown
    assert "±" not in du.run("case8", SMALL)._repr_html_()


def test_it_prints_nothing_on_stdout(capsys):
    du.run("tiny", policy=east)
    assert capsys.readouterr().out == ""
