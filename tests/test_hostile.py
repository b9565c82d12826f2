"""Hostile and foolish input: one clear error and its exit code, soon, in little memory.

Each table is (name, input, exit code, part of the message). Whatever it is, a case has LONGEST_S
seconds of processor time and MOST_MIB of memory, leaves no traceback, and writes nothing.
"""

from __future__ import annotations

import io
import json
import os
import pickle
import resource
import shutil
import signal
import struct
import sys
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from desim_uav import array_file, cli
from desim_uav.checksums import SUMS, of_files
from desim_uav.cli.ending import complain
from desim_uav.errors import DesimError
from desim_uav.policies.tabular import Greedy, QTable, TableFile, described
from desim_uav.scenario.load import load, loads
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.run_to_folder import run_to_folder

LONGEST_S, MOST_MIB = 5.0, 512


@pytest.fixture(scope="module")
def table() -> QTable:
    """A table that fits the scenario tiny."""
    world = build_world(load(scenario_path("tiny")), 0)
    features = described(world.scenario.observation.features(world.facts))
    states = int(np.prod([high + 1 for _, high in features]))
    about = {
        "features": features,
        "actions": [action.name.lower() for action in world.actions],
        "scenario": "tiny",
        "scenario_hash": "0" * 64,
        "world_seed": 0,
        "world_hash": "0" * 64,
        "algorithm": "q_learning",
        "seed": 0,
        "episodes": 1,
    }
    drones = world.scenario.drones.count
    return QTable(np.zeros((drones, states, len(world.actions)), np.float32), about)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder, without checksums: whoever changes it could change them too."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    scenario = load(scenario_path("case8"), ["users.count=12", "episode.steps=6"])
    options = {"warmup": 0, "keep_events": True, "command": []}
    run_to_folder(scenario, "baseline", episodes=2, out=folder, **options)
    (folder / SUMS).unlink()
    return folder


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    """Give the command line its words: how it ended, if within the limits and with one error."""
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    monkeypatch.setenv("COLUMNS", "300")

    def tell(*words: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["desim-uav", *map(str, words)])
        before, began = _most_mib(), time.process_time()
        with pytest.raises(SystemExit) as end:
            cli.main()
        took_s, more_mib = time.process_time() - began, _most_mib() - before
        out, err = capsys.readouterr()
        assert took_s < LONGEST_S and more_mib < MOST_MIB, (took_s, more_mib)
        assert "Traceback" not in err and out == ""
        assert list(here.iterdir()) == [], "something was written"
        return int(end.value.code or 0), " ".join(err.replace("│", " ").split())

    return tell


def _most_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


# ---- policy files

Damage = Callable[[QTable], bytes]


class Trap:
    """What must not be unpickled."""

    def __reduce__(self) -> Any:
        return os.mkdir, ("sprung",)


def packed(table: QTable, q: Any = None, **about: Any) -> bytes:
    """A policy file with some of its contents changed."""
    content = {**table.about, "format": 1, **about}
    return array_file.pack(content, q=table.q if q is None else q)


def without(key: str) -> Damage:
    def made(table: QTable) -> bytes:
        about = {name: value for name, value in table.about.items() if name != key}
        return array_file.pack({**about, "format": 1}, q=table.q)

    return made


def members(table: QTable, **content: bytes | None) -> bytes:
    """The file with members (their names with _ for .) in place of its own, None: left out."""
    with zipfile.ZipFile(io.BytesIO(packed(table))) as archive:
        found: dict[str, bytes | None] = {name: archive.read(name) for name in archive.namelist()}
    found.update(content)
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, part in found.items():
            if part is not None:
                archive.writestr(name, part)
    return file.getvalue()


def npy(
    shape: object, dtype: str = "<f4", data: bytes = b"", version: bytes = b"\x01\x00"
) -> bytes:
    """An array's file whose header says whatever it likes."""
    header = f"{{'descr': {dtype!r}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    return b"\x93NUMPY" + version + struct.pack("<H", len(header)) + header + data


def longest() -> bytes:
    """A header of 256 MiB, which version 2 of the format allows."""
    return b"\x93NUMPY\x02\x00" + struct.pack("<I", 2**28) + bytes(2**28)


