"""What the doctor sees, and says."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from numba.core.caching import NullCache

from desim_uav import cli
from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.engine.des.skies import LISTS
from desim_uav.experiment import doctor
from desim_uav.experiment.doctor import Check, examine
from desim_uav.rowcode import kernels
from desim_uav.sample_path import draw
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.sky.foresee import foresee_discs
from desim_uav.world import build_world


def found(findings: list[Check], what: str) -> Check:
    (one,) = [finding for finding in findings if finding.what == what]
    return one


def pretend(monkeypatch: pytest.MonkeyPatch, versions: dict[str, str | None]) -> None:
    """Let packages be of other versions, or missing (None)."""
    real = doctor.version

    def version(name: str) -> str:
        told = versions[name] if name in versions else real(name)
        if told is None:
            raise doctor.PackageNotFoundError(name)
        return told

    monkeypatch.setattr(doctor, "version", version)


def on_the_command_line(monkeypatch, capsys) -> tuple[int, dict]:
    monkeypatch.setattr("sys.argv", ["desim-uav", "doctor", "--json"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code, json.loads(capsys.readouterr().out)


def test_here_nothing_is_wrong(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    code, told = on_the_command_line(monkeypatch, capsys)
    assert (code, told["healthy"]) == (0, True)
    assert {"desim-uav", "Python", "packages", "compiled code", "processors", "runs"} <= {
        finding["what"] for finding in told["findings"]
    }
    assert list(tmp_path.iterdir()) == []


def test_a_package_that_is_too_old_or_missing(monkeypatch, capsys):
    pretend(monkeypatch, {"numpy": "1.26.4", "simpy": None})
    code, told = on_the_command_line(monkeypatch, capsys)
    assert (code, told["healthy"]) == (1, False)
    words = " ".join(finding["words"] for finding in told["findings"])
    assert "numpy 1.26.4 is installed, but <3,>=2.1 is needed" in words
    assert "simpy is missing" in words


def test_a_package_that_cannot_be_imported(monkeypatch):
    real = doctor.importlib.import_module

    def broken(name: str):
        if name == "numba":
            raise ImportError("Numba needs NumPy 2.3 or less")
        return real(name)

    monkeypatch.setattr(doctor.importlib, "import_module", broken)
    assert found(examine(), "numba") == Check(
        "problem", "numba", "cannot be imported: Numba needs NumPy 2.3 or less"
    )


def test_an_extra_that_is_missing_has_its_command(monkeypatch):
    pretend(monkeypatch, {"stable-baselines3": None})
    told = found(examine(), "extra sb3")
    assert told.verdict == "note"
    assert "stable-baselines3 is missing" in told.words
    assert told.words.endswith('pip install -e ".[sb3]"')


def test_rllib_and_its_gymnasium(monkeypatch):
    real = doctor.requires
    asked = ["gymnasium==1.2.2; extra == 'rllib'"]
    monkeypatch.setattr(doctor, "requires", lambda name: asked if name == "ray" else real(name))
    pretend(monkeypatch, {"ray": "2.60.0", "gymnasium": "1.4.0"})
    told = found(examine(), "ray 2.60.0")
    assert told.verdict == "note"
    assert told.words.startswith("RLlib needs gymnasium ==1.2.2, but 1.4.0 is installed")


def test_an_extra_of_another_packages_extra(monkeypatch):
    """RLlib is an extra of Ray: that Ray is there does not do."""
    asked = {
        "desim-uav": ["ray[rllib]>=2.60; extra == 'sb3'"],
        "ray": ["gymnasium==1.2.2; extra == 'rllib'"],
    }
    monkeypatch.setattr(doctor, "requires", asked.get)
    pretend(monkeypatch, {"ray": "2.60.0", "gymnasium": "1.4.0"})
    told = found(examine(), "extra sb3")
    assert told.verdict == "note"
    assert told.words.startswith("gymnasium 1.4.0 is installed, but ==1.2.2 is needed; pip install")
    pretend(monkeypatch, {"ray": "2.60.0", "gymnasium": "1.2.2"})
    assert found(examine(), "extra sb3").words == "installed"


def test_machine_code_of_other_sources_is_not_ready(monkeypatch):
    """Each scenario needs one of several kernels, so a run has been compiled if one of them has."""
    world = build_world(load(scenario_path("tiny")), 0)
    Simulation(world, RunSettings((True,), False)).reset(draw(world, 0, 0))
    assert kernels.compiled_before(foresee_discs)
    for kernel in LISTS[1:]:
        monkeypatch.setattr(kernel._cache.file, "origin", b"of another day")
    assert not found(examine(), "compiled code").words.startswith("run")
    monkeypatch.setattr(foresee_discs._cache.file, "origin", b"of another day")
    assert not kernels.compiled_before(foresee_discs)
    told = found(examine(), "compiled code")
    assert told.verdict == "note"
    assert told.words.startswith("run")


def test_it_says_where_compiled_code_is_kept():
    told = found(examine(), "compiled code")
    folder = kernels.cache_folder(foresee_discs)
    assert told.words.endswith(f"; kept in {folder}, which is writable")


def test_there_is_no_place_for_compiled_code(monkeypatch):
    monkeypatch.setattr(foresee_discs, "_cache", NullCache())
    told = found(examine(), "compiled code")
    assert told.verdict == "problem"
    assert told.words.startswith("compiled code cannot be kept on disk")
    assert told.words.endswith("set NUMBA_CACHE_DIR to a folder that can be")


def test_a_folder_for_compiled_code_that_cannot_be_written(monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "kernels"))
    told = found(examine(), "NUMBA_CACHE_DIR")
    assert told.verdict == "problem"
    assert str(tmp_path / "file") in told.words
    assert told.words.endswith("; it is not used")


def test_no_place_to_write(monkeypatch):
    def full(**_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(doctor.tempfile, "TemporaryFile", full)
    told = found(examine(), "runs")
    assert told.verdict == "problem"
    assert told.words.startswith(str(Path.cwd()))
    assert told.words.endswith("No space left on device")


def test_no_compiler(monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    assert found(examine(), "kernels").verdict == "problem"
