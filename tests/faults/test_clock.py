"""A clock that is set forward and back by a day at each look: nothing but dates hangs on it."""

import itertools
import json
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest

from desim_uav import lock
from desim_uav.experiment import provenance
from desim_uav.experiment.sweep import folder as sweep_folder
from tests.command_line import runner
from tests.faults.kill import SWEPT, same_files, same_run, same_sweep, same_training

DAY_S = 86_400


@pytest.fixture
def command(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    return runner(capsys, monkeypatch)


@pytest.fixture
def jumps(monkeypatch):
    """From now on; the looks there were."""
    found = []
    days = itertools.cycle([0, 1, -1, 1, -2])
    seconds, nanoseconds = time.time, time.time_ns

    def away() -> int:
        found.append(next(days) * DAY_S)
        return found[-1]

    class Jumping(datetime):
        @classmethod
        def now(cls, tz=None):
            return datetime.now(tz) + timedelta(seconds=away())

    def begin():
        monkeypatch.setattr(time, "time", lambda: seconds() + away())
        monkeypatch.setattr(time, "time_ns", lambda: nanoseconds() + away() * 10**9)
        for module in (provenance, lock, sweep_folder):
            monkeypatch.setattr(module, "datetime", Jumping)
        return found

    return begin


def twice(command, jumps, *words):
    """The same under a clock that can be trusted, and under one that cannot."""
    assert command(*words, "--out", "one").code == 0
    looks = jumps()
    ended = command(*words, "--out", "other")
    assert ended.code == 0 and len(looks) > 1
    manifest = json.loads(Path("other/manifest.json").read_text())
    times = [datetime.fromisoformat(manifest[k]) for k in ("started", "finished") if k in manifest]
    assert times == sorted(times)
    return Path("one"), Path("other")


@pytest.mark.parametrize("days", [[0, 1, -1, 1, -2], [1, -1], [0, 0, 3, -3, -1], [-1, 2, 2, 0]])
def test_no_time_is_before_another(days, monkeypatch):
    looks = itertools.cycle(days)

    class Jumping(datetime):
        @classmethod
        def now(cls, tz=None):
            return datetime.now(tz) + timedelta(days=next(looks))

    monkeypatch.setattr(provenance, "datetime", Jumping)
    begun, now = datetime.now(UTC), provenance.clock()
    times = [datetime.fromisoformat(now()) for _ in range(4 * len(days))]
    assert times == sorted(times)
    assert times[-1] - begun < timedelta(days=max(days), minutes=1), "jumps add up"


def test_it_goes_on_while_the_clock_is_behind(monkeypatch):
    """By what has passed, and not from where the clock was set back to."""
    wall, passed = iter([5, 9, 2, 2, 9]), iter([0.0, 10.0, 25.0, 45.0, 45.0])

    class Set(datetime):
        @classmethod
        def now(cls, tz=None):
            return datetime(2026, 1, next(wall), tzinfo=tz)

    monkeypatch.setattr(provenance, "datetime", Set)
    monkeypatch.setattr(provenance, "time", SimpleNamespace(monotonic=lambda: next(passed)))
    now = provenance.clock()
    ninth = "2026-01-09T00:00"
    assert [now() for _ in range(4)] == [f"{ninth}:{s}+00:00" for s in ("00", "15", "35", "35")]


@pytest.mark.parametrize("engine", ["des", "batch"])
def test_a_run(engine, command, jumps):
    flags = ("--policy", "random", "--episodes", 3, "--events", "--engine", engine)
    same_run(*twice(command, jumps, "run", "tiny", *flags))


def test_a_training(command, jumps):
    same_training(*twice(command, jumps, "train", "tiny", "--episodes", 40))


def test_a_training_goes_on(command, jumps):
    words = ("train", "tiny", "--checkpoint-every", 10)
    assert command(*words, "--episodes", 40, "--out", "one").code == 0
    jumps()
    assert command(*words, "--episodes", 20, "--out", "other").code == 0
    assert command(*words, "--episodes", 40, "--resume", "--out", "other").code == 0
    same_training(Path("one"), Path("other"))


@pytest.mark.thorough
def test_a_sweep_goes_on(command, jumps):
    words = ("sweep", "tiny", "--policies", "hover,random", *SWEPT)
    one, other = twice(command, jumps, *words)
    same_sweep(one, other)
    (next((other / "results").iterdir())).unlink()
    ended = command(*words, "--resume", "--out", "other")
    assert "7 of 8 jobs had ended before" in ended.message
    same_files(one / "results", other / "results", "*")


def test_a_lock_holds(jumps, tmp_path):
    jumps()
    with lock.held(tmp_path / "mine"):
        for _ in range(5):
            with pytest.raises(lock.UsageError, match="is writing to it"):
                lock.held(tmp_path / "mine").__enter__()
