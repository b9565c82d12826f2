"""Commands that simulate a policy, and say what came out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from desim_uav.cli import options
from desim_uav.cli.ending import complain
from desim_uav.cli.fork import run_forked
from desim_uav.errors import UsageError
from desim_uav.notices import tell


def run(
    scenario: options.ScenarioName,
    policy: Annotated[
        str,
        typer.Option(
            metavar="POLICY",
            help="The policy: baseline, random, hover, a trained one (case8.npz), "
            "a planner (greedy, rollout:BASE, clairvoyant), "
            "commands from a file (script:FILE.csv), a network (sb3:FILE.zip, rllib:DIR), or a "
            'class of your own ("package.module:Class").',
            autocompletion=_policies,
            rich_help_panel=options.MAKING,
        ),
    ] = "baseline",
    episodes: options.Counted = 1,
    warmup: options.Warmup = 0,
    engine: options.Engine = "des",
    overrides: options.Override = None,
    seed: options.Seed = None,
    world_seed: options.WorldSeed = None,
    fork: Annotated[
        str | None,
        typer.Option(
            metavar="EPISODE:STEP",
            help="Also play what would have happened if the policy --to had gone on from this step "
            "(both numbers from 0), and compare both. Events are kept.",
            rich_help_panel=options.MAKING,
        ),
    ] = None,
    to: Annotated[
        str | None,
        typer.Option(
            metavar="POLICY",
            help="The policy that goes on from --fork; see --policy.",
            autocompletion=_policies,
            rich_help_panel=options.MAKING,
        ),
    ] = None,
    events: Annotated[
        bool,
        typer.Option(
            "--events",
            help="Keep the event log and the drones' flights, too.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="The folder to write the run to. It must be new or empty. By default it is "
            "runs/<scenario>-<policy>-s<seed>.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Continue the interrupted run in --out, or the last one of this name in runs/. "
            "The result is that of an uninterrupted run.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Run a policy in a scenario, log every request, and print the quality of experience.

    The log is a folder of Parquet tables. QoE1 is the share of the requested time that was served,
    QoE2 the time for which a request was open but not served, in steps, and QoE3 the share of
    users that were attached to a drone, averaged over time.
    """
    import desim_uav as du

    if fork is not None or to is not None:
        if resume:
            raise UsageError("--resume: a run with --fork cannot be continued")
        how: dict[str, Any] = {
            "seed": seed,
            "world_seed": world_seed,
            "episodes": episodes,
            "warmup": warmup,
        }
        how |= {"engine": engine}
        run_forked(scenario, overrides, (policy, to), fork, how, out, (as_json, quiet))
        return
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
            resume=resume,
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
        kept = f"interrupted; the finished episodes are kept: {summary['run_dir']}"
        complain(f"{kept} (--resume goes on)")
        raise typer.Exit(130)


