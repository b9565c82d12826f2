"""What a digest of code says of values: two values have two digests, or none."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from desim_uav.rowcode.code_digest import code_digest
from desim_uav.rowcode.value_text import ChangedError, UndescribedError

BEGINNING = """
import collections, ctypes, datetime, decimal, enum, fractions, functools, math, operator, re, types
from dataclasses import dataclass
from typing import NamedTuple
import numba
import numpy as np
from desim_uav.rowcode.kernels import kernel, rule

class Colour(enum.Enum):
    RED, GREEN = 1, 2
class Level(enum.IntEnum):
    LOW, HIGH = 1, 2
class Bits(enum.Flag):
    A, B = 1, 2
class Pair(NamedTuple):
    a: object
    b: object = 3
Point = collections.namedtuple("Point", "x y")
@dataclass(frozen=True)
class Fixed:
    a: object
    b: tuple = ()
class Seconds(int):
    pass
def one(x):
    return x + 1
def two(x):
    return x + 2
def adds(n):
    return lambda x: x + n
def holds(value):
    class Holder:
        X = value
    return Holder
def names(value):
    return types.SimpleNamespace(value=value)
def array(*values, **options):
    return np.array(values, **options)
def module(value, depth=0):
    made = types.ModuleType("mine_rates")
    made.GAP = value if depth == 0 else module(value, depth - 1)
    return made
