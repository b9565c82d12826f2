"""Makes the paper's table from the rows of ``reproduce``: estimates, claims, CSV and Markdown."""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

from desim_uav import escaped
from desim_uav.experiment.published import POLICIES, PUBLISHED, best_qoe3
from desim_uav.experiment.statistics import Estimate, estimate, paired
from desim_uav.measures.known import ALWAYS
from desim_uav.model.sums import in_order

PaperRow = dict[str, Any]

LEARNED = POLICIES[1:]
LAST = ("last_qoe1_percent", "last_qoe2_iterations", "last_qoe3_percent")
LEAST_OF_BEST_COVER = {1: 0.99, 2: 0.97, 3: 0.93}
MOST_CRASHES = 0.05
MOST_CRASHES_WITH_NOISE = 0.10
NOISY_CASE = 9


class PaperLine(NamedTuple):
    """A policy in a case: its estimates over the seeds, and the values that the paper printed."""

    case: int
    preset: str
    policy: str
    estimates: dict[str, Estimate]
    published: tuple[float, float, float]


class Claim(NamedTuple):
    """A claim about the results, the value that was found, and whether the claim holds.

    A ``gate`` must hold. The paper's own claims are only reported.
    """

    text: str
    found: str
    holds: bool
    gate: bool = True


def lines(rows: Sequence[PaperRow]) -> list[PaperLine]:
    """Return a line for each case, preset and policy that has rows."""
    groups: dict[tuple[int, str, int], list[PaperRow]] = {}
    for row in rows:
        key = row["case"], row["preset"], POLICIES.index(row["policy"])
        groups.setdefault(key, []).append(row)
    bounds = (key for key in rows[0] if key.startswith(("cover_", "fair_")))
    names = [*ALWAYS, *LAST, *bounds]
    return [
        PaperLine(
            case,
            preset,
            POLICIES[number],
            {name: estimate(row.get(name) for row in group) for name in names},
            PUBLISHED[case][POLICIES[number]],
        )
        for (case, preset, number), group in sorted(groups.items())
    ]


def claims(rows: Sequence[PaperRow]) -> list[Claim]:
    """Return the claims about our own training (without the paper's preset) in these cases."""
    ours = [row for row in rows if row["preset"] == "default"]
    cases = sorted({row["case"] for row in ours})
    verdicts = [claim for case in cases for claim in _claims_of(case, ours)]
    if {8, 9} <= set(cases):
        verdicts += _claims_of_the_paper(ours)
    return verdicts


def _claims_of(case: int, rows: Sequence[PaperRow]) -> list[Claim]:
    learned = _values(rows, case, "q_learning")
    verdicts = []
    if case in LEAST_OF_BEST_COVER:
        share = [r["qoe3_percent"] / r["cover_qoe3_percent"] for r in learned]
        least = LEAST_OF_BEST_COVER[case]
        interval = estimate(share)
        text = f"case {case}: Q-learning's QoE3 is at least {least:g} of the best cover"
        verdicts.append(Claim(text, _words(interval, 3), _at_least(interval.mean, least)))
        return verdicts
    baseline = _values(rows, case, "baseline")
    qoe1 = "qoe1_feasible_percent" if case >= 8 else "qoe1_percent"
    for name, label in ((qoe1, "QoE1" if case < 8 else "feasible QoE1"), ("qoe3_percent", "QoE3")):
        more = paired([r[name] for r in learned], [r[name] for r in baseline])
        text = f"case {case}: Q-learning beats the baseline on {label}"
        verdicts.append(Claim(text, f"{_words(more, 1)} points", (more.low or 0.0) > 0.0))
    interval = estimate(r["qoe3_percent"] for r in learned)
    text = f"case {case}: Q-learning reaches the best published QoE3, {best_qoe3(case):g} %"
    verdicts.append(
        Claim(text, f"{_words(interval, 1)} %", _at_least(interval.mean, best_qoe3(case)))
    )
    crashes = estimate(r["crashes_per_drone_episode"] for r in learned)
    most = MOST_CRASHES_WITH_NOISE if case == NOISY_CASE else MOST_CRASHES
    text = f"case {case}: at most {most:g} crashes per drone and episode"
    verdicts.append(
        Claim(text, _words(crashes, 3), crashes.mean is not None and crashes.mean <= most)
    )
    return verdicts


def _claims_of_the_paper(rows: Sequence[PaperRow]) -> list[Claim]:
    """Return the paper's claims: on crashes with position error, and on the baseline."""
    verdicts = []
    for policy in LEARNED:
        more = paired(
            [r["crashes_per_drone_episode"] for r in _values(rows, 9, policy)],
            [r["crashes_per_drone_episode"] for r in _values(rows, 8, policy)],
        )
        text = f"the paper: crashes rise with the position error (case 9 against 8, {policy})"
        verdicts.append(Claim(text, _words(more, 3), (more.low or 0.0) > 0.0, gate=False))
    for name, label, cases in (
        ("qoe1_percent", "the baseline's QoE1 is the worst", range(1, 10)),
        ("qoe3_percent", "the baseline's QoE3 is the worst", range(1, 10)),
        ("crashes_per_drone_episode", "the baseline is the safest", range(4, 10)),
    ):
        among = [row for row in rows if row["case"] in cases]
        for policy in LEARNED:
            more = paired(_over_cases(among, policy, name), _over_cases(among, "baseline", name))
            where = f"mean over cases {cases[0]}-{cases[-1]}"
            text = f"the paper: {label} ({where}, against {policy})"
            verdicts.append(Claim(text, _words(more, 3), (more.low or 0.0) > 0.0, gate=False))
    return verdicts


