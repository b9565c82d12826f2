"""Commands that simulate a policy, and say what came out."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from desim_uav.cli.ending import complain, end_politely
from desim_uav.cli.options import (
    Counted,
    Engine,
    EngineIfAny,
    FirstSeed,
    Json,
    NoProgress,
    Override,
    Quiet,
    RunDir,
    ScenarioName,
    Seed,
    Seeds,
    Warmup,
    WorldSeed,
    one_of,
)
from desim_uav.errors import UsageError


def run(
    scenario: ScenarioName,
    policy: Annotated[
        str,
        typer.Option(
            metavar="P",
            help="baseline, random, hover, policy.npz, script:FILE.csv, sb3:FILE.zip, rllib:DIR "
            'or "package.module:Class".',
        ),
    ] = "baseline",
    seed: Seed = None,
    world_seed: WorldSeed = None,
    episodes: Counted = 1,
    warmup: Warmup = 0,
    overrides: Override = None,
    events: Annotated[bool, typer.Option("--events", help="Keep the event log.")] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Instead of runs/<name>-<policy>-s<seed>.")
    ] = None,
    engine: Engine = "des",
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Run a policy in a scenario, log every request, and print the quality of experience."""
    import desim_uav as du

    end_politely()
    try:
        done = du.run(
            scenario,
            overrides,
            policy=policy,
            seed=seed,
            world_seed=world_seed,
            episodes=episodes,
            warmup=warmup,
            events=events,
            out=True if out is None else out,
            engine=engine,
            progress=not quiet,
        )
        interrupted = False
    except du.Interrupted as stopped:
        done, interrupted = stopped.result, True
    except KeyboardInterrupt:
        complain("interrupted; nothing is kept")
        raise typer.Exit(130) from None
    (summary,), (by_service,) = done.summaries(), done.groups("service")
    if as_json:
        print(json.dumps(summary, indent=1))
    elif not quiet:
        from desim_uav.report.text import print_run

        print_run(summary, by_service)
    if interrupted:
        complain(f"interrupted; the finished episodes are kept: {summary['run_dir']}")
        raise typer.Exit(130)


