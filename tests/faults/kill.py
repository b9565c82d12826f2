"""Kill a command with signal 9 at random moments until it has been killed so often.

``python -m tests.faults.kill COMMAND KILLS SEED`` in an empty folder. Each attempt is a fork of
this warm process, so that a kill costs a fraction of a second. Prints how many kills and endings
there were; an AssertionError says what was found other than it must be.
"""

import json
import os
import random
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from desim_uav import cli
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.experiment import command, compare, reproduce  # noqa: F401 (warm)
from desim_uav.experiment.sweep import run as sweep  # noqa: F401 (warm)
from desim_uav.experiment.train import folder as train  # noqa: F401 (warm)
from desim_uav.learning.training import Training
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world

MOST_S = 120
SWEPT = ("-S", "episode.steps=3:4", "--seeds", "2", "--episodes", "2", "--warmup", "0")


@dataclass(frozen=True)
class Command:
    """What is killed, how it goes on (None: anew), what a kill may leave, what must come out."""

    words: tuple[str, ...]
    goes_on: tuple[str, ...] | None
    left: Callable[[Path, Path], None]
    same: Callable[[Path, Path], None]


def same_files(one: Path, other: Path, *patterns: str) -> None:
    names = [{file.name for p in patterns for file in d.glob(p)} for d in (one, other)]
    assert names[0] == names[1] and names[0], names
    for name in names[0]:
        assert (one / name).read_bytes() == (other / name).read_bytes(), name


def same_run(one: Path, other: Path) -> None:
    """All but when it was."""
    same_files(one, other, "*.parquet", "*.yaml", "world.json")
    assert {file.name for file in one.iterdir()} == {file.name for file in other.iterdir()}


def no_part_of_a_run(one: Path, whole: Path) -> None:
    """There is nothing, or all of it: the kill came after the last step."""
    if one.exists():
        same_run(one, whole)


def same_training(one: Path, other: Path) -> None:
    same_files(one, other, "policy.npz", "training.parquet", "world.json", "scenario.yaml")


def no_part_of_a_training(one: Path, whole: Path) -> None:
    """What stands there is as it will be in the end."""
    for name in ("policy.npz", "training.parquet", "world.json", "scenario.yaml"):
        if (one / name).exists():
            assert (one / name).read_bytes() == (whole / name).read_bytes(), name


def same_sweep(one: Path, other: Path) -> None:
    same_files(one / "results", other / "results", "[!.]*")
    rows = [pd.read_parquet(d / "results").sort_values("job") for d in (one, other)]
    pd.testing.assert_frame_equal(*(found.reset_index(drop=True) for found in rows))
    tables = [(d / "table.md").read_text().split("\n", 1)[1] for d in (one, other)]
    assert tables[0] == tables[1]


def same_table(one: Path, other: Path) -> None:
    """But for the command it names."""
    for folder in ("jobs", "policies"):
        same_files(one / folder, other / folder, "[!.]*")
    same_files(one, other, "*.csv")
    tables = [(d / "table.md").read_text().split("\n", 1)[1] for d in (one, other)]
    assert tables[0] == tables[1]


def no_part_of_a_table(one: Path, whole: Path) -> None:
    """Each finished job that stands there is whole."""
    for name in ("jobs", "policies"):
        for file in (one / name).glob("[!.]*"):
            assert file.read_bytes() == (whole / name / file.name).read_bytes(), file


def no_part_of_a_sweep(one: Path, whole: Path) -> None:
    """Each row and each table that stands there is whole."""
    for name in ("results", "policies"):
        for file in (one / name).glob("[!.]*"):
            assert file.read_bytes() == (whole / name / file.name).read_bytes(), file


COMMANDS = {
    "run": Command(
        ("run", "tiny", "--policy", "random", "--episodes", "60", "--events", "--engine", "batch"),
        None,
        no_part_of_a_run,
        same_run,
    ),
    "run-des": Command(
        ("run", "tiny", "--policy", "random", "--episodes", "60", "--warmup", "2"),
        None,
        no_part_of_a_run,
        same_run,
    ),
    "train": Command(
        ("train", "tiny", "--episodes", "400", "--checkpoint-every", "25"),
        ("--resume",),
        no_part_of_a_training,
        same_training,
    ),
    "sweep": Command(
        ("sweep", "tiny", "--policies", "hover,random", *SWEPT),
        ("--resume",),
        no_part_of_a_sweep,
        same_sweep,
    ),
    "sweep-train": Command(
        ("sweep", "tiny", "--train", "-S", "learning.episodes=30", *SWEPT),
        ("--resume",),
        no_part_of_a_sweep,
        same_sweep,
    ),
    "reproduce": Command(
        ("reproduce", "--cases", "1", "--seeds", "2", "--episodes", "30"),
        (),
        no_part_of_a_table,
        same_table,
    ),
}


def warm() -> None:
    """Compile, or fetch from disk, what the forks will need."""
    world = build_world(load(scenario_path("tiny")), 0)
    from desim_uav.experiment.run import play
    from desim_uav.policies import load_policy

    for engine in ("des", "batch"):
        list(play(world, load_policy("random"), "random", 0, 1, 0, True, engine))
    Training(world, 0, "batch").play(2)
    assert BatchSimulation


def begun(words: tuple[str, ...], out: Path) -> int:
    """The command in a fork."""
    child = os.fork()
    if child == 0:
        code = 99
        try:
            with Path("stderr").open("w") as file:
                os.dup2(file.fileno(), 2)
            sys.argv = ["desim-uav", *words, "--out", str(out), "-q"]
            cli.main()
        except SystemExit as end:
            code = int(end.code or 0)
        finally:  # whatever happened, this is not the parent
            os._exit(code)
    return child


def ended(child: int) -> int | None:
    """Its exit code; None: it was killed."""
    before = time.monotonic()
    while True:
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            return None if os.WIFSIGNALED(status) else os.WEXITSTATUS(status)
        assert time.monotonic() < before + MOST_S, "it does not end"
        time.sleep(0.001)


def main(name: str, kills: int, seed: int) -> dict[str, int]:
    what, chance = COMMANDS[name], random.Random(seed)
    resumed = (*what.words, *(what.goes_on or ()))
    warm()
    assert ended(begun(what.words, Path("warm"))) == 0, Path("stderr").read_text()
    before = time.monotonic()
    whole = Path("whole")
    assert ended(begun(what.words, whole)) == 0
    took_s = time.monotonic() - before
    killed = refused = finished = 0
    while killed < kills:
        out = Path(f"out{finished}")
        child = begun(resumed, out)
        time.sleep(chance.uniform(0, took_s))
        os.kill(child, signal.SIGKILL)
        code = ended(child)
        what.left(out, whole)
        if code is None:
            killed += 1
            if what.goes_on and not refused and out.exists() and any(out.iterdir()):
                assert ended(begun(what.words, out)) == 2, "it needs --resume"
                assert "Traceback" not in Path("stderr").read_text()
                what.left(out, whole)
                refused = 1
            if what.goes_on is not None or not out.exists():
                continue
        else:
            assert code == 0, Path("stderr").read_text()
        what.same(out, whole)
        finished += 1
    out = Path(f"out{finished}")
    if what.goes_on is not None or not out.exists():
        assert ended(begun(resumed, out)) == 0, Path("stderr").read_text()
    what.same(out, whole)
    return {"killed": killed, "refused": refused, "finished": finished + 1}


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))))
