"""Figures and the report of a sweep, made from its folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from desim_uav.errors import UsageError, did_you_mean
from desim_uav.experiment.evaluate import ENERGY, MEASURES, OF_TASKS, SOMETIMES
from desim_uav.experiment.sweep.results import MOST_KEYS, chosen_keys, content, read_sweep
from desim_uav.report.text import LOOKS, word

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

    names = (*MEASURES, *SOMETIMES)
    for name in measure or ():
        if name not in names:
            hint = did_you_mean(name, names)
            raise UsageError(f"--measure {name}{hint}; allowed: {', '.join(names)}")
    measures = list(dict.fromkeys(measure or DRAWN))
    results = read_sweep(folder)
    for name in measures:
        if name not in results.measures:
            raise UsageError(f"--measure {name}: {_WHY_NOT[name]}")
    if not results.keys and not key:
        table = content(results, {})
        titles = {name: LOOKS[name][0] for name in measures}
        return intervals_figure(table["estimates"], table["policies"], titles, False)
    value_at = _values_at(key or ())
    fixed = {name: value for name, value in value_at.items() if value is not None}
    return sweep_figure(content(chosen_keys(results, value_at), fixed), measures)


_WHY_NOT = {ENERGY: "no battery in this sweep is measured in Wh"} | dict.fromkeys(
    OF_TASKS, "no service in this sweep has tasks"
)
"""Why a sweep has no such measure."""


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
            raise UsageError(f"--key {name}: the key is given twice")
        value_at[name] = value if equals else None
    return value_at