def qoe(
    run_dir: options.RunDir,
    by: Annotated[
        str | None,
        typer.Option(
            metavar="service|episode|user|outcome",
            help="Print a row per group of requests, grouped by this.",
        ),
    ] = None,
    covered_once: Annotated[
        bool,
        typer.Option(
            "--covered-once",
            help="Also print the share of users that drones covered at least once in an episode.",
        ),
    ] = False,
    as_json: options.Json = False,
) -> None:
    """Print the quality of experience of a finished run."""
    import desim_uav as du
    from desim_uav.qoe import GROUPS

    if by is not None:
        options.one_of(GROUPS, by, "--by")
        if covered_once:
            raise UsageError("--covered-once: it is one number for all requests; not with --by")
    found = du.read_run(run_dir)
    groups = None if by is None else found.groups(by)[0]
    summary = found.summaries()[0]
    if covered_once:
        share = found.covered_once().dropna().tolist()  # none if no episode has ended
        summary = summary | {"covered_once_percent": share[0] if share else None}
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
        typer.Argument(
            metavar="SCENARIO|RUN…",
            help="A scenario to run --policies in, or the folders of finished runs.",
            autocompletion=options.complete_scenarios,
        ),
    ],
    policies: Annotated[
        str | None,
        typer.Option(
            metavar="P,Q…",
            help="The policies to run in the scenario, separated by commas; see `run --policy`.",
            rich_help_panel=options.MAKING,
        ),
    ] = None,
    seeds: options.Seeds = 10,
    first_seed: options.FirstSeed = 0,
    episodes: options.Counted = 20,
    warmup: options.Warmup = 2,
    jobs: Annotated[
        int,
        typer.Option(
            "-j",
            "--jobs",
            metavar="N",
            callback=options.within(1, 1024),
            help="The number of runs at a time, each in a process of its own.",
            rich_help_panel=options.MAKING,
        ),
    ] = 1,
    engine: options.Engine = "des",
    overrides: options.Override = None,
    world_seed: options.WorldSeed = None,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="POLICY",
            help="The policy that the others are compared with. By default it is the first.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv",
            help="A file for the values of each policy and seed.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    as_json: options.Json = False,
    quiet: options.NoProgress = False,
) -> None:
    """Compare policies on common seeds: means, 95 % intervals and paired differences."""
    import desim_uav as du
    from desim_uav.experiment.compare import policy_names, the_scenario

    interrupted = False
    if policies is None:
        _refuse_how_to_run(context)
        found = du.compare_runs(what, against=against, out=out)
    else:
        try:
            found = du.compare(
                the_scenario(what),
                overrides,
                policies=policy_names(policies.split(",")),
                seeds=seeds,
                first_seed=first_seed,
                world_seed=world_seed,
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


HOW_TO_RUN = (
    *("seeds", "first_seed", "world_seed", "episodes", "warmup", "overrides", "jobs", "engine"),
)
"""The options of a comparison that are about runs to come."""


def _refuse_how_to_run(context: typer.Context) -> None:
    """Finished runs are as they are. Raises UsageError for an option that says how to run."""
    for option in HOW_TO_RUN:
        source = context.get_parameter_source(option)
        if source is not None and source.name == "COMMANDLINE":
            flag = {"overrides": "-S", "jobs": "-j"}.get(option, "--" + option.replace("_", "-"))
            raise UsageError(f"{flag} goes with a scenario and --policies, not with finished runs")


def sweep(
    scenario: options.ScenarioName,
    out: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="The folder of the sweep. Its results/ is one Parquet dataset with a row per job.",
            rich_help_panel=options.OUTPUT,
        ),
    ],
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "-S",
            metavar="KEY.PATH=V,W…",
            help="The values of a key of the scenario: a,b,c or first:last or first:last:step. If "
            "the option is repeated, every combination of values is run.",
            rich_help_panel=options.SCENARIO,
        ),
    ] = None,
    policies: Annotated[
        str | None,
        typer.Option(
            metavar="P,Q…",
            help="The policies to run, separated by commas; see `run --policy`. By default it is "
            "the baseline, unless --train is given.",
            rich_help_panel=options.MAKING,
        ),
    ] = None,
    learn: Annotated[
        bool,
        typer.Option(
            "--train",
            help="Train on each seed as well, and evaluate the learned policies.",
            rich_help_panel=options.MAKING,
        ),
    ] = False,
    algorithm: Annotated[
        str | None,
        typer.Option(
            metavar="A,B…",
            help="The algorithms to train by, separated by commas. By default it is the "
            "scenario's.",
            rich_help_panel=options.MAKING,
        ),
    ] = None,
    seeds: options.Seeds = 10,
    first_seed: options.FirstSeed = 0,
    episodes: options.Counted = 20,
    warmup: options.Warmup = 2,
    jobs: Annotated[
        int | None,
        typer.Option(
            "-j",
            "--jobs",
            metavar="N",
            callback=options.within(1, 1024),
            help="The number of jobs at a time. By default it is 1, or all cores of a Ray cluster.",
            rich_help_panel=options.MAKING,
        ),
    ] = None,
    backend: Annotated[
        str,
        typer.Option(
            metavar="local|ray",
            help="Where the jobs run: in processes of this machine, or in a Ray cluster.",
            rich_help_panel=options.MAKING,
        ),
    ] = "local",
    address: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="The address of the Ray cluster: auto, or HOST:PORT. By default a cluster is "
            "started on this machine.",
            rich_help_panel=options.MAKING,
        ),
    ] = None,
    engine: options.EngineIfAny = None,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Continue the sweep of the folder: run only the jobs without a row in results/.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Run or train policies for every combination of values of some keys, on common seeds."""
    import desim_uav as du
    from desim_uav.experiment.sweep.run import BACKENDS

    interrupted = False
    try:
        done = du.sweep(
            scenario,
            overrides or (),
            out=out,
            policies=None if policies is None else policies.split(","),
            train=learn,
            algorithms=None if algorithm is None else algorithm.split(","),
            seeds=seeds,
            first_seed=first_seed,
            episodes=episodes,
            warmup=warmup,
            jobs=jobs,
            resume=resume,
            backend=options.one_of(BACKENDS, backend, "--backend"),
            address=address,
            engine=engine,
            progress=not quiet,
        )
    except du.Interrupted as stopped:
        done, interrupted = stopped.result, True
    except KeyboardInterrupt:
        complain("interrupted; what had ended is kept; --resume goes on")
        raise typer.Exit(130) from None
    if as_json:
        print(json.dumps(done.content(), indent=1))
    elif not quiet:
        from desim_uav.report.text import print_sweep

        print_sweep(done.headings(), done.lines())
        tell(out / "results")
    if done.failures:
        complain(done.complaint())
    if interrupted:
        complain(
            f"interrupted; {len(done.rows)} of {len(done.jobs)} jobs are kept; --resume goes on"
        )
    if interrupted or done.failures:
        raise typer.Exit(130 if interrupted else 1)


def _policies(incomplete: str) -> list[str]:
    """Return built-in and shipped policies, for a shell that completes what is typed."""
    from desim_uav.shipped import trained_names

    known = ["baseline", "hover", "random", *trained_names()]
    return [name for name in known if name.startswith(incomplete)]
