"""Training from the command line: its folder, checkpoints, resuming, and the policy it leaves."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from desim_uav import array_file
from desim_uav.checksums import verify
from desim_uav.cli import app
from desim_uav.errors import DesimError, PolicyError, SimulationError, UsageError
from desim_uav.experiment.train.course import Asked, train
from desim_uav.experiment.train.folder import train_to_folder
from desim_uav.learning.checkpoint import FORMAT
from desim_uav.model.observations import Feature
from desim_uav.parquet_file import read_table
from desim_uav.records import TRAINING
from desim_uav.report.figures.training import read_training
from desim_uav.sample_path import MOST_AT_ONCE
from desim_uav.scenario.load import from_mapping, load
from desim_uav.scenario.schema import Scenario

SMALL: dict[str, Any] = {
    "name": "small",
    "map": {"size_m": [960, 960], "cells": [4, 4], "dimensions": 2},
    "drones": {
        "count": 2,
        "footprint_radius_m": 200,
        "battery": {"autonomy_min": 7, "return_below": 0.6, "respawn_after_min": 1},
    },
    "stations": {"count": 1, "radius_m": 0, "full_charge_min": 3},
    "users": {"count": 6, "clusters": {"count": 2, "radius_m": [100, 200]}},
    "demand": {"kind": "dynamic", "think_time_s": 60},
    "episode": {"steps": 12, "carry_over": True},
    "learning": {"episodes": 60, "restart_every": 5},
}


def small(**changes: Any) -> Scenario:
    return from_mapping({**SMALL, **changes})


def trained(out: Path, scenario: Scenario | None = None, resume: bool = False, **options: Any):
    settings = {"checkpoint_every": 10, "asked": Asked(["desim-uav", "train"]), **options}
    return train_to_folder(scenario or small(), out=out, resume=resume, **settings)


def run_cli(*args: object) -> Any:
    """In process; its exception, if it has one, is an error a user would read."""
    return CliRunner().invoke(app, [str(arg) for arg in args])


# ---- the folder


def test_what_a_training_leaves(tmp_path: Path):
    done = trained(tmp_path / "t")
    assert not done.interrupted
    files = {path.name for path in (tmp_path / "t").iterdir()}
    expected = {
        "SHA256SUMS",
        "policy.npz",
        "training.parquet",
        "manifest.json",
        "scenario.yaml",
        "world.json",
    }
    assert files == expected | {"checkpoint.npz"}
    rows = read_table(tmp_path / "t", "training", TRAINING)
    assert len(rows) == 60 * 2 and rows["episode"].max() == 59
    assert load(tmp_path / "t" / "scenario.yaml") == small()
    manifest = json.loads((tmp_path / "t" / "manifest.json").read_text())
    assert manifest["algorithm"] == "q_learning" and manifest["episodes"] == 60
    last = rows[rows["episode"] >= 0]
    assert done.summary()["qoe3_percent"] == pytest.approx(last["qoe3_percent"].mean())
    assert done.summary()["reward_mean"] == pytest.approx(last["reward"].mean())


def test_the_slower_engine_is_named_with_the_reason(tmp_path: Path, capsys: Any):
    drones = {**SMALL["drones"], "admission": {"kind": "tests.engine.helpers:Loss"}}
    learning = {**SMALL["learning"], "episodes": 2}
    trained(tmp_path / "t", small(drones=drones, learning=learning))
    assert capsys.readouterr().err.splitlines() == [
        "desim-uav: the SimPy engine (des) is used, which is slower: "
        "drones.admission: 'Loss' is not compiled: it does not work on rows"
    ]
    trained(tmp_path / "told", small(drones=drones, learning=learning), engine="des")
    trained(tmp_path / "compiled", small(learning=learning))
    assert capsys.readouterr().err == ""


def test_the_same_training_gives_the_same_bytes(tmp_path: Path):
    trained(tmp_path / "one")
    trained(tmp_path / "two")
    for name in ("policy.npz", "training.parquet", "scenario.yaml", "world.json"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_it_is_the_training_without_a_folder(tmp_path: Path):
    trained(tmp_path / "t")
    table, rows = train(small())
    assert (tmp_path / "t" / "policy.npz").read_bytes() == table.to_bytes()
    assert len(rows) == 120


def test_a_folder_in_use_is_not_overwritten(tmp_path: Path):
    trained(tmp_path / "t")
    before = (tmp_path / "t" / "manifest.json").read_bytes()
    with pytest.raises(UsageError, match=r"holds a training; continue it with --resume"):
        trained(tmp_path / "t")
    assert (tmp_path / "t" / "manifest.json").read_bytes() == before
    (tmp_path / "file").write_text("mine")
    with pytest.raises(DesimError, match="file"):
        trained(tmp_path / "file", resume=True)
    assert (tmp_path / "file").read_text() == "mine"


# ---- resuming


def test_a_longer_training_goes_on_from_a_shorter_one(tmp_path: Path):
    """ε and α follow the episode, not how many there will be."""
    trained(tmp_path / "short", small(learning={**SMALL["learning"], "episodes": 23}))
    trained(tmp_path / "short", resume=True)
    trained(tmp_path / "long")
    for name in ("policy.npz", "training.parquet"):
        short, long = (tmp_path / where / name for where in ("short", "long"))
        assert short.read_bytes() == long.read_bytes()


def test_resuming_without_a_checkpoint_begins(tmp_path: Path):
    trained(tmp_path / "t", resume=True)
    trained(tmp_path / "u")
    assert (tmp_path / "t/policy.npz").read_bytes() == (tmp_path / "u/policy.npz").read_bytes()


@pytest.mark.parametrize(
    "changes",
    [
        {"seed": 1},
        {"learning": {**SMALL["learning"], "algorithm": "sarsa"}},
        {"learning": {**SMALL["learning"], "gamma": 0.9}},
        {"users": {**SMALL["users"], "count": 7}},
    ],
)
def test_the_checkpoint_of_another_training_is_refused(changes: dict[str, Any], tmp_path: Path):
    trained(tmp_path / "t", small(learning={**SMALL["learning"], "episodes": 10}))
    before = {path.name: path.read_bytes() for path in (tmp_path / "t").iterdir()}
    with pytest.raises(PolicyError, match="checkpoint of another training"):
        trained(tmp_path / "t", small(**changes), resume=True)
    assert {path.name: path.read_bytes() for path in (tmp_path / "t").iterdir()} == before


def test_a_checkpoint_that_has_learned_for_longer_is_refused(tmp_path: Path):
    trained(tmp_path / "t")
    with pytest.raises(PolicyError, match="60 episodes already, more than 10"):
        trained(tmp_path / "t", small(learning={**SMALL["learning"], "episodes": 10}), resume=True)


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "text", "format"])
def test_a_damaged_checkpoint_is_refused(damage: str, tmp_path: Path):
    trained(tmp_path / "t", small(learning={**SMALL["learning"], "episodes": 10}))
    file = tmp_path / "t" / "checkpoint.npz"
    content = bytearray(file.read_bytes())
    if damage == "cut":
        content = content[: len(content) // 2]
    elif damage == "flipped":
        content[len(content) // 3] ^= 0xFF
    elif damage == "empty":
        content = bytearray()
    elif damage == "text":
        content = bytearray(b"not a checkpoint")
    else:
        with np.load(file) as arrays:
            parts = dict(arrays)
        about = json.loads(parts["about"].tobytes()) | {"format": 99}
        parts["about"] = np.frombuffer(json.dumps(about).encode(), np.uint8)
        np.savez(file, **parts)
        content = bytearray(file.read_bytes())
    file.write_bytes(content)
    with pytest.raises(PolicyError, match=r"checkpoint\.npz"):
        trained(tmp_path / "t", resume=True)


KILLER = """
import os, random, signal, sys, time
from pathlib import Path
from desim_uav.experiment.train.folder import train_to_folder
from desim_uav.scenario.load import load

