"""Commands that learn, and say how well anything could do."""

from __future__ import annotations

from typing import Any

import typer

from desim_uav.api.study import find_optimum
from desim_uav.api.study import reproduce as run_reproduce
from desim_uav.api.train import train as run_train
from desim_uav.cli.ending import complain, end, ended, print_json
from desim_uav.cli.made import made
from desim_uav.cli.terminal import AS_JSON, CHECK, NO_PLUGINS, NO_PROGRESS, QUIET
from desim_uav.errors import UsageError
from desim_uav.notices import tell


@made(run_train, AS_JSON, QUIET, NO_PLUGINS, without=("callback", "callback_every"))
def train(arguments: dict[str, Any], as_json: bool, quiet: bool) -> None:
    """Print the means over the last episodes."""
    arguments["out"] = arguments["out"] or True
    resumable = "the last checkpoint is kept: --resume goes on from it"
    result, interrupted = ended(run_train, arguments, resumable)
    summary = result.summary()
    if as_json:
        print_json(summary)
    elif not quiet:
        from desim_uav.report.text import print_training

        print_training(summary)
    if interrupted:
        end(f"interrupted after {summary['episodes']} episodes; --resume goes on")


@made(find_optimum, AS_JSON, NO_PROGRESS, NO_PLUGINS)
def optimum(arguments: dict[str, Any], as_json: bool, quiet: bool) -> None:
    """Print the optima, and the bounds of runs."""
    from desim_uav.report.optimum import print_optimum

    solution = find_optimum(**arguments)
    if as_json:
        print_json(solution.content())
    else:
        print_optimum(solution.content())


@made(run_reproduce, CHECK, QUIET)
def reproduce(arguments: dict[str, Any], check: bool, quiet: bool) -> None:
    """Print both tables, and end with exit code 6 if a gate does not hold and this was asked."""
    from desim_uav.experiment.paper_table import HEADINGS, cells
    from desim_uav.report.paper import print_claims, print_paper_table

    if check and arguments["preset"] == "paper":
        raise UsageError("--check: the gates are of the default training, not of the paper's")
    report = run_reproduce(**arguments)
    if not quiet:
        print_paper_table(HEADINGS, [cells(line) for line in report.table])
        print_claims([(c.text, c.found, c.holds) for c in report.claims])
        tell(arguments["out"] / "table.md")
    if check and report.failed:
        complain("\n".join(f"gate: {claim.text}: {claim.found}" for claim in report.failed))
        raise typer.Exit(6)
