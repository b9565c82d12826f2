"""Tables of published figures beside ours, in the terminal and in Markdown."""

from __future__ import annotations

from collections.abc import Sequence

from rich import box
from rich.table import Table
from rich.text import Text

from desim_uav.report.text import print_table

NUMBERS = frozenset({"theirs", "ours", "apart", "limit", "hold", "fail", "open", "s", "MiB"})


def print_paper(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table: of a paper's figures, or of all papers."""
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), title_justify="left")
    for column in columns:
        right = column in NUMBERS
        table.add_column(column, justify="right" if right else "left", no_wrap=right)
    for row in rows:
        table.add_row(*map(Text, row))
    print_table(table)


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    rule = ["---:" if column in NUMBERS else "---" for column in columns]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in (columns, rule, *rows))