scenario, out, kills = load(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
random.seed(1)

def train(resume):
    train_to_folder(scenario, out=out, resume=resume, checkpoint_every=7)

killed = 0
for attempt in range(100 * kills):
    if killed == kills:
        break
    child = os.fork()
    if child == 0:
        train(True)
        os._exit(0)
    time.sleep(random.uniform(0.02, 0.25))
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        killed += 1
    else:
        break
train(True)
print(killed)
"""


@pytest.mark.thorough
def test_killed_at_twenty_random_moments_it_learns_the_same(tmp_path: Path):
    """kill -9, resume, kill -9, resume … gives bit for bit what an undisturbed training gives."""
    (tmp_path / "small.yaml").write_text(json.dumps({**SMALL, "learning": {"episodes": 1500}}))
    command = [sys.executable, "-c", KILLER, tmp_path / "small.yaml", tmp_path / "killed", "20"]
    killed = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert killed.returncode == 0, killed.stderr
    assert int(killed.stdout) == 20
    trained(tmp_path / "whole", load(tmp_path / "small.yaml"), checkpoint_every=10**6)
    for name in ("policy.npz", "training.parquet"):
        one, other = (tmp_path / where / name for where in ("killed", "whole"))
        assert one.read_bytes() == other.read_bytes()
    left = [p.name for p in (tmp_path / "killed").iterdir() if not p.name.startswith(".")]
    assert "policy.npz" in left


@pytest.mark.thorough
def test_ctrl_c_ends_after_the_episode_and_keeps_it(tmp_path: Path):
    script = """
import os, signal, sys
from pathlib import Path
from desim_uav.experiment.train.folder import train_to_folder
from desim_uav.scenario.load import load

def stop(rows):
    if rows[0].episode == 16:
        os.kill(os.getpid(), signal.SIGINT)

done = train_to_folder(load(sys.argv[1]), out=Path(sys.argv[2]), resume=False,
                       checkpoint_every=1000, on_episode=stop)
print(done.interrupted, done.summary()["episodes"])
"""
    (tmp_path / "small.yaml").write_text(json.dumps({**SMALL, "learning": {"episodes": 1500}}))
    command = [sys.executable, "-c", script, tmp_path / "small.yaml", tmp_path / "t"]
    stopped = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    interrupted, episodes = stopped.stdout.split()
    assert interrupted == "True" and 17 <= int(episodes) <= MOST_AT_ONCE  # played in one call
    assert not (tmp_path / "t" / "policy.npz").exists()
    scenario = load(tmp_path / "small.yaml")
    trained(tmp_path / "t", scenario, resume=True)
    trained(tmp_path / "u", scenario)
    assert (tmp_path / "t/policy.npz").read_bytes() == (tmp_path / "u/policy.npz").read_bytes()


def test_one_that_goes_on_leaves_the_finished_one_whole(tmp_path: Path):
    """Interrupted, its folder is that of the shorter training, with a checkpoint to go on from."""
    shorter, longer = ({"learning": {**SMALL["learning"], "episodes": n}} for n in (20, 40))
    folder = tmp_path / "t"
    trained(folder, small(**shorter))
    before = {file.name: file.read_bytes() for file in folder.iterdir()}

    def looked_at(rows: Any) -> None:
        read_training(folder)
        if rows[0].episode == 25:
            signal.raise_signal(signal.SIGINT)

    done = trained(folder, small(**longer), resume=True, on_episode=looked_at)
    assert done.interrupted and 25 < done.summary()["episodes"] < 40
    after = {file.name: file.read_bytes() for file in folder.iterdir()}
    assert {name for name in after if after[name] != before.get(name)} == {
        "checkpoint.npz",
        "checkpoint-before.npz",
    }
    assert len(read_training(folder).curves) == 20
    for file in folder.iterdir():
        verify(file, strangers=True)
    trained(folder, small(**longer), resume=True)
    assert len(read_training(folder).curves) == 40
    for file in folder.iterdir():
        verify(file, strangers=True)
    whole = trained(tmp_path / "whole", small(**longer))
    assert (folder / "policy.npz").read_bytes() == Path(whole.summary()["policy"]).read_bytes()


def test_one_that_was_interrupted_says_what_it_is_of(tmp_path: Path):
    with pytest.raises(StoppedError):
        trained(tmp_path / "t", on_episode=stop_after(25))
    assert load(tmp_path / "t" / "scenario.yaml") == small()
    assert not (tmp_path / "t" / "SHA256SUMS").exists()


# ---- the command line


def test_train_and_run_from_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yaml").write_text(json.dumps(SMALL))
    result = run_cli(
        "train", "small.yaml", "--algorithm", "sarsa", "--episodes", 15, "--seed", 4, "--json"
    )
    assert result.exit_code == 0, result.output
    summary = json.loads(result.stdout)
    assert summary["algorithm"] == "sarsa" and summary["episodes"] == 15 and summary["seed"] == 4
    assert summary["folder"] == "runs/small-sarsa-s4"
    table = np.load(tmp_path / summary["policy"])["q"]
    assert table.shape == (2, 4 * 4 * 8, 7)

    run = run_cli("run", "small.yaml", "--policy", summary["policy"], "--json", "-q")
    assert run.exit_code == 0, run.output
    manifest = json.loads(
        (tmp_path / json.loads(run.stdout)["run_dir"] / "manifest.json").read_text()
    )
    assert (manifest["seed"], manifest["world_seed"]) == (0, 0), "as for every policy"
    assert "world seed 4; it is run in world 0: set the world seed to 4" in run.stderr

    elsewhere = run_cli("run", "small.yaml", "--policy", summary["policy"], "--world-seed", 9)
    assert elsewhere.exit_code == 0
    assert "learned in another world: small, world seed 4" in elsewhere.stderr


def test_trainings_that_cannot_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    unknown = run_cli("train", "tiny", "--algorithm", "qlearning")
    assert "did you mean 'q_learning'?" in str(unknown.exception)
    real = run_cli("train", "tiny", "-S", "observation.kind=local")
    assert isinstance(real.exception, UsageError)
    plug_in = run_cli("train", "tiny", "--algorithm", "nowhere:Learner")
    assert "nowhere" in str(plug_in.exception)
    assert not (tmp_path / "runs").exists()


def test_what_nobody_asked_for_is_null_in_the_table(tmp_path: Path):
    quiet = small(demand={"kind": "poisson", "rate_per_hour": 0.001})
    trained(tmp_path / "t", quiet)
    rows = pd.read_parquet(tmp_path / "t" / "training.parquet")
    assert rows["qoe1_percent"].isna().any() and rows["qoe3_percent"].notna().all()


# ---- resuming, where something else stands


def test_resuming_does_not_touch_what_is_no_training(tmp_path: Path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "scenario.yaml").write_text("name: mine")
    with pytest.raises(UsageError, match="not empty"):
        trained(tmp_path / "mine", resume=True)
    assert (tmp_path / "mine" / "scenario.yaml").read_text() == "name: mine"
    assert len(list((tmp_path / "mine").iterdir())) == 1


def test_resuming_without_a_folder_finds_the_unfinished_one(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    trained(None)
    trained(None)
    unfinished = Path("runs/small-q_learning-s0-2")
    for name in ("manifest.json", "policy.npz", "training.parquet"):
        (unfinished / name).unlink()
    done = trained(None, resume=True)
    assert done.summary()["folder"] == str(unfinished) and (unfinished / "policy.npz").exists()
    other = trained(None, small(seed=1), resume=True)
    assert other.summary()["folder"] == "runs/small-q_learning-s1", "nothing of its own to resume"
    longer = small(learning={**SMALL["learning"], "episodes": 70})
    assert trained(None, longer, resume=True).summary()["folder"] == str(unfinished)


def test_a_checkpoint_with_a_decision_there_is_not(tmp_path: Path):
    trained(tmp_path / "t", small(learning={**SMALL["learning"], "episodes": 11}))
    file = tmp_path / "t" / "checkpoint.npz"
    stored = array_file.Stored(file, "checkpoint", ["q", "sums", "rows"], FORMAT)
    about = stored.about | {"pending": [[10**7, 0, 0.0, 1.0], None]}
    file.write_bytes(array_file.pack(about, **stored.arrays()))
    with pytest.raises(PolicyError, match="decision"):
        trained(tmp_path / "t", resume=True)


def test_the_checkpoint_before_is_offered(tmp_path: Path):
    """A damaged one is refused; the one before it is whole, and leads to the same table."""
    whole = trained(tmp_path / "whole")
    with pytest.raises(StoppedError):
        trained(tmp_path / "t", on_episode=stop_after(25), checkpoint_every=10)
    file, before = tmp_path / "t" / "checkpoint.npz", tmp_path / "t" / "checkpoint-before.npz"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0x10
    file.write_bytes(content)
    with pytest.raises(
        PolicyError, match=f"the one before it, of episode 10, is intact: mv {before} "
    ):
        trained(tmp_path / "t", resume=True)
    before.rename(file)
    again = trained(tmp_path / "t", resume=True)
    assert (
        Path(again.summary()["policy"]).read_bytes() == Path(whole.summary()["policy"]).read_bytes()
    )
    assert not before.exists()


def test_two_trainings_in_one_folder(tmp_path: Path):
    """The second is refused, and names the first; a lock without its process holds nobody up."""

    def second(rows: Any) -> None:
        with pytest.raises(UsageError, match=rf"process {os.getpid()}, since .* is writing to it"):
            trained(tmp_path / "t", resume=True)
        raise StoppedError

    with pytest.raises(StoppedError):
        trained(tmp_path / "t", on_episode=second)
    assert [path.name for path in tmp_path.iterdir()] == ["t"]
    (tmp_path / ".t.lock").write_text("process 1, since yesterday")
    assert not trained(tmp_path / "t", resume=True).interrupted


class StoppedError(Exception):
    """The end, all of a sudden."""


def stop_after(episodes: int) -> Any:
    told = iter(range(1, episodes + 1))

    def on_episode(rows: Any) -> None:
        if next(told) == episodes:
            raise StoppedError

    return on_episode


class Astray:
    """An encoding that leaves its features."""

    def features(self, facts: Any) -> Any:
        return (Feature("place", 0, 1, True),)

    def encode(self, observation: Any, facts: Any) -> Any:
        return (10**6,)


class Endless:
    """An algorithm that learns what is no number."""

    tables = 1

    @staticmethod
    def update(q, lesson) -> None:
        q[0, lesson.state, lesson.action] = np.nan


class Single:
    """A reward in the precision networks like."""

    def terms(self, drone: Any, open_requests: Any, facts: Any) -> Any:
        return {"users": np.float32(drone.attached_users)}


@pytest.mark.thorough
def test_components_of_ones_own_that_go_wrong(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "wrong", sys.modules[__name__])
    astray = small(observation={"kind": "wrong:Astray"})
    with pytest.raises(SimulationError, match="outside the bounds of its features"):
        trained(tmp_path / "a", astray)
    endless = small(learning={**SMALL["learning"], "algorithm": "wrong:Endless"})
    with pytest.raises(SimulationError, match="not finite"):
        trained(tmp_path / "e", endless)
    assert not (tmp_path / "e" / "policy.npz").exists()
    trained(tmp_path / "s", small(reward={"kind": "wrong:Single"}))
