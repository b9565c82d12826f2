"""kill -9 at random moments: nothing half written, and in the end what an undisturbed one gives."""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.command_line import ROOT, elsewhere, program
from tests.faults.kill import COMMANDS, same_sweep

SWEEP = (
    "sweep",
    "tiny",
    "--policies",
    "hover,random",
    "--episodes",
    60,
    "--warmup",
    0,
    "--seeds",
    12,
    "-q",
)


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return tmp_path


def killed(name: str, kills: int, seed: int):
    """The kills there were."""
    command = [sys.executable, "-m", "tests.faults.kill", name, str(kills), str(seed)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1200, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["killed"] == kills
    return found


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "kills"),
    [("run", 4), ("run-des", 2), ("sweep", 2)],
)
def test_at_random_moments(name, kills):
    """Those of ``train`` are in experiment/test_train.py."""
    killed(name, kills, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_at_many_random_moments(name):
    killed(name, 40, seed=2)


@pytest.mark.slow
def test_processes_of_a_killed_sweep_end_by_themselves(here):
    """Nobody writes to the folder once its sweep is dead; the same command goes on with it."""
    process = subprocess.Popen(program(*SWEEP, "-j", 2, "--out", "out"))
    until(lambda: len(list(here.glob("out/results/*.parquet"))) > 3)
    workers = children(process.pid)
    assert len(workers) >= 2
    process.kill()
    process.wait()
    kept = files(here / "out")
    until(lambda: not any(map(is_alive, workers)))
    assert files(here / "out") == kept
    assert 3 < len(list(here.glob("out/results/[!.]*"))) < 24
    again = elsewhere(*SWEEP, "--resume", "--out", "out")
    assert again.code == 0 and "jobs had ended before" in again.message
    assert kept["results"].items() <= files(here / "out")["results"].items()
    assert elsewhere(*SWEEP, "--out", "whole").code == 0
    same_sweep(here / "out", here / "whole")


@pytest.mark.thorough
def test_a_run_that_is_killed_leaves_nothing_in_its_place(here):
    """While it lives a second one is told who is there; then that may have the folder.

    The lock has died with its process; a hidden draft is all that stays.
    """
    process = subprocess.Popen(program("run", "tiny", "--episodes", 10**6, "--out", "mine", "-q"))
    until(lambda: list(here.glob(".unfinished-*/*.parquet")))
    second = elsewhere("run", "tiny", "--out", "mine")
    second.failed(2, f"mine: process {process.pid}, since", "is writing to it")
    process.kill()
    process.wait()
    (left,) = (path.name for path in here.iterdir() if path.name != ".mine.lock")
    assert left.startswith(".unfinished-")
    assert elsewhere("run", "tiny", "--out", "mine", "-q").code == 0
    assert sorted(path.name for path in here.iterdir()) == [left, "mine"]


def files(out: Path):
    """When each file was written, by folder."""
    return {
        folder.name: {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}
        for folder in (out, out / "results", out / "policies")
    }


def children(pid: int) -> list[int]:
    listed = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(child) for child in listed]


def is_alive(pid: int) -> bool:
    """Does it run? Where nobody fetches it, the dead stay listed."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def until(condition) -> None:
    begun = time.monotonic()
    while not condition():
        assert time.monotonic() < begun + 120
        time.sleep(0.02)
