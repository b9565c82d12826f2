"""Small tables for the terminal."""

from __future__ import annotations

import math
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

PIPED_WIDTH = 200
MEASURES = {
    "requests": ("requests", "d"),
    "qoe1_percent": ("QoE1\n%", ".1f"),
    "qoe1_feasible_percent": ("feasible\nQoE1 %", ".1f"),
    "qoe2_iterations": ("QoE2\nit.", ".2f"),
    "qoe3_percent": ("QoE3\n%", ".1f"),
    "qoe3_active_percent": ("active\nQoE3 %", ".1f"),
    "completed": ("comp-\nleted", "d"),
    "unfinished": ("unfin-\nished", "d"),
    "never_served": ("never\nserved", "d"),
}
"""Headings and formats; a table of them fits a terminal of 80 columns."""


def print_run(summary: dict[str, Any], by_service: list[dict[str, Any]]) -> None:
    """The table a run ends with: all requests, and by service."""
    rows = [{"service": "all"} | summary, *by_service]
    title = "{scenario}, {policy}, seed {seed}: {episodes} episode(s), {crashes} crash(es)"
    _print("service", rows, Text(title.format(**summary)))
    print(f"{summary['run_dir']}")


def print_summary(summary: dict[str, Any]) -> None:
    """Every measure on a line of its own."""
    for name, value in summary.items():
        shown = f"{value:.6g}" if isinstance(value, float) else "-" if value is None else value
        print(f"{name:22s} {shown}")


def print_groups(by: str, rows: list[dict[str, Any]]) -> None:
    """A row for each group of requests."""
    _print(by, rows, None)


def _print(by: str, rows: list[dict[str, Any]], title: Text | None) -> None:
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), title_justify="left")
    table.add_column(by, no_wrap=True)
    shown = {name: look for name, look in MEASURES.items() if any(name in row for row in rows)}
    for heading, _ in shown.values():
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(str(row[by]), *(_cell(row, name, look[1]) for name, look in shown.items()))
    console = Console()
    Console(width=None if console.is_terminal else PIPED_WIDTH).print(table)


def _cell(row: dict[str, Any], name: str, form: str) -> str:
    value = row.get(name)
    return "" if value is None or math.isnan(value) else format(value, form)
