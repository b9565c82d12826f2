"""The work of ``desim-uav bench board``: the leaderboard of submissions, in Markdown or as data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from desim_uav import escaped
from desim_uav.errors import PolicyError
from desim_uav.experiment.bench.score import Interval, interquartile_mean, score
from desim_uav.experiment.bench.submission import Submission
from desim_uav.experiment.bench.tasks import SEEDS, TRACKS, TRAINING_SEEDS, tasks

REFERENCE = "baseline"
MEANS = (
    *("crashes_per_drone_episode", "fairness", "worst_tenth_qoe1_percent"),
    *("decision_ms", "j_per_mbit"),
)
QUARTILES = ("qoe1_percent", "qoe3_percent")
PROFILE = (0.0, 0.25, 0.5, 0.75, 0.9)
"""The scores for which the profile of a policy says how many of its runs reach them."""

HEADINGS = (
    *("Policy", "Score", "QoE1 %", "QoE3 %", "Crashes per drone and episode", "Fairness"),
    *("Worst tenth of users, QoE1 %", "J per Mbit", "Decision, ms"),
    *("Uses", "Trainings", "Seeds"),
)


def board(submissions: Sequence[Submission]) -> list[dict[str, Any]]:
    """Return a table for each task and track of these submissions, and one for several tasks.

    Each row has the measures of a policy; the best score is first. Raises PolicyError if two
    submissions in a task have the same name.
    """
    tables = []
    for track in TRACKS:
        here = [
            (name, [s for s in submissions if (s.task.name, s.track.name) == (name, track)])
            for name in tasks()
        ]
        of_tasks = [_of_task(name, track, those) for name, those in here if those]
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


def _of_task(name: str, track: str, those: Sequence[Submission]) -> dict[str, Any]:
    names = [submission.about.name for submission in those]
    for submission in those:
        if names.count(submission.about.name) > 1:
            raise PolicyError(
                f"{submission.folder}: two submissions in {name}, track {track}, are called "
                f"{submission.about.name!r}; give each a name with `bench run --name`"
            )
    reference = {
        row["seed"]: row["qoe3_percent"]
        for submission in those
        if submission.about.policy == REFERENCE
        for row in submission.rows
    }
    rows = [_row(submission, reference) for submission in those]
    bounded = all(r["qoe3_at_most_percent"] is not None for s in those for r in s.rows)
    return {
        "task": name,
        "track": track,
        "scored": bounded and bool(reference),
        "bounded": bounded,
        "rows": sorted(rows, key=_rank, reverse=True),
    }


def _row(submission: Submission, reference: dict[int, float]) -> dict[str, Any]:
    rows, about = submission.rows, submission.about
    trainings = 1 + max(row["training"] for row in rows)
    is_trained = bool(about.policy_sha256) or about.training_steps is not None
    scores = [
        score(row["qoe3_percent"], reference[row["seed"]], row["qoe3_at_most_percent"])
        for row in rows
        if row["seed"] in reference and row["qoe3_at_most_percent"] is not None
    ]
    matrix = _by_training([one for one in scores if one is not None], trainings)
    whole = None not in scores and len(scores) == len(rows)
    return {
        "policy": about.name,
        "knows_future": about.knows_future,
        "information": about.information,
        "trainings": trainings if is_trained else None,
        "training_steps": about.training_steps,
        "seeds": len(rows) // trainings,
        "score": interquartile_mean([matrix]) if whole else None,
        "scores": matrix,
        **{name: _quartiles(rows, name, trainings) for name in QUARTILES},
        **{name: _mean(rows, name) for name in MEANS},
    }


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


def _rank(row: dict[str, Any]) -> tuple[bool, float]:
    if row["score"] is not None:
        return True, row["score"].value
    qoe3 = row["qoe3_percent"]
    return False, -1.0 if qoe3 is None else qoe3.value


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
                    *(_name(row), _cell(row["score"], 3)),
                    *(f"{100 * share:.0f} %" for share in row["profile"].values()),
                    _of(row["tasks"], len(table["tasks"])),
                    str(row["runs"]),
                ]
                for row in table["rows"]
            ),
        )
    heading = f"## `{table['task']}`, track `{table['track']}`\n\n"
    if not table["bounded"]:
        heading += "No bound of QoE3 is proven for this task's model, so there are no scores.\n\n"
    elif not table["scored"]:
        heading += "There are no scores, because the baseline is not among the submissions.\n\n"
    return heading + _table(HEADINGS, map(_line, table["rows"]))


def _line(row: dict[str, Any]) -> list[str]:
    return [
        _name(row),
        _cell(row["score"], 3),
        _cell(row["qoe1_percent"], 2),
        _cell(row["qoe3_percent"], 2),
        _number(row["crashes_per_drone_episode"], 4),
        _number(row["fairness"], 4),
        _number(row["worst_tenth_qoe1_percent"], 2),
        _number(row["j_per_mbit"], 2),
        _number(row["decision_ms"], 2),
        escaped.markdown(row["information"]),
        _of(row["trainings"], TRAINING_SEEDS),
        _of(row["seeds"], SEEDS),
    ]


def _name(row: dict[str, Any]) -> str:
    mark = " (knows the future: not a competitor)" if row["knows_future"] else ""
    return f"{escaped.markdown(row['policy'])}{mark}"


def _cell(interval: Interval | None, digits: int) -> str:
    if interval is None:
        return "-"
    value = f"{interval.value:.{digits}f}"
    if interval.low is None or interval.high is None:
        return value
    return f"{value} [{interval.low:.{digits}f}, {interval.high:.{digits}f}]"


def _of(count: int | None, total: int) -> str:
    return "-" if count is None else f"{count} of {total}" if count < total else str(count)


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _table(headings: Sequence[str], rows: Any) -> str:
    lines = [headings, ["---"] * len(headings), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def _plain(value: object) -> Any:
    return asdict(value) if isinstance(value, Interval) else value
