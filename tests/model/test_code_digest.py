"""When machine code is stale: what a digest of code depends on, and what it does not."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest

from desim_uav.model.code_digest import code_digest

BEGINNING = """
import math
from typing import NamedTuple
from enum import IntEnum
import numba
import numpy as np

FACTOR = 2.5
TABLE = np.array([1.0, 2.0])
PAIR = (1, (2.0, "x"))

class Row(NamedTuple):
    a: int

class Mode(IntEnum):
    ON = 1

@numba.njit
def called(x):
    return x + 1.0

def f(x, y=1):
    '''What it does.'''
    # why
    if x in {"a", "b"}:
        return [1 for _ in range(3)]
    return FACTOR * called(x) + TABLE[0] + PAIR[0] + Mode.ON + math.sqrt(2.0) + Row(1).a
"""


def digest(source: str) -> str:
    space: dict[str, object] = {"__name__": "mine"}
    exec(source, space)
    return code_digest(space["f"])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("FACTOR = 2.5", "FACTOR = 2.25"),
        ("np.array([1.0, 2.0])", "np.array([1.0, 3.0])"),
        ("np.array([1.0, 2.0])", "np.array([1.0, 2.0], np.float32)"),
        ('(1, (2.0, "x"))', '(1, (2.0, "y"))'),
        ('(1, (2.0, "x"))', '(1.0, (2.0, "x"))'),
        ("a: int", "a: int; b: int"),
        ("ON = 1", "ON = 2"),
        ("x + 1.0", "x + 1.5"),
        ("@numba.njit", "@numba.njit(fastmath=True)"),
        ("y=1", "y=2"),
        ('{"a", "b"}', '{"a", "c"}'),
        ("[1 for", "[2 for"),
        ("FACTOR * called(x)", "FACTOR + called(x)"),
        ("math.sqrt(2.0)", "math.cbrt(2.0)"),
    ],
)
def test_what_is_compiled_counts(before: str, after: str):
    assert before in BEGINNING
    assert digest(BEGINNING) != digest(BEGINNING.replace(before, after))


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("# why", "# whatever"),
        ("What it does.", "What it does, and more."),
        ("import math\n", "import math\n\n\nUNUSED = 1\n"),
        ("def called(x):\n", "def called(x):\n    # more\n"),
    ],
)
def test_what_is_only_said_does_not(before: str, after: str):
    assert before in BEGINNING
    assert digest(BEGINNING) == digest(BEGINNING.replace(before, after))


def test_functions_that_call_each_other():
    source = "def g(n):\n    return f(n - 1)\ndef f(n):\n    return g(n) if n else {}"
    assert digest(source.format(0)) == digest(source.format(0))
    assert digest(source.format(0)) != digest(source.format(1))


def test_what_a_closure_holds_counts():
    def times(factor: float):
        return lambda x: factor * x

    assert code_digest(times(2.0)) == code_digest(times(2.0))
    assert code_digest(times(2.0)) != code_digest(times(3.0))


def test_functions_of_other_packages_do_not():
    def f(x: float) -> float:
        return float(np.median(np.array([x, math.pi]))) + numba.typed.List([1.0])[0]

    assert len(code_digest(f)) == 64
