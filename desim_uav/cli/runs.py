"""Commands that simulate a policy, and say what came out."""

from __future__ import annotations

from typing import Any

import typer

from desim_uav.api.compare import compare as compare_policies
from desim_uav.api.compare import compare_runs
from desim_uav.api.fork import counterfactual
from desim_uav.api.listing import list_runs
from desim_uav.api.measures import measures_of
from desim_uav.api.run import run as run_policy
from desim_uav.api.study import sweep as run_sweep
from desim_uav.cli.ending import complain, end, ended, print_json
from desim_uav.cli.looks import flags_of
from desim_uav.cli.made import made
from desim_uav.cli.terminal import AS_JSON, CONTEXT, NO_PLUGINS, NO_PROGRESS, QUIET
from desim_uav.errors import UsageError
from desim_uav.notices import tell


@made(
    *(run_policy, AS_JSON, QUIET, NO_PLUGINS),
    without=("seeds", "first_seed"),
    optional=("fork", "to"),
    also={"fork": counterfactual, "to": counterfactual},
)
def run(arguments: dict[str, Any], as_json: bool, quiet: bool) -> None:
    """Print the measures, by service; or those of both branches of a fork."""
    arguments["out"] = arguments["out"] or True
    branches = {name: arguments.pop(name) for name in ("fork", "to")}
    if branches != {"fork": None, "to": None}:
        _run_forked(arguments | branches, as_json, quiet)
        return
    result, interrupted = ended(run_policy, arguments)
    (summary,), (by_service,) = result.summaries(), result.groups("service")
    if as_json:
        print_json(summary)
    elif not quiet:
        from desim_uav.report.text import print_run

        print_run(summary, by_service)
    if interrupted:
        message = f"interrupted; the finished episodes are kept: {summary['run_dir']}"
        end(f"{message} (--resume goes on)")


def _run_forked(arguments: dict[str, Any], as_json: bool, quiet: bool) -> None:
    """Run both branches, and print their measures."""
    if arguments.pop("resume"):
        raise UsageError("--resume: a run with --fork cannot be continued")
    for option, lacks in (("fork", "to"), ("to", "fork")):
        if arguments[lacks] is None:
            form = "run SCENARIO --fork EPISODE:STEP --to POLICY"
            raise UsageError(f"--{option} needs --{lacks}: {form}")
    arguments.pop("events")  # they are kept
    branches, _ = ended(counterfactual, arguments)
    if as_json:
        print_json(branches.summary())
    elif not quiet:
        from desim_uav.report.text import print_fork

        print_fork(branches.summary())


@made(measures_of, AS_JSON, NO_PLUGINS)
def qoe(arguments: dict[str, Any], as_json: bool) -> None:
    """Print the measures, or those of each group."""
    summary, groups = measures_of(**arguments)
    by = arguments["by"]
    if as_json:
        print_json(summary | ({} if groups is None else {"by": by, "groups": groups}))
        return
    from desim_uav.report.text import print_groups, print_summary

    if groups is None:
        print_summary(summary)
    else:
        print_groups(by, groups)


@made(list_runs, AS_JSON)
def ls(arguments: dict[str, Any], as_json: bool) -> None:
    """Print a row for each run, the latest last."""
    frame = list_runs(**arguments)
    rows = frame.astype(object).where(frame.notna(), None).to_dict("records")
    if as_json:
        print_json(rows)
        return
    if not rows:
        complain(f"{arguments['root']}: no run or training is there")
        return
    from desim_uav.report.text import print_runs

    print_runs(rows)


HOW_TO_RUN = (
    *("seeds", "first_seed", "world_seed", "episodes", "warmup", "overrides", "jobs", "engine"),
)
"""The options of a comparison that are about runs to come."""

OF_FINISHED = ("against", "measure", "out")
"""The options of a comparison of finished runs."""


@made(
    *(compare_policies, CONTEXT, AS_JSON, NO_PROGRESS, NO_PLUGINS),
    without=("scenario",),
    optional=("policies",),
    also={"folders": compare_runs},
)
def compare(arguments: dict[str, Any], context: typer.Context, as_json: bool, quiet: bool) -> None:
    """Print the means, and the differences from a policy, of finished runs or of runs to come."""
    from desim_uav.experiment.compare import policy_names, the_scenario

    what, interrupted = arguments.pop("folders"), ""
    if arguments["policies"] is None:
        _refuse_how_to_run(context)
        comparison = compare_runs(what, **{name: arguments[name] for name in OF_FINISHED})
    else:
        scenario = the_scenario(what)
        arguments["policies"] = policy_names(arguments["policies"])
        comparison, interrupted = ended(
            compare_policies, arguments | {"scenario": scenario}, "no run has ended"
        )
    if as_json:
        print_json(comparison.content())
    else:
        from desim_uav.report.text import print_comparison

        print_comparison(comparison.content())
    if interrupted:
        end("interrupted; what had ended is shown")


def _refuse_how_to_run(context: typer.Context) -> None:
    """Finished runs are as they are. Raises UsageError for an option that says how to run."""
    for option in HOW_TO_RUN:
        source = context.get_parameter_source(option)
        if source is not None and source.name == "COMMANDLINE":
            flag = flags_of("compare", option)[0]
            raise UsageError(f"{flag} goes with a scenario and --policies, not with finished runs")


@made(run_sweep, AS_JSON, QUIET, NO_PLUGINS)
def sweep(arguments: dict[str, Any], as_json: bool, quiet: bool) -> None:
    """Print a row for each combination, and which jobs have failed."""
    result, interrupted = ended(run_sweep, arguments, "what had ended is kept; --resume goes on")
    if as_json:
        print_json(result.content())
    elif not quiet:
        from desim_uav.report.text import print_sweep

        print_sweep(result.headings(), result.lines())
        tell(arguments["out"] / "results")
    if result.failures:
        complain(result.complaint())
    if interrupted:
        end(
            f"interrupted; {len(result.rows)} of {len(result.jobs)} jobs are kept; --resume goes on"
        )
    if result.failures:
        raise typer.Exit(1)
