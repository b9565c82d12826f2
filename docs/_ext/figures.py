"""The figures of the pages on verification, as their commands have left them in ``_data``."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from markdown_table import table

from desim_uav.experiment.papers import ENTRIES, work
from desim_uav.experiment.papers.row import FigureRow

DATA = Path(__file__).parents[1] / "_data"
CHECKED = ("", "ours", "theory", "difference", "limit", "n", "holds")


def verification() -> str:
    """One section for each file that ``analysis/verification.py --data`` has written."""
    return "\n".join(_checked(_read(file)) for file in sorted(DATA.glob("verification/*.json")))


def mutations() -> str:
    """The table that ``tests/mutation.py --csv`` has written."""
    with (DATA / "mutations.csv").open(encoding="utf-8", newline="") as file:
        headings, *rows = csv.reader(file)
    return table(headings, rows)


def papers() -> str:
    """The list of all papers, with what their commands printed when they were measured.

    Their names lead to the sections of the page, which have the links to the papers.
    """
    listed = [replace(one, doi=None) for one in work.listing()]
    cells = work.cells(listed)
    return table(work.LIST_COLUMNS, ((f"[{name}](#{name})", *rest) for name, *rest in cells))


def paper(name: str) -> str:
    """The citation of a paper, and its table as its command printed it."""
    entry, known = ENTRIES[name], work.measured()[name]
    doi = "" if entry.doi is None else f" [doi:{entry.doi}]({work.link_of(entry.doi)})"
    took = (
        f"`{known['command']}`, {known['date'][:10]}: {known['seconds']:g} s, of the processor "
        f"{known['processor_s']:g} s, and {known['peak_mib']} MiB on {known['processor']}, with "
        "nothing compiled before."
    )
    rows = table(work.COLUMNS, (_row(row).cells() for row in known["rows"]))
    return f"{entry.paper}.{doi}\n\n{took}\n\n{rows}"


def _checked(part: dict[str, Any]) -> str:
    made = f"`{part['command']}`, {part['date']}; processor: {part['processor']}"
    return f"## {part['about']}\n\n{made}; versions: {part['versions']}.\n\n" + table(
        CHECKED, part["rows"]
    )


def _row(content: dict[str, Any]) -> FigureRow:
    """Return a row without what it computes itself."""
    return FigureRow(**{k: v for k, v in content.items() if k not in {"apart", "holds"}})


def _read(file: Path) -> dict[str, Any]:
    read: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return read
