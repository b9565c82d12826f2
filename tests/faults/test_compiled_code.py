"""Commands go on without compiled code on disk: damaged, or with no place for it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.command_line import ROOT, START

RUN = ("run", "tiny", "--episodes", "1", "--warmup", "0", "--json", "--out")

pytestmark = pytest.mark.thorough  # each compiles the kernels of a run anew


def called(place: Path, *arguments: object, root: Path = ROOT, **environment: object):
    """A command in a process of its own, in a folder of its own."""
    environment = {**os.environ, "PYTHONPATH": root, **environment}
    return subprocess.run(
        [sys.executable, "-c", START, *map(str, arguments)],
        cwd=place,
        env={name: str(value) for name, value in environment.items()},
        capture_output=True,
        text=True,
        check=False,
    )


def said(stderr: str) -> list[str]:
    """What is said of compiled code on disk."""
    return [line for line in stderr.splitlines() if "compiled code" in line]


def measures(out: str) -> dict[str, Any]:
    """What a run prints, but for its folder."""
    return {key: value for key, value in json.loads(out).items() if key != "run_dir"}


@pytest.mark.parametrize(
    "damaged",
    [b"garbage" * 1000, pytest.param(b"", marks=pytest.mark.slow)],
    ids=["garbage", "empty"],
)
def test_damaged_compiled_code_is_made_anew_with_one_line(tmp_path, damaged):
    kept = tmp_path / "kernels"
    first = called(tmp_path, *RUN, "one", NUMBA_CACHE_DIR=kept)
    assert (first.returncode, said(first.stderr)) == (0, [])
    files = sorted(kept.rglob("*.nbc"))
    assert files
    for file in files:
        file.write_bytes(damaged)
    second = called(tmp_path, *RUN, "two", NUMBA_CACHE_DIR=kept)
    assert second.returncode == 0
    (line,) = said(second.stderr)
    assert line.startswith("desim-uav: damaged compiled code is removed and made anew: ")
    third = called(tmp_path, *RUN, "three", NUMBA_CACHE_DIR=kept)
    assert (third.returncode, said(third.stderr)) == (0, [])
    assert measures(first.stdout) == measures(second.stdout) == measures(third.stdout)


def test_with_nowhere_to_keep_it_a_run_goes_on_and_doctor_explains(tmp_path):
    """Where a folder should be there is a file, so that an administrator cannot write, either."""
    installed, home = tmp_path / "installed", tmp_path / "home"
    for name in ("desim_uav", "scenarios", "policies"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, installed / name, ignore=ignored)
    for folder in {file.parent for file in installed.rglob("*.py")}:
        (folder / "__pycache__").touch()
    home.touch()
    nowhere = {"HOME": home, "XDG_CACHE_HOME": home, "NUMBA_CACHE_DIR": "", "root": installed}
    run = called(tmp_path, *RUN, "out", **nowhere)
    assert run.returncode == 0
    (line,) = said(run.stderr)
    assert line.startswith("desim-uav: compiled code cannot be kept on disk")
    doctor = called(tmp_path, "doctor", **nowhere)
    assert doctor.returncode == 1
    assert "compiled code cannot be kept on disk" in doctor.stdout
    assert "NUMBA_CACHE_DIR" in doctor.stdout
