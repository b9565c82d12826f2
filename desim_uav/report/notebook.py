"""The display of results in a notebook: a heading and a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from desim_uav.report.markup import Html, joined, tag

ROW = "text-align: right; padding: 0.1em 0.6em; white-space: pre-line"
WORDS = "text-align: left; padding: 0.1em 0.6em"


def heading(text: str) -> Html:
    """Return the heading of a table."""
    return tag("div", text, style="font-weight: 600; margin: 0.3em 0")


def table(headings: Sequence[Any], rows: Sequence[Sequence[Any]], words: Sequence[int]) -> Html:
    """Return a table; ``words`` are its columns of text, all others hold numbers."""

    def cells(name: str, row: Sequence[Any]) -> Html:
        return joined(
            tag(name, cell, style=WORDS if number in words else ROW)
            for number, cell in enumerate(row)
        )

    head = tag("thead", tag("tr", cells("th", headings)))
    body = tag("tbody", joined(tag("tr", cells("td", row)) for row in rows))
    return tag("table", head, body)