def lying(table: QTable) -> bytes:
    """The directory says the table is of 3 GiB, and so does its header."""
    content = bytearray(members(table, **{"q.npy": npy((3, 2**26, 4))}))
    at = content.rfind(b"PK\x01\x02", 0, content.rfind(b"q.npy"))
    content[at + 24 : at + 28] = struct.pack("<I", 128 + 3 * 2**26 * 4 * 4 % 2**32)
    return bytes(content)


def bomb(table: QTable) -> bytes:
    """768 MiB of zeros, as its directory, its header and its text say: the table of a wide map."""
    actions, states = len(table.about["actions"]), 2**20
    drones = 768 * 2**20 // (states * actions * 4)
    size = drones * states * actions * 4
    header = npy((drones, states, actions))
    squeeze = zlib.compressobj(1, zlib.DEFLATED, -15)
    zeros, body = bytes(2**24), squeeze.compress(header)
    crc = zlib.crc32(header)
    for begin in range(0, size, len(zeros)):
        part = zeros[: size - begin]
        body += squeeze.compress(part)
        crc = zlib.crc32(part, crc)
    body += squeeze.flush()
    about = {**table.about, "format": 1, "features": [["cell_x", states - 1]]}
    with zipfile.ZipFile(io.BytesIO(packed(table, **about))) as archive:
        text = archive.read("about.npy")
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("about.npy", text)
        archive.writestr("q.npy", body)
    content = bytearray(file.getvalue())
    whole = len(header) + size
    for signature, method, sizes in ((b"PK\x03\x04", 8, 14), (b"PK\x01\x02", 10, 16)):
        at = content.rfind(signature, 0, content.rfind(b"q.npy") if method == 10 else None)
        if method == 8:
            at = content.find(b"q.npy") - 30
        content[at + method : at + method + 2] = struct.pack("<H", zipfile.ZIP_DEFLATED)
        content[at + sizes : at + sizes + 12] = struct.pack("<III", crc, len(body), whole)
    return bytes(content)


