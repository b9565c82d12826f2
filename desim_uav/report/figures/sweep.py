"""A measure over the values of one key of a sweep, or of two."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from desim_uav.errors import UsageError
from desim_uav.measures.known import KNOWN, of_mean
from desim_uav.palette import ink_on
from desim_uav.report.figures.style import MOST_PANELS, Figure, headed, look, marker, short, styled
from desim_uav.report.intervals import have_interval, interval_words

APART = 0.015
"""The sideways shift of a series, as a share of the axis, so that intervals do not overlap."""

WRITTEN = 8
"""The most cells in a row or column of a heat map that has numbers in its cells."""

MOST_LINES = 12
SHADES = "cividis"

Content = dict[str, Any]


@styled
def sweep_figure(content: Content, measures: Sequence[str]) -> Figure:
    """Draw measures of a sweep over one or two keys: means over seeds, with their intervals.

    ``content`` has ``scenario``, ``episodes``, ``keys`` (one or two, each with its values),
    ``held`` (keys at one value), ``policies`` and ``estimates``: rows with a value of each key,
    ``policy`` and ``measures`` (n, mean, half_width). One key gives a panel per measure and a line
    per policy. Two keys give a row of panels per policy: heat maps if both keys are numbers with
    at least three values, else a line per value of the second key. Raises UsageError for too many
    panels or lines.
    """
    heat = len(content["keys"]) == 2 and all(map(_is_scale, content["keys"].values()))
    rows = content["policies"] if len(content["keys"]) == 2 else [None]
    if len(rows) * len(measures) > MOST_PANELS:
        raise UsageError(
            f"{len(rows) * len(measures)} panels are too many (at most {MOST_PANELS}); choose "
            "measures with --measure"
        )
    size = (3.5 * len(measures) + 0.6, 2.7 * len(rows) + 1.0)
    figure = Figure(figsize=size)
    panels = figure.subplots(len(rows), len(measures), squeeze=False)
    for across, policies in zip(panels, rows, strict=True):
        for axes, measure in zip(across, measures, strict=True):
            if heat:
                _draw_heat(figure, axes, content, measure, policies)
            else:
                _draw_lines(axes, content, measure, policies)
            label = KNOWN[measure].label.replace(" %", ", %").replace(" steps", ", steps")
            axes.set_title(label if policies is None else f"{short(policies)}: {label}")
    if not heat:
        handles, names = panels[0][0].get_legend_handles_labels()
        title = "policy" if len(content["keys"]) == 1 else short([*content["keys"]][1])
        columns = min(len(names), 3 * len(measures))
        figure.legend(handles, names, loc="outside lower center", ncols=columns, title=title)
    headed(figure, "\n".join(_heading(content, heat)))
    return figure


def _heading(content: Content, heat: bool) -> Iterator[str]:
    counts = sorted({of["n"] for row in content["estimates"] for of in row["measures"].values()})
    counts = [count for count in counts if count] or [0]
    seeds = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    size = f"{short(content['scenario'])}, {seeds} seed(s) of {content['episodes']} episode(s)"
    words = interval_words(content["estimates"])
    half_widths = heat and have_interval(content["estimates"])
    yield f"{size}: {f'means ± half-widths of {words}' if half_widths else words}"
    if content["held"]:
        yield ", ".join(f"{short(key)} = {short(value)}" for key, value in content["held"].items())


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_scale(values: Sequence[Any]) -> bool:
    """Return whether a key has enough numbers to be an axis of a heat map."""
    return len(values) > 2 and all(map(_is_number, values))


def _word(value: object) -> str:
    """Return a value of a key as a scenario has it."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return short(f"{value:g}" if isinstance(value, float) else str(value))


