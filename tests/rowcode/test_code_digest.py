"""When machine code is stale: what a digest of code depends on, and what it does not."""

from __future__ import annotations

import math
import subprocess
import sys
from types import FunctionType, ModuleType
from typing import Any

import numba
import numpy as np
import pytest

from desim_uav.learning import fused
from desim_uav.rowcode import compiled_queues, compiled_rows, compiled_types, numba_parts
from desim_uav.rowcode.code_digest import code_digest
from desim_uav.rowcode.rows import Row, row

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
    run(source, space)
    return code_digest(space["f"])  # type: ignore[arg-type]


def run(source: str, space: dict[str, object]) -> None:
    """Run a module's source, whose annotations are values."""
    exec(compile(source, "<mine>", "exec", dont_inherit=True), space)


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


# ---- rules over rows

OVER_ROWS = """
from desim_uav.rowcode.kernels import rule, stands_in_for
from desim_uav.rowcode.rows import Queue, Row, Table, row

STEP = 2

@row
class Part(Row):
    size: int

@row
class Whole(Row):
    weight: float
    parts: Table[Part]
    def __getitem__(self, k):
        return self.weight * 4.0

def later(whole, size):
    '''The seam.'''

@stands_in_for(later)
def _later(whole, size):
    # why
    whole.weight = STEP * grown(size)

@rule
def grown(size):
    return size + 1.5

@rule
def add(whole, size):
    '''What it does.'''
    later(whole, size - 1)

def f(whole: Whole, size: int):
    add(whole, size)
"""


@pytest.mark.parametrize(
    ("before", "after"),
    [
        pytest.param("weight: float", "weight: int", id="the type of a field"),
        pytest.param("weight: float", "mass: float", id="the name of a field"),
        pytest.param("    weight: float\n    parts: Table[Part]", "    parts: Table[Part]\n"
                     "    weight: float", id="the order of fields"),
        pytest.param("Table[Part]", "Queue[Part]", id="the kind of a table"),
        pytest.param("size: int\n", "size: int\n    more: int\n", id="the rows of a table"),
        pytest.param("size - 1", "size - 2", id="a rule that is called"),
        pytest.param("* 4.0", "* 5.0", id="a method of a row"),
        pytest.param("STEP * ", "3 * ", id="what stands in for the seam"),
        pytest.param("STEP = 2", "STEP = 3", id="a constant of what stands in for the seam"),
        pytest.param("size + 1.5", "size + 1.25", id="a rule that only the stand-in calls"),
    ],
)  # fmt: skip
def test_what_a_rule_is_compiled_from_counts(before: str, after: str):
    assert before in OVER_ROWS
    assert digest(OVER_ROWS) == digest(OVER_ROWS)
    assert digest(OVER_ROWS) != digest(OVER_ROWS.replace(before, after))


@pytest.mark.parametrize(
    ("before", "after"),
    [("# why", "# whatever"), ("The seam.", "The seam!"), ("What it does.", "What it did.")],
)
def test_what_is_only_said_in_a_rule_does_not(before: str, after: str):
    assert before in OVER_ROWS
    assert digest(OVER_ROWS) == digest(OVER_ROWS.replace(before, after))


def test_rows_elsewhere_do_not_count():
    before = digest(OVER_ROWS)
    run(OVER_ROWS.replace("size: int", "length: float"), {"__name__": "elsewhere"})
    assert digest(OVER_ROWS) == before


@pytest.mark.parametrize(
    ("module", "name"),
    [(compiled_types, "get_field"), (compiled_queues, "_append"), (numba_parts, "keep_in")],
)
def test_how_rows_are_compiled_counts_for_what_is_over_rows(
    module: ModuleType, name: str, monkeypatch: pytest.MonkeyPatch
):
    before = digest(OVER_ROWS), digest(BEGINNING)
    code = getattr(module, name).__code__.replace(co_consts=("changed",) * 9)
    monkeypatch.setattr(module, name, FunctionType(code, vars(module)))
    after = digest(OVER_ROWS), digest(BEGINNING)
    assert before[0] != after[0] and before[1] == after[1]


def test_the_layout_of_a_row_that_is_given_by_its_address_counts():
    def over(kind: type) -> str:
        own = row(type("Own", (Row,), {"__annotations__": {"before": kind, "value": float}}))
        at = compiled_rows.pointer_to(own)
        return code_digest(lambda address: at(address).value)

    assert over(int) == over(int)
    assert over(int) != over(float)


def test_the_kernels_of_the_engine_are_over_rows(monkeypatch: pytest.MonkeyPatch):
    """Those as well that call no rule themselves, but a kernel by its address."""
    from desim_uav.engine.compiled import calls

    kernels = [
        value
        for value in vars(calls).values()
        if hasattr(value, "py_func") and value.py_func.__module__ == calls.__name__
    ]
    before = [code_digest(kernel.py_func) for kernel in kernels]
    code = compiled_types.get_field.__code__.replace(co_consts=("changed",) * 9)
    monkeypatch.setattr(compiled_types, "get_field", FunctionType(code, vars(compiled_types)))
    after = [code_digest(kernel.py_func) for kernel in kernels]
    assert len(kernels) > 3
    assert all(one != other for one, other in zip(before, after, strict=True))


def test_the_lines_count_where_faults_name_them():
    digests = []
    for source in (BEGINNING, f"# a comment\n{BEGINNING}"):
        space: dict[str, Any] = {"__name__": "mine"}
        run(source, space)
        digests.append([code_digest(space["f"], placed) for placed in (False, True)])
    (one, placed), (other, placed_elsewhere) = digests
    assert one == other and len({one, placed, placed_elsewhere}) == 3


def test_the_digest_is_the_same_in_another_process():
    program = (
        "from desim_uav.learning.fused import play\n"
        "from desim_uav.rowcode.code_digest import code_digest\n"
        "print(code_digest(play.py_func))"
    )
    told = [sys.executable, "-c", program]
    made = subprocess.run(told, check=True, capture_output=True, text=True).stdout.strip()
    assert made == code_digest(getattr(fused.play, "py_func", fused.play))
