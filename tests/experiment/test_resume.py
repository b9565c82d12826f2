"""A run that is continued is one that was never interrupted, bit for bit, or it is refused."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

import desim_uav as du
from desim_uav import run_folder
from desim_uav.errors import DesimError, PolicyError, UsageError
from desim_uav.experiment import resume, run
from tests.command_line import runner
from tests.selection import by_default

SMALL = {"users.count": 12, "episode.steps": 8}
FRESH = {**SMALL, "episode.carry_over": False}


@pytest.fixture(autouse=True)
def somewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def flown(out: str, episodes: int, config: Any = FRESH, **options: Any) -> du.RunResult:
    how = {"policy": "random", "warmup": 1, "seed": 3} | options
    return du.run("case8", config, episodes=episodes, out=out, progress=False, **how)


def tables(folder: str) -> dict[str, str]:
    """The digests of the files of tables, which hold nothing but their rows."""
    files = Path(folder).glob("*.parquet")
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def forgetting() -> Any:
    """A policy that knows at which of all its calls it hovers: it keeps that between episodes."""
    calls = [0]

    def act(observation: Any, mask: Any) -> int:
        calls[0] += 1
        return 0 if calls[0] % 7 == 0 or not mask[1] else 1

    return act


EVERY = [(batch, done) for batch in (50, 3, 2) for done in (1, 2, 3)]
KINDS: dict[str, tuple[Any, Any]] = {
    "afresh": (FRESH, {}),
    "carried": (SMALL, {"engine": "batch"}),
    "events": (SMALL, {"events": True}),
    "no warm-up": (FRESH, {"events": True, "warmup": 0}),
}
BY_DEFAULT = [(3, 2, "afresh"), (50, 2, "carried")]


@pytest.mark.parametrize(
    "case",
    by_default(BY_DEFAULT, [(*size, kind) for kind in KINDS for size in EVERY], at_most=12),
)
def test_the_result_is_that_of_one_piece(case: tuple[int, int, str], monkeypatch: Any):
    batch, done, kind = case
    config, options = KINDS[kind]
    monkeypatch.setattr(run, "BATCH", batch)
    whole = flown("whole", 5, config, **options)
    flown("part", done, config, **options)
    continued = flown("part", 5, config, **options, resume=True)
    assert tables("part") == tables("whole")
    assert {**continued.summaries()[0], "run_dir": ""} == {**whole.summaries()[0], "run_dir": ""}
    manifest = json.loads(Path("part/manifest.json").read_text(encoding="utf-8"))
    assert (manifest["episodes"], manifest["resumed_at"], manifest["interrupted"]) == (
        5,
        done,
        False,
    )
    assert du.read_run("part").qoe().equals(du.read_run("whole").qoe())
    assert not list(Path().glob(".*"))


def test_a_policy_that_remembers_is_flown_from_the_start():
    flown("whole", 4, policy=forgetting())
    flown("part", 2, policy=forgetting())
    flown("part", 4, policy=forgetting(), resume=True)
    assert tables("part") == tables("whole")


def test_a_built_in_policy_is_not_flown_from_the_start(monkeypatch):
    numbers = []

    def noted(world: Any, seed: int, episode: int, real: Any = run.draw) -> Any:
        numbers.append(episode)
        return real(world, seed, episode)

    flown("part", 3)
    monkeypatch.setattr(run, "draw", noted)
    flown("part", 5, resume=True)
    assert numbers == [2, 3, 4]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"seed": 4}, "seed 3, not 4"),
        ({"policy": "hover"}, "policy 'random', not 'hover'"),
        ({"config": SMALL}, "scenario_hash"),
        ({"warmup": 2}, "warmup 1, not 2"),
        ({"engine": "batch"}, "engine 'auto', not 'batch'"),
        ({"events": True}, "events False, not True"),
        ({"world_seed": 9}, "world_seed 3, not 9"),
        ({"episodes": 1}, "it holds 2 episode"),
    ],
)
def test_another_run_is_refused(options: dict[str, Any], said: str):
    flown("part", 2)
    before = tables("part")
    with pytest.raises(PolicyError, match=said):
        flown("part", **{"episodes": 4, **options}, resume=True)
    assert tables("part") == before


@pytest.mark.parametrize("name", ["desim-uav", "numpy", "python"])
def test_other_versions_are_refused(name: str, monkeypatch):
    flown("part", 1)
    now = resume.versions() | {name: "0.1"}
    monkeypatch.setattr(resume, "versions", lambda: now)
    with pytest.raises(PolicyError, match=f"version of {name} .*, not '0.1'"):
        flown("part", 2, resume=True)


def test_a_policy_that_has_changed_is_refused():
    def act(observation: Any, mask: Any) -> int:
        return 0

    flown("part", 2, policy=act)
    before = tables("part")

    def other(observation: Any, mask: Any) -> int:
        return int(mask[1])

    other.__qualname__, other.__name__ = act.__qualname__, act.__name__
    with pytest.raises(
        PolicyError, match=r"cannot be continued: episode -?\d in \w+.parquet differs"
    ):
        flown("part", 4, policy=other, resume=True)
    assert tables("part") == before


def test_what_has_ended_is_returned_as_it_is():
    done = flown("part", 2)
    again = flown("part", 2, resume=True)
    assert again.summaries() == done.summaries()


@pytest.mark.parametrize("out", [None, "nowhere", True])
def test_nothing_to_resume(out: Any):
    flown("part", 2)
    with pytest.raises(UsageError, match="resume"):
        flown(out, 4, resume=True)


def test_several_seeds():
    """The first has ended, the second is interrupted, the third has not begun."""
    whole = flown("whole", 3, seed=None, seeds=[1, 2, 3])
    flown("part", 3, seed=None, seeds=[1])
    flown("part/s2", 1, seed=2)
    continued = flown("part", 3, seed=None, seeds=[1, 2, 3], resume=True)
    for name in ("s1", "s2", "s3"):
        assert tables(f"part/{name}") == tables(f"whole/{name}")
    assert continued.qoe().equals(whole.qoe())


def test_other_files_of_the_folder_are_kept():
    flown("part", 1)
    Path("part/notes.txt").write_text("mine", encoding="utf-8")
    flown("part", 2, resume=True)
    assert Path("part/notes.txt").read_text(encoding="utf-8") == "mine"
    assert len(du.read_run("part").steps)


@pytest.mark.parametrize("at", [1, 2])
def test_a_folder_that_cannot_be_replaced_stays(at: int, monkeypatch):
    flown("part", 1)
    before, calls = tables("part"), []

    def rename(path: Path, target: Path, real: Any = Path.rename) -> Path:
        calls.append(path)
        if len(calls) == at:
            raise PermissionError(13, "Permission denied")
        return real(path, target)

    with monkeypatch.context() as failing:
        failing.setattr(run_folder.Path, "rename", rename)
        with pytest.raises(DesimError, match="Permission denied"):
            flown("part", 2, resume=True)
    assert tables("part") == before and [path.name for path in Path().iterdir()] == ["part"]


def test_on_the_command_line(capsys, monkeypatch):
    """A run that was interrupted goes on where it stands, in runs/ as well."""
    command = runner(capsys, monkeypatch)
    words = ("run", "tiny", "--policy", "hover", "--episodes", 4, "-q")
    real, ended = run.is_batch, []

    def interrupting(played: Any, before: Any = (0, 0)) -> bool:
        ended.append(len(played))
        if len(ended) == 2:
            raise KeyboardInterrupt
        return real(played, before)

    command(*words, "--out", "whole")
    monkeypatch.setattr(run, "is_batch", interrupting)
    stopped = command(*words)
    monkeypatch.setattr(run, "is_batch", real)
    assert stopped.code == 130 and "--resume goes on" in stopped.err
    assert command(*words, "--resume").code == 0
    assert tables("runs/tiny-hover-s1") == tables("whole")
    command(*words, "--resume").failed(2, "there is no interrupted run")
    command(*words, "--resume", "--out", "typo").failed(2, "there is no run to be continued")
