"""The worst-served requests, each with a link to its time in the replay."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from heapq import nlargest, nsmallest
from typing import Any

from desim_uav.report.markup import Html, code, joined, paragraph, table, tag
from desim_uav.report.page import Reported, count, number

WORST = 8
"""The number of requests that are listed."""


def worst_requests(runs: Sequence[Reported]) -> Html:
    """Return the worst-served requests of some runs, with links to their times in the replay."""
    every = [(run, row) for run in runs for row in run.counted("requests").itertuples()]
    served = [(run, row) for run, row in every if row.outcome != "never_served"]
    return joined(
        [
            tag("h3", "Lowest QoE1"),
            request_table(
                nsmallest(WORST, every, lambda one: (one[1].qoe1, -one[1].wait_s)), len(runs) > 1
            ),
            tag("h3", "Longest wait before a service"),
            request_table(nlargest(WORST, served, lambda one: one[1].wait_s), len(runs) > 1),
            how_to_watch(runs),
        ]
    )


def request_table(requests: Sequence[tuple[Reported, Any]], with_seed: bool) -> Html:
    """Return a table of requests, each with its run; the number of a request is a link."""
    headings = (
        *(("seed",) if with_seed else ()),
        *("episode", "request", "user", "service", "asked at", "wait, s", "requested, s"),
        *("served, s", "QoE1\u00a0%", "QoE2\u00a0steps", "outcome"),
    )
    rows = (
        (
            *((run.summary["seed"],) if with_seed else ()),
            row.episode,
            tag(
                "a",
                row.request_id,
                href=moment(run, row.episode, row.t_request_s, row.request_id),
                aria_label=f"request {row.request_id} in the replay",
            ),
            row.user,
            row.service,
            f"{int(row.t_request_s) // 60}:{int(row.t_request_s) % 60:02d}",
            number(row.wait_s, ".0f"),
            number(row.requested_s, ".0f"),
            number(row.served_s, ".0f"),
            number(100 * row.qoe1, ".1f"),
            number(row.qoe2_iterations, ".2f"),
            str(row.outcome).replace("_", "\u00a0"),
        )
        for run, row in requests
    )
    return table(headings, rows, (4, 11) if with_seed else (3, 10))


def moment(run: Reported, episode: int, t_s: float, request: int) -> str:
    """Return the address of a request's beginning in the replay of its run."""
    at_s = f"{t_s:.6f}".rstrip("0").rstrip(".")
    return f"{run.link}replay.html#episode={episode}&t={at_s}&request={request}"


def how_to_watch(runs: Sequence[Reported]) -> Html:
    """Return the commands that make the missing replays."""
    missing = [run for run in runs if not run.has_replay and not run.passing]
    if not missing:
        return Html("")
    commands = (code(shlex.join(["desim-uav", "replay", str(run.folder)])) for run in missing[:3])
    more = f" and so on, for {count(len(missing), 'run')}" if len(missing) > 3 else ""
    hint = "There is no replay to watch yet. Make it with "
    return paragraph(hint, joined(commands, ", "), f"{more}.", class_="note")
