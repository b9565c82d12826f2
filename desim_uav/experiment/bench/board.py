"""The work of ``desim-uav bench board``: the leaderboard of submissions, in Markdown or as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from desim_uav import escaped
from desim_uav.errors import PolicyError
from desim_uav.experiment.bench.bounds import has_bound
from desim_uav.experiment.bench.kept import bound_of, reference_of
from desim_uav.experiment.bench.receipts import CLAIMED, NO_CHECKS, digest_of
from desim_uav.experiment.bench.score import (
    Interval,
    interquartile_mean,
    measures_of,
    paired,
    score,
)
from desim_uav.experiment.bench.submission import Submission
from desim_uav.experiment.bench.tasks import TRACKS, TRAINING_SEEDS, tasks
from desim_uav.measures.known import KNOWN

MEANS = (
    *("crashes_per_drone_episode", "fairness", "worst_tenth_qoe1_percent"),
    *("decision_ms", "j_per_mbit"),
)
PROFILE = (0.0, 0.25, 0.5, 0.75, 0.9)
"""The scores for which the profile of a policy says how many of its runs reach them."""

BEFORE = ("Policy", "Score", "Difference from the best", "Better than the best", "Better than 0")
AFTER = (
    *("Crashes per drone and episode", "Fairness", "Worst tenth of users, QoE1 %"),
    *("J per Mbit", "Decision, ms", "Uses", "Checked", "Trainings", "Seeds"),
)


def board(
    submissions: Sequence[Submission], checks: Mapping[str, str] = NO_CHECKS
) -> list[dict[str, Any]]:
    """Return a table for each task and track of these submissions, and one for several tasks.

    ``checks`` says of the digest of a submission how it was verified (``receipts``). Each row has
    the measures of a policy. Those with the most seeds are first, as nobody may leave out hard
    ones, and among these the best score. Raises PolicyError if two submissions in a task have the
    same name.
    """
    tables = []
    for track in TRACKS:
        here = [
            (name, [s for s in submissions if (s.task.name, s.track.name) == (name, track)])
            for name in tasks()
        ]
        of_tasks = [_of_task(name, track, those, checks) for name, those in here if those]
        tables += of_tasks
        if len(of_tasks) > 1:
            tables.append(_of_all(track, of_tasks))
    return tables


def markdown(tables: Sequence[dict[str, Any]]) -> str:
    """Return the tables in Markdown."""
    return "\n".join(map(_section, tables))


def plain(tables: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the tables as plain data."""
    return [
        table | {"rows": [{k: _plain(v) for k, v in row.items()} for row in table["rows"]]}
        for table in tables
    ]


def _of_task(
    name: str, track: str, those: Sequence[Submission], checks: Mapping[str, str]
) -> dict[str, Any]:
    names = [submission.about.name for submission in those]
    for submission in those:
        if names.count(submission.about.name) > 1:
            raise PolicyError(
                f"{submission.folder}: two submissions in {name}, track {track}, are called "
                f"{submission.about.name!r}; give each a name with `bench run --name`"
            )
    rows = sorted((_row(each, checks) for each in those), key=_rank, reverse=True)
    competitors = [row for row in rows if row["scores"] and not row["knows_future"]]
    for row in rows:
        _pair(row, competitors[0] if competitors else None)
    first = those[0]
    return {
        "task": name,
        "track": track,
        "scored": any(row["scores"] for row in rows),
        "bounded": has_bound(first.task, first.track),
        "measures": [one.name for one in measures_of(first.task)],
        "rows": rows,
    }


