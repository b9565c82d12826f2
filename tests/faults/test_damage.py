"""Damaged files: refused by name, or the same as they were; never read as something else.

JSON and YAML without checksums are what they say: another number there is another number.
"""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from desim_uav.checksums import SUMS, of_files
from desim_uav.errors import PolicyError
from desim_uav.experiment.command import read_summary
from desim_uav.experiment.replay.page import write_replay
from desim_uav.learning import checkpoint
from desim_uav.policies import load_policy
from desim_uav.policies.tabular import QTable, TableFile
from desim_uav.report.figures.training import read_training
from desim_uav.report.run import Run
from tests.command_line import runner
from tests.report.helpers import make_run, make_training
from tests.selection import by_default

SMALL = ("users.count=6", "episode.steps=4")
LEARNING = (*SMALL, "learning.episodes=8")
FLIPS, FEW = 300, 10


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("damage") / "run"
    return make_run(folder, "case8", "random", SMALL, episodes=2, warmup=1)


@pytest.fixture(scope="module")
def learned(tmp_path_factory):
    return make_training(tmp_path_factory.mktemp("damage") / "training", "case1", LEARNING)


RUN_FILES = [f"{name}.parquet" for name in ("requests", "steps", "episodes", "users")]
RUN_FILES += ["events.parquet", "legs.parquet", "manifest.json", "world.json", "scenario.yaml"]
TRAINING_FILES = ["training.parquet", "manifest.json", "scenario.yaml"]


def read_run(folder, name):
    """All that readers ask of a file."""
    run = Run(folder)
    if name.endswith(".parquet"):
        return run.table(name.removesuffix(".parquet"))
    return {
        "manifest.json": lambda: (run.manifest, run.settings),
        "world.json": lambda: run.map,
        "scenario.yaml": lambda: (run.scenario, run.yaml),
    }[name]()


def flipped(content: bytes, chance: np.random.Generator) -> bytes:
    """One bit of it is another."""
    damaged = bytearray(content)
    damaged[chance.integers(len(content))] ^= 1 << chance.integers(8)
    return bytes(damaged)


def cut(content: bytes, chance: np.random.Generator) -> bytes:
    """Its end is missing."""
    return content[: chance.integers(len(content))]


@pytest.mark.parametrize("damage", [flipped, cut])
@pytest.mark.parametrize("name", RUN_FILES)
def test_a_file_of_a_run(name, damage, flown, tmp_path):
    folder, chance = shutil.copytree(flown, tmp_path / "run"), np.random.default_rng(1)
    content = (folder / name).read_bytes()
    read_run(folder, name)
    for _ in range(FEW):
        (folder / name).write_bytes(damage(content, chance))
        with pytest.raises(
            PolicyError, match=rf"{name}: the file has changed since it was"
        ) as refused:
            read_run(folder, name)
        assert refused.value.exit_code == 4


@pytest.mark.parametrize("damage", [flipped, cut])
@pytest.mark.parametrize("name", by_default(["requests.parquet", "manifest.json"], RUN_FILES))
@pytest.mark.parametrize("times", by_default([100], [100, FLIPS]))
def test_a_file_of_a_run_without_checksums(name, damage, times, flown, tmp_path):
    """A table is refused or as it was, wherever the bit is: in a page, a footer, a name."""
    folder, chance = shutil.copytree(flown, tmp_path / "run"), np.random.default_rng(1)
    (folder / SUMS).unlink()
    content, whole, refused = (folder / name).read_bytes(), read_run(folder, name), 0
    for _ in range(times):
        (folder / name).write_bytes(damage(content, chance))
        try:
            found = read_run(folder, name)
        except PolicyError as error:
            assert f"{folder / name}:" in str(error) and error.exit_code == 4
            refused += 1
        else:
            if name.endswith(".parquet"):
                pd.testing.assert_frame_equal(found, whole, check_exact=True)
    assert refused > times / 3


def listed(content: bytes) -> list[tuple[bytes, bytes]]:
    """Checksums and names, upper case or lower, the last line ended or not."""
    lines = content.removesuffix(b"\n").split(b"\n")
    return [(line[:64].lower(), line[64:]) for line in lines]


