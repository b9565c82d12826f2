"""The work of ``desim-uav report``: reads the folders, compares them and writes the page."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any
from urllib.parse import quote

from desim_uav import qoe
from desim_uav.errors import PolicyError, UsageError
from desim_uav.experiment.command import read_summary
from desim_uav.experiment.compare_runs import compare_runs
from desim_uav.experiment.replay.again import playing_again
from desim_uav.experiment.statistics import estimate
from desim_uav.experiment.sweep.pictures import sweep_report
from desim_uav.experiment.sweep.results import is_sweep
from desim_uav.report.comparison_page import Compared, comparison_page
from desim_uav.report.page import Reported
from desim_uav.report.run_page import run_page
from desim_uav.report.text import MEASURES
from desim_uav.run_folder import file_place, write_at

NAME = "report.html"


def report(
    folders: Sequence[Path], out: Path | None, title: str | None, against: str | None
) -> Path:
    """Write the report of a run, of a sweep, or of several runs compared; return its file.

    Without ``out`` it is written into the folder of the run or sweep, and for several runs into the
    working folder. ``against`` is the reference policy. Raises PolicyError, and writes nothing, if
    a folder cannot be read or the runs cannot be compared.
    """
    alone = len(folders) == 1
    if alone and against is not None:
        raise UsageError("--against needs several runs")
    place = out if out is not None else folders[0] / NAME if alone else Path(NAME)
    if alone and is_sweep(folders[0]):
        return _write_sweep(folders[0], place, out, title)
    runs = [_read(folder, place) for folder in folders]
    content = None if alone else compare_runs(folders, against).content()
    file = file_place(place, "" if out is None else "--out")
    try:
        if content is None:
            text = run_page(runs[0], title)
        else:
            text = comparison_page(Compared(content, runs, _by_service(runs, content)), title)
    except (LookupError, TypeError, ValueError, ArithmeticError) as error:
        raise PolicyError(
            f"{folders[0] if alone else 'these runs'}: the tables do not fit together: "
            f"{type(error).__name__}: {error}"
        ) from error
    write_at(file, text.encode())
    return place


def _write_sweep(folder: Path, place: Path, out: Path | None, title: str | None) -> Path:
    file = file_place(place, "" if out is None else "--out")
    write_at(file, sweep_report(folder, title).encode())
    return place


def _read(folder: Path, page: Path) -> Reported:
    summary, _ = read_summary(folder)
    if not summary["episodes"]:
        raise PolicyError(f"{folder}: the run has no counted episode")
    return Reported(folder, playing_again(), link=_link(folder, page), summary=summary)


def _link(folder: Path, page: Path) -> str:
    """Return a folder's address relative to a page, as a prefix of a file's name."""
    try:
        way = os.path.relpath(folder.resolve(), page.resolve().parent)
    except ValueError:  # on another drive
        return folder.resolve().as_uri() + "/"
    return "" if way == "." else quote(os.fsencode(Path(way).as_posix())) + "/"


def _by_service(runs: Sequence[Reported], content: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the estimates over seeds for each service and policy."""
    found: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for run in runs:
        for row in qoe.grouped(run.counted("requests"), "service"):
            found.setdefault((row["service"], run.summary["policy"]), []).append(row)
    order = [row["policy"] for row in content["policies"]]
    return [
        {
            "service": service,
            "policy": policy,
            "measures": {
                name: asdict(estimate(row[name] for row in rows))
                for name in MEASURES
                if name in rows[0]
            },
        }
        for (service, policy), rows in sorted(
            found.items(), key=lambda item: (item[0][0], order.index(item[0][1]))
        )
    ]
