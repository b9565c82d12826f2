"""The figures of the pages on verification, as their commands have left them in ``_data``."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

from markdown_table import table

from desim_uav.experiment import papers as papers
from desim_uav.experiment.papers.row import GalleryRow

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


def gallery() -> str:
    """One section for each paper in the output of ``desim-uav gallery --json``."""
    return "\n".join(
        f"## {paper['name']}\n\n{paper['paper']}\n\n"
        + table(papers.COLUMNS, (_row(row).cells() for row in paper["rows"]))
        for paper in _read(DATA / "papers.json")["papers"]
    )


def _checked(part: dict[str, Any]) -> str:
    made = f"`{part['command']}`, {part['date']}; processor: {part['processor']}"
    return f"## {part['about']}\n\n{made}; versions: {part['versions']}.\n\n" + table(
        CHECKED, part["rows"]
    )


def _row(content: dict[str, Any]) -> GalleryRow:
    """Return a row without what it computes itself."""
    return GalleryRow(**{k: v for k, v in content.items() if k not in {"apart", "holds"}})


def _read(file: Path) -> dict[str, Any]:
    read: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return read
