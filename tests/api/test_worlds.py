"""One rule for all policies: the world is that of the world seed, or else that of the seed."""

import json
import re
import warnings
from pathlib import Path

import pytest

import desim_uav as du
from desim_uav.errors import PolicyError, ScenarioError, UsageError
from tests.command_line import runner

SHORT = {"episode.steps": 2}


@pytest.fixture
def cli_run(capsys, monkeypatch):
    return runner(capsys, monkeypatch)


@pytest.fixture(autouse=True)
def _somewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("policy", ["baseline", "case8.npz", "ppo_case8.npz", "rollout:case8.npz"])
@pytest.mark.filterwarnings("ignore::desim_uav.DesimWarning")
def test_every_policy_flies_in_the_world_of_its_seed(policy):
    done = du.run("case8", {"episode.steps": 1}, policy=policy, seeds=[7001])
    assert done.world_seeds == [7001]
    assert done.summaries()[0]["world_seed"] == 7001
    assert done.manifests[0]["world_seed"] == 7001


@pytest.mark.parametrize("policy", ["baseline", "case8.npz"])
def test_a_world_seed_is_the_world_of_all_seeds(policy):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        done = du.run("case8", SHORT, policy=policy, seeds=[7001, 3], world_seed=0)
    assert done.world_seeds == [0, 0]
    assert "2 seeds in world 0" in repr(done)


def test_a_warning_names_the_world_of_the_training():
    with pytest.warns(du.DesimWarning, match="world seed 0; it is run in world 5: set the world"):
        du.run("case8", SHORT, policy="case8.npz", seed=5)
    with pytest.warns(du.DesimWarning, match="world 0 and is run in a world for each seed"):
        du.run("case8", SHORT, policy="case8.npz", seeds=2)


def test_the_command_line_says_in_which_world_it_was(cli_run):
    short = ("-S", "episode.steps=2")
    ended = cli_run("run", "case8", *short, "--seed", 3, "--world-seed", 0, "--policy", "case8.npz")
    assert "case8, case8.npz, seed 3 in world 0: 1 episode(s)" in ended.out
    ended = cli_run("run", "case8", *short, "--seed", 3, "--json")
    assert json.loads(ended.out)["world_seed"] == 3


class TestBuildWorld:
    def test_of_a_name_a_file_a_mapping_and_a_scenario(self):
        Path("mine.yaml").write_text("name: mine\nseed: 4\n")
        assert du.build_world("case8", 0).seed == 0
        assert du.build_world("mine.yaml").seed == du.build_world({"seed": 4}).seed == 4
        assert du.build_world(du.load("case8"), overrides={"users.count": 3}).homes.shape == (3, 3)

    def test_what_cannot_be(self):
        with pytest.raises(ScenarioError, match="did you mean 'case8'"):
            du.build_world("cse8")
        with pytest.raises(UsageError, match=r"seed: 1.5: must be a whole number"):
            du.build_world("case8", 1.5)


def test_scenarios_and_worlds_print_as_tables():
    for shown in (du.load("case8"), du.build_world("case8", 0), du.load("festival")):
        lines = repr(shown).splitlines()
        assert re.match(r"(Scenario|World 0 of) (case8|festival)$", lines[0])
        assert all(line.startswith("  ") and len(line.split()) > 1 for line in lines[1:])
        assert shown._repr_html_().count("<tr>") == len(lines) - 1


def test_a_folder_that_is_not_there_is_answered_with_the_nearest():
    du.run("tiny", SHORT).save("runs/mine")
    with pytest.raises(
        PolicyError, match=r"^runs/mien: no such run folder \(did you mean 'mine'\?"
    ):
        du.read_run("runs/mien")


@pytest.mark.parametrize("kind", ["file", "mapping", "scenario", "overrides"])
def test_a_scenario_of_any_kind_is_warned_of(kind, capsys):
    given = {"name": "wide", "stations": {"count": 3, "radius_m": 1e6}}
    Path("wide.yaml").write_text(json.dumps(given))
    loaded = du.load("wide.yaml")
    overrides = {"name": "other"} if kind == "overrides" else {}
    assert capsys.readouterr().err == ""
    scenarios = {"file": "wide.yaml", "mapping": given, "scenario": loaded, "overrides": loaded}
    du.build_world(scenarios[kind], 0, overrides)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("desim-uav: warning: stations.radius_m: 1e+06: the circle leaves")
