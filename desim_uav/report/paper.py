"""The paper's table in the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich import box
from rich.table import Table
from rich.text import Text

from desim_uav.report.text import print_table


def print_paper_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a row per case and policy, with a rule between cases."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1))
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="left" if number == 1 else "right")
    for row, after in zip(rows, [*rows[1:], None], strict=True):
        table.add_row(*row, end_section=after is None or after[0] != row[0])
    print_table(table)


def print_claims(claims: Sequence[tuple[str, str, bool]]) -> None:
    """Print each claim, the value that was found, and whether the claim holds."""
    if not claims:
        return
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1))
    for heading in ("claim", "found", "holds"):
        table.add_column(heading)
    for text, value, holds in claims:
        table.add_row(Text(text), Text(value), "yes" if holds else "NO")
    print_table(table)
