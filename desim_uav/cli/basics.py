"""Commands about scenario files, the installation, and published papers."""

from __future__ import annotations

from typing import Any

import typer

from desim_uav.api import files
from desim_uav.cli.ending import complain, print_json
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


@made(files.gallery, AS_JSON, NO_PROGRESS)
def gallery(arguments: dict[str, Any], as_json: bool, quiet: bool) -> None:
    """Print a table for each paper, and end with exit code 6 if a figure does not hold."""
    from desim_uav.experiment import papers as work
    from desim_uav.report.papers import print_gallery

    compared, pictures = files.gallery(**arguments)
    if as_json:
        print_json({**work.count(compared), "papers": [one.content() for one in compared]})
    else:
        print_gallery(work.COLUMNS, work.tables(compared))
    if arguments["figure"] is not None:
        for file in pictures:
            complain(str(file))
        for name in work.without_figure(compared):
            complain(f"{name} has no figure")
    complain(work.summary(compared))
    if work.count(compared)["fail"]:
        raise typer.Exit(6)
