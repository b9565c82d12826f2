"""The work of ``desim-uav report``: reads the folders, compares them and writes the page."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any
from urllib.parse import quote

from desim_uav.errors import PolicyError, UsageError
from desim_uav.experiment.command import read_summary
from desim_uav.experiment.compare_runs import compare_runs
from desim_uav.experiment.replay.again import Source, playing_again
from desim_uav.experiment.statistics import estimate
from desim_uav.experiment.sweep.pictures import sweep_report
from desim_uav.experiment.sweep.results import is_sweep
from desim_uav.report.comparison_page import Compared, comparison_page
from desim_uav.report.page import Reported
from desim_uav.report.run_page import run_page
from desim_uav.report.text import tables_of

NAME = "report.html"


def make_report(
    sources: Sequence[Source],
    place: Path,
    title: str | None = None,
    against: str | None = None,
    show_progress: bool = True,
) -> str:
    """Return the page about a run, a sweep or several runs compared, which will be at ``place``.

    Raises PolicyError if a folder cannot be read or the runs cannot be compared.
    """
    if not sources:
        raise UsageError("runs: give at least one run")
    folders = [source.folder for source in sources]
    alone = len(folders) == 1
    if alone and against is not None:
        raise UsageError("--against needs several runs")
    if alone and is_sweep(folders[0]):
        return sweep_report(folders[0], title)
    runs = [_read(source, place, show_progress) for source in sources]
    content = None if alone else compare_runs(folders, against).content()
    try:
        if content is None:
            return run_page(runs[0], title)
        return comparison_page(Compared(content, runs, _by_service(runs, content)), title)
    except (LookupError, TypeError, ValueError, ArithmeticError) as error:
        raise PolicyError(
            f"{folders[0] if alone else 'these runs'}: the tables do not fit together: "
            f"{type(error).__name__}: {error}"
        ) from error


def _read(source: Source, page: Path, show_progress: bool) -> Reported:
    folder = source.folder
    summary, _ = read_summary(folder)
    if not summary["episodes"]:
        raise PolicyError(f"{folder}: the run has no counted episode")
    again = playing_again(show_progress, source.policy)
    link = "" if source.passing else _link(folder, page)
    return Reported(folder, again, link=link, summary=summary, passing=source.passing)


def _link(folder: Path, page: Path) -> str:
    """Return a folder's address relative to a page, as a prefix of a file's name."""
    try:
        way = os.path.relpath(folder.resolve(), page.resolve().parent)
    except ValueError:  # on another drive
        return folder.resolve().as_uri() + "/"
    return "" if way == "." else quote(os.fsencode(Path(way).as_posix())) + "/"


def _by_service(runs: Sequence[Reported], content: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the estimates over seeds for each service and policy."""
    rows_of: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for run in runs:
        for row in run.groups("service"):
            rows_of.setdefault((row["service"], run.summary["policy"]), []).append(row)
    order = [row["policy"] for row in content["policies"]]
    every = [row for rows in rows_of.values() for row in rows]
    there = list(dict.fromkeys(name for shown, _ in tables_of(every) for name in shown))
    return [
        {
            "service": service,
            "policy": policy,
            "measures": {name: asdict(estimate(row[name] for row in rows)) for name in there},
        }
        for (service, policy), rows in sorted(
            rows_of.items(), key=lambda item: (item[0][0], order.index(item[0][1]))
        )
    ]
