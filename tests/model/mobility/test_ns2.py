"""Movements of ns-2, in files that nobody has checked before."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from desim_uav.model.mobility.ns2 import Node, read_ns2
from desim_uav.model.mobility.recorded_walks import Trace
from desim_uav.model.mobility.walks import Area
from desim_uav.model.random.streams import Purpose, Streams

US = 1_000_000
MOVES = """\
#
# nodes: 2, max time: 100.00
set val(x) 500
$node_(1) set X_ 10.0
$node_(1) set Y_ 20.0
$node_(1) set Z_ 0.000000000000
$node_(0) set X_ 5
$node_(0) set Y_ 5
$god_ set-dist 0 1 2
$ns_ at 0.0 "$node_(0) setdest 35.0 45.0 5.0"
$ns_ at 2.0 "$node_(1) setdest 10.0 60.0 2.0"
$ns_ at 4.0 "$node_(0) setdest 17.0 61.0 10.0"
$ns_ at 12.0 "$node_(1) setdest 40.0 40.0 0.0"
$ns_ at 12.0 "$god_ set-dist 0 1 1"
"""


def file_of(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "moves.tcl"
    file.write_text(text, encoding="utf-8")
    return file


def test_way_points_with_their_lines(tmp_path: Path):
    """Node 0 turns on its way, at (17, 21); node 1 waits for 2 s and is stopped half way."""
    assert read_ns2(file_of(tmp_path, MOVES)) == [
        Node(0, 0.0, 5.0, 5.0, 7),
        Node(0, 4.0, 17.0, 21.0, 12),
        Node(0, 8.0, 17.0, 61.0, 12),
        Node(1, 0.0, 10.0, 20.0, 4),
        Node(1, 2.0, 10.0, 20.0, 11),
        Node(1, 12.0, 10.0, 40.0, 13),
    ]


@pytest.mark.parametrize("form", ["auto", "ns2"])
def test_walks(tmp_path: Path, form: str):
    trace = Trace(file_of(tmp_path, MOVES), form)  # type: ignore[arg-type]
    area = Area(100.0, 100.0)
    walks = trace.walks(np.full((3, 2), 7.0), Streams(0, Purpose.MOBILITY), area, 60 * US)
    assert walks.offsets.tolist() == [0, 3, 6, 7]
    assert walks.legs.tolist() == [
        (0, 5, 5, 3, 4),
        (4 * US, 17, 21, 0, 10),
        (8 * US, 17, 61, 0, 0),
        (0, 10, 20, 0, 0),
        (2 * US, 10, 20, 0, 2),
        (12 * US, 10, 40, 0, 0),
        (0, 7, 7, 0, 0),
    ]
    assert trace.problems(3, area) == []
    (off,) = trace.problems(3, Area(100.0, 50.0))
    assert off.endswith(":12: (17, 61) m is off the map of 100 x 50 m")
    many = trace.problems(1, area)
    assert len(many) == 3 and all(p.endswith("user: 1: must be from 0 to 0") for p in many)


def test_a_file_of_moves_alone_is_one_of_ns2(tmp_path: Path):
    file = file_of(tmp_path, '$ns_ at 5.0 "$node_(0) setdest 10 20 1"\n')
    with pytest.raises(ValueError, match=r":1: node 0 has no first place"):
        Trace(file)


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ('$ns_ at 1.0 "$node_(7) setdest 1 2 3"', "node 7 has no first place (set X_, set Y_)"),
        ('$ns_ at 3.0 "$node_(0) setdest 1 2 3"', "node 0: times must increase"),
        ('$ns_ at 99 "$node_(0) setdest 1 2"', "expected $ns_ at T"),
        ('$ns_ at 99 "$node_(0) set X_ 3"', "expected $ns_ at T"),
        ('$ns_ at -1 "$node_(0) setdest 1 2 3"', "must be at least 0"),
        ('$ns_ at 99 "$node_(x) setdest 1 2 3"', "$node_: 'x': must be a whole number"),
        ('$ns_ at 99 "$node_(0) setdest east 2 3"', "X: 'east': must be a number"),
        ('$ns_ at 99 "$node_(0) setdest 1 1e9999 3"', "Y: '1e9999': must be a finite number"),
        ('$ns_ at 99 "$node_(0) setdest 1 2 fast"', "SPEED: 'fast': must be a number"),
        ('$ns_ at soon "$node_(0) setdest 1 2 3"', "at: 'soon': must be a number"),
        ('$ns_ at 99 "$node_(0) setdest 1 2 1e-300"', "SPEED: 1e-300: too slow, node 0 would"),
        ("$node_(9) set Y_ here", "Y_: 'here': must be a number"),
        ("$node_(0) set X_ 3", "a node's first place must be given before it moves"),
        ("$node_(9) set X_ nan", "must be a finite number"),
    ],
)
def test_lines_that_are_wrong(tmp_path: Path, line: str, problem: str):
    file = file_of(tmp_path, MOVES + line)
    with pytest.raises(ValueError) as error:
        Trace(file)
    assert str(error.value).startswith(f"{file}:15: ") and problem in str(error.value)
