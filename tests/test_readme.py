"""What the README says is so."""

import re
from pathlib import Path

import pytest
import yaml

from desim_uav import records
from desim_uav.model.rules import Action
from desim_uav.model.state import Observation
from desim_uav.policies import load_policy
from desim_uav.scenario.load import load, loads, to_plain
from desim_uav.scenario.schema import Scenario
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def test_the_two_commands():
    commands = re.findall(r"^pip install -e .*$", README, re.MULTILINE)
    assert commands == [
        "pip install -e . && desim-uav run case8",
        'pip install -e ".[test]" && pytest -n auto',
    ]


def test_the_keys_are_all_and_the_values_the_defaults():
    _, keys = blocks("yaml")
    assert to_plain(loads(keys)) == to_plain(Scenario())
    instead_of_count_and_clusters = ["users.positions_m"]
    assert missing(to_plain(Scenario()), yaml.safe_load(keys)) == instead_of_count_and_clusters


def missing(known, given):
    """Keys at any depth that are not given; a kind goes without saying, a number is a schedule."""
    if not isinstance(known, dict) or isinstance(given, int | float):
        return []
    inner = [f"{key}.{k}" for key in known if key in given for k in missing(known[key], given[key])]
    return [key for key in known if key not in given and key != "kind"] + inner


def test_the_short_scenario_is_six_lines_and_valid():
    short, _ = blocks("yaml")
    assert len(short.splitlines()) == 6
    scenario = loads(short)
    build_world(scenario, scenario.effective_world_seed)


@pytest.mark.parametrize("table", ["requests", "steps", "users", "events", "legs"])
def test_the_columns(table):
    (columns,) = re.findall(
        rf"^\| `{table}.parquet` \|[^`\n]*`(episode, [^`]*)`", README, re.M
    ) or [re.search(rf"`{table}.parquet`.*?`(episode, [^`]*)`", README).group(1)]
    assert columns.split(", ") == list(getattr(records, table.upper()))


def test_the_policy_example(tmp_path, monkeypatch):
    (example,) = [block for block in blocks("python") if "class North" in block]
    (tmp_path / "north.py").write_text(example, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    policy = load_policy("north:North")
    world = build_world(load(scenario_path("case8")), 0)
    policy.begin(world, None, False)
    observation = Observation(0, 0, 30, (5, 5), 0, 0, 100.0, 1800.0, 0.0, 0, 0, 0.0)
    assert world.actions[policy.act(observation, (True,) * 9)] is Action.FORWARD
    assert world.actions[policy.act(observation, (*[False] * 8, True))] is Action.CHARGE


def test_the_python_example(monkeypatch):
    (example,) = [block for block in blocks("python") if "Simulation" in block]
    monkeypatch.chdir(ROOT)
    names = {}
    exec(example, names)
    assert names["shown"].truncated
    assert names["engine"].log.attached_us >= 0


def test_the_environment_example():
    (example,) = [block for block in blocks("python") if "UavParallelEnv" in block]
    names = {}
    exec(example, names)
    assert names["env"].agents == [] and all(names["truncations"].values())
    assert set(names["rewards"]) == {"drone_0", "drone_1"}


def test_the_columns_of_a_training():
    (columns,) = re.findall(r"`training.parquet` \(`(episode, [^`]*)`\)", README)
    assert columns.replace("\n", " ").split(", ") == list(records.TRAINING)


def test_the_presets_values_are_those_said():
    said = re.search(r"`preset: paper` puts.*?\n\n", README, re.DOTALL).group(0)
    preset = loads("preset: paper")
    assert "`respawn_after_min: 0`" in said and preset.drones.battery.respawn_after_min == 0
    assert "`demand.none: 0.1`" in said and preset.demand.none == 0.1
    assert "`reward.cost_sign: 1`" in said and preset.reward.cost_sign == 1
    learning = re.sub(r"\s+", " ", said.partition("of learning:")[2].strip())
    keys = {key: yaml.safe_load(value) for key, value in re.findall(r"`(\w+): ([^`]*)`", learning)}
    assert loads(yaml.safe_dump({"learning": keys})).learning == preset.learning


def test_the_commands_are_those_there_are():
    from desim_uav.cli import app

    there = {command.name or command.callback.__name__ for command in app.registered_commands}
    said = set(re.findall(r"^desim-uav (\w+) ", README, re.MULTILINE))
    assert said == there


def test_the_picture_stands_beside_its_command():
    assert (ROOT / "docs" / "case8.png").is_file()
    assert "analysis/case_picture.py runs/picture docs/case8.png 0 20" in README


@pytest.mark.parametrize(
    ("file", "command"),
    [
        ("policy.png", "desim-uav plot policy case8.npz -o docs/policy.png"),
        ("replay.gif", "desim-uav video runs/learned --gif docs/replay.gif --speed 240"),
    ],
)
def test_figures_stand_beside_their_commands(file, command):
    assert f"](docs/{file})" in README and command in README
    assert (ROOT / "docs" / file).stat().st_size < 1.5e6


def test_the_kinds_of_figures_are_those_there_are():
    from desim_uav.experiment.plot import KINDS

    (table,) = re.findall(r"^\| `desim-uav plot …`.*?\n\n", README, re.MULTILINE | re.DOTALL)
    assert set(re.findall(r"^\| `(\w+) ", table, re.MULTILINE)) == set(KINDS)
