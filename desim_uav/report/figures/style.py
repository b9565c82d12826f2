"""The common style of all figures, and writing them to files."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
import pandas as pd
from matplotlib import figure as mpl_figure
from matplotlib.axes import Axes

from desim_uav.errors import UsageError
from desim_uav.palette import drone_colour
from desim_uav.report.markup import visible

STYLE = Path(__file__).parents[1] / "desim_uav.mplstyle"

COLOURS = ("#000000", "#56B4E9", "#332288", "#D55E00", "#470647", "#009E73", "#7A1F36")
"""The colours of series (policies, algorithms, services). None of them looks like a drone's colour
(`desim_uav.palette.DRONES`), also for colour-blind readers, and neighbours differ in lightness for
grey prints. Black, sky blue, vermillion and green are from Okabe and Ito, indigo from Paul Tol."""

MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DASHES: tuple[Any, ...] = ("-", "--", ":", "-.", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)), (0, (8, 2)))
HATCHES = ("", "////", "....", "xxxx", "\\\\\\\\", "----", "++++")
GOOD, FAIR, BAD = "#009E73", "#F0E442", "#D55E00"

MOST_PANELS, MOST_NAMED = 24, 9
NARROW = 5.0
"""The width in inches of a figure that fits beside another, or on a telephone."""

LONGEST_NAME = 26
ENDINGS = (".png", ".pdf", ".svg")
METADATA: dict[str, dict[str, Any]] = {
    ".png": {"Software": None},
    ".pdf": {"Creator": None, "Producer": None, "CreationDate": None},
    ".svg": {"Creator": None, "Date": None},
}
"""Leave out dates and versions, so that the same figure gives the same file."""

IDENTIFIER = re.compile(r'(?<= id=")p[0-9a-f]{10}(?=")')
REFERENCE = re.compile(r'( id="|url\(#)(p[0-9a-f]{10})')
"""The identifier of a clip path, and where it stands, in an SVG of Matplotlib's."""

P = ParamSpec("P")
T = TypeVar("T")


class Figure(mpl_figure.Figure):
    """A figure of Matplotlib that a notebook shows, although pyplot does not know it.

    ``table`` has its numbers, if they can be written to a file.
    """

    table: pd.DataFrame | None = None

    def _repr_png_(self) -> bytes:
        return to_bytes(self, ".png")


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Make a function draw in the common style, independent of the user's own settings."""

    @wraps(draw)
    def in_style(*args: P.args, **kwargs: P.kwargs) -> T:
        with mpl.rc_context():
            mpl.rcdefaults()
            mpl.rcParams.update(mpl.rc_params_from_file(STYLE, use_default_template=False))
            return draw(*args, **kwargs)

    return in_style


@styled
def to_bytes(figure: mpl_figure.Figure, suffix: str) -> bytes:
    """Return a figure as the content of a file; the same figure gives the same bytes."""
    file = io.BytesIO()
    figure.savefig(file, format=suffix[1:], metadata=METADATA[suffix])
    content = file.getvalue()
    return as_text(content).encode() if suffix == ".svg" else content


def as_text(svg: bytes) -> str:
    """Return an SVG of Matplotlib's that is valid XML and the same for the same figure.

    Names may contain characters that XML does not allow or that hide what is beside them. The
    identifiers of clip paths, which in some versions depend on addresses in memory, become numbers.
    """
    text = visible(svg.decode())
    numbers = {name: f"i{k}" for k, name in enumerate(dict.fromkeys(IDENTIFIER.findall(text)))}
    return REFERENCE.sub(lambda match: match[1] + numbers.get(match[2], match[2]), text)


def headed(figure: Figure, text: str) -> None:
    """Write a heading above a figure."""
    figure.suptitle(text, fontsize=9.5)
    figure.set_layout_engine("constrained", h_pad=0.07)


def look(number: int) -> dict[str, Any]:
    """Return the line style of a series: neighbours differ in both colour and dashes.

    Up to 49 series differ in at least one of them.
    """
    dash = DASHES[(number + number // len(DASHES)) % len(DASHES)]
    return {"color": COLOURS[number % len(COLOURS)], "linestyle": dash}


def drone_look(drone: int) -> dict[str, Any]:
    """Return the line style of a drone: its colour everywhere, and dashes for grey.

    Dashes and colours repeat together only after 49 drones.
    """
    dash = DASHES[(drone + drone // len(DASHES)) % len(DASHES)]
    return {"color": drone_colour(drone), "linestyle": dash}


def marker(number: int) -> str:
    """Return the marker of a series."""
    return MARKERS[number % len(MARKERS)]


def grid_of(count: int, width: float, height: float, across: int = 3) -> tuple[Figure, list[Axes]]:
    """Return a figure with ``count`` panels, row by row, and the panels.

    ``width`` and ``height`` are those of one panel, in inches. Raises UsageError for too many.
    """
    if count > MOST_PANELS:
        raise UsageError(
            f"{count} panels are too many (at most {MOST_PANELS}); choose one with --drone"
        )
    columns = min(count, across)
    rows = -(-count // columns)
    figure = Figure(figsize=(width * columns + 0.7, height * rows + 0.9))
    return figure, [figure.add_subplot(rows, columns, k + 1) for k in range(count)]


def short(name: str) -> str:
    """Return a printable name; only the end of a long one, which is that of a file's own name."""
    text = visible(name)
    return text if len(text) <= LONGEST_NAME else "…" + text[1 - LONGEST_NAME :]


def named(drone: int, drones: int, text: str) -> str | None:
    """Return a drone's entry in a legend, or one entry for all if there are many drones."""
    if drones <= MOST_NAMED:
        return text
    return f"drone, one of {drones}" if drone == 0 else None
