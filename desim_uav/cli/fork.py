"""``run --fork``: what would have happened if another policy had gone on."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer

from desim_uav.cli.ending import complain
from desim_uav.errors import UsageError


def run_forked(
    scenario: str,
    overrides: Sequence[str] | None,
    policies: tuple[str, str | None],
    fork: str | None,
    how: dict[str, Any],
    out: Path | None,
    shows: tuple[bool, bool],
) -> None:
    """Run both branches, and print their measures, or JSON; ``shows`` are --json and --quiet."""
    import desim_uav as du

    policy, to = policies
    as_json, quiet = shows
    if fork is None or to is None:
        given, lacks = ("--to", "--fork") if fork is None else ("--fork", "--to")
        raise UsageError(f"{given} needs {lacks}: run SCENARIO --fork EPISODE:STEP --to POLICY")
    try:
        done = du.counterfactual(
            scenario,
            overrides,
            policy=policy,
            to=to,
            fork=fork,
            out=True if out is None else out,
            progress=not quiet,
            **how,
        )
    except KeyboardInterrupt:
        complain("interrupted; nothing is kept")
        raise typer.Exit(130) from None
    if as_json:
        print(json.dumps(done.summary(), indent=1))
    elif not quiet:
        from desim_uav.report.text import print_fork

        print_fork(done.summary())
