"""Options that several commands share, and what they make of them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from desim_uav.scenario.schema import Scenario

ScenarioName = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A scenario file, or a shipped name: case5.")
]
RunDir = Annotated[Path, typer.Argument(metavar="RUN_DIR", help="The folder of a run.")]
Override = Annotated[
    list[str] | None,
    typer.Option("-S", metavar="KEY.PATH=VALUE", help="Set a key of the scenario; repeatable."),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="No progress, no table.")]
NoProgress = Annotated[bool, typer.Option("-q", "--quiet", help="No progress.")]
Seed = Annotated[
    int | None, typer.Option(metavar="N", min=0, max=2**63 - 1, help="Not the scenario's.")
]
WorldSeed = Annotated[
    int | None, typer.Option(metavar="N", min=0, max=2**63 - 1, help="Draws the world alone.")
]
Counted = Annotated[int, typer.Option(metavar="N", min=1, max=10**6, help="Counted ones.")]
Warmup = Annotated[
    int, typer.Option(metavar="N", min=0, max=10**6, help="Episodes before, counted nowhere.")
]
Seeds = Annotated[int, typer.Option(metavar="N", min=1, max=10**6, help="How many.")]
FirstSeed = Annotated[
    int, typer.Option(metavar="N", min=0, max=2**62, help="The others follow it.")
]


def one_of(allowed: Collection[str], word: str, option: str) -> str:
    """The word. Raises BadParameter where it is none of those allowed."""
    from desim_uav.registry import did_you_mean

    if word not in allowed:
        raise typer.BadParameter(
            f"{word!r}{did_you_mean(word, allowed)}; allowed: {', '.join(allowed)}",
            param_hint=option,
        )
    return word


def _an_engine(name: str | None) -> str | None:
    """An engine's name, or none. Raises BadParameter where there is no such engine."""
    from desim_uav.engine.choose import ENGINES

    return name if name is None else one_of(ENGINES, name, "--engine")


Engine = Annotated[
    str,
    typer.Option(
        metavar="des|batch", callback=_an_engine, help="SimPy or compiled: the same numbers."
    ),
]
EngineIfAny = Annotated[
    str | None,
    typer.Option(
        metavar="des|batch",
        callback=_an_engine,
        help="SimPy or compiled: the same numbers. Compiled, if it can be.",
    ),
]


def opened(
    name: str,
    overrides: list[str] | None,
    seed: int | None,
    world_seed: int | None,
    further: Sequence[str] = (),
) -> tuple[Path, Scenario]:
    """A scenario's file, and what it says with all that the command line sets of it."""
    from desim_uav.scenario.load import load
    from desim_uav.shipped import find_scenario

    settings = list(overrides or [])
    settings += [] if seed is None else [f"seed={seed}"]
    settings += [] if world_seed is None else [f"world_seed={world_seed}"]
    path = find_scenario(name)
    return path, load(path, [*settings, *further])