@pytest.mark.parametrize("damage", [flipped, cut])
@pytest.mark.parametrize("times", by_default([100], [100, FLIPS]))
def test_the_checksums_of_a_run(damage, times, flown, tmp_path):
    """Whatever is wrong with them, some file no longer fits."""
    folder, chance = shutil.copytree(flown, tmp_path / "run"), np.random.default_rng(1)
    content = (folder / SUMS).read_bytes()
    assert all(f"  {name}\n".encode() in content for name in RUN_FILES)
    for _ in range(times):
        damaged = damage(content, chance)
        (folder / SUMS).write_bytes(damaged)
        if listed(damaged) == listed(content):  # it says the same in other letters
            continue
        with pytest.raises(PolicyError, match=rf"run/\S+: .*({SUMS}|line|checksums|UTF-8)"):
            for name in RUN_FILES:
                read_run(folder, name)


@pytest.mark.thorough
@pytest.mark.parametrize("name", [*TRAINING_FILES, SUMS])
def test_a_file_of_a_training(name, learned, tmp_path):
    folder, chance = shutil.copytree(learned, tmp_path / "t"), np.random.default_rng(1)
    content = (folder / name).read_bytes()
    read_training(folder)
    for _ in range(FLIPS if name == SUMS else FEW):
        (folder / name).write_bytes(flipped(content, chance))
        try:
            read_training(folder)
        except PolicyError as error:
            assert str(folder) in str(error)
        else:  # of the checksums of the policy or the world, which a figure does not ask for
            assert name == SUMS


class TestAPolicyBesideChecksums:
    """One that has learned something else since is a policy file like any, but not this one."""

    @pytest.fixture
    def other(self, learned, tmp_path):
        folder = shutil.copytree(learned, tmp_path / "t")
        table = TableFile(folder / "policy.npz").table()
        (folder / "policy.npz").write_bytes(QTable(table.q + 1, table.about).to_bytes())
        return folder

    @pytest.mark.parametrize(
        "words", [("run", "case1", "--policy", "{}/policy.npz"), ("plot", "policy", "{}")]
    )
    def test_is_refused(self, words, other, capsys, monkeypatch):
        monkeypatch.chdir(other.parent)
        ended = runner(capsys, monkeypatch)(*(word.format(other) for word in words))
        ended.failed(4, f"{other}/policy.npz: the file has changed since it was written")
        assert ended.err.count("\n") == 1 and list(other.parent.iterdir()) == [other]

    def test_is_taken_where_they_are_gone_or_of_others(self, other):
        lines = (other / SUMS).read_text().splitlines(keepends=True)
        (other / SUMS).write_text("".join(line for line in lines if "policy" not in line))
        TableFile(other / "policy.npz").table()
        (other / SUMS).unlink()
        TableFile(other / "policy.npz").table()

    def test_a_whole_one_flies(self, learned):
        load_policy(str(learned / "policy.npz"))


@pytest.mark.parametrize("damage", [flipped, cut])
def test_a_policy(damage, learned, tmp_path):
    """Each member of the archive has a checksum; its headers have none, but say nothing else."""
    content, chance = (learned / "policy.npz").read_bytes(), np.random.default_rng(1)
    whole, file = TableFile(learned / "policy.npz").table(), tmp_path / "policy.npz"
    refused = 0
    for _ in range(3 * FLIPS):
        file.write_bytes(damage(content, chance))
        try:
            found = TableFile(file).table()
        except PolicyError as error:
            assert str(file) in str(error) and error.exit_code == 4
            refused += 1
        else:
            assert found.about == whole.about and np.array_equal(found.q, whole.q)
    assert refused > 2 * FLIPS


@pytest.mark.parametrize("damage", [flipped, cut])
def test_a_checkpoint(damage, learned, tmp_path):
    source = learned / "checkpoint.npz"
    content, chance = source.read_bytes(), np.random.default_rng(1)
    shape = TableFile(learned / "policy.npz").table().q.shape
    shape = (shape[0], 1, *shape[1:])
    whole, file = checkpoint.read(source, shape), tmp_path / "checkpoint.npz"
    for _ in range(FLIPS):
        file.write_bytes(damage(content, chance))
        try:
            checkpoint.identity(file)
            found = checkpoint.read(file, shape)
        except PolicyError as error:
            assert str(file) in str(error)
        else:
            assert checkpoint.to_bytes(found) == checkpoint.to_bytes(whole)


