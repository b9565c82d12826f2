"""Rules that are compiled on their own, when compiled code first calls them."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from desim_uav.errors import SimulationError
from desim_uav.rowcode import compiled_apart
from desim_uav.rowcode.code_digest import code_digest
from desim_uav.rowcode.compiled_rows import pointer_to
from desim_uav.rowcode.kernels import apart, kernel, rule
from desim_uav.rowcode.packing import packed
from desim_uav.rowcode.rows import Row, row


@row
class Pot(Row):
    """Something with two numbers."""

    count: int
    level: float


pot_at: Any = pointer_to(Pot)


@apart
def poured(pot: Pot, more: float, all_of_it: bool) -> float:
    """Pour, and return what is in the pot."""
    pot.level = more if all_of_it else pot.level + more
    pot.count += 1
    return pot.level


@apart
def count_down(pot: Pot, steps: int) -> bool:
    """Count down by calling itself, and return whether it did."""
    if steps > 0:
        pot.count -= 1
        count_down(pot, steps - 1)
    return steps > 0


@apart
def broken(pot: Pot) -> int:
    """Do what cannot be compiled."""
    return pot.missing  # type: ignore[attr-defined, no-any-return]


@apart
def failing(pot: Pot) -> None:
    """Fail, in compiled code as in Python."""
    raise ValueError("the pot is empty")


@rule
def _use(pot: Pot, more: int) -> float:
    return poured(pot, more, pot.count > 5) + poured(pot, 2 * more, False)


@kernel
def use(pot: int, more: int) -> float:
    return _use(pot_at(pot), more)


@kernel
def use_others(pot: int, which: int) -> bool:
    own = pot_at(pot)
    if which == 0:
        return count_down(own, 3)
    if which == 1:
        return broken(own) > 0
    failing(own)
    return False


def _pot(count: int, level: float) -> Pot:
    made = Pot()
    made.count, made.level = count, level
    return made


def _cell(function: Any) -> Any:
    return next(one for one in compiled_apart._CELLS.values() if one.function is function)


def test_it_is_compiled_when_compiled_code_first_calls_it():
    cell, pot = _cell(poured), packed(_pot(1, 0.5))
    known = code_digest(use.py_func)  # type: ignore[attr-defined]
    use.compile((compiled_apart.I64, compiled_apart.I64))  # type: ignore[attr-defined]
    assert cell.value.value == 0
    results: list[float] = []
    threads = [
        threading.Thread(target=lambda: results.append(use(pot.ctypes.data, 3))) for _ in range(3)
    ]
    for thread in threads:
        thread.start()
        thread.join()
    expected, level = [], _pot(1, 0.5)
    expected = [_use(level, 3) for _ in range(3)]
    assert results == expected
    assert cell.value.value > 0
    assert (pot[0], pot.view(float)[1]) == (level.count, level.level)
    assert code_digest(use.py_func) == known  # type: ignore[attr-defined]


def test_what_calls_it_does_not_depend_on_its_code(monkeypatch):
    known = code_digest(use.py_func)  # type: ignore[attr-defined]
    other = (lambda pot, more, all_of_it: 2.0).__code__
    before, own = poured.__code__, code_digest(count_down)
    monkeypatch.setattr(poured, "__code__", other)
    assert code_digest(use.py_func) == known  # type: ignore[attr-defined]
    monkeypatch.setattr(poured, "__code__", before)
    assert code_digest(count_down) == own
    monkeypatch.setattr(poured, "__annotations__", {**poured.__annotations__, "more": "int"})
    assert code_digest(count_down) == own


def test_it_may_call_itself_and_return_a_truth_value():
    pot = packed(_pot(4, 0.0))
    assert use_others(pot.ctypes.data, 0) is True
    assert pot[0] == 1


def test_an_error_in_it_ends_its_callers():
    with pytest.raises(ValueError, match="the pot is empty"):
        use_others(packed(_pot(0, 0.0)).ctypes.data, 2)


def test_what_cannot_be_compiled_is_one_error_and_no_crash():
    with pytest.raises(
        SimulationError, match=r"internal error: .*broken cannot be called: .*missing"
    ):
        use_others(packed(_pot(0, 0.0)).ctypes.data, 1)