def _row(submission: Submission, checks: Mapping[str, str]) -> dict[str, Any]:
    about, measures = submission.about, measures_of(submission.task)
    rows, trainings = _distinct(submission)
    scores = [
        score(
            measures,
            row,
            reference_of(submission.task, submission.track, row["seed"]),
            bound_of(submission.task, submission.track, row["seed"]),
        )
        for row in rows
    ]
    values = [one for one in scores if one is not None]
    matrix = _by_training(values, trainings) if len(values) == len(scores) else []
    return {
        "policy": about.name,
        "knows_future": about.knows_future,
        "information": about.information,
        "checked": checks.get(digest_of(submission.folder), CLAIMED) if checks else CLAIMED,
        "trainings": trainings if about.is_trained else None,
        "training_steps": about.training_steps,
        "seeds": len(rows) // trainings,
        "all_seeds": len(submission.track.seeds),
        "different_runs": max(len(each) for each in _digests(rows).values()),
        "listed": about.seeds,
        "score": interquartile_mean([matrix]) if matrix else None,
        "scores": matrix,
        **{one.name: _quartiles(rows, one.name, trainings) for one in measures},
        **{name: _mean(rows, name) for name in MEANS},
    }


def _digests(rows: Sequence[Mapping[str, Any]]) -> dict[int, set[str]]:
    """Return the digests of the runs of each training: where nothing is random, all are equal."""
    digests: dict[int, set[str]] = {}
    for row in rows:
        digests.setdefault(row["training"], set()).add(row["digest"])
    return digests


def _distinct(submission: Submission) -> tuple[list[Any], int]:
    """Return the rows of the trainings whose runs differ, and how many these are.

    Trainings whose runs are all equal are one training, even if their commands differ: one that is
    not allowed has no effect.
    """
    digests: dict[tuple[str, ...], int] = {}
    for number in range(len(submission.about.trainings)):
        those = tuple(row["digest"] for row in submission.rows if row["training"] == number)
        digests.setdefault(those, number)
    distinct = {*digests.values()}
    return [row for row in submission.rows if row["training"] in distinct], len(distinct)


def _pair(row: dict[str, Any], best: dict[str, Any] | None) -> None:
    """Add how a policy compares with the best competitor and with the reference, on equal seeds."""
    row |= {"to_best": None, "better_than_best": None, "better_than_reference": None}
    if not row["scores"]:
        return
    zeros = np.zeros((1, len(row["scores"][0])))
    row["better_than_reference"] = paired(row["scores"], zeros).improvement
    if best is None or best is row:
        return
    common = [seed for seed in row["listed"] if seed in best["listed"]]
    if common:
        one, other = (
            np.array(each["scores"])[:, [each["listed"].index(seed) for seed in common]]
            for each in (row, best)
        )
        pairing = paired(one, other)
        row["to_best"], row["better_than_best"] = pairing.difference, pairing.improvement


