"""The commands of the benchmark."""

from __future__ import annotations

from typing import Any

import typer

from desim_uav.api.bench import (
    bench_board,
    bench_export,
    bench_list,
    bench_reveal,
    bench_run,
    bench_seal,
    bench_verify,
)
from desim_uav.cli.ending import complain, end, ended, print_json
from desim_uav.cli.made import made
from desim_uav.cli.plain import PlainCommand, PlainGroup
from desim_uav.cli.terminal import AS_JSON, NO_PLUGINS, NO_PROGRESS
from desim_uav.notices import tell

app = typer.Typer(
    help="Compare policies on frozen tasks: list them, make and verify submissions, rank them.",
    no_args_is_help=True,
    cls=PlainGroup,
    pretty_exceptions_enable=False,
)


@made(bench_list, AS_JSON)
def list_tasks(arguments: dict[str, Any], as_json: bool) -> None:
    """Print the tasks, the tracks and the protocol."""
    registry = bench_list()
    if as_json:
        print_json(registry)
        return
    for task in registry["tasks"]:
        tell(f"{task['task']:30s} {task['scenario_hash'][:12]}  {task['about']}")
    rules = registry["protocol"]
    tell()
    for name, track in rules["tracks"].items():
        seeds = track["seeds"]
        tell(f"track {name}: {track['about']}; {len(seeds)} seeds, {seeds[0]} to {seeds[-1]}")
    budgets = ", ".join(f"{size} {steps:,}" for size, steps in rules["training_steps"].items())
    tell(f"per seed: {rules['episodes']} episodes after {rules['warmup']} of warm-up")
    tell(f"training: {rules['training_seeds']} seeds, at most so many steps each: {budgets}")


@made(bench_run, AS_JSON, NO_PROGRESS, NO_PLUGINS)
def run(arguments: dict[str, Any], as_json: bool, quiet: bool) -> None:
    """Print how the policy did, and the folder of the submission."""
    submission, interrupted = ended(bench_run, arguments, "the first seed has not ended")
    if as_json:
        print_json(submission.content())
    else:
        from desim_uav.report.text import print_bench

        print_bench(submission.content())
        tell(submission.folder)
    end(interrupted)


@made(bench_verify, AS_JSON, NO_PROGRESS, NO_PLUGINS)
def verify(arguments: dict[str, Any], as_json: bool, quiet: bool) -> None:
    """Print the differences, and end with exit code 6 if there are any."""
    folder = arguments["folder"]
    differences, _ = ended(bench_verify, arguments, "nothing was found out")
    if as_json:
        print_json({"folder": str(folder), "verified": not differences, "differences": differences})
    elif not differences:
        tell(f"{folder}: all runs replayed, bit for bit the same")
    if differences:
        complain("\n".join(f"{folder}: {line}" for line in differences))
        raise typer.Exit(6)


@made(bench_board, AS_JSON)
def board(arguments: dict[str, Any], as_json: bool) -> None:
    """Print the leaderboard, or the files that it was written to."""
    leaderboard = bench_board(**arguments)
    if as_json:
        print_json(leaderboard.content())
    elif arguments["out"] is None:
        print(leaderboard.markdown(), end="")
    for file in (arguments["out"], arguments["figure"]):
        if file is not None and not as_json:
            tell(file)


@made(bench_export, NO_PROGRESS, NO_PLUGINS)
def export(arguments: dict[str, Any], quiet: bool) -> None:
    """Print the folder of the data set."""
    folder, _ = ended(bench_export, arguments)
    tell(folder)


@made(bench_seal)
def seal(arguments: dict[str, Any]) -> None:
    """Print the seal."""
    print(bench_seal(**arguments))


@made(bench_reveal, NO_PLUGINS)
def reveal(arguments: dict[str, Any]) -> None:
    """Print the folder of the set."""
    folder, _ = ended(
        bench_reveal, arguments, "what was computed is kept; to go on, give its folder to --out"
    )
    tell(folder)


app.command("list", cls=PlainCommand)(list_tasks)
for command in (run, verify, board, export, seal, reveal):
    app.command(cls=PlainCommand)(command)
