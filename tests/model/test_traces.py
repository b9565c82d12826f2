"""Measured walks and requests: what a CSV file may be wrong in."""

from __future__ import annotations

from pathlib import Path

import pytest

from desim_uav.model import traces
from desim_uav.model.traces import index, quantity, read_table

COLUMNS = {"user": index, "t_s": quantity}


def told(file: Path, content: bytes) -> str:
    """What is said of a file with this content."""
    file.write_bytes(content)
    with pytest.raises(ValueError, match=str(file)) as refused:
        read_table(file, COLUMNS)
    return str(refused.value).removeprefix(str(file))


def test_rows_have_their_values_and_line(tmp_path: Path):
    file = tmp_path / "walks.csv"
    file.write_text("\ufefft_s,other,user\n0.5,x,1\n\n2,y,0\n", encoding="utf-8")
    assert read_table(file, COLUMNS) == [(1, 0.5, 2), (0, 2.0, 4)]


def test_a_file_that_has_changed_is_read_again(tmp_path: Path):
    file = tmp_path / "walks.csv"
    file.write_text("user,t_s\n1,0\n", encoding="utf-8")
    assert read_table(file, COLUMNS) == [(1, 0.0, 2)]
    file.write_text("user,t_s\n1,0\n2,5\n", encoding="utf-8")
    assert read_table(file, COLUMNS) == [(1, 0.0, 2), (2, 5.0, 3)]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"user\n1\n", ":1: no column 't_s'; expected the columns user, t_s"),
        (b"user,t_s\n1,\xff\n", ": it is not UTF-8 text"),
        (b'user,t_s\n1,"2"3\n', ":2: it is not CSV: ',' expected after '\"'"),
        (b"user,t_s\n1,soon\n", ":2: t_s: 'soon': must be a number"),
        (b"user,t_s\n1.5,0\n", ":2: user: '1.5': must be a whole number"),
        (b"user,t_s\n" + b"9" * 5000 + b",0\n", "…: must be a whole number"),
        (b"user,t_s\n1\n", ":2: t_s: '': must be a number"),
        (b"user,t_s\n-1,0\n", ":2: user"),
        (b"user,t_s\n1,nan\n", ":2: t_s"),
        (b"user,t_s\n1,1e300\n", ":2: t_s: '1e300': must be at most 1,000,000,000"),
        (b"user,t_s\n9999999999,0\n", ":2: user: '9999999999': must be at most 1,000,000,000"),
    ],
)
def test_what_is_wrong_is_told_with_its_file(tmp_path: Path, content: bytes, words: str):
    assert words in told(tmp_path / "walks.csv", content)


def test_no_file(tmp_path: Path):
    with pytest.raises(ValueError, match=r"walks\.csv: No such file"):
        read_table(tmp_path / "walks.csv", COLUMNS)


def test_a_folder(tmp_path: Path):
    with pytest.raises(ValueError, match="Is a directory"):
        read_table(tmp_path, COLUMNS)


def test_larger_than_it_may_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(traces, "MAX_BYTES", 2**20)
    assert told(tmp_path / "walks.csv", b"x" * (2**20 + 1)) == ": it is larger than 1 MiB"