def _of_all(track: str, of_tasks: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the table of the policies that have a score in several tasks.

    Those that have one in each task come first: others are not comparable with them.
    """
    scored = [table for table in of_tasks if table["scored"]]
    by_policy: dict[str, list[dict[str, Any]]] = {}
    for table in scored:
        for row in table["rows"]:
            if row["score"] is not None:
                by_policy.setdefault(row["policy"], []).append(row)
    rows = [
        {
            "policy": policy,
            "knows_future": any(row["knows_future"] for row in rows),
            "score": interquartile_mean([row["scores"] for row in rows]),
            "profile": profile([row["scores"] for row in rows]),
            "strata": [row["scores"] for row in rows],
            "tasks": len(rows),
            "seeds": sum(row["seeds"] for row in rows),
            "runs": sum(sum(map(len, row["scores"])) for row in rows),
        }
        for policy, rows in by_policy.items()
        if len(rows) > 1
    ]
    rows.sort(key=lambda row: (row["tasks"] == len(scored), *_rank(row)), reverse=True)
    return {"tasks": [table["task"] for table in scored], "track": track, "rows": rows}


def profile(strata: Sequence[ArrayLike]) -> dict[str, float]:
    """Return the share of runs that reach each score of ``PROFILE``; each task counts the same."""
    shares = [[np.mean(np.asarray(stratum) >= least) for stratum in strata] for least in PROFILE]
    return {f"{least:g}": float(np.mean(of)) for least, of in zip(PROFILE, shares, strict=True)}


def _rank(row: dict[str, Any]) -> tuple[bool, int, float]:
    if row["score"] is not None:
        return True, row["seeds"], row["score"].value
    return False, row["seeds"], 0.0


def _quartiles(rows: Sequence[Any], name: str, trainings: int) -> Interval | None:
    values = [row[name] for row in rows]
    return None if None in values else interquartile_mean([_by_training(values, trainings)])


def _by_training(values: Sequence[float], trainings: int) -> list[list[float]]:
    """Return the values of all runs, in their order, in a list for each training."""
    seeds = len(values) // trainings
    return [list(values[n * seeds : (n + 1) * seeds]) for n in range(trainings)]


def _mean(rows: Sequence[Any], name: str) -> float | None:
    there = [row[name] for row in rows if row.get(name) is not None]
    return sum(there) / len(there) if there else None


def _section(table: dict[str, Any]) -> str:
    if "tasks" in table:
        heading = f"## All {len(table['tasks'])} tasks with scores, track `{table['track']}`\n\n"
        shares = [f"Score ≥ {least:g}" for least in PROFILE]
        return heading + _table(
            ("Policy", "Score", *shares, "Tasks", "Runs"),
            (
                [
                    *(_name(row), cell_of(row["score"], 3)),
                    *(f"{100 * share:.0f} %" for share in row["profile"].values()),
                    _of(row["tasks"], len(table["tasks"])),
                    str(row["runs"]),
                ]
                for row in table["rows"]
            ),
        )
    heading = f"## `{table['task']}`, track `{table['track']}`\n\n"
    if not table["scored"]:
        heading += (
            "There are no scores, because no references are kept; "
            f"`python analysis/bench_references.py {table['task']}` computes those of the public "
            f"set, and `desim-uav bench reveal {table['task']}` those of a revealed one.\n\n"
        )
    elif not table["bounded"]:
        heading += "No bound is proven for this task's model, so a score of 1 means the best value "
        heading += "that any run could have.\n\n"
    labels = [KNOWN[name].label for name in table["measures"]]
    lines = (_line(row, table["measures"]) for row in table["rows"])
    return heading + _table((*BEFORE, *labels, *AFTER), lines)


def _line(row: dict[str, Any], measures: Sequence[str]) -> list[str]:
    return [
        _name(row),
        cell_of(row["score"], 3),
        cell_of(row["to_best"], 3),
        *(cell_of(row[name], 2) for name in ("better_than_best", "better_than_reference")),
        *(cell_of(row[name], 2) for name in measures),
        number_of(row["crashes_per_drone_episode"], 4),
        number_of(row["fairness"], 4),
        number_of(row["worst_tenth_qoe1_percent"], 2),
        number_of(row["j_per_mbit"], 2),
        number_of(row["decision_ms"], 2),
        escaped.markdown(row["information"]),
        row["checked"],
        _of(row["trainings"], TRAINING_SEEDS),
        _of(row["seeds"], row["all_seeds"]) + same_runs(row),
    ]


def _name(row: dict[str, Any]) -> str:
    mark = " (knows the future: not a competitor)" if row["knows_future"] else ""
    return f"{escaped.markdown(row['policy'])}{mark}"


def same_runs(row: Mapping[str, Any]) -> str:
    """Return how many runs of a training differ, as words behind the number of seeds, or ""."""
    different, seeds = row["different_runs"], row["seeds"]
    return "" if different == seeds else f" ({different} different)"


def cell_of(interval: Interval | None, digits: int) -> str:
    """Return a value and its interval as a cell of a table; "-" if there is none."""
    if interval is None:
        return "-"
    value = f"{interval.value:.{digits}f}"
    if interval.low is None or interval.high is None:
        return value
    return f"{value} [{interval.low:.{digits}f}, {interval.high:.{digits}f}]"


def _of(count: int | None, total: int) -> str:
    return "-" if count is None else f"{count} of {total}" if count < total else str(count)


def number_of(value: float | None, digits: int) -> str:
    """Return a number as a cell of a table; "-" if there is none."""
    return "-" if value is None else f"{value:.{digits}f}"


def _table(headings: Sequence[str], rows: Any) -> str:
    lines = [headings, ["---"] * len(headings), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def _plain(value: object) -> Any:
    return asdict(value) if isinstance(value, Interval) else value
