"""Options that several commands share, and what they make of them."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Annotated

import typer

MAKING, SCENARIO, OUTPUT = "What is run", "The scenario", "What comes out"
"""Headings that group options in the help."""


def within(low: int, high: int) -> Callable[[int | None], int | None]:
    """Return what checks that a number is within its bounds, and says otherwise which they are."""

    def check(number: int | None) -> int | None:
        if number is not None and not low <= number <= high:
            raise typer.BadParameter(f"{number} is not a whole number from {low} to {high}")
        return number

    return check


def between(low: float, high: float) -> Callable[[float | None], float | None]:
    """Do the same for numbers that need not be whole."""

    def check(number: float | None) -> float | None:
        if number is not None and not low <= number <= high:
            raise typer.BadParameter(f"{number:g} is not a number from {low:g} to {high:g}")
        return number

    return check


def complete_scenarios(incomplete: str) -> list[str]:
    """Return the shipped scenarios, for a shell that completes what is typed."""
    from desim_uav.shipped import scenario_names

    return [name for name in scenario_names() if name.startswith(incomplete)]


ScenarioName = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help="The name of a shipped scenario, such as case8, or a scenario file (YAML).",
        autocompletion=complete_scenarios,
    ),
]
RunDir = Annotated[
    Path, typer.Argument(metavar="RUN_DIR", help="The folder of a run, as `run` writes it.")
]
Override = Annotated[
    list[str] | None,
    typer.Option(
        "-S",
        metavar="KEY.PATH=VALUE",
        help="Set a key of the scenario, as in -S users.count=60. The option may be repeated.",
        rich_help_panel=SCENARIO,
    ),
]
Json = Annotated[
    bool,
    typer.Option(
        "--json", help="Print one JSON object instead of a table.", rich_help_panel=OUTPUT
    ),
]
Quiet = Annotated[
    bool,
    typer.Option(
        "-q", "--quiet", help="Print neither progress nor a table.", rich_help_panel=OUTPUT
    ),
]
NoProgress = Annotated[
    bool, typer.Option("-q", "--quiet", help="Print no progress.", rich_help_panel=OUTPUT)
]
Seed = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        callback=within(0, 2**63 - 1),
        help="The seed of all random draws. By default it is the scenario's.",
        rich_help_panel=SCENARIO,
    ),
]
WorldSeed = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        callback=within(0, 2**63 - 1),
        help="The seed of the world alone: buildings, homes of users, clusters. By default it is "
        "the scenario's world_seed, or else the seed.",
        rich_help_panel=SCENARIO,
    ),
]
Counted = Annotated[
    int,
    typer.Option(
        metavar="N",
        callback=within(1, 10**6),
        help="The number of episodes that count, per policy and seed.",
        rich_help_panel=MAKING,
    ),
]
Warmup = Annotated[
    int,
    typer.Option(
        metavar="N",
        callback=within(0, 10**6),
        help="The number of warm-up episodes before them, which count in no measure.",
        rich_help_panel=MAKING,
    ),
]
Seeds = Annotated[
    int,
    typer.Option(
        metavar="N",
        callback=within(1, 10**6),
        help="The number of seeds. On a seed all policies meet the same users and requests.",
        rich_help_panel=MAKING,
    ),
]
FirstSeed = Annotated[
    int,
    typer.Option(
        metavar="N",
        callback=within(0, 2**62),
        help="The first seed; the others follow it.",
        rich_help_panel=MAKING,
    ),
]


def one_of(allowed: Collection[str], word: str, option: str) -> str:
    """The word. Raises BadParameter where it is none of those allowed."""
    from desim_uav.errors import did_you_mean

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
        metavar="des|batch",
        callback=_an_engine,
        help="The engine: des (SimPy, easy to read) or batch (compiled, fast). Their numbers are "
        "the same.",
        rich_help_panel=MAKING,
    ),
]
EngineIfAny = Annotated[
    str | None,
    typer.Option(
        metavar="des|batch",
        callback=_an_engine,
        help="The engine: des (SimPy, easy to read) or batch (compiled, fast). Their numbers are "
        "the same. By default it is batch, if it can run the scenario.",
        rich_help_panel=MAKING,
    ),
]
