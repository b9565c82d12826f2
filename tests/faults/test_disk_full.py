"""A disk that fills up: one error that names the file, nothing half written, the rest is kept."""

import resource
import signal
import subprocess
from pathlib import Path

import pytest

from desim_uav.experiment.sweep import run as sweep
from tests.command_line import ROOT, elsewhere, program, runner
from tests.faults.kill import same_sweep, same_training

NO_SPACE = "No space left on device"
TRAINING = ("train", "tiny", "--episodes", 300, "--checkpoint-every", 20, "-q")
SWEEP = ("sweep", "tiny", "--seeds", 12, "--episodes", 1, "--warmup", 0, "-q")


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield tmp_path
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def command(capsys, monkeypatch):
    return runner(capsys, monkeypatch)


@pytest.fixture
def disk(here):
    """A small disk of memory."""
    place = here / "disk"
    place.mkdir()
    mounted = mount("-t", "tmpfs", "-o", "size=256k", "none", place)
    if mounted.returncode:
        pytest.skip(f"no small disk can be mounted: {mounted.stderr.strip()}")
    yield Path("disk")
    subprocess.run(["umount", "-l", place], check=True)


def mount(*words):
    return subprocess.run(["mount", *map(str, words)], capture_output=True, text=True, check=False)


def fill(disk: Path, leave: int) -> Path:
    """A file that leaves so many KiB of 256."""
    ballast = disk / "ballast"
    ballast.write_bytes(bytes((256 - leave) * 1024))
    return ballast


def hidden(folder: Path) -> list[str]:
    return [path.name for path in folder.rglob(".*")]


def test_a_run(disk, command):
    flags = ("--episodes", 10**5, "--events", "--engine", "batch", "-q")
    ended = command("run", "tiny", *flags, "--out", disk / "mine")
    ended.failed(1, "cannot write ", ".parquet to ", NO_SPACE)
    assert ended.err.count("\n") == 1
    assert list(disk.iterdir()) == []


@pytest.mark.parametrize("leave", range(0, 44, 4))
def test_a_run_wherever_it_fills_up(disk, command, leave):
    """In the folder, the lock, a table, a text, the checksums: nothing stays of it."""
    ballast = fill(disk, leave)
    ended = command("run", "tiny", "-q", "--out", disk / "mine")
    if ended.code:
        assert ended.code in (1, 2)
        ended.failed(ended.code, "cannot write ", NO_SPACE)
        assert list(disk.iterdir()) == [ballast]
    else:
        assert leave >= 36, "there was no room for it"


def test_a_training_goes_on_from_its_last_checkpoint(disk, command):
    """Checkpoints grow as rows are added: one has no room beside that before."""
    fill(disk, 56)
    ended = command(*TRAINING, "--out", disk / "t")
    ended.failed(1, "cannot write disk/t/", NO_SPACE)
    assert ended.err.count("\n") == 1
    left = {path.name for path in (disk / "t").iterdir()}
    assert "checkpoint.npz" in left and "policy.npz" not in left and not hidden(disk)
    assert mount("-o", "remount,size=4m", disk).returncode == 0
    assert command(*TRAINING, "--resume", "--out", disk / "t").code == 0
    assert command(*TRAINING, "--out", "whole").code == 0
    same_training(disk / "t", Path("whole"))


@pytest.mark.thorough
def test_a_sweep_keeps_its_rows(disk, command, monkeypatch):
    ballast = fill(disk, 40)
    ended = command(*SWEEP, "--out", disk / "s")
    ended.failed(1, "cannot write disk/s/results/", ".parquet: " + NO_SPACE)
    notice, problem = ended.err.splitlines()
    assert "nothing is swept" in notice and NO_SPACE in problem
    kept = {path: path.stat().st_mtime_ns for path in (disk / "s/results").iterdir()}
    assert 1 < len(kept) < 12 and not hidden(disk)
    ballast.unlink()
    assert command(*SWEEP, "--out", "whole").code == 0
    run_job, again = sweep.run_job, []
    monkeypatch.setattr(sweep, "run_job", lambda *task: (again.append(task), run_job(*task))[1])
    assert command(*SWEEP, "--resume", "--out", disk / "s").code == 0
    assert len(again) == 12 - len(kept)
    assert all(path.stat().st_mtime_ns == at for path, at in kept.items())
    same_sweep(disk / "s", Path("whole"))


@pytest.mark.thorough
def test_a_comparison_a_report_and_a_replay(disk, command):
    command("run", "tiny", "--events", "-q", "--out", "mine")
    fill(disk, 0)
    for words, file in (
        (("compare", "mine", "--out"), disk / "values.csv"),
        (("report", "mine", "--out"), disk / "report.html"),
        (("replay", "mine", "-q", "--html"), disk / "replay.html"),
        (("plot", "services", "mine", "-o"), disk / "services.png"),
        (("plot", "services", "mine", "-o"), disk / "new/services.png"),
    ):
        ended = command(*words, file).failed(1, "cannot write ", NO_SPACE)
        assert f"{file}: {NO_SPACE}" in ended.err and ended.err.count("\n") == 1
        assert [path.name for path in disk.iterdir()] == ["ballast"]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("words", "file"),
    [
        (("run", "tiny", "--events", "--episodes", 300, "--engine", "batch"), "parquet"),
        ((*TRAINING, "-S", "learning.initial_q=random"), "checkpoint"),
    ],
)
def test_a_limit_on_the_size_of_files(here, words, file):
    """As ``ulimit -f`` sets it."""

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (8_000, 8_000))

    ended = elsewhere(*words, "--out", "mine", preexec_fn=limit)
    ended.failed(1, "cannot write ", file, "File too large")
    assert ended.err.count("\n") == 1 and not hidden(here)


@pytest.mark.thorough
def test_nobody_takes_what_is_printed(here):
    """The disk that stdout goes to is full; the run is kept."""
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            program("run", "tiny", "--json", "--out", "mine"),
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=120,
            check=False,
        )
    assert done.returncode == 1
    assert NO_SPACE in done.stderr and "Traceback" not in done.stderr
    assert Path("mine/manifest.json").exists()
