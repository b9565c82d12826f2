"""Training scripts say which file they have written, and refuse what trains nothing."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

SCRIPTS = {"evolve": "npz", "ppo": "npz", "expert": "npz", "harvest": "json"}


def script(name: str) -> Any:
    """A script as a module, if what it needs is installed."""
    if name == "expert":
        pytest.importorskip("torch")
    if name in ("train_maskable_ppo", "train_continuous"):
        pytest.importorskip("sb3_contrib")
    return importlib.import_module(f"policies.{name}")


def words_of(name: str, file: Path) -> list[str]:
    """What a script is asked for, beside options: where to train, and the file."""
    if name.startswith("train_"):
        return ["case5", str(file)]
    return ["--out", str(file), *(["case8"] if name != "harvest" else [])]


@pytest.mark.parametrize(
    ("name", "asked", "told"),
    [
        ("ppo", "--steps 0", "--steps 0: must be from 1 to"),
        ("expert", "--imitations 0 --searches 0", "--searches 0: nothing would be learned"),
        ("harvest", "--generations 0", "--generations 0: must be from 1 to"),
        ("harvest", "--generations 1 --missions 0", "--missions 0: must be from 1 to"),
        ("harvest", "--generations 1 --population 1", "--population 1: must be from 2 to"),
        ("train_maskable_ppo", "--steps -5", "--steps -5: must be from 1 to"),
        ("train_continuous", "--steps 0", "--steps 0: must be from 1 to"),
        ("train_continuous", "--seed -1", "--seed -1: must be from 0 to"),
    ],
)
def test_what_trains_nothing_is_refused(
    name: str, asked: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / f"none.{SCRIPTS.get(name, 'zip')}"
    assert script(name).main([*words_of(name, file), *asked.split()]) == 2
    out, err = capsys.readouterr()
    assert told in err and not out and not file.exists()


def test_a_model_without_its_ending_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """stable-baselines3 would write another file than the one that is named."""
    main = script("train_maskable_ppo").main
    assert main(["case5", str(tmp_path / "model"), "--steps", "8"]) == 2
    assert "must end in .zip" in capsys.readouterr().err and not [*tmp_path.iterdir()]


@pytest.mark.parametrize("task", ["edge", "harvest", "handover"])
def test_planners_are_not_evolved_where_other_measures_count(
    task: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "none.npz"
    assert script("evolve").main([f"uav-v1/{task}/small", "--out", str(file)]) == 2
    assert "every service must ask for a time" in capsys.readouterr().err


def test_evolution_needs_more_steps_than_the_flights_of_baseline(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    evolve, file = script("evolve"), tmp_path / "none.npz"
    monkeypatch.setattr(evolve, "flown", lambda *_: ({}, 10))
    assert evolve.main(["uav-v1/dispatch/small", "--steps", "9", "--out", str(file)]) == 2
    out, err = capsys.readouterr()
    assert "--steps 9: must be at least 10" in err and not out and not file.exists()


def test_episodes_without_requests_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    evolve = script("evolve")
    log = SimpleNamespace(requests=[], attached_us=0, crashed=[], steps=[])
    monkeypatch.setattr(evolve, "play", lambda *_, **__: [(log, None)])
    world = SimpleNamespace(starts=[0], horizon_us=1, homes=[0])
    with pytest.raises(evolve.UsageError, match="--episodes 3: nobody asks"):
        evolve.flown(world, None, 0, 3)


@pytest.mark.parametrize("name", SCRIPTS)
@pytest.mark.parametrize("where", ["file_place", "train", "save"])
def test_after_an_interruption_a_file_is_named_only_if_it_was_written(
    name: str,
    where: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    module, file = script(name), tmp_path / f"kept.{SCRIPTS[name]}"

    def interrupted(*given: Any, **how: Any) -> None:
        if where == "save" and name == "harvest":
            given[1]([0.0] * len(module.FEATURES), 1, 1.0)
        elif where == "save" and name == "evolve":
            given[2](module.planner, [0.0] * len(module.planner.WEIGHTS), 1)
        elif where == "save":
            given[2](SimpleNamespace(about={"training": {}}, to_bytes=lambda: b"network"))
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "train" if where == "save" else where, interrupted)
    assert module.main(words_of(name, file)) == 130
    err = capsys.readouterr().err
    assert file.exists() == (where == "save")
    assert err.startswith(f"interrupted; {file if where == 'save' else 'no file'} has the ")


@pytest.mark.parametrize("began", [False, True])
def test_an_interrupted_training_of_benchmarl_names_a_file_once_it_has_begun(
    began: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module, file = script("train_benchmarl"), tmp_path / "policy.npz"

    def interrupted(*_: Any, **__: Any) -> Any:
        raise KeyboardInterrupt

    def begun(*_: Any, **__: Any) -> Any:
        return SimpleNamespace(run=interrupted)

    library = SimpleNamespace(SavePolicy=lambda file: None)
    monkeypatch.setitem(sys.modules, "desim_uav.env.benchmarl", library)
    monkeypatch.setattr(module, "experiment", begun if began else interrupted)
    assert module.main(["case8", str(file)]) == 130
    told = f"interrupted; {file if began else 'no file'} has the policy of the last update\n"
    assert capsys.readouterr().err == told


@pytest.mark.parametrize("name", ["train_maskable_ppo", "train_continuous"])
def test_an_interrupted_training_says_that_there_is_no_file(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*asked: object) -> None:
        raise KeyboardInterrupt

    own = script(name)
    monkeypatch.setattr(own, "train", interrupted)
    assert own.main(words_of(name, tmp_path / "model.zip")) == 130
    assert capsys.readouterr() == ("", "interrupted; no file has been written\n")
    assert not [*tmp_path.iterdir()]