def _over_cases(rows: Sequence[PaperRow], policy: str, name: str) -> list[float]:
    """Return a policy's mean over all cases for each seed; the seed is the replication."""
    by_seed: dict[int, list[float]] = {}
    for row in rows:
        if row["policy"] == policy:
            by_seed.setdefault(row["seed"], []).append(row[name])
    return [in_order(values) / len(values) for _, values in sorted(by_seed.items())]


def _values(rows: Sequence[PaperRow], case: int, policy: str) -> list[PaperRow]:
    """Return the rows of a policy in a case, ordered by seed."""
    of_policy = [row for row in rows if row["case"] == case and row["policy"] == policy]
    return sorted(of_policy, key=lambda row: int(row["seed"]))


def _at_least(value: float | None, least: float) -> bool:
    return value is not None and value >= least


def _words(value: Estimate, digits: int) -> str:
    if value.mean is None:
        return "-"
    half = "" if value.half_width is None else f" ± {value.half_width:.{digits}f}"
    return f"{value.mean:.{digits}f}{half}"


def rows_csv(rows: Sequence[PaperRow]) -> str:
    """Return the rows as CSV, one per job, ordered by preset, case, policy and seed."""
    ordered = sorted(
        rows, key=lambda r: (r["preset"], r["case"], POLICIES.index(r["policy"]), r["seed"])
    )
    columns = list(dict.fromkeys(name for row in ordered for name in row))
    return _csv(columns, [[row.get(name) for name in columns] for row in ordered])


def table_csv(table: Sequence[PaperLine]) -> str:
    """Return the table as CSV: means, half-widths and the published values of each line."""
    measures = list(table[0].estimates)
    columns = ["case", "preset", "policy", "seeds"]
    columns += [f"{name}{part}" for name in measures for part in ("", "_half_width")]
    columns += ["published_qoe1_percent", "published_qoe2_iterations", "published_qoe3_percent"]
    return _csv(columns, [_cells(line, measures) for line in table])


def _cells(line: PaperLine, measures: Sequence[str]) -> list[Any]:
    estimates = [line.estimates[name] for name in measures]
    numbers = [value for one in estimates for value in (one.mean, one.half_width)]
    seeds = line.estimates["qoe3_percent"].n
    return [line.case, line.preset, line.policy, seeds, *numbers, *line.published]


def _csv(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue()


HEADINGS = (
    *("case", "policy", "QoE1 %", "feasible QoE1 %", "QoE2 steps", "QoE3 %", "best cover %"),
    *("crashes", "last episode: QoE1, 2, 3", "published: QoE1, 2, 3"),
)


def cells(line: PaperLine) -> list[str]:
    """Return a line as text, one cell for each of ``HEADINGS``."""
    estimates = line.estimates
    cover = estimates.get("cover_qoe3_percent", Estimate(0, None, None))
    last = [mean for mean in (estimates[name].mean for name in LAST) if mean is not None]
    return [
        str(line.case),
        line.policy.replace("_", "-") + (" (paper)" if line.preset == "paper" else ""),
        _words(estimates["qoe1_percent"], 1),
        _words(estimates["qoe1_feasible_percent"], 1),
        _words(estimates["qoe2_iterations"], 2),
        _words(estimates["qoe3_percent"], 1),
        "" if cover.mean is None else f"{cover.mean:.1f}",
        _words(estimates["crashes_per_drone_episode"], 3),
        "{:.0f}, {:.1f}, {:.0f}".format(*last) if len(last) == len(LAST) else "",
        "{:g}, {:g}, {:g}".format(*line.published),
    ]


def markdown(
    table: Sequence[PaperLine], claims: Sequence[Claim], seeds: Collection[int], command: str
) -> str:
    """Return the table and the claims as Markdown, with the seeds and the command."""
    parts = [
        escaped.markdown_code(command),
        "",
        f"The values are means over {len(seeds)} seeds ({min(seeds)} to {max(seeds)}), each with a "
        "world of its own, ± the half-width of the 95 % t-interval. Policies are greedy and fly 20 "
        "episodes after 2 of warm-up. *Last episode* is the last episode of the training, which "
        "is what the paper's table printed. Crashes are per drone and episode.",
        "",
        "| " + " | ".join(HEADINGS) + " |",
        "| " + " | ".join("---" for _ in HEADINGS) + " |",
    ]
    parts += ["| " + " | ".join(cells(line)) + " |" for line in table]
    if claims:
        parts += ["", "| claim | found | holds |", "| --- | --- | --- |"]
        parts += [f"| {c.text} | {c.found} | {'yes' if c.holds else '**no**'} |" for c in claims]
    return "\n".join(parts) + "\n"
