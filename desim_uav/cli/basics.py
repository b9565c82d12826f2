"""Commands about scenario files, the installation, and published papers."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import typer

from desim_uav.api import files
from desim_uav.cli.ending import complain, ended, print_json
from desim_uav.cli.made import made
from desim_uav.cli.terminal import AS_JSON, NO_PLUGINS, NO_PROGRESS
from desim_uav.notices import tell


@made(files.list_scenarios, AS_JSON)
def scenarios(arguments: dict[str, Any], as_json: bool) -> None:
    """Print the names and what they are about, or the text of a file."""
    listing = files.list_scenarios(**arguments)
    if arguments["show"] is not None:
        print(listing[arguments["show"]], end="")
    elif as_json:
        print_json(listing)
    else:
        width = max(map(len, listing))
        for name, about in listing.items():
            tell(f"{name:{width}s} {about}")


@made(files.list_tutorials, AS_JSON)
def tutorials(arguments: dict[str, Any], as_json: bool) -> None:
    """Print the names or files of the tutorials, and their titles."""
    listing = files.list_tutorials(**arguments)
    if as_json:
        print_json(listing)
        return
    width = max(map(len, listing))
    for name, title in listing.items():
        tell(f"{name:{width}s} {title}")


@made(files.validate, NO_PLUGINS)
def validate(arguments: dict[str, Any]) -> None:
    """Print which files are valid."""
    for line in files.validate(**arguments):
        tell(line)


@made(files.schema)
def schema(arguments: dict[str, Any]) -> None:
    """Print the schema."""
    print_json(files.schema())


@made(files.doctor, AS_JSON)
def doctor(arguments: dict[str, Any], as_json: bool) -> None:
    """Print what was found, and end with exit code 1 if there is a problem."""
    from desim_uav.experiment.doctor import as_content
    from desim_uav.report.text import print_findings

    findings = files.doctor()
    content = as_content(findings)
    if as_json:
        print_json(content)
    else:
        print_findings([(f.verdict, f.what, f.words) for f in findings])
    if not content["healthy"]:
        raise typer.Exit(1)


@made(files.paper, AS_JSON, NO_PROGRESS, optional=("name",))
def paper(arguments: dict[str, Any], as_json: bool, quiet: bool) -> None:
    """Print the table of a paper, and end with exit code 6 if a figure does not hold."""
    from desim_uav.experiment.papers import ENTRIES, work
    from desim_uav.report.papers import print_paper

    name = arguments["name"]
    if name is None:
        _list_papers(as_json)
        return
    kept = ENTRIES[name].kept if name in ENTRIES else ""
    otherwise = f"what had ended is kept in {kept}" if kept else "nothing is kept"
    (computed, folder), _ = ended(files.paper, arguments, otherwise)
    if as_json:
        print_json(computed.content())
    else:
        print_paper(computed.entry.paper, work.COLUMNS, [row.cells() for row in computed.rows])
    complain(str(folder))
    complain(computed.summary())
    if computed.count()["fail"]:
        raise typer.Exit(6)


def _list_papers(as_json: bool) -> None:
    """Print all papers."""
    from desim_uav.experiment.papers import work
    from desim_uav.report.papers import print_paper

    listed = files.list_papers()
    if as_json:
        print_json([asdict(one) for one in listed])
    else:
        print_paper("desim-uav paper NAME computes one", work.LIST_COLUMNS, work.cells(listed))
