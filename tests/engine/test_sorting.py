"""Changes of classes in the order in which a compiled engine takes them: the latest first."""

import numpy as np
import pytest

from desim_uav.rowcode.rows import blank, fill
from desim_uav.sky.order import MANY, spread_last_first
from desim_uav.sky.rows import Change


def plainly(rows):
    """By time, then falls before rises, then by user; and the last one first."""
    return sorted(rows.tolist(), key=lambda row: (row[0], row[2] > 0, row[1]), reverse=True)


@pytest.mark.parametrize("count", [0, 1, 2, 40, MANY, MANY + 1, 3 * MANY])
@pytest.mark.parametrize("latest_us", [0, 3, 60_000_000])
@pytest.mark.parametrize("uneven", [False, True])
def test_changes_are_spread_into_order(count, latest_us, uneven):
    """Also where many are at one time, or nearly all of them in one stretch."""
    rng = np.random.default_rng(count)
    times = rng.integers(0, latest_us + 1, count)
    if uneven:
        times[1:] //= 100_000
    users = np.sort(rng.integers(0, 50, count))
    # A user has one change in a microsecond.
    _, first = np.unique(np.column_stack([times, users]), axis=0, return_index=True)
    first = np.sort(first)
    rows = np.column_stack([times, users, rng.integers(-14, 15, count)])[first] + (10**12, 0, 0)
    out, changes = [blank(Change) for _ in rows], [fill(Change, row) for row in rows.tolist()]
    spread_last_first(changes, len(rows), [0] * len(rows), out)
    assert [[row.t_us, row.user, row.change] for row in out] == plainly(rows)