def flipped(table: QTable) -> bytes:
    content = bytearray(packed(table, q=np.random.default_rng(0).random(table.q.shape, np.float32)))
    content[len(content) // 2] ^= 0x20
    return bytes(content)


def said(text: bytes) -> Damage:
    """The file says this of itself."""
    return lambda t: members(t, **{"about.npy": npy((len(text),), "|u1", text)})


POLICIES: list[tuple[str, Damage, str]] = [
    ("empty", lambda t: b"", "not a readable policy file"),
    ("text", lambda t: b"q = 1\n", "not a readable policy file"),
    ("a pickle", lambda t: pickle.dumps(Trap()), "not a readable policy file"),
    ("an npy file", lambda t: npy((3,), data=bytes(12)), "not a readable policy file"),
    ("only a signature", lambda t: b"PK\x03\x04", "not a readable policy file"),
    ("an empty archive", lambda t: b"PK\x05\x06" + bytes(18), "it must hold exactly"),
    ("half of it", lambda t: packed(t)[: len(packed(t)) // 2], "not a readable policy file"),
    ("all but its end", lambda t: packed(t)[:-10], "not a readable policy file"),
    ("a bit flipped", flipped, "not a readable policy file"),
    ("a member more", lambda t: members(t, **{"r.npy": b"x"}), "it must hold exactly"),
    ("out of its folder", lambda t: members(t, **{"../q.npy": b"x"}), "it must hold exactly"),
    ("from the root", lambda t: members(t, **{"/etc/q.npy": b"x"}), "it must hold exactly"),
    ("no table", lambda t: members(t, **{"q.npy": None}), "it must hold exactly"),
    ("no text", lambda t: members(t, **{"about.npy": None}), "it must hold exactly"),
    ("a pickled member", lambda t: members(t, **{"q.npy": pickle.dumps(Trap())}), "not a readable"),
    ("an array of objects", lambda t: members(t, **{"q.npy": npy((1,), "|O")}), "allow_pickle"),
    ("a text of objects", lambda t: members(t, **{"about.npy": npy((1,), "|O")}), "allow_pickle"),
    (
        "a terabyte",
        lambda t: members(t, **{"q.npy": npy((10**6, 10**6))}),
        "but its header announces",
    ),
    ("below zero", lambda t: members(t, **{"q.npy": npy((-1, 2, 3))}), "negative length"),
    (
        "more than it says",
        lambda t: members(t, **{"q.npy": npy((1,), data=bytes(99))}),
        "bytes, but its header",
    ),
    (
        "less than it says",
        lambda t: members(t, **{"q.npy": npy((9,), data=bytes(4))}),
        "bytes, but its header",
    ),
    ("a directory that lies", lying, "but its description has"),
    ("a bomb", bomb, "drones"),
    ("a shape of text", lambda t: members(t, **{"q.npy": npy("'x'")}), "not a readable"),
    ("a shape of code", lambda t: members(t, **{"q.npy": npy("exit()")}), "not a readable"),
    ("npy of the future", lambda t: members(t, **{"q.npy": npy((1,), version=b"\x09\x00")}), "npy"),
    ("two dimensions", lambda t: packed(t, t.q[0]), "not float32 of shape"),
    ("no dimension", lambda t: packed(t, np.float32(1.0)), "not float32 of shape ()"),
    ("float64", lambda t: packed(t, t.q.astype(np.float64)), "not float64"),
    ("whole numbers", lambda t: packed(t, t.q.astype(np.int32)), "not int32"),
    ("complex", lambda t: packed(t, t.q.astype(np.complex64)), "not complex64"),
    ("words", lambda t: packed(t, t.q.astype("<U4")), "not <U4"),
    ("bytes the other way", lambda t: packed(t, t.q.astype(">f4")), "not >f4"),
    ("nan", lambda t: packed(t, np.full_like(t.q, np.nan)), "not finite"),
    ("infinity", lambda t: packed(t, np.full_like(t.q, np.inf)), "not finite"),
    ("a state less", lambda t: packed(t, t.q[:, 1:]), "but its description has"),
    ("an action less", lambda t: packed(t, t.q[:, :, 1:]), "but its description has"),
    ("a drone more", lambda t: packed(t, np.concatenate([t.q, t.q])), "the scenario has"),
    ("no drone", lambda t: packed(t, t.q[:0]), "the scenario has"),
    ("other actions", lambda t: packed(t, actions=t.about["actions"][::-1]), "the scenario has"),
    (
        "a newer format",
        lambda t: packed(t, format=2),
        "its format is 2; this version of desim-uav reads format 1",
    ),
    ("a format of text", lambda t: packed(t, format="1"), "its format is '1'"),
    ("no format", lambda t: array_file.pack(t.about, q=t.q), "its format is None"),
    ("no features", without("features"), "its description has no valid 'features'"),
    ("no actions", without("actions"), "its description has no valid 'actions'"),
    ("no hash", without("world_hash"), "its description has no valid 'world_hash'"),
    (
        "features of text",
        lambda t: packed(t, features="x"),
        "its description has no valid 'features'",
    ),
    ("half a feature", lambda t: packed(t, features=[["x"]]), "features must be"),
    ("a feature of text", lambda t: packed(t, features=[["x", "9"]]), "features must be"),
    (
        "states without end",
        lambda t: packed(t, features=[["x", 10**30]]),
        "but its description has",
    ),
    ("states below zero", lambda t: packed(t, features=[["x", -5]]), "but its description has"),
    ("a seed below zero", lambda t: packed(t, world_seed=-5), "world_seed: -5: must be"),
    ("a seed too large", lambda t: packed(t, world_seed=2**63), "world_seed: "),
    (
        "a long format",
        lambda t: packed(t, format="x" * 2**20),
        "x…; this version of desim-uav reads format 1",
    ),
    (
        "a header of any length",
        lambda t: members(t, **{"q.npy": longest()}),
        "npy format is (2, 0)",
    ),
    (
        "a seed of text",
        lambda t: packed(t, world_seed="0"),
        "its description has no valid 'world_seed'",
    ),
    ("no JSON", said(b"{'format': 1}"), "not a readable policy file"),
    ("JSON of nothing", said(b"null"), "about must be a mapping"),
    ("a list", said(b"[1]"), "about must be a mapping"),
    ("no UTF-8", said(b"\xff\xfe"), "not a readable policy file"),
    ("deep", said(b"[" * 100_000), "not a readable policy file"),
    ("a number without end", said(b"1" * 100_000), "not a readable policy file"),
    ("talkative", said(b" " * (2**24 + 1)), "its description is larger than 16 MiB"),
]

LARGE = ("a bomb", "a header of any length")
"""The policy files that take seconds to make and to refuse."""


@pytest.mark.parametrize(
    ("damage", "part"),
    [
        pytest.param(*row[1:], id=row[0], marks=[pytest.mark.thorough] if row[0] in LARGE else [])
        for row in POLICIES
    ],
)
def test_a_policy_file(damage: Damage, part: str, table: QTable, told, tmp_path: Path):
    file = tmp_path / "policy.npz"
    file.write_bytes(damage(table))
    code, message = told("run", "tiny", "--policy", file)
    assert code == 4 and str(file) in message and part in message, message
    assert message.count("desim-uav:") == 1


def test_a_name_that_forges_a_line(table: QTable, told, tmp_path: Path):
    file = tmp_path / "policy.npz"
    file.write_bytes(packed(table, actions=["\x1b[2J\rdesim-uav: all is well"] * 5))
    code, message = told("run", "tiny", "--policy", file)
    assert code == 4 and message.isprintable() and message.count("desim-uav: ") < 20
    file.write_bytes(packed(table, scenario="\x1b[2J\ndesim-uav: all is well" + "." * 1000))
    notice = Greedy(str(file)).notice(build_world(load(scenario_path("tiny")), 0))
    assert notice.isprintable() and len(notice) < 400


def test_a_complaint_is_a_line_for_each_problem(capsys: pytest.CaptureFixture[str]):
    complain("one\x1b[2J\rtwo\x85three\nfour")
    assert capsys.readouterr().err == "\n".join(
        ["desim-uav: one\\x1b[2J\\rtwo\\x85three", "desim-uav: four", ""]
    )


def test_the_table_itself_is_taken(table: QTable, tmp_path: Path):
    """What is damaged above flies when whole."""
    file = tmp_path / "policy.npz"
    file.write_bytes(packed(table))
    assert TableFile(file).table().q.shape == table.q.shape


FILES: list[tuple[str, Callable[[Path], None], str]] = [
    ("not there", lambda p: None, "No such file"),
    ("a folder", lambda p: p.mkdir(), "it is not a regular file"),
    ("a pipe nobody writes to", os.mkfifo, "it is not a regular file"),
    ("a link to itself", lambda p: p.symlink_to(p), "not a readable policy file"),
    ("a link to zeros", lambda p: p.symlink_to("/dev/zero"), "it is not a regular file"),
]


@pytest.mark.parametrize(
    ("make", "part"), [row[1:] for row in FILES], ids=[row[0] for row in FILES]
)
def test_what_is_no_file(make: Callable[[Path], None], part: str, told, tmp_path: Path):
    file = tmp_path / "policy.npz"
    make(file)
    code, message = told("run", "tiny", "--policy", file)
    assert code == 4 and str(file) in message and part in message, message


NOT_REGULAR: list[tuple[str, Callable[[Path], None]]] = [
    ("a pipe nobody writes to", os.mkfifo),
    ("a link to zeros", lambda p: p.symlink_to("/dev/zero")),
    ("a file of 3 GiB", lambda p: os.truncate(os.open(p, os.O_CREAT | os.O_WRONLY), 3 * 2**30)),
]


@pytest.mark.parametrize("make", [row[1] for row in NOT_REGULAR], ids=[r[0] for r in NOT_REGULAR])
@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("run", "{file}"), 3),
        (("validate", "{file}"), 3),
        (("run", "tiny", "-S", "users.mobility={{kind: trace, file: {file}}}"), 3),
        (("run", "tiny", "-S", "demand={{kind: trace, file: {file}}}"), 3),
        (("run", "tiny", "--policy", "script:{file}"), 4),
        (("run", "tiny", "--policy", "sb3:{file}"), 4),
    ],
    ids=lambda given: " ".join(given) if isinstance(given, tuple) else str(given),
)
def test_only_regular_files_of_a_bounded_size_are_read(
    words: tuple[str, ...], code: int, make: Callable[[Path], None], told, tmp_path: Path
):
    file = tmp_path / "given.yaml"
    make(file)
    found, message = told(*(word.format(file=file) for word in words))
    assert found == code and str(file) in message, message
    assert "it is not a regular file" in message or "it is larger than" in message, message


