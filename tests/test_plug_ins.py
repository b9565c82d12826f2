"""What a component of a user's own raises is one error that names it, its file and its line."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from desim_uav import cli
from desim_uav.scenario.load import load
from tests.command_line import runner

FAULTY = """
import sys
from dataclasses import dataclass

from desim_uav.model.mobility.mobility import RandomWalk
from desim_uav.rules.rewards import Coverage


@dataclass(frozen=True)
class Walk(RandomWalk):
    draws = True

    def walks(self, *args):
        raise ZeroDivisionError("no way")  # line 14


@dataclass(frozen=True)
class Leaving(RandomWalk):
    def walks(self, *args):
        sys.exit(0)  # line 20


@dataclass(frozen=True)
class Reward(Coverage):
    def terms(self, *args):
        return {"a": 1.0 / 0}  # line 26


@dataclass(frozen=True)
class Huge(Coverage):
    def terms(self, *args):
        return {"a": 1e308, "b": 1e307}


@dataclass(frozen=True)
class Infinite(Coverage):
    def terms(self, *args):
        return {"a": 1e308, "b": 1e308}


class Quits:
    ceiling = True

    def begin(self, world, streams, carried=False):
        pass

    def act(self, observation, mask):
        if observation.step == 2:
            sys.exit(3)  # line 49
        return mask.index(True)


class Unmade:
    def __init__(self):
        raise SystemExit("never")  # line 55


class Component:
    def __init__(self):
        sys.exit(1)  # line 60

    def terms(self, *args):
        return {}
