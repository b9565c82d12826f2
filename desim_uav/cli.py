"""The command line. Imports what a command needs only when it runs."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from desim_uav import __version__
from desim_uav.errors import DesimError

app = typer.Typer(
    help="Exact discrete-event simulation of UAV-enabled wireless networks.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Override = Annotated[
    list[str] | None,
    typer.Option("-S", metavar="KEY.PATH=VALUE", help="Set a key of the scenario; repeatable."),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]


def main() -> NoReturn:
    """Run the command line; every error a user can mend is one message and an exit code."""
    try:
        app(prog_name="desim-uav")
    except DesimError as error:
        for problem in str(error).splitlines():
            print(f"desim-uav: {problem}", file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(1)
    sys.exit(0)


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        print(f"desim-uav {__version__}")
        raise typer.Exit


@app.command()
def scenarios(
    show: Annotated[
        str | None, typer.Option(metavar="NAME", help="Print the file of this scenario.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the shipped scenarios."""
    from desim_uav import shipped

    if show is not None:
        print(shipped.find_scenario(show).read_text(encoding="utf-8"), end="")
        return
    names = shipped.scenario_names()
    found = [(name, _first_comment(shipped.scenario_path(name))) for name in names]
    if as_json:
        print(json.dumps(dict(found), indent=1))
        return
    for name, about in found:
        print(f"{name:8s} {about}")


@app.command()
def validate(
    files: Annotated[list[str], typer.Argument(metavar="FILE…", help="Files or shipped names.")],
    overrides: Override = None,
) -> None:
    """Check scenario files, every error of each, and that their worlds can be drawn."""
    from desim_uav.errors import ScenarioError
    from desim_uav.scenario.load import load
    from desim_uav.shipped import find_scenario
    from desim_uav.world import build_world

    problems: list[str] = []
    for file in files:
        try:
            path = find_scenario(file)
            scenario = load(path, overrides or [])
            _located(path, lambda s=scenario: build_world(s, s.effective_world_seed))
            print(f"{file}: valid")
        except ScenarioError as error:
            problems += error.problems
    if problems:
        raise ScenarioError(*problems)


@app.command()
def schema() -> None:
    """Print the JSON Schema of scenario files, for editors."""
    from desim_uav.scenario.load import json_schema

    print(json.dumps(json_schema(), indent=1))


@app.command()
def run(
    scenario: Annotated[str, typer.Argument(help="A scenario file, or a shipped name: case5.")],
    policy: Annotated[
        str,
        typer.Option(
            metavar="P", help='baseline, random, hover, script:FILE.csv or "package.module:Class".'
        ),
    ] = "baseline",
    seed: Annotated[
        int | None, typer.Option(metavar="N", min=0, max=2**63 - 1, help="Not the scenario's.")
    ] = None,
    world_seed: Annotated[
        int | None, typer.Option(metavar="N", min=0, max=2**63 - 1, help="Draws the world alone.")
    ] = None,
    episodes: Annotated[int, typer.Option(metavar="N", min=1, max=10**6, help="Counted ones.")] = 1,
    warmup: Annotated[
        int, typer.Option(metavar="N", min=0, max=10**6, help="Episodes before, counted nowhere.")
    ] = 0,
    overrides: Override = None,
    events: Annotated[bool, typer.Option("--events", help="Keep the event log.")] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Instead of runs/<name>-<policy>-s<seed>.")
    ] = None,
    as_json: Json = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress, no table.")] = False,
) -> None:
    """Run a policy in a scenario, log every request, and print the quality of experience."""
    from desim_uav.experiment.command import run_to_folder
    from desim_uav.scenario.load import load
    from desim_uav.shipped import find_scenario

    settings = list(overrides or [])
    settings += [] if seed is None else [f"seed={seed}"]
    settings += [] if world_seed is None else [f"world_seed={world_seed}"]
    path = find_scenario(scenario)
    loaded = load(path, settings)
    done = _located(
        path,
        lambda: run_to_folder(
            loaded,
            policy,
            episodes=episodes,
            warmup=warmup,
            keep_events=events,
            out=out,
            command=["desim-uav", *sys.argv[1:]],
            show_progress=not quiet,
        ),
    )
    if as_json:
        print(json.dumps(done.summary, indent=1))
    elif not quiet:
        from desim_uav.report.text import print_run

        print_run(done.summary, done.by_service)
    if done.interrupted:
        print("desim-uav: interrupted; the finished episodes are kept", file=sys.stderr)
        raise typer.Exit(130)


@app.command()
def qoe(
    run_dir: Annotated[Path, typer.Argument(help="The folder of a run.")],
    by: Annotated[
        str | None, typer.Option(metavar="service|episode|user|outcome", help="Group by.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Print the quality of experience of a finished run."""
    from desim_uav import qoe as measures
    from desim_uav.experiment.command import read_counted
    from desim_uav.registry import did_you_mean

    if by is not None and by not in measures.GROUPS:
        raise typer.BadParameter(
            f"{by!r}{did_you_mean(by, measures.GROUPS)}; allowed: {', '.join(measures.GROUPS)}",
            param_hint="--by",
        )
    summary, requests = read_counted(run_dir)
    if by is None:
        content: Any = summary
    else:
        content = json.loads(measures.grouped(requests, by).to_json(orient="records"))
    if as_json:
        print(json.dumps(content, indent=1))
        return
    from desim_uav.report.text import print_groups, print_summary

    if by is None:
        print_summary(content)
    else:
        print_groups(by, content)


def _located(path: Path, action: Any) -> Any:
    """Run ``action``; a scenario error found only in drawing the world gets its file's name."""
    from desim_uav.errors import ScenarioError

    try:
        return action()
    except ScenarioError as error:
        raise ScenarioError(*(f"{path}: {problem}" for problem in error.problems)) from error


def _first_comment(path: Path) -> str:
    first = path.read_text(encoding="utf-8").partition("\n")[0]
    return first.lstrip("# ") if first.startswith("#") else ""