@pytest.mark.parametrize("words", [("qoe",), ("qoe", "--by", "service")])
def test_what_a_manifest_says_moves_no_cursor(words: tuple[str, ...], log: Path, tmp_path: Path):
    folder = shutil.copytree(log, tmp_path / "run")
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["scenario"] = manifest["policy"] = "\x1b[2J[bold]mine[/bold]\x9b1A"
    (folder / "manifest.json").write_text(json.dumps(manifest))
    ended = CliRunner().invoke(cli.app, [words[0], str(folder), *words[1:]])
    assert ended.exit_code == 0, ended.output
    assert "\x1b[2J" not in ended.output and "\x9b" not in ended.output
    assert len(words) > 1 or "\\x1b[2J[bold]mine[/bold]\\x9b1A" in ended.output


# ---- logs

Change = Callable[[pd.DataFrame], pd.DataFrame]


def put(**values: Any) -> Change:
    """Into the first row."""

    def changed(frame: pd.DataFrame) -> pd.DataFrame:
        frame = frame.copy()
        for name, value in values.items():
            frame.loc[frame.index[0], name] = value
        return frame

    return changed


LOGS: list[tuple[str, str, Change, str]] = [
    ("a column less", "requests", lambda f: f.drop(columns="served_s"), "no column 'served_s'"),
    ("a column twice", "requests", lambda f: f, "no column 'user'"),
    ("times of text", "requests", lambda f: f.astype({"t_end_s": str}), "column 't_end_s' holds"),
    ("users that are no number", "requests", lambda f: f.astype({"user": float}), "column 'user'"),
    ("no user", "requests", lambda f: f.astype({"user": "Int64"}).assign(user=pd.NA), "'user'"),
    ("infinite", "requests", put(served_s=np.inf), "infinite"),
    ("the same request twice", "requests", put(request_id=1), "occurs twice"),
    ("all twice", "requests", lambda f: pd.concat([f, f]), "occurs twice"),
    ("more served than asked for", "requests", put(served_s=1e6), "served_s exceeds"),
    ("served below zero", "requests", put(served_s=-1.0), "served_s is negative"),
    ("ended before it began", "requests", put(t_end_s=-9.0, t_request_s=0.0), "is before"),
    ("an outcome there is not", "requests", put(outcome="lost"), "outcome is not one of"),
    ("a request less", "requests", lambda f: f.iloc[1:], "not of one run"),
    ("another episode's", "requests", put(episode=7, request_id=999), "not of one run"),
    ("an episode less", "episodes", lambda f: f.iloc[1:], "not of one run"),
    ("no crashes", "episodes", lambda f: f.drop(columns="crashes"), "no column 'crashes'"),
    ("crashes of text", "episodes", lambda f: f.astype({"crashes": str}), "column 'crashes'"),
]


