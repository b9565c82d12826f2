"""Commands that learn, and say how well anything could do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from desim_uav.cli.ending import complain
from desim_uav.cli.options import (
    MAKING,
    OUTPUT,
    Engine,
    EngineIfAny,
    Json,
    NoProgress,
    Override,
    Quiet,
    ScenarioName,
    Seed,
    WorldSeed,
    within,
)
from desim_uav.errors import UsageError
from desim_uav.notices import tell


def train(
    scenario: ScenarioName,
    algorithm: Annotated[
        str | None,
        typer.Option(
            metavar="A",
            help="The algorithm: q_learning, sarsa, expected_sarsa, double_q, or a class of your "
            'own ("package.module:Class"). By default it is the scenario\'s.',
            rich_help_panel=MAKING,
        ),
    ] = None,
    episodes: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            callback=within(1, 10**7),
            help="The number of episodes to learn from. By default it is the scenario's.",
            rich_help_panel=MAKING,
        ),
    ] = None,
    engine: EngineIfAny = None,
    overrides: Override = None,
    seed: Seed = None,
    world_seed: WorldSeed = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="The folder of the training. By default it is "
            "runs/<scenario>-<algorithm>-s<seed>.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Continue from the checkpoint of the folder, if it has one.",
            rich_help_panel=OUTPUT,
        ),
    ] = False,
    checkpoint_every: Annotated[
        int,
        typer.Option(
            metavar="N",
            callback=within(1, 10**7),
            help="The number of episodes between two checkpoints.",
            rich_help_panel=OUTPUT,
        ),
    ] = 500,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Train the drones of a scenario; `run --policy` takes the policy.npz that this writes."""
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
    overrides: Override = None,
    seed: Seed = None,
    world_seed: WorldSeed = None,
    seeds: Annotated[
        int,
        typer.Option(
            metavar="N",
            callback=within(1, 10**4),
            help="The number of seeds on which runs are bounded, from --seed on.",
            rich_help_panel=MAKING,
        ),
    ] = 1,
    episodes: Annotated[
        int,
        typer.Option(
            metavar="N",
            callback=within(1, 10**6),
            help="The number of episodes of a run.",
            rich_help_panel=MAKING,
        ),
    ] = 20,
    as_json: Json = False,
    quiet: NoProgress = False,
) -> None:
    """Work out how well any policy could do in a scenario."""
    import desim_uav as du
    from desim_uav.report.optimum import print_optimum

    found = du.find_optimum(
        scenario,
        overrides,
        seed=seed,
        world_seed=world_seed,
        seeds=seeds,
        episodes=episodes,
        progress=not quiet,
    )
    if as_json:
        print(json.dumps(found.content(), indent=1))
    else:
        print_optimum(found.content())


def reproduce(
    cases: Annotated[
        str,
        typer.Option(
            metavar="1-9", help="The cases of the paper, such as 1-3,8.", rich_help_panel=MAKING
        ),
    ] = "1-9",
    seeds: Annotated[
        int,
        typer.Option(
            metavar="N",
            callback=within(1, 10**4),
            help="The number of seeds.",
            rich_help_panel=MAKING,
        ),
    ] = 10,
    first_seed: Annotated[
        int,
        typer.Option(
            metavar="N",
            callback=within(0, 2**62),
            help="The first seed; the others follow it. The defaults of learning were chosen on "
            "seeds below 100.",
            rich_help_panel=MAKING,
        ),
    ] = 100,
    episodes: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            callback=within(1, 10**7),
            help="The number of episodes to learn from. By default it is the scenario's.",
            rich_help_panel=MAKING,
        ),
    ] = None,
    preset: Annotated[
        str,
        typer.Option(
            metavar="default|paper|both",
            help="How to train: with our defaults, as the paper's code did, or both ways.",
            rich_help_panel=MAKING,
        ),
    ] = "default",
    jobs: Annotated[
        int,
        typer.Option(
            "-j",
            metavar="N",
            callback=within(1, 1000),
            help="The number of jobs at a time, each in a process of its own.",
            rich_help_panel=MAKING,
        ),
    ] = 1,
    engine: Engine = "batch",
    out: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="The folder for jobs, policies and tables. Jobs that it holds are not run again.",
            rich_help_panel=OUTPUT,
        ),
    ] = Path("runs/reproduce"),
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="End with exit code 6 if a gate does not hold.",
            rich_help_panel=OUTPUT,
        ),
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Train and evaluate in the paper's nine cases, and compare with the numbers in the paper."""
    import desim_uav as du
    from desim_uav.experiment.paper_table import HEADINGS, cells
    from desim_uav.report.paper import print_claims, print_paper_table

    if check and preset == "paper":
        raise UsageError("--check: the gates are of the default training, not of the paper's")
    found = du.reproduce(
        cases,
        seeds=seeds,
        first_seed=first_seed,
        episodes=episodes,
        preset=preset,
        jobs=jobs,
        out=out,
        engine=engine,
        progress=not quiet,
    )
    if not quiet:
        print_paper_table(HEADINGS, [cells(line) for line in found.table])
        print_claims([(c.text, c.found, c.holds) for c in found.claims])
        tell(out / "table.md")
    if check and found.failed:
        complain("\n".join(f"gate: {claim.text}: {claim.found}" for claim in found.failed))
        raise typer.Exit(6)
