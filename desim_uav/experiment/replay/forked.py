"""The folder of a counterfactual, whose two branches are played side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, NamedTuple

from pydantic import Field

from desim_uav.errors import UsageError
from desim_uav.experiment.fork import BRANCHES, FORK_FILE
from desim_uav.report.json_file import Form, read_json

Number = Annotated[int, Field(ge=0, lt=10**9)]


class ForkForm(Form):
    """The entries of ``fork.json`` that are needed to play both branches."""

    episode: Number
    episodes: Number


class ReplayChoice(NamedTuple):
    """What a replay shows: the folders of one run or two, and the episodes, if some are chosen."""

    folders: list[Path]
    episodes: str | None


def shown_of(run_dir: Path, beside: Path | None, episodes: str | None) -> ReplayChoice:
    """Return what to show of a folder: of a counterfactual both branches, from the fork's episode.

    Raises UsageError for a third run beside them, and PolicyError if ``fork.json`` is unreadable.
    """
    file = run_dir / FORK_FILE
    if not file.exists():
        return ReplayChoice([run_dir] if beside is None else [run_dir, beside], episodes)
    if beside is not None:
        raise UsageError(f"{run_dir}: it has two branches, so nothing else fits beside them")
    about = read_json(file, ForkForm, "the description of a fork")
    since = f"{about['episode']}-{about['episodes'] - 1}"
    return ReplayChoice([run_dir / branch for branch in BRANCHES], episodes or since)