@pytest.mark.parametrize(
    ("name", "change", "part"), [row[1:] for row in LOGS], ids=[row[0] for row in LOGS]
)
def test_a_log(name: str, change: Change, part: str, log: Path, told, tmp_path: Path):
    folder = shutil.copytree(log, tmp_path / "run")
    file = folder / f"{name}.parquet"
    frame = change(pd.read_parquet(file))
    if part == "no column 'user'":
        import pyarrow as pa
        import pyarrow.parquet as pq

        whole = pa.Table.from_pandas(frame, preserve_index=False)
        pq.write_table(whole.append_column("user", whole["user"]), file)
    else:
        frame.to_parquet(file, index=False)
    code, message = told("qoe", folder)
    assert code == 4 and str(folder) in message and part in message, message


BROKEN: list[tuple[str, str, Callable[[bytes], bytes], str]] = [
    ("empty", "requests.parquet", lambda c: b"", "not a readable Parquet file"),
    ("no footer", "requests.parquet", lambda c: c[:-8], "not a readable Parquet file"),
    ("half", "requests.parquet", lambda c: c[: len(c) // 2], "not a readable Parquet file"),
    (
        "a footer without end",
        "requests.parquet",
        lambda c: c[:-8] + b"\xff\xff\xff\x7fPAR1",
        "not a",
    ),
    ("zeros", "episodes.parquet", lambda c: bytes(len(c)), "not a readable Parquet file"),
    ("a pickle", "requests.parquet", lambda c: pickle.dumps(Trap()), "not a readable Parquet"),
    ("no JSON", "manifest.json", lambda c: b"{", "not a readable JSON file"),
    ("JSON of nothing", "manifest.json", lambda c: b"null", "not the manifest of a run"),
    ("no seed", "manifest.json", lambda c: c.replace(b'"seed"', b'"sede"'), "seed: missing"),
    ("deep", "manifest.json", lambda c: b"[" * 100_000, "not a readable JSON file"),
    ("no UTF-8", "manifest.json", lambda c: b"\xff" + c, "JSON file: it is not UTF-8 text"),
]


@pytest.mark.parametrize(
    ("name", "damage", "part"),
    [row[1:] for row in BROKEN],
    ids=[f"{row[1]}-{row[0]}" for row in BROKEN],
)
def test_a_broken_log(
    name: str, damage: Callable[[bytes], bytes], part: str, log: Path, told, tmp_path: Path
):
    folder = shutil.copytree(log, tmp_path / "run")
    file = folder / name
    file.write_bytes(damage(file.read_bytes()))
    code, message = told("qoe", folder)
    assert code == 4 and str(file) in message and part in message, message


NO_FILES: list[tuple[str, Callable[[Path], None]]] = [
    ("a pipe nobody writes to", os.mkfifo),
    ("a link to zeros", lambda p: p.symlink_to("/dev/zero")),
    ("a folder", lambda p: p.mkdir()),
]


@pytest.mark.parametrize("sums", [None, "", "{}  {}\n"], ids=["no sums", "empty sums", "sums"])
@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("plot", "visits"), "scenario.yaml"),
        (("replay",), "manifest.json"),
        (("qoe",), "manifest.json"),
        (("plot", "snapshot"), "world.json"),
        (("qoe",), "requests.parquet"),
        (("replay",), "users.parquet"),
    ],
    ids=lambda found: found if isinstance(found, str) else " ".join(found),
)
@pytest.mark.parametrize("make", [row[1] for row in NO_FILES], ids=[row[0] for row in NO_FILES])
def test_what_is_no_file_of_a_run(
    make: Callable[[Path], None],
    words: tuple[str, ...],
    name: str,
    sums: str | None,
    log: Path,
    told,
    tmp_path: Path,
):
    folder = shutil.copytree(log, tmp_path / "run")
    if sums is not None:
        files = [file for file in folder.iterdir() if sums and file.name != name]
        (folder / SUMS).write_text(of_files(files) + sums.format("0" * 64, name))
    (folder / name).unlink()
    make(folder / name)
    with soon():
        code, message = told(*words, folder)
    assert code == 4 and str(folder) in message, message
    assert name in message or sums == "", message
    assert message.count("desim-uav:") == 1