def test_a_row_of_a_sweep(tmp_path, capsys, monkeypatch):
    """A damaged row is made again, be it in a page or in what Parquet says about it."""
    from desim_uav.experiment.sweep.folder import SweepFolder
    from desim_uav.experiment.sweep.job import jobs
    from desim_uav.experiment.sweep.plan import SweepPlan, arms
    from desim_uav.shipped import scenario_path

    monkeypatch.chdir(tmp_path)
    command = runner(capsys, monkeypatch)
    flags = ("--policies", "random", "--seeds", 1, "--episodes", 1, "--warmup", 0, "-q")
    assert command("sweep", "tiny", *flags, "--out", "s").code == 0
    asked = SweepPlan(scenario_path("tiny"), [], ["random"], False, None, range(1), 1, 0)
    (job,), folder = jobs(asked, arms(asked, [])), SweepFolder(Path("s"), [])
    whole, chance = folder.rows([job]), np.random.default_rng(1)
    (file,) = Path("s/results").iterdir()
    content, damaged = file.read_bytes(), 0
    for _ in range(3 * FLIPS):
        file.write_bytes(flipped(content, chance))
        found = folder.rows([job])
        assert found in ({}, whole)
        damaged += not found
    assert damaged > FLIPS


class TestAChangedTable:
    """Who changes a table does as they like; our commands say that it is no longer the run's."""

    @pytest.fixture
    def changed(self, flown, tmp_path):
        folder = shutil.copytree(flown, tmp_path / "mine")
        requests = pd.read_parquet(folder / "requests.parquet")
        requests.assign(mine=1).to_parquet(folder / "requests.parquet", index=False)
        return folder

    @pytest.mark.parametrize(
        "words", [("qoe",), ("report",), ("replay", "-q"), ("compare",), ("plot", "services")]
    )
    def test_is_refused(self, words, changed, capsys, monkeypatch):
        ended = runner(capsys, monkeypatch)(*words, changed)
        said = (
            f"{changed}/requests.parquet: the file has changed since it was written (delete {SUMS}"
        )
        ended.failed(4, said)
        assert ended.err.count("\n") == 1

    def test_is_taken_where_that_is_wanted(self, changed, flown):
        (changed / SUMS).unlink()
        found, _ = read_summary(changed)
        assert found == read_summary(flown)[0] | {"run_dir": str(changed)}

    def test_or_where_its_checksum_is_written_anew(self, changed):
        files = [file for file in changed.iterdir() if file.name != SUMS]
        (changed / SUMS).write_text(of_files(files))
        assert read_summary(changed)[0]["episodes"] == 2

    def test_other_files_in_the_folder_are_nobodys_business(self, flown, tmp_path):
        folder = shutil.copytree(flown, tmp_path / "mine")
        (folder / "notes.txt").write_text("mine")
        write_replay(folder, show_progress=False)
        assert read_summary(folder)[0]["episodes"] == 2


def test_sha256sum_reads_the_checksums(flown, learned):
    if shutil.which("sha256sum") is None:
        pytest.skip("no sha256sum here")
    for folder in (flown, learned):
        subprocess.run(["sha256sum", "--check", "--strict", SUMS], cwd=folder, check=True)


@pytest.mark.parametrize("how", ["--binary", "upper case", "no newline", "./", "more", "other"])
def test_checksums_as_sha256sum_reads_them(how, flown, tmp_path):
    folder = shutil.copytree(flown, tmp_path / "run")
    content = (folder / SUMS).read_text()
    (folder / SUMS).write_text(
        {
            "--binary": content.replace("  ", " *"),
            "upper case": "".join(
                f"{line[:64].upper()}{line[64:]}" for line in content.splitlines(keepends=True)
            ),
            "no newline": content.rstrip("\n"),
            "./": content.replace("  ", "  ./"),
            "more": content + content.replace("  ", "  in/another/"),
            "other": content + "\\" + "0" * 64 + "  new\\nline\n",
        }[how]
    )
    for name in RUN_FILES:
        read_run(folder, name)
    (folder / "world.json").write_bytes((folder / "world.json").read_bytes() + b" ")
    with pytest.raises(PolicyError, match=r"world.json: the file has changed since"):
        read_run(folder, "world.json")


def test_a_table_nobody_has_a_checksum_of(flown, tmp_path):
    folder = shutil.copytree(flown, tmp_path / "run")
    lines = (folder / SUMS).read_text().splitlines(keepends=True)
    (folder / SUMS).write_text("".join(line for line in lines if "steps" not in line))
    with pytest.raises(PolicyError, match=f"steps.parquet: {SUMS} does not list this file"):
        Run(folder).table("steps")