"""

PAIRS = {
    "int": "1 | 2",
    "bool and int": "True | 1",
    "float and int": "1.0 | 1",
    "signed zero": "0.0 | -0.0",
    "nan": "math.nan | 0.0",
    "large int": "2**70 | 2**70 + 1",
    "complex": "1j | 2j",
    "sign in complex": "complex(0.0, 0.0) | complex(0.0, -0.0)",
    "str": "'a' | 'b'",
    "bytes": "b'a' | b'b'",
    "bytearray": "bytearray(b'a') | bytearray(b'b')",
    "none": "None | 0",
    **{
        f"np.{kind}": f"np.{kind}(1) | np.{kind}(0)"
        for kind in ("bool_", "int8", "int64", "uint64", "float32", "float64", "complex128")
    },
    "width of a scalar": "np.int64(1) | np.int32(1)",
    "scalar and number": "np.float64(1.5) | 1.5",
    "np.datetime64": "np.datetime64('2026-01-01') | np.datetime64('2026-01-02')",
    "unit of time": "np.datetime64(1, 's') | np.datetime64(1, 'ms')",
    "np.timedelta64": "np.timedelta64(1, 's') | np.timedelta64(2, 's')",
    "np.str_": "np.str_('a') | np.str_('b')",
    "np.void": "np.array((1, 2.0), 'i8,f8')[()] | np.array((1, 3.0), 'i8,f8')[()]",
    "dtype": "np.dtype('i8') | np.dtype('i4')",
    "names of a dtype": "np.dtype([('a', 'i8')]) | np.dtype([('b', 'i8')])",
    "array": "array(1, 2) | array(1, 3)",
    "type of an array": "array(1, 2) | array(1, 2, dtype=np.int32)",
    "shape of an array": "np.zeros((2, 3)) | np.zeros((3, 2))",
    "order of an array": "np.zeros((2, 3)) | np.zeros((2, 3), order='F')",
    "part of an array": "np.arange(6)[::2] | np.arange(6)[1::2]",
    "strided array": "np.zeros(6)[::2] | np.zeros(3)",
    "array without axes": "np.array(1) | np.array(2)",
    "empty array": "np.zeros((0, 2)) | np.zeros((0, 3))",
    "array of records": "np.array((1, 2.0), dtype='i8,f8') | np.array((1, 2.5), dtype='i8,f8')",
    "signed zero in an array": "np.array([0.0]) | np.array([-0.0])",
    "array of objects": "np.array([{}]) | np.array([[]], dtype=object)",
    "masked array": "np.ma.array([1], mask=[0]) | np.ma.array([1], mask=[1])",
    "large array": "np.zeros(200_000) | np.append(np.zeros(199_999), 1.0)",
    "tuple": "(1, 2) | (1, 3)",
    "types in a tuple": "(1, 0) | (True, False)",
    "nested tuple": "(1, (2, (3, np.int8(4)))) | (1, (2, (3, np.int8(5))))",
    "brackets": "((1, 2), 3) | (1, (2, 3))",
    "named tuple": "Pair(1, 2.0) | Pair(1, 2.5)",
    "type of a named tuple": "Pair(1, 2) | Point(1, 2)",
    "names of a named tuple": "collections.namedtuple('P', 'x y')(1, 2) | "
    "collections.namedtuple('P', 'y x')(1, 2)",
    "class of named tuples": "collections.namedtuple('P', 'x y') | "
    "collections.namedtuple('P', 'y x')",
    "defaults of a named tuple": "collections.namedtuple('P', 'x', defaults=[1]) | "
    "collections.namedtuple('P', 'x', defaults=[2])",
    "list": "[1, 2] | [1, 3]",
    "dict": "{'a': 1} | {'a': 2}",
    "keys of a dict": "{1: 1} | {True: 1}",
    "order of a dict": "{'a': 1, 'b': 2} | {'b': 2, 'a': 1}",
    "ordered dict": "collections.OrderedDict(a=1) | collections.OrderedDict(a=2)",
    "mapping proxy": "types.MappingProxyType({'a': 1}) | types.MappingProxyType({'a': 2})",
    "set": "{1, 2} | {1, 3}",
    "frozenset": "frozenset({'a', 'b'}) | frozenset({'a', 'c'})",
    "range": "range(3) | range(0, 3, 2)",
    "slice": "slice(1, 2) | slice(1, 3)",
    "enum": "Colour.RED | Colour.GREEN",
    "IntEnum": "Level.LOW | Level.HIGH",
    "flag": "Bits.A | Bits(3)",
    "value of an enum": "enum.Enum('E', {'A': 1}).A | enum.Enum('E', {'A': 2}).A",
    "class of enums": "enum.Enum('E', {'A': 1}) | enum.Enum('E', {'A': 2})",
    "frozen dataclass": "Fixed(1) | Fixed(2)",
    "types in a dataclass": "Fixed(1) | Fixed(True)",
    "array in a dataclass": "Fixed(np.arange(2)) | Fixed(np.arange(2) + 1)",
    "attribute of a class": "holds(1) | holds(2)",
    "nested attribute of a class": "holds(holds(1)) | holds(holds(2))",
    "function of a class": "holds(one) | holds(two)",
    "property of a class": "holds(property(one)) | holds(property(two))",
    "static function of a class": "holds(staticmethod(one)) | holds(staticmethod(two))",
    "namespace": "names(1) | names(2)",
    "int of a class": "Seconds(1) | Seconds(2)",
    "int of a class and int": "Seconds(1) | 1",
    "function": "one | two",
    "closure": "adds(1) | adds(2)",
    "closure within a closure": "adds((1, adds(1))) | adds((1, adds(2)))",
    "order of closures": "(adds(1), adds(2)) | (adds(2), adds(1))",
    "partial": "functools.partial(one, 1) | functools.partial(one, 2)",
    "function of a partial": "functools.partial(one) | functools.partial(two)",
    "bound function": "types.MethodType(one, 1) | types.MethodType(one, 2)",
    "built-in function": "math.sqrt | math.cbrt",
    "bound built-in function": "[1].index | [2].index",
    "operator": "operator.add | operator.sub",
    "ufunc": "np.add | np.subtract",
    "own ufunc": "np.frompyfunc(one, 1, 1) | np.frompyfunc(two, 1, 1)",
    "function of NumPy": "np.median | np.mean",
    "random function": "np.random.random | np.random.normal",
    "compiled function": "numba.njit(one) | numba.njit(two)",
    "options of a compiled function": "numba.njit(one) | numba.njit(fastmath=True)(one)",
    "callable as an option": "numba.njit(inline=adds(1))(one) | numba.njit(inline=adds(2))(one)",
    "kernel": "kernel(one) | kernel(two)",
    "rule": "rule(adds(1)) | rule(adds(2))",
    "cached function": "functools.cache(one) | functools.cache(two)",
    "vectorized function": "numba.vectorize(one) | numba.vectorize(two)",
    "C function": "ctypes.CFUNCTYPE(None)(lambda: 1) | ctypes.CFUNCTYPE(None)(lambda: 2)",
    "type of Numba": "numba.int64 | numba.int32",
    "array type of Numba": "numba.int64[:] | numba.int64[::1]",
    "built-in class": "int | float",
    "generic alias": "list[int] | list[float]",
    "module": "math | operator",
    "date": "datetime.date(2026, 1, 1) | datetime.date(2026, 1, 2)",
    "time difference": "datetime.timedelta(1) | datetime.timedelta(2)",
    "decimal": "decimal.Decimal(1) | decimal.Decimal(2)",
    "fraction": "fractions.Fraction(1) | fractions.Fraction(2)",
    "pattern": "re.compile('a') | re.compile('b')",
    "object": "object() | object()",
    "deque": "collections.deque([1]) | collections.deque([2])",
    "generator of random numbers": "np.random.default_rng(1) | np.random.default_rng(2)",
}

PLACES = {
    "global name": "X = {}\ndef f(x): return x + X",
    "local name in an expression": "X = {}\ndef f(x): return [x + X for _ in range(2)]",
    "nested function": "X = {}\ndef f(x):\n    def g(): return X\n    return g",
    "default": "def f(x, y={}): return x + y",
    "default of a keyword": "def f(x, *, y={}): return x + y",
    "cell": "def made(y):\n    return lambda x: x + y\nf = made({})",
    "called function": "X = {}\ndef g(x): return x + X\ndef f(x): return g(x)",
    "method": "class C:\n    def of(self): return X\nX = {}\nf = C.of",
    "attribute of a module": "m = module({})\ndef f(x): return x + m.GAP",
    "attribute three dots away": "m = module({}, 2)\ndef f(x): return x + m.GAP.GAP.GAP",
    "attribute of a class": "C = holds({})\ndef f(x): return x + C.X",
    "attribute of an instance": "c = Fixed({})\ndef f(x): return x + c.a",
    "overload": "X = {}\ndef g(): ...\n@numba.extending.overload(g)\ndef h():\n"
    "    return lambda: X\ndef f(x): return g()",
}

TABLE = [*(("global name", pair) for pair in PAIRS), *((place, "np.int64") for place in PLACES)]


def digest(source: str) -> str | None:
    """Return the digest of the function ``f``, or None if it has none."""
    try:
        return code_digest(space_of(source)["f"])
    except UndescribedError:
        return None


def space_of(source: str) -> dict[str, Any]:
    """Return the global names of a module that has been run."""
    space: dict[str, Any] = {"__name__": "mine"}
    exec(compile(BEGINNING + source, __file__, "exec", dont_inherit=True), space)
    return space


@pytest.mark.parametrize(("place", "pair"), TABLE)
def test_two_values_have_two_digests_or_none(place: str, pair: str):
    """And equal values of two runs have equal digests."""
    one, _, other = PAIRS[pair].partition(" | ")
    before, after = (digest(PLACES[place].format(value)) for value in (one, other))
    assert before is None or before != after
    assert before == digest(PLACES[place].format(one))


NOT_DESCRIBED = {
    *("array of objects", "masked array", "own ufunc", "vectorized function", "C function"),
    *("date", "time difference", "decimal", "fraction", "pattern", "object", "deque"),
    *("bytearray", "generator of random numbers"),
}


@pytest.mark.parametrize("pair", PAIRS)
def test_what_can_be_described_is(pair: str):
    value = PAIRS[pair].partition(" | ")[0]
    assert (digest(PLACES["global name"].format(value)) is None) == (pair in NOT_DESCRIBED)


def test_all_kernels_of_this_package_can_be_described():
    """So that all of them are kept on disk."""
    import desim_uav.learning.fused
    import desim_uav.optimum.gain  # noqa: F401

    modules = [module for name, module in sys.modules.items() if name.startswith("desim_uav.")]
    values = [value for module in modules for value in vars(module).values()]
    kernels = {id(value): value for value in values if hasattr(value, "py_func")}
    assert len(kernels) > 30
    assert all(len(code_digest(value.py_func)) == 64 for value in kernels.values())


# ---- code


@pytest.mark.parametrize(
    ("before", "after"),
    [
        pytest.param("def g(a, b): return a - b\ndef f(x): return g(a=x, b=1)",
                     "def g(b, a): return b - a\ndef f(x): return g(a=x, b=1)",
                     id="names of arguments"),
        pytest.param("def f(x):\n    'a'\n    return x == 'a'",
                     "def f(x):\n    'b'\n    return x == 'b'", id="a docstring that is used"),
        pytest.param("g, h = adds(1), adds(2)\ndef f(x): return g(h(x)) - h(x)",
                     "h, g = adds(1), adds(2)\ndef f(x): return g(h(x)) - h(x)",
                     id="which of two functions of one name"),
        pytest.param("def f(x): return len('a')", "def len(x): return 2\ndef f(x): return len('a')",
                     id="a name of Python's own"),
        pytest.param("def f(x):\n    try:\n        return x\n    except ValueError:\n"
                     "        return 1",
                     "def f(x):\n    try:\n        return x\n    except KeyError:\n"
                     "        return 1", id="what is caught"),
    ],
)  # fmt: skip
def test_other_code_has_another_digest(before: str, after: str):
    assert None not in (digest(before), digest(after))
    assert digest(before) != digest(after)


@pytest.mark.parametrize(
    "source",
    [
        "m = module(1)\ndef g(m): return m.GAP\ndef f(x): return g(m)",
        "m = module(1)\ndef f(x):\n    n = m\n    return n.GAP",
        "m = module(1, 1)\ndef f(x):\n    n = m.GAP\n    return n.GAP",
    ],
)
def test_a_module_whose_attributes_are_used_elsewhere_is_not_described(source: str):
    assert digest(source) is None


@pytest.mark.parametrize(
    "source",
    [
        "GAP = object()\nm = module(1)\ndef f(x): return m.GAP",
        "def f(x): return f(x - 1) if x else g(x)\ndef g(x): return f(x)",
        "x = [1]\nx.append(x)\ndef f(): return x[0]",
        "def made():\n    def inner(x): return inner(x - 1)\n    return inner\nf = made()",
        "class C:\n    def of(self): return C.of\ndef f(x): return C",
    ],
)
def test_these_are_described(source: str):
    assert digest(source) is not None
    assert digest(source) == digest(source)


def test_a_value_that_changes_in_a_process_makes_a_function_have_no_digest():
    """Numba goes on with the first value in what it has compiled, and this must not be kept."""
    space = space_of("X = array(1)\ndef f(x): return x + X")
    first = code_digest(space["f"])
    assert code_digest(space["f"]) == first
    space["X"][0] = 2
    with pytest.raises(ChangedError, match=r"mine\.f', or a value in it, has changed in this"):
        code_digest(space["f"])
    space["X"][0] = 1
    assert code_digest(space["f"]) == first


def test_the_name_of_what_has_no_digest_is_said():
    space = space_of("GAP = datetime.timedelta(1)\ndef g(x): return x + GAP\n"
                     "def f(x): return g(x)")  # fmt: skip
    with pytest.raises(UndescribedError, match=r"^'GAP' in 'mine\.g' is a value of type 'datetime"):
        code_digest(space["f"])


DESCRIBED = [pair for pair in PAIRS if pair not in NOT_DESCRIBED]

IN_A_PROCESS = f"""
from tests.rowcode.test_code_digest_values import *
for pair in {DESCRIBED!r}:
    print(pair, digest(PLACES["global name"].format(PAIRS[pair].partition(" | ")[0])))
from desim_uav.engine.compiled.simulation import kernels_digest
print("run", kernels_digest())
"""


@pytest.mark.thorough
def test_digests_are_equal_in_all_processes():
    """Whatever the order of Python's sets, and the addresses of objects."""
    root, said = Path(__file__).parents[2], []
    for seed in ("1", "2"):
        done = subprocess.run(
            [sys.executable, "-c", IN_A_PROCESS],
            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(root)},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        said.append(done.stdout.splitlines())
    assert len(said[0]) == len(DESCRIBED) + 1
    assert said[0] == said[1]
