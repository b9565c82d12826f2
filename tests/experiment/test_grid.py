"""The grid of a sweep: what -S means, and the columns its values stand in."""

import pytest

from desim_uav.errors import UsageError
from desim_uav.experiment.sweep.grid import axes, combinations


def texts(override):
    (axis,) = axes([override])
    return [value.text for value in axis.values]


@pytest.mark.parametrize(
    ("values", "meant"),
    [
        ("3", ["3"]),
        ("1,2, 5", ["1", "2", "5"]),
        ("static,random_walk", ["static", "random_walk"]),
        ("[2400,2400]", ["[2400,2400]"]),
        ("[1,2],[3,[4,5]]", ["[1,2]", "[3,[4,5]]"]),
        (
            "{kind: endurance, autonomy_min: 30},null",
            ["{kind: endurance, autonomy_min: 30}", "null"],
        ),
        ("{kind: 'x,}',a: 1},b", ["{kind: 'x,}',a: 1}", "b"]),
        ("'a,b',c", ["'a,b'", "c"]),
        (r'"a\",b",c', [r'"a\",b"', "c"]),
        ("it's,b", ["it's", "b"]),
        ("[1,2", ["[1,2"]),
        ("a=b,c", ["a=b", "c"]),
        ("my_module:MyWalk,static", ["my_module:MyWalk", "static"]),
        ("'1:3'", ["'1:3'"]),
        ("", [""]),
    ],
)
def test_commas_separate_values_but_not_within_them(values, meant):
    assert texts(f"some.key={values}") == meant


@pytest.mark.parametrize(
    ("values", "meant"),
    [
        ("1:4", ["1", "2", "3", "4"]),
        ("-1:1", ["-1", "0", "1"]),
        ("3:3", ["3"]),
        ("1:10:4", ["1", "5", "9"]),
        ("5:1:-2", ["5", "3", "1"]),
        ("0.1:0.5:0.1", ["0.1", "0.2", "0.3", "0.4", "0.5"]),
        (".5:1.25:.25", ["0.50", "0.75", "1.00", "1.25"]),
        ("1e3:2e3:5e2", ["1000", "1500", "2000"]),
        ("1,2,4:6,null", ["1", "2", "4", "5", "6", "null"]),
    ],
)
def test_ranges_hold_both_ends(values, meant):
    assert texts(f"some.key={values}") == meant


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("k=4:1", "range 4:1: it contains no value"),
        ("k=1:4:0", "the step is 0"),
        ("k=1:4:-1", "contains no value"),
        ("k=0.1:0.5", "needs a step"),
        ("k=1:9999999", "more than 1000000 values"),
        ("k=0:1:1e-9", "more than 1000000 values"),
        ("k=1,1", "1 is given twice"),
        ("k=1,1.0", "1.0 is given twice"),
        ("k=2,1:3", "2 is given twice"),
        ("k=[1, 2],[1,2]", "[1,2] is given twice"),
        ("k=1,,2", "a value is empty"),
        ("k=1,", "a value is empty"),
        ("k", "must be key.path=value"),
        ("seed=1,2", "choose the first seed and the number of seeds"),
    ],
)
def test_what_is_no_grid_is_refused(override, said):
    with pytest.raises(UsageError) as refused:
        axes([override])
    assert said in str(refused.value)


def test_a_key_is_given_once():
    with pytest.raises(UsageError, match=r"override a\.b: given twice"):
        axes(["a.b=1", "c=2", "a.b=3"])


def test_one_and_true_are_two_values():
    assert texts("k=1,true,'1'") == ["1", "true", "'1'"]


@pytest.mark.parametrize(
    ("values", "dtype", "cells"),
    [
        ("1,2", "int64", [1, 2]),
        ("1,null", "int64", [1, None]),
        ("1,0.5", "float64", [1.0, 0.5]),
        ("true,false", "bool", [True, False]),
        ("a,b,null", "string", ["a", "b", None]),
        ("null", "string", [None]),
        ("[1,2],3", "string", ["[1, 2]", "3"]),
        ("{kind: static}", "string", ['{"kind": "static"}']),
        ("true,1", "string", ["true", "1"]),
        ("99999999999999999999", "string", ["99999999999999999999"]),
    ],
)
def test_columns(values, dtype, cells):
    (axis,) = axes([f"k={values}"])
    found = [axis.cell(value.plain) for value in axis.values]
    assert axis.dtype == dtype
    assert [(type(cell), cell) for cell in found] == [(type(cell), cell) for cell in cells]


def test_every_combination_the_last_key_first():
    found = list(combinations(axes(["a=1,2", "b.c=x", "d=0.5:1:0.5"])))
    assert [c.settings for c in found] == [
        ("a=1", "b.c=x", "d=0.5"),
        ("a=1", "b.c=x", "d=1.0"),
        ("a=2", "b.c=x", "d=0.5"),
        ("a=2", "b.c=x", "d=1.0"),
    ]
    assert found[2].cells == {"a": 2, "b.c": "x", "d": 0.5}
    assert found[2].name == "a=2, d=0.5"


def test_nothing_given_is_one_combination():
    (found,) = combinations(axes([]))
    assert (found.settings, found.cells, found.name) == ((), {}, "")