"""


@pytest.fixture
def told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """Run the command line beside ``faulty.py``: how it ended, and what stands on stderr."""
    (tmp_path / "faulty.py").write_text(FAULTY)
    (tmp_path / "quits.py").write_text("import sys\nsys.exit(0)\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)

    def tell(*words: Any) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["desim-uav", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        out, err = capsys.readouterr()
        assert out == "" and "Traceback" not in err
        assert not (tmp_path / "runs").exists() or not list((tmp_path / "runs").iterdir())
        return int(end.value.code or 0), err

    yield tell
    for name in ("faulty", "quits"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize(
    ("words", "code", "parts"),
    [
        (
            ("-S", "users.mobility.kind=faulty:Walk"),
            1,
            ("'faulty:Walk' failed", "no way", "faulty.py:14, in Walk.walks"),
        ),
        (
            ("-S", "users.mobility.kind=faulty:Leaving"),
            1,
            ("'faulty:Leaving' failed", "SystemExit: 0", "faulty.py:20"),
        ),
        (
            ("-S", "reward.kind=faulty:Reward"),
            1,
            ("'faulty:Reward' failed", "ZeroDivisionError", "faulty.py:26"),
        ),
        (("-S", "reward.kind=faulty:Huge"), 1, ("reward 'Huge'", "between -1e+100 and 1e+100")),
        (("-S", "reward.kind=faulty:Infinite"), 1, ("reward 'Infinite'", "inf")),
        (
            ("--policy", "faulty:Quits"),
            1,
            ("'faulty:Quits' failed in episode 0, step 2", "SystemExit: 3", "faulty.py:49"),
        ),
        (("--policy", "faulty:Unmade"), 4, ("'faulty:Unmade'", "never", "faulty.py:55")),
        (("--policy", "quits:Policy"), 4, ("cannot import 'quits:Policy'", "quits.py:2")),
        (
            ("-S", "demand.kind=quits:Demand"),
            3,
            ("demand.kind", "cannot import 'quits:Demand'", "quits.py:2"),
        ),
        (("-S", "reward.kind=faulty:Component"), 3, ("reward", "cannot be made", "faulty.py:60")),
    ],
)
def test_a_fault_of_a_component(words, code: int, parts: tuple[str, ...], told):
    found, message = told("run", "tiny", *words)
    assert found == code, message
    for part in parts:
        assert part in message, message


@pytest.mark.parametrize(
    "words", [("-S", "reward.kind=faulty:Reward"), ("-S", "users.mobility.kind=faulty:Leaving")]
)
def test_a_fault_in_a_training(words, told):
    (found, message) = told("train", "tiny", "--episodes", 1, "--out", "x", *words)
    assert found == 1 and "faulty.py:" in message, message


@pytest.mark.thorough
def test_a_fault_in_another_process(told):
    flags = ("--policies", "hover,faulty:Quits", "--seeds", 2, "--episodes", 1, "-j", 2)
    found, message = told("compare", "tiny", *flags)
    assert found == 1 and "SystemExit: 3" in message and "faulty.py:49" in message, message


class TestOthersCode:
    """A file names components; whoever reads it is told before their code runs, or refuses it."""

    @pytest.fixture
    def folder(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any):
        """A folder of somebody's: a scenario and a module, which leaves a trace when it runs."""
        (tmp_path / "theirs.py").write_text(
            "from pathlib import Path\n"
            "from desim_uav.rules.rewards import Coverage\n\n"
            "Path('trace').touch()\n\n\n"
            "class Paid(Coverage):\n    pass\n",
            encoding="utf-8",
        )
        text = "name: x\nreward: {kind: 'theirs:Paid'}\n"
        (tmp_path / "scenario.yaml").write_text(text, encoding="utf-8")
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "path", [*sys.path])
        monkeypatch.delenv("PYTHONPATH", raising=False)
        yield runner(capsys, monkeypatch)
        sys.modules.pop("theirs", None)

    def test_a_notice_says_so_once(self, folder: Any, tmp_path: Path):
        ended = folder("validate", "scenario.yaml", "scenario.yaml")
        assert ended.code == 0 and Path("trace").exists()
        assert ended.err == (
            f"desim-uav: 'theirs:Paid' is imported from {tmp_path}, which runs its code "
            "(see --no-plugins)\n"
        )

    @pytest.mark.parametrize("how", ["project", "above", "PYTHONPATH"])
    def test_not_where_the_user_works(self, how: str, folder: Any, tmp_path: Path, monkeypatch):
        if how == "PYTHONPATH":
            monkeypatch.setenv("PYTHONPATH", str(tmp_path))
        else:
            (tmp_path / "pyproject.toml").touch()
        if how == "above":
            inner = tmp_path / "inner"
            inner.mkdir()
            for name in ("theirs.py", "scenario.yaml"):
                (tmp_path / name).rename(inner / name)
            monkeypatch.chdir(inner)
        ended = folder("validate", "scenario.yaml")
        assert (ended.code, ended.err) == (0, "")

    @pytest.mark.parametrize(
        ("command", "code"),
        [
            (("validate", "scenario.yaml"), 3),
            (("run", "scenario.yaml"), 3),
            (("run", "tiny", "--policy", "theirs:Paid"), 4),
            (("train", "scenario.yaml"), 3),
            (("optimum", "scenario.yaml"), 3),
            (("compare", "scenario.yaml", "--policies", "hover"), 3),
            (("sweep", "scenario.yaml", "--policies", "hover", "--out", "s"), 3),
            (("report", "kept"), 4),
            (("replay", "kept"), 4),
            (("plot", "battery", "kept"), 4),
            (("video", "kept", "--gif", "f.gif"), 4),
            (("bench", "run", "uav-v1/coverage/small", "--policy", "theirs:Paid"), 4),
        ],
        ids=lambda words: words[0] if isinstance(words, tuple) else "",
    )
    def test_refused(self, command: Any, code: int, folder: Any):
        if "kept" in command:
            folder("run", "scenario.yaml", "-S", "episode.steps=3", "--out", "kept", "-q")
            Path("trace").unlink()
            sys.modules.pop("theirs")
        ended = folder(*command, "--no-plugins")
        assert (ended.code, ended.out) == (code, ""), ended.err
        assert "--no-plugins refuses" in ended.err and not Path("trace").exists()
        assert "theirs" not in sys.modules

    def test_only_for_the_command(self, folder: Any, capsys: pytest.CaptureFixture[str]):
        assert folder("validate", "scenario.yaml", "--no-plugins").code == 3
        load(Path("scenario.yaml"))
        assert Path("trace").exists() and capsys.readouterr().err == ""
