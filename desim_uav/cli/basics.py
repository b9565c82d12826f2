"""Commands about scenario files and the installation."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from desim_uav.cli.options import Json, Override, complete_scenarios
from desim_uav.errors import notice
from desim_uav.notices import tell


def scenarios(
    show: Annotated[
        str | None, typer.Option(metavar="NAME", help="Print the file of this shipped scenario.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the shipped scenarios."""
    from desim_uav import shipped

    if show is not None:
        print(shipped.scenario_path(show).read_text(encoding="utf-8"), end="")
        return
    names = shipped.scenario_names()
    found = [(name, _first_comment(shipped.scenario_path(name))) for name in names]
    if as_json:
        print(json.dumps(dict(found), indent=1))
        return
    width = max(map(len, names))
    for name, about in found:
        tell(f"{name:{width}s} {about}")


def validate(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE…",
            help="Scenario files, or names of shipped scenarios.",
            autocompletion=complete_scenarios,
        ),
    ],
    overrides: Override = None,
) -> None:
    """Check scenario files: print every error of each, and see that their worlds can be drawn.

    For a scenario that only the SimPy engine can run, print a notice with the keys and the reason.
    Components that a file names as module:Class are imported from the working folder, which runs
    their code; --no-plugins refuses them.
    """
    from desim_uav.engine.choose import lacking_of
    from desim_uav.errors import ScenarioError
    from desim_uav.experiment.interrupt import at_once
    from desim_uav.scenario.doubts import recordings, warn_of
    from desim_uav.scenario.draft import blaming
    from desim_uav.scenario.load import load
    from desim_uav.shipped import find_scenario
    from desim_uav.world import build_world

    problems: list[str] = []
    for file in files:
        try:
            path = find_scenario(file)
            scenario = at_once(load, path, overrides or [])
            with blaming(path, overrides or []):
                world = at_once(build_world, scenario, scenario.effective_world_seed)
            warn_of(scenario)
            for why in at_once(lacking_of, world):
                notice(f"{file}: only the SimPy engine (--engine des) can run this scenario: {why}")
            tell(f"{file}: valid")
            for recording in recordings(scenario):
                tell(f"{file}: {recording}")
        except ScenarioError as error:
            problems += error.problems
    if problems:
        raise ScenarioError(*problems)


def schema() -> None:
    """Print the JSON Schema of scenario files, for editors."""
    from desim_uav.scenario.load import json_schema

    print(json.dumps(json_schema(), indent=1))


def doctor(as_json: Json = False) -> None:
    """Check the installation: versions, extras, the compiled code, and what can be written."""
    from desim_uav.experiment.doctor import as_content, examine
    from desim_uav.report.text import print_findings

    findings = examine()
    content = as_content(findings)
    if as_json:
        print(json.dumps(content, indent=1))
    else:
        print_findings([(f.verdict, f.what, f.words) for f in findings])
    if not content["healthy"]:
        raise typer.Exit(1)


def _first_comment(path: Path) -> str:
    first = path.read_text(encoding="utf-8").partition("\n")[0]
    return first.lstrip("# ") if first.startswith("#") else ""
