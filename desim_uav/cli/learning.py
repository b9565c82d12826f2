"""Commands that learn, and say how well anything could do."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from desim_uav.cli.ending import complain
from desim_uav.cli.options import (
    Engine,
    EngineIfAny,
    Json,
    Override,
    Quiet,
    ScenarioName,
    Seed,
    WorldSeed,
    opened,
)
from desim_uav.errors import UsageError, located


def train(
    scenario: ScenarioName,
    algorithm: Annotated[
        str | None,
        typer.Option(metavar="A", help="q_learning, sarsa, expected_sarsa or double_q."),
    ] = None,
    episodes: Annotated[
        int | None, typer.Option(metavar="N", min=1, max=10**7, help="Not the scenario's.")
    ] = None,
    seed: Seed = None,
    world_seed: WorldSeed = None,
    overrides: Override = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Instead of runs/<name>-<algorithm>-s<seed>.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from the folder's checkpoint, if it has one.")
    ] = False,
    checkpoint_every: Annotated[
        int, typer.Option(metavar="N", min=1, max=10**7, help="Episodes between checkpoints.")
    ] = 500,
    engine: EngineIfAny = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Let the drones of a scenario learn; leaves policy.npz, for run --policy."""
    import desim_uav as du

    try:
        done = du.train(
            scenario,
            overrides,
            algorithm=algorithm,
            episodes=episodes,
            seed=seed,
            world_seed=world_seed,
            out=True if out is None else out,
            resume=resume,
            checkpoint_every=checkpoint_every,
            engine=engine,
            progress=not quiet,
        )
        interrupted = False
    except du.Interrupted as stopped:
        done, interrupted = stopped.result, True
    except KeyboardInterrupt:
        complain("interrupted; the last checkpoint is kept: --resume goes on from it")
        raise typer.Exit(130) from None
    summary = done.summary()
    if as_json:
        print(json.dumps(summary, indent=1))
    elif not quiet:
        from desim_uav.report.text import print_training

        print_training(summary)
    if interrupted:
        complain(f"interrupted after {summary['episodes']} episodes; --resume goes on")
        raise typer.Exit(130)


def optimum(
    scenario: ScenarioName,
    seed: Seed = None,
    world_seed: WorldSeed = None,
    overrides: Override = None,
    as_json: Json = False,
) -> None:
    """Work out how well any policy could do, where users stand still."""
    from desim_uav.experiment.interrupt import at_once
    from desim_uav.experiment.optimum import optimum as best_of
    from desim_uav.report.text import print_optimum

    path, loaded = opened(scenario, overrides, seed, world_seed)
    with located(path):
        found = at_once(best_of, loaded)
    if as_json:
        print(json.dumps(found, indent=1))
    else:
        print_optimum(found)


def reproduce(
    cases: Annotated[str, typer.Option(metavar="1-9", help="Which, as 1-3,8.")] = "1-9",
    seeds: Annotated[
        int, typer.Option(metavar="N", min=1, max=10**4, help="The number of seeds.")
    ] = 10,
    first_seed: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=0,
            max=2**62,
            help="The first seed; the others follow it. The defaults of learning were chosen on "
            "seeds below 100.",
        ),
    ] = 100,
    episodes: Annotated[
        int | None, typer.Option(metavar="N", min=1, max=10**7, help="Of training.")
    ] = None,
    preset: Annotated[
        str, typer.Option(metavar="default|paper|both", help="Train so, or as the paper did.")
    ] = "default",
    jobs: Annotated[int, typer.Option("-j", metavar="N", min=1, max=1000, help="At a time.")] = 1,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Holds what was finished before, too.")
    ] = Path("runs/reproduce"),
    engine: Engine = "batch",
    check: Annotated[
        bool, typer.Option("--check", help="Exit with 6 where a gate does not hold.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Train and evaluate the paper's nine cases, beside what the paper printed."""
    from desim_uav.experiment import reproduce as table
    from desim_uav.experiment.paper_table import HEADINGS, cells
    from desim_uav.experiment.progress import progress
    from desim_uav.report.paper import print_claims, print_paper_table

    presets: dict[str, list[str | None]] = {
        "default": [None],
        "paper": ["paper"],
        "both": [None, "paper"],
    }
    if preset not in presets:
        raise UsageError(f"--preset {preset}: allowed: {', '.join(presets)}")
    if check and preset == "paper":
        raise UsageError("--check: the gates are of the default training, not of the paper's")
    drawn = range(first_seed, first_seed + seeds)
    todo = table.jobs(table.numbers(cases), drawn, episodes, presets[preset])
    with progress(not quiet, len(todo), "jobs", engine) as advance:
        rows = table.run_jobs(todo, out, jobs, advance, engine)
    found = table.report(rows, out, " ".join(["desim-uav", *sys.argv[1:]]))
    if not quiet:
        print_paper_table(HEADINGS, [cells(line) for line in found.table])
        print_claims([(c.text, c.found, c.holds) for c in found.claims])
        print(out / "table.md")
    if check and found.failed:
        complain("\n".join(f"gate: {claim.text}: {claim.found}" for claim in found.failed))
        raise typer.Exit(6)
