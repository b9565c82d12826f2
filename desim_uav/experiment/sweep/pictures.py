"""Figures and the report of a sweep, made from its folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from desim_uav.errors import UsageError
from desim_uav.experiment.sweep.results import MOST_KEYS, chosen_keys, content, read_sweep
from desim_uav.measures.known import KNOWN, check, looks
from desim_uav.report.text import word

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAWN = ("qoe1_percent", "qoe2_iterations", "qoe3_percent")
"""The measures of a figure unless --measure names others."""


def plot_sweep(
    folder: Path, measure: Sequence[str] | None = None, key: Sequence[str] | None = None
) -> Figure:
    """Draw measures of a sweep over one or two of its keys.

    ``key`` has names of keys to show, the first along the axis, and KEY=VALUE for keys to hold at a
    value. Raises PolicyError if the folder cannot be read, UsageError for a wrong name.
    """
    from desim_uav.report.figures import intervals_figure, sweep_figure

    for name in measure or ():
        check(name)
    measures = list(dict.fromkeys(measure or DRAWN))
    results = read_sweep(folder)
    for name in measures:
        if name not in results.measures:
            lack = KNOWN[name].where.lack or "it was not asked for"
            raise UsageError(f"measure: {name}: this sweep does not have it: {lack}")
    if not results.keys and not key:
        table = content(results, {})
        titles = {name: label for name, (label, _) in looks(measures).items()}
        return intervals_figure(table["estimates"], table["policies"], titles, False)
    value_at = _values_at(key or ())
    fixed = {name: value for name, value in value_at.items() if value is not None}
    return sweep_figure(content(chosen_keys(results, value_at), fixed), measures)


def sweep_report(folder: Path, title: str | None) -> str:
    """Return the page on a sweep. Raises PolicyError if the folder cannot be read."""
    from desim_uav.report.sweep_page import Swept, sweep_page

    results = read_sweep(folder)
    fixed: dict[str, str | None] = {
        key: word(values[0]) for key, values in list(results.keys.items())[MOST_KEYS:]
    }
    left_out, table = "", {}
    try:
        rest = chosen_keys(results, fixed) if results.keys else results
        table = content(rest, fixed)
    except UsageError as error:
        left_out = f"There is no figure. {error}"
    return sweep_page(
        Swept(
            folder,
            results.manifest,
            content(results, {}),
            table,
            left_out,
            len(results.rows),
            results.failures,
        ),
        title,
    )


def _values_at(keys: Sequence[str]) -> dict[str, str | None]:
    value_at: dict[str, str | None] = {}
    for text in keys:
        name, equals, value = text.partition("=")
        if name in value_at:
            raise UsageError(f"key: {name}: the key is given twice")
        value_at[name] = value if equals else None
    return value_at
