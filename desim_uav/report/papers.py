"""Tables of published figures beside ours, in the terminal and in Markdown."""

from __future__ import annotations

from collections.abc import Sequence

from rich import box
from rich.table import Table

from desim_uav.report.text import print_table

Titled = tuple[str, Sequence[Sequence[str]]]
"""A title, and the rows of its table as text."""

NUMBERS = frozenset({"theirs", "ours", "apart", "limit"})


def print_gallery(columns: Sequence[str], tables: Sequence[Titled]) -> None:
    """Print a table for each paper."""
    for title, rows in tables:
        table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), title_justify="left")
        for column in columns:
            right = column in NUMBERS
            table.add_column(column, justify="right" if right else "left", no_wrap=right)
        for row in rows:
            table.add_row(*row)
        print_table(table)


def markdown_tables(columns: Sequence[str], tables: Sequence[Titled]) -> str:
    """Return a heading and a table for each paper."""
    return "\n".join(f"### {title}\n\n{_table(columns, rows)}" for title, rows in tables)


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    rule = ["---:" if column in NUMBERS else "---" for column in columns]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in (columns, rule, *rows))
