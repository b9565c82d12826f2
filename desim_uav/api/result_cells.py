"""What a notebook shows of a result: its measures as tables in HTML."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from desim_uav.experiment.statistics import estimate
from desim_uav.measures.known import of_mean
from desim_uav.report import notebook
from desim_uav.report.text import Looks, Row


def collected(rows: Sequence[dict[str, Any]]) -> dict[str, list[Any] | None]:
    """Return the values that some seeds have of each measure; None if there are none."""
    values = {name: [row.get(name) for row in rows] for name in rows[0]}
    return {name: of if any(v is not None for v in of) else None for name, of in values.items()}


def table(looks: Looks, rows: Sequence[Row]) -> str:
    """Return a table of the measures of services on some seeds."""
    headings = ["service", *(heading for heading, _ in looks.values())]
    cells = [
        [row["service"], *(cell(row.get(name), form) for name, (_, form) in looks.items())]
        for row in rows
    ]
    return notebook.table(headings, cells, words=[0])


def cell(values: Sequence[float | None] | None, form: str) -> str:
    """Return the mean of the values of some seeds, and the half-width of its interval."""
    interval = estimate(values or ())
    if interval.mean is None:
        return ""
    if len(values or ()) > 1:
        form = of_mean(form)
    value = int(interval.mean) if form == "d" else interval.mean
    spread = "" if interval.half_width is None else f" ± {interval.half_width:{form}}"
    return f"{value:{form}}{spread}"


def number(count: int, one: str, more: str = "") -> str:
    """Return a number of things in words."""
    return f"{count} {one if count == 1 else more or one + 's'}"
