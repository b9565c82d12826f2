"""The quality of experience of finished runs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

from desim_uav.api.parameters import verb
from desim_uav.errors import UsageError
from desim_uav.typed import OneOf


def _groups() -> Iterable[str]:
    from desim_uav.qoe import GROUPS

    return GROUPS


@verb
def measures_of(
    run_dir: str | Path,
    by: Annotated[str | None, OneOf(_groups)] = None,
    covered_once: bool = False,
) -> tuple[dict[str, Any], list[dict[str, Any]] | None]:
    """Print the quality of experience of a finished run.

    In Python, this returns what ``desim-uav qoe`` prints: the measures of everything, and of each
    group, or None.

    Args:
        run_dir: The folder of a run, as `run` writes it.
        by: Print a row per group of requests, grouped by this.
        covered_once: Also print the share of users that drones covered at least once in an episode.

    Raises:
        PolicyError: the folder cannot be read.
        UsageError: both options were given.
    """
    from desim_uav.api.run_result import of_folder

    if by is not None and covered_once:
        raise UsageError("--covered-once: it is one number for all requests; not with --by")
    experience = of_folder(run_dir)
    groups = None if by is None else experience.groups(by)[0]
    summary = experience.summaries()[0]
    if covered_once:
        share = experience.covered_once().dropna().tolist()  # none if no episode has ended
        summary = summary | {"covered_once_percent": share[0] if share else None}
    return summary, groups