@pytest.mark.parametrize("make", [row[1] for row in NO_FILES], ids=[row[0] for row in NO_FILES])
def test_what_is_no_list_of_checksums(
    make: Callable[[Path], None], log: Path, told, tmp_path: Path
):
    folder = shutil.copytree(log, tmp_path / "run")
    make(folder / SUMS)
    with soon():
        code, message = told("qoe", folder)
    assert code == 4 and f"{folder / SUMS}: " in message, message


@contextmanager
def soon() -> Iterator[None]:
    """Who waits for what never comes takes no processor time."""

    def too_long(*_: object) -> None:
        raise AssertionError("it does not end")

    before = signal.signal(signal.SIGALRM, too_long)
    signal.alarm(20)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


# ---- command lines

WORDS: list[tuple[str, int, str]] = [
    ("rnu tiny", 2, "No such command 'rnu'"),
    ("Run tiny", 2, "No such command 'Run'"),
    ("--jsn", 2, "No such option"),
    ("scenarios --show tny", 3, "did you mean 'tiny'?"),
    ("scenarios extra", 2, "unexpected extra argument"),
    ("validate", 2, "Missing argument"),
    ("validate nothing.yaml", 3, "no such file"),
    ("schema case8", 2, "unexpected extra argument"),
    ("run", 2, "Missing argument"),
    ("run tiny --episodes 0", 2, "--episodes"),
    ("run tiny --episodes 1e3", 2, "'1e3' is not a whole number from 1 to 1000000"),
    ("plot map nothing --minute soon", 2, "'soon' is not a number from 0 to"),
    ("run tiny --seed -1", 2, "--seed"),
    ("run tiny --engine simpy", 2, "allowed: auto, des, batch"),
    ("run tiny --policy basline", 4, "did you mean 'baseline'?"),
    ("run tiny --policy no.such:Thing", 4, "ModuleNotFoundError"),
    ("run tiny --out /dev/null/x", 2, "cannot write to"),
    ("run tiny --out /dev/null", 2, "is not a folder"),
    ("run tiny -S users.count=10**9", 3, "users.count"),
    ("run tiny -S users.count=-1", 3, "must be at least"),
    ("run tiny -S map.cells=[1000000000,1]", 3, "map.cells"),
    ("run tiny -S drones.cuont=2", 3, "did you mean 'count'?"),
    ("run tiny -S seed=!!python/object:os.system", 3, "seed"),
    ("run tiny -S seed=&a", 3, "seed"),
    ("train tiny --algorithm q_lerning", 3, "did you mean 'q_learning'?"),
    ("train tiny --episodes 0", 2, "--episodes"),
    ("train tiny --checkpoint-every 0", 2, "--checkpoint-every"),
    ("train tiny --seed x", 2, "--seed"),
    ("optimum case8 --seeds 0", 2, "--seeds"),
    ("optimum case8 -S drones.battery.on_crash=end_episode", 2, "drones.battery.on_crash"),
    ("optimum nothing", 3, "neither a file nor a shipped scenario"),
    ("reproduce --cases 0", 2, "--cases"),
    ("reproduce --cases 9-1", 2, "--cases"),
    ("reproduce --cases all", 2, "--cases"),
    ("reproduce --seeds 0", 2, "--seeds"),
    ("reproduce --preset papre", 2, "allowed: default, paper, both"),
    ("reproduce --preset paper --check", 2, "--check"),
    ("reproduce -j 0", 2, "-j"),
    ("qoe", 2, "Missing argument"),
    ("qoe nothing", 4, "no such run folder"),
    ("qoe nothing --by srevice", 2, "did you mean 'service'?"),
    ("compare", 2, "Missing argument"),
    ("compare tiny", 4, "tiny"),
    ("compare tiny --policies ,", 2, "a name is empty"),
    ("compare tiny --policies hover,hover", 2, "is given twice"),
    ("compare tiny --policies hover --seeds 0", 2, "--seeds"),
    ("compare nothing nothing", 4, "no such run folder"),
    ("compare nothing --seeds 3", 2, "--seeds goes with a scenario"),
    ("replay nothing", 4, "no such run folder"),
    ("replay", 2, "Missing argument"),
    ("report nothing", 4, "no such run folder"),
    ("report", 2, "Missing argument"),
    ("plot", 2, "Missing argument"),
    ("plot batery nothing", 2, "did you mean 'battery'?"),
    ("plot battery nothing", 4, "nothing"),
    ("plot battery nothing -o x.bmp", 2, "x.bmp"),
    ("plot policy nothing.npz", 4, "nothing.npz"),
    ("video nothing --gif x.gif", 4, "nothing"),
    ("video nothing", 2, "--gif"),
    ("video nothing --gif new/deep/x.gif", 4, "nothing"),
    ("plot services nothing -o new/x.png", 4, "nothing"),
    ("report nothing --out new/x.html", 4, "nothing"),
    ("replay nothing --html new/x.html", 4, "nothing"),
    ("compare nothing nothing --out new/x.csv", 4, "nothing"),
    ("doctor --fix", 2, "No such option"),
]


