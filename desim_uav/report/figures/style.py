"""One look for all figures, and how they become files."""

from __future__ import annotations

import io
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from desim_uav.errors import UsageError
from desim_uav.palette import drone_colour
from desim_uav.report.markup import visible

STYLE = Path(__file__).parents[1] / "desim_uav.mplstyle"

COLOURS = ("#000000", "#56B4E9", "#332288", "#D55E00", "#470647", "#009E73", "#7A1F36")
"""Of series (policies, algorithms, services). None of them looks like a drone's colour
(`desim_uav.palette.DRONES`), whichever colours a reader can see, and neighbours differ in lightness
for grey. Black, sky blue, vermillion and green are from Okabe and Ito, indigo is from Paul Tol."""

MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DASHES: tuple[Any, ...] = ("-", "--", ":", "-.", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)), (0, (8, 2)))
HATCHES = ("", "////", "....", "xxxx", "\\\\\\\\", "----", "++++")
GOOD, FAIR, BAD = "#009E73", "#F0E442", "#D55E00"

MOST_PANELS, MOST_NAMED = 24, 9
NARROW = 5.0
"""Inches: where figures stand beside each other on a desk, and one fills a telephone."""

LONGEST_NAME = 26
ENDINGS = (".png", ".pdf", ".svg")
METADATA: dict[str, dict[str, Any]] = {
    ".png": {"Software": None},
    ".pdf": {"Creator": None, "Producer": None, "CreationDate": None},
    ".svg": {"Creator": None, "Date": None},
}
"""Nothing of when and by what: the same figure is the same file."""

P = ParamSpec("P")
T = TypeVar("T")


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Let a function draw in the one style, whatever the user's own settings are."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> T:
        with mpl.rc_context():
            mpl.rcdefaults()
            mpl.rcParams.update(mpl.rc_params_from_file(STYLE, use_default_template=False))
            return draw(*args, **kwargs)

    return drawn


def ending(out: Path) -> str:
    """The format a file's name asks for. Raises UsageError, naming those there are."""
    found = out.suffix.lower()
    if found not in ENDINGS:
        raise UsageError(f"--out {out}: a figure ends in {', '.join(ENDINGS)}")
    return found


@styled
def to_bytes(figure: Figure, suffix: str) -> bytes:
    """A figure as a file of one of ``ENDINGS``: the same figure gives the same bytes."""
    file = io.BytesIO()
    figure.savefig(file, format=suffix[1:], metadata=METADATA[suffix])
    return file.getvalue()


def headed(figure: Figure, text: str) -> None:
    """Write what a figure is of over it."""
    figure.suptitle(text, fontsize=9.5)
    figure.set_layout_engine("constrained", h_pad=0.07)


def look(number: int) -> dict[str, Any]:
    """Return colour and dashes of a series: neighbours differ in both, and 49 series in one."""
    dash = DASHES[(number + number // len(DASHES)) % len(DASHES)]
    return {"color": COLOURS[number % len(COLOURS)], "linestyle": dash}


def drone_look(drone: int) -> dict[str, Any]:
    """Return the line style of a drone: its colour everywhere, and dashes for grey.

    Dashes and colours repeat together only after 49 drones.
    """
    dash = DASHES[(drone + drone // len(DASHES)) % len(DASHES)]
    return {"color": drone_colour(drone), "linestyle": dash}


def marker(number: int) -> str:
    """The marker of this number."""
    return MARKERS[number % len(MARKERS)]


def grid_of(count: int, width: float, height: float, across: int = 3) -> tuple[Figure, list[Axes]]:
    """A figure with so many panels, row by row; ``width`` and ``height`` of one, in inches.

    Raises UsageError for more than one can look at.
    """
    if count > MOST_PANELS:
        raise UsageError(f"{count} panels, at most {MOST_PANELS}: choose one with --drone")
    columns = min(count, across)
    rows = -(-count // columns)
    figure = Figure(figsize=(width * columns + 0.7, height * rows + 0.9))
    return figure, [figure.add_subplot(rows, columns, k + 1) for k in range(count)]


def short(name: str) -> str:
    """A name as it can be seen; a long one from its end, for a file's own name is there."""
    seen = visible(name)
    return seen if len(seen) <= LONGEST_NAME else "…" + seen[1 - LONGEST_NAME :]


def named(drone: int, drones: int, text: str) -> str | None:
    """A drone's entry in a legend; where there are many, one for all."""
    if drones <= MOST_NAMED:
        return text
    return f"drone, one of {drones}" if drone == 0 else None
