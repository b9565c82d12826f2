"""The figures of the verification and the mutations, as ``analysis/verified`` has them."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import NamedTuple

from markdown_table import table

FOLDER = Path(__file__).parents[2] / "analysis" / "verified"
MUTATIONS = FOLDER / "mutations.csv"
ORDER = (
    *("transit", "crossings", "planning", "queueing", "tasks", "ages", "demand", "placement"),
    *("mobility", "streams", "determinism", "conservation", "identities", "convergence"),
    *("flights", "engines", "optimality"),
)
"""The parts in the order of the page; a part that is not in it stands at its end."""


class Part(NamedTuple):
    """What ``analysis/verification.py`` has written of one part."""

    title: str
    origin: str
    rows: list[list[str]]


def figures() -> str:
    """Return a section for each part."""
    return "\n".join(_section(part(file)) for file in files())


def mutations() -> str:
    """Return the table of deliberate errors, with the tests that notice them."""
    headings = ("Error", "File in `desim_uav/`", "Noticed by", "Seconds")
    rows = records(MUTATIONS)
    return table(
        headings, ([what, f"`{file}`", f"`{test}`", time] for what, file, test, time in rows)
    )


def files() -> list[Path]:
    """Return the file of each part, in the order of the page."""
    known = {name: place for place, name in enumerate(ORDER)}
    parts = [file for file in FOLDER.glob("*.csv") if file != MUTATIONS]
    return sorted(parts, key=lambda file: (known.get(file.stem, len(known)), file.stem))


def part(file: Path) -> Part:
    """Return a part: its title and its origin stand in comments above the rows."""
    title, origin, *_ = file.read_text(encoding="utf-8").splitlines()
    return Part(title.removeprefix("# "), origin.removeprefix("# "), records(file))


def records(file: Path) -> list[list[str]]:
    """Return the rows below the heading."""
    with file.open(encoding="utf-8", newline="") as opened:
        rows = [*csv.reader(line for line in opened if not line.startswith("# "))]
    return rows[1:]


def _section(one: Part) -> str:
    headings = ("Figure", "Ours", "Theory", "Difference", "Limit", "n", "Holds")
    return f"## {one.title}\n\n{one.origin}.\n\n{table(headings, one.rows)}"
