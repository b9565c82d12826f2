"""Where nothing can be written is found before anything is simulated, whatever the command."""

import shutil
import signal
import subprocess
from pathlib import Path

import pytest

from desim_uav.errors import PolicyError
from desim_uav.experiment.replay import again
from tests.command_line import runner
from tests.report.helpers import make_run

SMALL = ("users.count=12", "episode.steps=8")
LONG = ("--episodes", 10**6)
MANY = ("-S", "learning.episodes=1000000,1000001")
ENDLESS = {
    "run": ("run", "case8", *LONG, "--out"),
    "train": ("train", "case8", *LONG, "--out"),
    "sweep": ("sweep", "case8", "--policies", "hover,random", *LONG, "--out"),
    "sweep-train": ("sweep", "case8", "--train", *MANY, "--out"),
    "compare": ("compare", "case8", "--policies", "hover", *LONG, "--out"),
    "reproduce": ("reproduce", *LONG, "--out"),
}
"""What would take hours, were its place not looked at first; the place follows."""

DRAWN = {
    "report": (("report", "flown", "--out"), "report.html"),
    "replay": (("replay", "flown", "-q", "--html"), "replay.html"),
    "plot": (("plot", "battery", "flown", "-o"), "battery.png"),
    "gif": (("video", "flown", "-q", "--gif"), "film.gif"),
    "mp4": (("video", "flown", "-q", "--mp4"), "film.mp4"),
}
"""What would play a run again that kept no events; the file follows."""


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """Whoever simulates all the same is interrupted."""
    monkeypatch.chdir(tmp_path)
    Path("file").touch()

    def too_long(*_):
        raise AssertionError("it has begun to simulate")

    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    alarm = signal.signal(signal.SIGALRM, too_long)
    signal.alarm(60)
    yield tmp_path
    signal.alarm(0)
    signal.signal(signal.SIGALRM, alarm)
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def command(capsys, monkeypatch):
    return runner(capsys, monkeypatch)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A run without events; not to be written to."""
    folder = tmp_path_factory.mktemp("kept") / "flown"
    return make_run(folder, "case8", "baseline", SMALL, events=False)


@pytest.fixture
def flown(kept, monkeypatch):
    """A copy in the working folder, of which nothing may be played again."""
    shutil.copytree(kept, "flown")
    monkeypatch.setattr(again, "play", lambda *_: pytest.fail("played again"))
    return Path("flown")


def mounted(folder: Path):
    """A folder on a disk that is mounted read-only, which holds for root too."""
    for words in (["--bind", folder, folder], ["-o", "remount,bind,ro", folder]):
        done = subprocess.run(["mount", *map(str, words)], capture_output=True, check=False)
        if done.returncode:
            pytest.skip(f"no folder can be mounted read-only: {done.stderr.decode().strip()}")


@pytest.fixture
def read_only(here):
    """In it an empty folder, and what a table of the paper was begun in."""
    folder = here / "fixed"
    for name in ("empty", "begun/jobs", "begun/policies"):
        (folder / name).mkdir(parents=True)
    mounted(folder)
    yield Path("fixed")
    subprocess.run(["umount", "-l", folder], check=True)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*"))


@pytest.mark.parametrize("place", ["file/out", "file/deep/out", "/proc/out", "/dev/null/out"])
@pytest.mark.parametrize("name", ENDLESS)
def test_beneath_what_is_no_folder(name, place, command, here):
    ended = command(*ENDLESS[name], place + ".csv" * (name == "compare"))
    ended.failed(2, "desim-uav: ")
    assert ended.err.count("\n") == 1 and place.rpartition("/")[0].split("/")[-1] in ended.err
    assert names(here) == ["file"]


@pytest.mark.parametrize("place", ["new", "empty", "empty/new/deep"])
@pytest.mark.parametrize("name", ENDLESS)
def test_on_a_read_only_disk(name, place, command, read_only, here):
    ended = command(*ENDLESS[name], read_only / (place + ".csv" * (name == "compare")))
    assert ended.code in (1, 2), ended.err
    ended.failed(ended.code, "desim-uav: ", "fixed")
    assert ended.err.count("\n") == 1
    assert "Read-only file system" in ended.err
    assert names(here) == sorted(["begun", "empty", "file", "fixed", "jobs", "policies"])


def test_a_table_that_was_begun_on_a_disk_now_read_only(command, read_only):
    ended = command(*ENDLESS["reproduce"], read_only / "begun")
    ended.failed(2, "fixed/begun: Read", "only file system")


def test_a_training_that_was_begun_on_a_disk_now_read_only(command, here):
    words = ("train", "tiny", "--checkpoint-every", 5, "--out", "disk/t", "-q")
    signal.alarm(0)  # the first training may have to be compiled
    assert command(*words, "--episodes", 10).code == 0
    signal.alarm(60)
    mounted(here / "disk")
    try:
        ended = command(*words, *LONG, "--resume")
    finally:
        subprocess.run(["umount", "-l", here / "disk"], check=True)
    ended.failed(2, "cannot write to", "disk: Read", "only file system")
    assert command(*words, "--episodes", 20, "--resume").code == 0


@pytest.mark.parametrize("name", DRAWN)
@pytest.mark.parametrize("place", ["file", "/proc", "fixed", "fixed/new"])
def test_a_drawing(name, place, flown, command, read_only):
    words, file = DRAWN[name]
    ended = command(*words, f"{place}/{file}")
    ended.failed(2, "desim-uav: ")
    assert ended.err.count("\n") == 1 and place.split("/")[0] in ended.err


@pytest.mark.parametrize("words", [("report",), ("replay", "-q"), ("plot", "battery")])
def test_a_run_folder_that_is_read_only(words, flown, command, here):
    shutil.copytree(flown, here / "fixed" / "flown")
    mounted(here / "fixed")
    try:
        ended = command(*words, "fixed/flown")
    finally:
        subprocess.run(["umount", "-l", here / "fixed"], check=True)
    ended.failed(2, "desim-uav: fixed/flown/", ": the folder cannot be written to: Read-only file")


@pytest.mark.parametrize("name", DRAWN)
def test_a_drawing_that_fails_leaves_no_folder(name, flown, command, here, monkeypatch):
    """Its folders are made with it, and with it they go."""

    def wrong(*_):
        raise PolicyError("it went wrong")

    monkeypatch.setattr(again, "play", wrong)
    (words, file), before = DRAWN[name], names(here)
    command(*words, f"new/deep/{file}").failed(4, "it went wrong")
    assert names(here) == before


@pytest.mark.thorough
@pytest.mark.parametrize(("verb", "page"), [("report", "page.html"), ("compare", "page.csv")])
def test_a_drawing_in_new_folders(verb, page, command, here):
    words = (verb, "flown", "--out")
    make_run(here / "flown", "case8", "baseline", SMALL)
    assert command(*words, f"new/deep/{page}").code == 0
    assert [path.name for path in Path("new/deep").iterdir()] == [page]
    Path("new/file").touch()
    command(*words, f"new/file/{page}").failed(2, f"--out new/file/{page}: the folder cannot be")
