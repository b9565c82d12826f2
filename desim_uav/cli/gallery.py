"""The command that holds the models against published papers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from desim_uav.cli.ending import complain
from desim_uav.cli.options import OUTPUT, Json, NoProgress


def complete_papers(incomplete: str) -> list[str]:
    """Return the papers, for a shell that completes what is typed."""
    from desim_uav.experiment.gallery import ENTRIES

    return [name for name in ENTRIES if name.startswith(incomplete)]


def gallery(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME…]",
            help="The papers, such as al_hourani_2014. By default they are all.",
            autocompletion=complete_papers,
        ),
    ] = None,
    as_json: Json = False,
    figure: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Draw a figure of each paper into DIR.", rich_help_panel=OUTPUT
        ),
    ] = None,
    markdown: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write the tables to FILE, in Markdown.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    quiet: NoProgress = False,
) -> None:
    """Compute what published papers print, and end with exit code 6 if a figure does not hold."""
    from desim_uav.experiment import gallery as work
    from desim_uav.report.gallery import markdown_tables, print_gallery
    from desim_uav.run_folder import file_place, write_at

    place = None if markdown is None else file_place(markdown, "--markdown")
    if figure is not None:
        file_place(figure / "figure.png", "--figure")  # refused before anything is computed
    compared = work.gallery(names or (), show_progress=not quiet)
    tables = [(f"{one.name}. {one.paper}", [r.cells() for r in one.rows]) for one in compared]
    if as_json:
        content = {**work.count(compared), "papers": [one.content() for one in compared]}
        print(json.dumps(content, indent=1))
    else:
        print_gallery(work.COLUMNS, tables)
    if place is not None:
        write_at(place, markdown_tables(work.COLUMNS, tables).encode())
    if figure is not None:
        for file in work.draw_all(compared, figure):
            complain(str(file))
        for name in work.without_figure(compared):
            complain(f"{name} has no figure")
    complain(work.summary(compared))
    if work.count(compared)["fail"]:
        raise typer.Exit(6)