def qoe(
    run_dir: RunDir,
    by: Annotated[
        str | None, typer.Option(metavar="service|episode|user|outcome", help="Group by.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Print the quality of experience of a finished run."""
    import desim_uav as du
    from desim_uav.qoe import GROUPS

    if by is not None:
        one_of(GROUPS, by, "--by")
    found = du.read_run(run_dir)
    groups = None if by is None else found.groups(by)[0]
    summary = found.summaries()[0]
    if as_json:
        added = {} if groups is None else {"by": by, "groups": groups}
        print(json.dumps(summary | added, indent=1))
        return
    from desim_uav.report.text import print_groups, print_summary

    if by is None or groups is None:
        print_summary(summary)
    else:
        print_groups(by, groups)


def compare(
    context: typer.Context,
    what: Annotated[
        list[str],
        typer.Argument(metavar="RUN…|SCENARIO", help="Run folders; or a scenario, and --policies."),
    ],
    policies: Annotated[
        str | None,
        typer.Option(metavar="P,Q…", help="Run these; no name can hold a comma."),
    ] = None,
    seeds: Seeds = 10,
    first_seed: FirstSeed = 0,
    episodes: Counted = 20,
    warmup: Warmup = 2,
    overrides: Override = None,
    jobs: Annotated[
        int, typer.Option("-j", "--jobs", metavar="N", min=1, max=1024, help="Runs at a time.")
    ] = 1,
    against: Annotated[
        str | None, typer.Option(metavar="P", help="The policy of reference; else the first.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="The values of each seed.")
    ] = None,
    engine: Engine = "des",
    as_json: Json = False,
    quiet: NoProgress = False,
) -> None:
    """Compare policies on common seeds: means, 95 % intervals and paired differences."""
    import desim_uav as du
    from desim_uav.experiment.compare import policy_names, the_scenario

    interrupted = False
    if policies is None:
        _refuse_how_to_run(context)
        found = du.compare_runs(what, against=against, out=out)
    else:
        end_politely()
        try:
            found = du.compare(
                the_scenario(what),
                overrides,
                policies=policy_names(policies),
                seeds=seeds,
                first_seed=first_seed,
                episodes=episodes,
                warmup=warmup,
                jobs=jobs,
                against=against,
                out=out,
                engine=engine,
                progress=not quiet,
            )
        except du.Interrupted as stopped:
            found, interrupted = stopped.result, True
        except KeyboardInterrupt:
            complain("interrupted; no run has ended")
            raise typer.Exit(130) from None
    if as_json:
        print(json.dumps(found.content(), indent=1))
    else:
        from desim_uav.report.text import print_comparison

        print_comparison(found.content())
    if interrupted:
        complain("interrupted; what had ended is shown")
        raise typer.Exit(130)


def _refuse_how_to_run(context: typer.Context) -> None:
    """Finished runs are as they are. Raises UsageError for an option that says how to run."""
    for option in ("seeds", "first_seed", "episodes", "warmup", "overrides", "jobs", "engine"):
        source = context.get_parameter_source(option)
        if source is not None and source.name == "COMMANDLINE":
            flag = {"overrides": "-S", "jobs": "-j"}.get(option, "--" + option.replace("_", "-"))
            raise UsageError(f"{flag} goes with a scenario and --policies, not with finished runs")


def sweep(
    scenario: ScenarioName,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Takes results/, a Parquet dataset, a row a job.")
    ],
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "-S",
            metavar="KEY.PATH=V,W…",
            help="Values of a key: a,b or from:to or from:to:step; repeatable, every combination.",
        ),
    ] = None,
    policies: Annotated[
        str | None,
        typer.Option(metavar="P,Q…", help="Run these; no name can hold a comma. [baseline]"),
    ] = None,
    learn: Annotated[
        bool, typer.Option("--train", help="Train on each seed, and evaluate greedily.")
    ] = False,
    algorithm: Annotated[
        str | None, typer.Option(metavar="A,B…", help="With --train; else the scenario's.")
    ] = None,
    seeds: Seeds = 10,
    first_seed: FirstSeed = 0,
    episodes: Counted = 20,
    warmup: Warmup = 2,
    jobs: Annotated[
        int | None,
        typer.Option(
            "-j", "--jobs", metavar="N", min=1, max=1024, help="At a time. [1; all cores of Ray]"
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on: run what the folder has no row of.")
    ] = False,
    backend: Annotated[
        str, typer.Option(metavar="local|ray", help="Processes, or a Ray cluster.")
    ] = "local",
    address: Annotated[
        str | None,
        typer.Option(metavar="A", help="The Ray cluster's: auto or host:port. [this machine]"),
    ] = None,
    engine: EngineIfAny = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Run policies, or train, in every combination of keys' values, on common seeds."""
    from desim_uav.experiment.sweep_command import BACKENDS, Asked, sweep_to_folder
    from desim_uav.shipped import find_scenario

    end_politely()
    try:
        done = sweep_to_folder(
            find_scenario(scenario),
            Asked(
                overrides or [],
                policies,
                learn,
                algorithm,
                range(first_seed, first_seed + seeds),
                episodes,
                warmup,
                engine,
            ),
            out,
            resume=resume,
            backend=one_of(BACKENDS, backend, "--backend"),
            workers=jobs,
            address=address,
            command=["desim-uav", *sys.argv[1:]],
            show_progress=not quiet,
            say=complain,
        )
    except KeyboardInterrupt:
        complain("interrupted; what had ended is kept; --resume goes on")
        raise typer.Exit(130) from None
    if as_json:
        print(json.dumps(done.content(), indent=1))
    elif not quiet:
        from desim_uav.report.text import print_sweep

        print_sweep(done.headings(), done.lines())
        print(out / "results")
    if done.failures:
        complain(done.complaint())
    if done.interrupted:
        complain(
            f"interrupted; {len(done.rows)} of {len(done.jobs)} jobs are kept; --resume goes on"
        )
    if done.interrupted or done.failures:
        raise typer.Exit(130 if done.interrupted else 1)
