"""What counts as equal, and how the first difference is named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

from desim_uav.testing.exact import difference, require_same_tables, same

NAN = float("nan")


@pytest.mark.parametrize(
    "value", [1, "a", NAN, None, pd.NA, [1, NAN], (1, (2,)), {"a": [NAN]}, np.array([1.0, NAN])]
)
def test_equal(value: Any):
    assert same(value, value)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1, 2),
        (NAN, 1.0),
        (pd.NA, 1),
        (1, pd.NA),
        ([1], [1, 2]),
        ({"a": 1}, {"b": 1}),
        ({"a": 1}, 1),
        (np.array([1, 2]), np.array([1.0, 2.0])),
        (np.array([1.0, NAN]), np.array([1.0, 2.0])),
        (0.1 + 0.2, 0.3),
        (1, 1.0),
        (True, 1),
        ((1,), [1]),
    ],
)
def test_unequal(one: Any, other: Any):
    assert not same(one, other)
    assert not same(other, one)


def test_where_two_values_differ():
    one, other = ({"a": [1, 2.0]}, "x"), ({"a": [1, NAN]}, "y")
    assert difference(one, other) == "[0]['a'][1]: 2.0 is not nan"
    assert difference(one, one) is None
    assert difference({"a": 1, "b": 2}, {"a": 1, "b": 3}, skips={"b"}) is None


def frames(**columns: list[Any]) -> dict[str, pd.DataFrame]:
    return {"requests": pd.DataFrame(columns)}


@pytest.mark.parametrize(
    ("others", "message"),
    [
        (
            {"a": [1, 2, 3], "b": [0.0, NAN, 5.0]},
            r"^requests, row 2, b: 3.0 \(des\), 5.0 \(batch\)$",
        ),
        ({"a": [1, 9, 3], "b": [0.0, NAN, 5.0]}, r"^requests, row 1, a: 2 \(des\), 9 \(batch\)$"),
        ({"a": [1, 2], "b": [0.0, NAN]}, r"^requests: 3 rows \(des\), 2 \(batch\)$"),
        ({"a": [1, 2, 3]}, r"^requests: columns \['a', 'b'\] \(des\), \['a'\] \(batch\)$"),
    ],
)
def test_the_first_difference_is_named(others: dict[str, list[Any]], message: str):
    mine = frames(a=[1, 2, 3], b=[0.0, NAN, 3.0])
    require_same_tables(mine, frames(a=[1, 2, 3], b=[0.0, NAN, 3.0]), ("des", "batch"))
    with pytest.raises(AssertionError, match=message):
        require_same_tables(mine, frames(**others), ("des", "batch"))


def test_a_table_that_one_run_lacks_is_named():
    with pytest.raises(AssertionError, match=r"^one: \['requests'\]; two: \[\]$"):
        require_same_tables(frames(a=[1]), {}, ("one", "two"))
