"""The report of several runs: policies compared on common seeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from desim_uav.measures.known import in_words, looks
from desim_uav.report import intervals
from desim_uav.report.figures import case_picture, intervals_figure
from desim_uav.report.figures.style import NARROW
from desim_uav.report.manifest import engine_of
from desim_uav.report.markup import Html, code, facts, folded, joined, paragraph, table, tag
from desim_uav.report.page import (
    Picture,
    Reported,
    command_of,
    count,
    gallery,
    heading,
    number,
    page,
    scenario_section,
    version_facts,
)
from desim_uav.report.worst import worst_requests

MOST_MAPS = 6


@dataclass(frozen=True)
class Compared:
    """A comparison and its runs.

    ``content`` is what ``compare --json`` prints, ``runs`` are in the order of the command, and
    ``by_service`` has the estimates of measures over seeds for each service and policy.
    """

    content: dict[str, Any]
    runs: Sequence[Reported]
    by_service: Sequence[dict[str, Any]]

    @property
    def policies(self) -> list[str]:
        """The names of the policies, that of the first run first."""
        return [row["policy"] for row in self.content["policies"]]

    def of(self, policy: str) -> list[Reported]:
        """Return the runs of a policy, ordered by seed."""
        runs = (run for run in self.runs if run.summary["policy"] == policy)
        return sorted(runs, key=lambda run: int(run.summary["seed"]))


def comparison_page(comparison: Compared, title: str | None) -> str:
    """Return the page as HTML."""
    content = comparison.content
    seeds = {run.summary["seed"] for run in comparison.runs}
    default = f"{content['scenario']}: {', '.join(comparison.policies)}"
    lead = (
        f"{count(len(comparison.runs), 'run')} on {count(len(seeds), 'seed')}, each of "
        f"{count(content['episodes'], 'episode')} after {content['warmup']} of warm-up"
    )
    return page(title or default, lead, ((name, section(comparison)) for name, section in SECTIONS))


def _policies(comparison: Compared) -> Html:
    """Return the table of means over seeds."""
    return joined(
        [
            _estimates(comparison.content["policies"], "seeds"),
            paragraph(
                f"{intervals.sentence(intervals.mean_words(comparison.content['policies']))} "
                "A seed is a replication: its episodes are averaged first.",
                class_="note",
            ),
        ]
    )


def _differences(comparison: Compared) -> Html:
    """Return the table of differences from the reference policy."""
    rows = comparison.content["differences"]
    if not rows:
        return Html("")
    apart = [row["policy"] for row in rows if not row["seeds"]]
    bold = "Bold: the 95 % t-interval excludes zero. " if intervals.have_interval(rows) else None
    alone = (
        intervals.sentence(intervals.NONE_FROM_ONE) + " " if intervals.have_single(rows) else None
    )
    return joined(
        [
            _estimates(rows, "pairs"),
            paragraph(
                f"Difference from {comparison.content['against']} on the seeds (and worlds) that "
                "both have, so with the same users and requests. ",
                bold,
                alone,
                in_words([*rows[0]["measures"]]) + " ",
                f"No seed and world in common: {', '.join(apart)}." if apart else None,
                class_="note",
            ),
        ]
    )


def _estimates(rows: Sequence[dict[str, Any]], counted: str) -> Html:
    shown = looks(rows[0]["measures"])
    headings = ["policy", counted, *(heading(label) for label, _ in shown.values())]
    cells = (
        [
            row["policy"],
            len(row["seeds"]),
            *(estimate_cell(row["measures"][name], form) for name, (_, form) in shown.items()),
        ]
        for row in rows
    )
    return table(headings, cells, (0,))


def estimate_cell(estimate: dict[str, Any], form: str) -> Html:
    """Return a table cell with a mean and its half-width, and the interval below them."""
    mean, half_width = number(estimate["mean"], form), estimate["half_width"]
    if half_width is None:
        return joined([mean])
    text = f"{mean} ± {half_width:{form}}"
    low, high = estimate["mean"] - half_width, estimate["mean"] + half_width
    name = "strong" if estimate.get("excludes_zero") else "span"
    return joined([tag(name, text), tag("small", f"[{low:{form}}, {high:{form}}]")])


def _intervals(comparison: Compared) -> Html:
    """Return the figures of the two tables."""
    content = comparison.content
    shown = looks(content["policies"][0]["measures"])
    titles = {name: label for name, (label, _) in shown.items()}
    pictures = [
        Picture(
            "Policies",
            intervals.sentence(intervals.mean_words(content["policies"])),
            partial(intervals_figure, content["policies"], comparison.policies, titles, False),
        )
    ]
    if content["differences"]:
        rows = content["differences"]
        against = f"Minus {content['against']}, paired by seed, {intervals.interval_words(rows)}."
        draw = partial(intervals_figure, rows, comparison.policies, titles, True)
        pictures.append(Picture("Differences", against, draw))
    return gallery(pictures, 0)


def _services(comparison: Compared) -> Html:
    """Return the table of means over seeds, by service and policy."""
    there = comparison.by_service[0]["measures"] if comparison.by_service else {}
    shown = looks(there, short=True)
    headings = ["service", "policy", *(heading(label) for label, _ in shown.values())]
    rows = (
        [
            row["service"],
            row["policy"],
            *(_short(row["measures"][name], form) for name, (_, form) in shown.items()),
        ]
        for row in comparison.by_service
    )
    note = f"Per run: {intervals.mean_words(comparison.by_service)}."
    return joined([table(headings, rows, (0, 1)), paragraph(note, class_="note")])


def _short(estimate: dict[str, Any], form: str) -> str:
    half_width = estimate["half_width"]
    return number(estimate["mean"], form) + (
        "" if half_width is None else f" ± {half_width:{form}}"
    )


def _maps(comparison: Compared) -> Html:
    """Return a map per policy, with its flights on its first seed."""
    pictures = []
    for policy in comparison.policies[:MOST_MAPS]:
        run = comparison.of(policy)[0]
        draw = partial(case_picture, run, run.counted_episodes[0], width=NARROW)
        caption = f"Seed {run.summary['seed']}, the end of the first counted episode."
        pictures.append(Picture(policy, caption, draw))
    left = len(comparison.policies) - len(pictures)
    more = paragraph(f"The maps of {left} more policies are left out.", class_="note")
    return joined([gallery(pictures, 2), more if left else None])


def _worst(comparison: Compared) -> Html:
    """Return the worst requests of each policy over all its seeds."""
    return joined(
        folded(policy, worst_requests(comparison.of(policy)), opened=True)
        for policy in comparison.policies
    )


def _runs(comparison: Compared) -> Html:
    """Return the values of each seed, and the folder and command of each run."""
    shown = looks(comparison.content["policies"][0]["measures"])
    headings = ["policy", "seed", "world", *(heading(label) for label, _ in shown.values())]
    values = (
        [
            row["policy"],
            row["seed"],
            row["world_seed"],
            *(number(row[name], form) for name, (_, form) in shown.items()),
        ]
        for row in comparison.content["replications"]
    )
    folders = (
        [
            run.summary["policy"],
            run.summary["seed"],
            code(run.place),
            engine_of(run.manifest),
            command_of(run),
        ]
        for run in comparison.runs
    )
    return joined(
        [
            folded(
                "The values of each seed", tag("div", table(headings, values, (0,)), class_="tall")
            ),
            folded(
                "Folders and commands",
                table(("policy", "seed", "folder", "engine", "command"), folders, (0, 2, 3, 4)),
            ),
            tag("div", facts(version_facts(comparison.runs)), class_="facts"),
        ]
    )


def _scenario(comparison: Compared) -> Html:
    return scenario_section(comparison.runs[0])


SECTIONS: tuple[tuple[str, Callable[[Compared], Html]], ...] = (
    ("Policies", _policies),
    ("Paired differences", _differences),
    ("Figures", _intervals),
    ("By service", _services),
    ("Maps", _maps),
    ("Worst requests", _worst),
    ("Scenario", _scenario),
    ("Runs", _runs),
)
