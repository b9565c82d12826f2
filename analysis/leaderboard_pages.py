"""The pages of the leaderboard: an overview of tasks by policies, and a page for each task.

They are made of submissions alone. A page of a task has a section for each size and track, and the
performance profiles of all of them in one figure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from leaderboard_times import Times
from script import row as line

from desim_uav import escaped
from desim_uav.disk import write_at
from desim_uav.errors import PolicyError
from desim_uav.experiment.bench import profile
from desim_uav.experiment.bench.board import board, cell_of, number_of, same_runs
from desim_uav.experiment.bench.score import Pairing, interquartile_mean, paired
from desim_uav.experiment.bench.submission import Submission
from desim_uav.experiment.bench.tasks import FAMILIES, Task, find_task
from desim_uav.measures.known import KNOWN

OVERVIEW = "overview.md"
NOTE = "<!-- written by analysis/leaderboard.py -->\n\n"
SCORES = ("Policy", "Score", "Difference from the best")
OTHERS = (
    *("Policy", "Difference to the next one", "Better than the next one", "Fairness"),
    *("Worst tenth of users, QoE1 %", "J per Mbit", "Decision, ms", "Each training", "Seeds"),
)

FLOORS = ("random", "hover")
"""The policies that do not count as algorithms that a task tells apart."""

NEARLY_SOLVED, MANY = 0.9, 3
"""A score above which little is left to gain, and the policies that a task should tell apart."""

Table = dict[str, Any]


class Policy(NamedTuple):
    """What a policy of the leaderboard is, in words, and whether it has learned."""

    words: str
    learned: bool


class Planned(NamedTuple):
    """A submission of the plan: its task, track and policy, and whether it is there."""

    task: Task
    track: str
    policy: str
    there: bool


def write(
    folder: Path,
    submissions: Sequence[Submission],
    checks: Mapping[str, str],
    policies: Mapping[str, Policy],
    costs: Callable[[], str],
) -> None:
    """Write the overview, and a page and a figure for each task that has submissions with scores.

    ``checks`` says of the digest of a submission how it was verified, ``policies`` what the
    policies are, by name, and ``costs``, which is called last, returns what the leaderboard took.
    Raises PolicyError if no submission has a score.
    """
    tables = board(submissions, checks)
    of_tasks = [table for table in tables if "task" in table and _competitors(table)]
    if not of_tasks:
        raise PolicyError(f"{folder}: there are no pages without a submission that has a score")
    folder.mkdir(parents=True, exist_ok=True)
    by_family: dict[str, list[Table]] = {}
    for table in sorted(of_tasks, key=lambda each: FAMILIES.index(_task(each).family)):
        by_family.setdefault(_task(table).family, []).append(table)
    for family, those in by_family.items():
        write_at(folder / f"{family}.png", _figure(those))
        write_at(folder / f"{family}.md", _page(family, those).encode())
    names = list(dict.fromkeys(one.about.name for one in submissions))
    of_all = [table for table in tables if "tasks" in table]
    ordered = [table for those in by_family.values() for table in those]
    text = _overview(ordered, of_all, {name: policies[name] for name in names}, costs)
    write_at(folder / OVERVIEW, text.encode())


def _task(table: Table) -> Task:
    return find_task(table["task"])


def _figure(tables: Sequence[Table]) -> bytes:
    """Return the performance profiles of some tables as a picture, a panel for each."""
    from desim_uav.report.figures.profile import profile_figure
    from desim_uav.report.figures.style import to_bytes

    panels = [panel for table in tables for panel in profile.panels([table])]
    return to_bytes(profile_figure(panels), ".png")


def told_apart(table: Table) -> int:
    """Return how many policies without knowledge of the future differ pairwise.

    Two differ if the interval of their paired difference does not contain 0. They are taken from
    the best one on, each if it differs from all that were taken before. ``FLOORS`` do not count.
    """
    taken: list[Table] = []
    for row in _competitors(table):
        if row["policy"] not in FLOORS and all(_differ(_pair(other, row)) for other in taken):
            taken.append(row)
    return len(taken)


def _pair(one: Table, other: Table) -> Pairing | None:
    """Return how the scores of two policies compare on the seeds that both have flown."""
    common = [seed for seed in one["listed"] if seed in other["listed"]]
    if not common:
        return None
    chosen = [
        np.array(each["scores"])[:, [each["listed"].index(seed) for seed in common]]
        for each in (one, other)
    ]
    return paired(*chosen)


def _differ(pairing: Pairing | None) -> bool:
    if pairing is None or pairing.difference.low is None or pairing.difference.high is None:
        return False
    return pairing.difference.low > 0 or pairing.difference.high < 0


def _overview(
    tables: Sequence[Table],
    of_all: Sequence[Table],
    policies: Mapping[str, Policy],
    costs: Callable[[], str],
) -> str:
    names = list(policies)
    families = dict.fromkeys(_task(table).family for table in tables)
    heads = ("Task", "Size", "Track", "Seeds", *map(escaped.markdown, names), "Best", "Apart")
    lines = [_of_task(table, names) for table in tables]
    parts = [
        NOTE + "# Leaderboard\n",
        "The [scores](../benchmark.md#scores) of policies in the tasks of the benchmark: the "
        "baseline has 0 unless it crashes, and no policy exceeds 1. Each is an interquartile mean "
        "over the runs; the pages of the tasks have the intervals. The best policy without "
        "knowledge of the future is bold. *Apart* counts policies of which any two differ: the "
        "95 % interval of their difference, paired by seed, does not contain 0; `random` and "
        "`hover` do not count. A click on a heading of a table sorts it.\n",
        _markdown(heads, lines),
        _summary(tables),
        *map(_of_several, of_all),
        "## Learned policies and greedy\n",
        _learned(tables, policies),
        "## What the policies are\n",
        _markdown(("Policy", "What it is", "Uses", "Checked"), _claims(tables, policies)),
        "## How it was made\n",
        '```sh by-hand="takes hours"\npython analysis/leaderboard.py -j 2\n```\n',
        costs(),
        "```{toctree}\n:hidden:\n\n" + "".join(f"{family}\n" for family in families) + "```\n",
    ]
    return "\n".join(parts)


def _summary(tables: Sequence[Table]) -> str:
    """Return a sentence on what is left to gain in the tasks, and how well they tell apart."""
    within = sum(_competitors(table)[0]["score"].value <= NEARLY_SOLVED for table in tables)
    apart = sum(told_apart(table) >= MANY for table in tables)
    return (
        f"In {within} of {len(tables)} lines the best policy without knowledge of the future has a "
        f"score of at most {NEARLY_SOLVED}, and in {apart} at least {MANY} policies differ from "
        "each other.\n"
    )


def _competitors(table: Table) -> list[Table]:
    """Return the rows of policies with scores and without knowledge of the future."""
    return [row for row in table["rows"] if row["scores"] and not row["knows_future"]]


def _of_task(table: Table, names: Sequence[str]) -> list[str]:
    task, by_name = _task(table), {row["policy"]: row for row in table["rows"]}
    best = _competitors(table)[0]["policy"]
    cells = []
    for name in names:
        scored = name in by_name and by_name[name]["score"] is not None
        value = f"{by_name[name]['score'].value:.3f}" if scored else "-"
        cells.append(f"**{value}**" if name == best else value)
    seeds = str(max(row["seeds"] for row in table["rows"]))
    where = f"{task.family}.md#{task.size}-track-{table['track']}"
    apart = str(told_apart(table))
    said = [f"[{task.family}]({where})", task.size, table["track"], seeds]
    return [*said, *cells, escaped.markdown(best), apart]


def _learned(tables: Sequence[Table], policies: Mapping[str, Policy]) -> str:
    """Return how the best learned policy of each table compares with the planner ``greedy``."""
    lines, verdicts = [], []
    for table in tables:
        by_name = {row["policy"]: row for row in _competitors(table)}
        learned = next((row for name, row in by_name.items() if policies[name].learned), None)
        pairing = _pair(learned, by_name["greedy"]) if learned and "greedy" in by_name else None
        if learned is None or pairing is None:
            continue
        task, name = _task(table), escaped.markdown(learned["policy"])
        verdicts.append(np.sign(pairing.difference.value) if _differ(pairing) else 0)
        lines.append([task.family, task.size, table["track"], name, cell_of(pairing.difference, 3)])
    return (
        "The score of the best learned policy minus that of `greedy`, paired by seed. It is higher "
        f"in {verdicts.count(1)} of {len(lines)} lines, lower in {verdicts.count(-1)}, and in the "
        "others the 95 % interval contains 0. The planner also has other "
        "[settings](../howto/expert.md#learn-the-numbers-of-the-planner) than `greedy`, to which "
        "most of its gain in case 8 is due.\n\n"
        + _markdown(("Task", "Size", "Track", "Best learned policy", "Difference"), lines)
    )


def _claims(tables: Sequence[Table], policies: Mapping[str, Policy]) -> Iterable[list[str]]:
    """Yield for each policy what it is and declares to use, and how that was checked."""
    for name, (words, _) in policies.items():
        own = [row for table in tables for row in table["rows"] if row["policy"] == name]
        for uses in dict.fromkeys(row["information"] for row in own):
            checks = dict.fromkeys(row["checked"] for row in own if row["information"] == uses)
            yield [escaped.markdown(name), words, escaped.markdown(uses), ", ".join(checks)]


def _of_several(table: Table) -> str:
    """Return the section of the policies that have flown in all tasks of a track."""
    every = [row for row in table["rows"] if row["tasks"] == len(table["tasks"])]
    lines = [
        [
            escaped.markdown(row["policy"]),
            cell_of(row["score"], 3),
            *(f"{100 * share:.0f} %" for share in row["profile"].values()),
        ]
        for row in every
    ]
    shares = [f"Score ≥ {least}" for least in every[0]["profile"]] if every else []
    count = len(table["tasks"])
    return (
        f"## All {count} tasks of track `{table['track']}`\n\n"
        "These policies have flown in all of them. Each task has the same weight.\n\n"
        + _markdown(("Policy", "Score", *shares), lines)
    )


def costs(plan: Sequence[Planned], times: Times) -> str:
    """Return what of the plan is there and what is missing, and the processor time by kind."""
    sums = times.sums()
    lines = [[kind, str(count), f"{spent_s / 60:.1f}"] for kind, (count, spent_s) in sums.items()]
    total_s = sum(spent_s for _, spent_s in sums.values())
    there = sum(one.there for one in plan)
    missing = (
        "The others have not been made yet, so no table has them:\n\n"
        + _markdown(("Size", "Track", "Planned", "There", "Missing"), _fields(plan))
        + "\n"
    )
    return (
        f"{there} of the {len(plan)} submissions of the plan are there. "
        + (missing if there < len(plan) else "")
        + f"What is there took {total_s / 3600:.2f} hours on one core "
        f"({'; '.join(times.processors())}), with compilations, but without the trainings of "
        "shipped policies. This is the processor time in minutes:\n\n"
        + _markdown(("Parts", "Number", "Minutes"), lines)
    )


def _fields(plan: Sequence[Planned]) -> Iterable[list[str]]:
    """Yield for each size and track how many submissions are planned and there, and the others."""
    for size, track in dict.fromkeys((one.task.size, one.track) for one in plan):
        own = [one for one in plan if (one.task.size, one.track) == (size, track)]
        lacking: dict[str, list[str]] = {}
        for one in own:
            if not one.there:
                lacking.setdefault(one.policy, []).append(one.task.family)
        there = sum(one.there for one in own)
        missing = "; ".join(
            f"{escaped.markdown(policy)}: {', '.join(families)}"
            for policy, families in lacking.items()
        )
        said = missing or "-" if there else "all"
        yield [size, track, str(len(own)), str(there), said]


def _page(family: str, tables: Sequence[Table]) -> str:
    title = f"# Leaderboard: {family}\n\n"
    links = "The columns are explained in [](../benchmark.md), and [](overview.md) has all tasks.\n"
    figure = f"## Profiles\n\n![The share of runs that reach each score, by policy]({family}.png)\n"
    return "\n".join([NOTE + title + links, *map(_section, tables), figure])


def _section(table: Table) -> str:
    task, rows = _task(table), table["rows"]
    labels = [KNOWN[name].label for name in table["measures"]]
    unproven = "" if table["bounded"] else " No bound is proven for the model of this task."
    parts = [
        f"## {task.size.capitalize()}, track {table['track']}\n",
        f"{task.about.rstrip('.')}.{unproven}\n",
        _markdown(
            (*SCORES, *labels, "Crashes per drone and episode"),
            (_scores(row, table["measures"]) for row in rows),
        ),
        "What else was measured:\n",
        _markdown(*_filled(OTHERS, _others(rows))),
    ]
    return "\n".join(parts)


def _scores(row: Table, measures: Sequence[str]) -> list[str]:
    return [
        _name(row),
        cell_of(row["score"], 3),
        cell_of(row["to_best"], 3),
        *(cell_of(row[name], 2) for name in measures),
        number_of(row["crashes_per_drone_episode"], 3),
    ]


def _others(rows: Sequence[Table]) -> Iterable[list[str]]:
    scored = [row for row in rows if row["scores"]]
    following = dict(zip((row["policy"] for row in scored), scored[1:], strict=False))
    for row in rows:
        other = following.get(row["policy"])
        pairing = _pair(row, other) if other is not None else None
        yield [
            _name(row),
            cell_of(pairing.difference, 3) if pairing is not None else "-",
            cell_of(pairing.improvement, 2) if pairing is not None else "-",
            number_of(row["fairness"], 3),
            number_of(row["worst_tenth_qoe1_percent"], 1),
            number_of(row["j_per_mbit"], 1),
            number_of(row["decision_ms"], 2),
            _trainings(row),
            f"{row['seeds']}{same_runs(row)}",
        ]


def _filled(
    heads: Sequence[str], lines: Iterable[Sequence[str]]
) -> tuple[list[str], list[list[str]]]:
    """Return the columns of a table in which at least one cell says something."""
    columns = [[head, *cells] for head, *cells in zip(heads, *lines, strict=True)]
    kept, *rest = zip(*(each for each in columns if set(each[1:]) != {"-"}), strict=True)
    return list(kept), [list(cells) for cells in rest]


def _trainings(row: Table) -> str:
    """Return the score of each training whose runs differ from those of the ones before it."""
    scores = row["scores"] if row["trainings"] else []
    return ", ".join(f"{interquartile_mean([one]).value:.3f}" for one in scores) or "-"


def _name(row: Table) -> str:
    mark = " (knows the future)" if row["knows_future"] else ""
    return f"{escaped.markdown(row['policy'])}{mark}"


def _markdown(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    return "\n".join(map(line, (heads, ["---"] * len(heads), *lines))) + "\n"