@pytest.mark.parametrize(("words", "code", "part"), WORDS, ids=[row[0] for row in WORDS])
def test_a_command_line(words: str, code: int, part: str, told):
    found, message = told(*words.split())
    assert found == code and part in message, message


ENVIRONMENT: list[tuple[str, str, str]] = [
    ("NUMBA_NUM_THREADS", "abc", "must be a whole number from 1 on"),
    ("NUMBA_NUM_THREADS", "0", "must be a whole number from 1 on"),
    ("NUMBA_NUM_THREADS", "-3", "must be a whole number from 1 on"),
    ("NUMBA_DISABLE_JIT", "1", "unset it"),
]


@pytest.mark.parametrize(("name", "value", "part"), ENVIRONMENT)
def test_an_environment(name: str, value: str, part: str, told, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(name, value)
    code, message = told("run", "tiny")
    assert code == 2 and f"{name}" in message and part in message, message


# ---- whatever comes

TEXTS = st.one_of(
    st.text(max_size=200),
    st.text("abc:-[]{}#&*!|>'\"%@`\n\t 0123456789.eE+", max_size=200),
    st.lists(
        st.sampled_from(
            [
                *(
                    "name: x",
                    "seed: 1",
                    "drones: {count: 2}",
                    "users:",
                    "  count: 3",
                    "map: {cells: [4,",
                ),
                *(
                    "  4]}",
                    "demand: {kind: dynamic}",
                    "- a",
                    "? b",
                    "<<: *x",
                    "&x",
                    "!!int",
                    "...",
                    "---",
                ),
                *(
                    "reward: {kind: coverage}",
                    "learning: {alpha: .nan}",
                    "episode: {steps: 1e3}",
                    "\t",
                    "'",
                ),
            ]
        ),
        max_size=12,
    ).map("\n".join),
)


def read_scenario(text: str) -> None:
    try:
        scenario = loads(text)
    except DesimError as error:
        assert str(error).strip() and error.exit_code == 3
    else:
        assert json.dumps(scenario.model_dump(mode="json"), default=str)


def read_policy(content: bytes, folder: Path) -> None:
    file = folder / "fuzzed.npz"
    file.write_bytes(content)
    try:
        TableFile(file).table()
    except DesimError as error:
        assert str(file) in str(error) and error.exit_code == 4


@st.composite
def damaged(draw: st.DrawFn) -> Callable[[bytes], bytes]:
    """Some bytes changed, cut out or put in."""
    edits = draw(
        st.lists(st.tuples(st.floats(0, 1), st.integers(0, 3), st.binary(max_size=8)), max_size=4)
    )

    def done(content: bytes) -> bytes:
        for where, cut, put_in in edits:
            at = int(where * len(content))
            content = content[:at] + put_in + content[at + cut :]
        return content

    return done


FUZZED = settings(
    deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
AT_LENGTH = settings(FUZZED, max_examples=10_000)


@FUZZED
@given(text=TEXTS)
def test_any_scenario(text: str):
    read_scenario(text)


@FUZZED
@given(change=damaged(), other=st.binary(max_size=300))
def test_any_policy(change: Callable[[bytes], bytes], other: bytes, table: QTable, tmp_path: Path):
    read_policy(change(packed(table)), tmp_path)
    read_policy(other, tmp_path)


@pytest.mark.slow
@AT_LENGTH
@given(text=TEXTS)
def test_any_scenario_at_length(text: str):
    read_scenario(text)


@pytest.mark.slow
@AT_LENGTH
@given(change=damaged(), other=st.binary(max_size=300))
def test_any_policy_at_length(
    change: Callable[[bytes], bytes], other: bytes, table: QTable, tmp_path: Path
):
    read_policy(change(packed(table)), tmp_path)
    read_policy(other, tmp_path)
