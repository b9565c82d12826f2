"""The commands of the benchmark."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from desim_uav.cli import options
from desim_uav.cli.ending import complain
from desim_uav.cli.plain import Command, Group, careful
from desim_uav.notices import tell

app = typer.Typer(
    help="Compare policies on frozen tasks: list them, make and verify submissions, rank them.",
    no_args_is_help=True,
    cls=Group,
    pretty_exceptions_enable=False,
)

Jobs = Annotated[
    int,
    typer.Option(
        "-j",
        "--jobs",
        metavar="N",
        callback=options.within(1, 1024),
        help="The number of seeds that are run at a time.",
        rich_help_panel=options.MAKING,
    ),
]


def complete_tasks(incomplete: str) -> list[str]:
    """Return the tasks, for a shell that completes what is typed."""
    from desim_uav.experiment.bench.tasks import tasks

    return [name for name in tasks() if name.startswith(incomplete)]


def list_tasks(as_json: options.Json = False) -> None:
    """List the tasks, their hashes, the tracks and the protocol."""
    from desim_uav.experiment.bench.tasks import listing

    found = listing()
    if as_json:
        print(json.dumps(found, indent=1))
        return
    for task in found["tasks"]:
        tell(f"{task['task']:30s} {task['scenario_hash'][:12]}  {task['about']}")
    rules = found["protocol"]
    tell()
    for name, track in rules["tracks"].items():
        seeds = track["seeds"]
        tell(f"track {name}: {track['about']}; seeds {seeds[0]} to {seeds[-1]}")
    budgets = ", ".join(f"{size} {steps:,}" for size, steps in rules["training_steps"].items())
    tell(
        f"per seed: {rules['episodes']} episodes after {rules['warmup']} of warm-up\n"
        f"training: {rules['training_seeds']} seeds, at most so many steps each: {budgets}"
    )


def run(
    task: Annotated[
        str,
        typer.Argument(
            metavar="TASK",
            help="The task, such as uav-v1/coverage or uav-v1/coverage/small.",
            autocompletion=complete_tasks,
        ),
    ],
    policy: Annotated[
        list[str],
        typer.Option(
            metavar="POLICY",
            help="The policy: a name, a file or a class, as in `run --policy`. Given several "
            "times, these are the policies of several trainings, which make one submission.",
            rich_help_panel=options.MAKING,
        ),
    ],
    track: Annotated[
        str,
        typer.Option(
            metavar="one|any",
            help="The track: one world, or test worlds in which no policy was trained.",
            rich_help_panel=options.MAKING,
        ),
    ] = "one",
    seeds: Annotated[
        int,
        typer.Option(
            metavar="N",
            callback=options.within(1, 10),
            help="Run only the first N seeds of the protocol; the leaderboard then says so.",
            rich_help_panel=options.MAKING,
        ),
    ] = 10,
    name: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="What the leaderboard calls the policy. By default it is the policy's name.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    training_steps: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            callback=options.within(1, 10**12),
            help="The steps (decision epochs) of a training, at most those that the task allows. "
            "They are stated in the submission and cannot be checked.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="The folder of the submission. By default it is a new one in runs/.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    jobs: Jobs = 1,
    as_json: options.Json = False,
    quiet: options.NoProgress = False,
) -> None:
    """Evaluate a policy by the protocol, and write a submission that can be replayed."""
    import desim_uav as du

    interrupted = None
    try:
        done = du.bench_run(
            task,
            policy,
            track=track,
            seeds=seeds,
            name=name,
            training_steps=training_steps,
            out=out,
            jobs=jobs,
            progress=not quiet,
        )
    except du.Interrupted as stopped:
        done, interrupted = stopped.result, str(stopped)
    except KeyboardInterrupt:
        complain("interrupted; no seed has ended")
        raise typer.Exit(130) from None
    if as_json:
        print(json.dumps(done.content(), indent=1))
    else:
        from desim_uav.report.text import print_bench

        print_bench(done.content())
        tell(done.folder)
    if interrupted is not None:
        complain(interrupted)
        raise typer.Exit(130)


def verify(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="The submission, as `bench run` writes it.")
    ],
    decide: Annotated[
        bool,
        typer.Option(
            "--decide",
            help="Load the policy as well, and let it decide again. This runs its code.",
            rich_help_panel=options.MAKING,
        ),
    ] = False,
    jobs: Jobs = 1,
    as_json: options.Json = False,
    quiet: options.NoProgress = False,
) -> None:
    """Replay a submission bit for bit, and name every difference."""
    import desim_uav as du

    try:
        said = du.bench_verify(folder, decide=decide, jobs=jobs, progress=not quiet)
    except KeyboardInterrupt:
        complain("interrupted; nothing was found out")
        raise typer.Exit(130) from None
    if as_json:
        content = {"folder": str(folder), "verified": not said, "differences": said}
        print(json.dumps(content, indent=1))
    elif not said:
        tell(f"{folder}: all runs replayed, bit for bit the same")
    if said:
        complain("\n".join(f"{folder}: {line}" for line in said))
        raise typer.Exit(6)


def board(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="DIR…",
            help="Submissions, as `bench run` writes them, or folders of submissions.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            metavar="FILE.md",
            help="The file for the tables. By default they are printed.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    figure: Annotated[
        Path | None,
        typer.Option(
            "--figure",
            metavar="FILE",
            help="The file for the performance profiles: .png, .pdf or .svg.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Make the leaderboard of submissions, in Markdown. It does not replay them."""
    import desim_uav as du

    found = du.bench_board(folders, out=out, figure=figure)
    if as_json:
        print(json.dumps(found.content(), indent=1))
    elif out is None:
        print(found.markdown(), end="")
    for file in (out, figure):
        if file is not None and not as_json:
            tell(file)


app.command("list", cls=Command)(list_tasks)
for command in (careful(run), careful(verify), board):
    app.command(cls=Command)(command)