def _draw_lines(axes: Axes, content: Content, measure: str, policy: str | None) -> None:
    """Draw a line with intervals per policy, or for one policy per value of the second key."""
    first, *second = content["keys"]
    values = content["keys"][first]
    series = content["keys"][second[0]] if second else content["policies"]
    if len(series) > MOST_LINES:
        many = f"{len(series)} values of {second[0]}" if second else f"{len(series)} policies"
        raise UsageError(f"{many}, and a panel shows at most {MOST_LINES} lines; choose with --key")
    numbers = all(map(_is_number, values))
    places = np.array(values if numbers else range(len(values)), dtype=float)
    span = float(np.ptp(places)) if numbers else 8.0
    for number, of in enumerate(series):
        rows = {
            row[first]: row["measures"][measure]
            for row in content["estimates"]
            if (row[second[0]] == of and row["policy"] == policy if second else row["policy"] == of)
        }
        there = [k for k, v in enumerate(values) if v in rows and rows[v]["mean"] is not None]
        points = [rows[values[k]] for k in there]
        dressed = look(number) | {"marker": marker(number)}
        if not numbers:
            dressed["linestyle"] = "none"
        at = places[there] + APART * span * (number - (len(series) - 1) / 2)
        _draw_line(axes, at, points, _word(of), dressed)
    if not numbers:
        axes.set_xticks(places, [_word(value) for value in values])
        axes.set_xlim(-0.5, len(values) - 0.5)
    elif len(values) <= 6:
        axes.set_xticks(places, [_word(value) for value in values])
    axes.set_xlabel(short(first))


def _draw_line(
    axes: Axes, at: NDArray[np.float64], points: list[Any], label: str, dressed: dict[str, Any]
) -> None:
    """Draw a line through means, and the intervals of those that have one."""
    axes.plot(at, [p["mean"] for p in points], label=label, **dressed)
    those = [k for k, p in enumerate(points) if p["half_width"]]
    if those:
        means, wide = ([points[k][of] for k in those] for of in ("mean", "half_width"))
        colour = dressed["color"]
        axes.errorbar(at[those], means, wide, ls="none", capsize=3, color=colour, lw=1.1)


def _draw_heat(figure: Figure, axes: Axes, content: Content, measure: str, policy: str) -> None:
    """Draw the means of a policy as shades, with the numbers where there is room."""
    (across, columns), (up, rows) = content["keys"].items()
    means = np.full((len(rows), len(columns)), np.nan)
    estimates = {
        (row[up], row[across]): row["measures"][measure]
        for row in content["estimates"]
        if row["policy"] == policy and row["measures"][measure]["mean"] is not None
    }
    for (y, x), of in estimates.items():
        means[rows.index(y), columns.index(x)] = of["mean"]
    every = [row["measures"][measure]["mean"] for row in content["estimates"]]
    every = [mean for mean in every if mean is not None] or [0.0]
    image = axes.imshow(
        means, cmap=SHADES, vmin=min(every), vmax=max(every), origin="lower", aspect="auto"
    )
    figure.colorbar(image, ax=axes)
    if len(rows) <= WRITTEN and len(columns) <= WRITTEN:
        for (y, x), of in estimates.items():
            _write(axes, image, columns.index(x), rows.index(y), of, of_mean(KNOWN[measure].form))
    axes.set_xticks(range(len(columns)), [_word(value) for value in columns])
    axes.set_yticks(range(len(rows)), [_word(value) for value in rows])
    axes.set(xlabel=short(across), ylabel=short(up))
    axes.grid(visible=False)


def _write(axes: Axes, image: Any, x: int, y: int, of: dict[str, Any], form: str) -> None:
    """Write a mean, and its half-width if there is one, into a cell."""
    form = {".2f": ".1f", ".3f": ".2f"}.get(form, form)
    text = format(of["mean"], form)
    text += f"\n±{of['half_width']:{form}}" if of["half_width"] is not None else ""
    red, green, blue, _ = image.cmap(image.norm(of["mean"]), bytes=True)
    ink = ink_on(f"#{red:02x}{green:02x}{blue:02x}")
    axes.text(x, y, text, ha="center", va="center", fontsize=7, color=ink)
