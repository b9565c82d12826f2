"""Tables of results in the terminal."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from desim_uav.errors import printable
from desim_uav.notices import tell
from desim_uav.report.intervals import NONE_FROM_ONE, have_single, mean_words

PIPED_WIDTH = 200
TRAINED = ("reward_mean", "qoe1_percent", "qoe2_iterations", "qoe3_percent")
MEASURES = {
    "requests": ("requests", "d"),
    "qoe1_percent": ("QoE1\n%", ".1f"),
    "qoe1_feasible_percent": ("feasible\nQoE1 %", ".1f"),
    "qoe2_iterations": ("QoE2\nsteps", ".2f"),
    "qoe3_percent": ("QoE3\n%", ".1f"),
    "qoe3_active_percent": ("active\nQoE3 %", ".1f"),
    "completed": ("comp-\nleted", "d"),
    "unfinished": ("unfin-\nished", "d"),
    "never_served": ("never\nserved", "d"),
}
"""Headings and formats; the table fits a terminal of 80 columns."""

FORKED = {name: MEASURES[name] for name in ("qoe1_percent", "qoe2_iterations", "qoe3_percent")} | {
    "reward_mean": ("reward", ".3f"),
    "requests": ("requests", "d"),
    "crashes": ("crashes", "d"),
}
"""The measures of the branches of a run: headings and formats."""

COMPARED = {
    "qoe1_percent": ("QoE1 %", ".2f"),
    "qoe1_feasible_percent": ("feasible QoE1 %", ".2f"),
    "qoe2_iterations": ("QoE2 steps", ".3f"),
    "qoe3_percent": ("QoE3 %", ".2f"),
    "qoe3_active_percent": ("active QoE3 %", ".2f"),
    "crashes_per_drone_episode": ("crashes/drone/ep.", ".4f"),
    "reward_mean": ("reward", ".3f"),
}
"""The headings and formats of a comparison's measures; its tables fit 100 columns."""

OF_ENERGY = {"j_per_mbit": ("J per Mbit", ".2f")}
"""The same for what is measured if batteries hold energy."""

OF_SOME = OF_ENERGY | {
    "completion_s": ("delay s", ".3f"),
    "deadlines_met_percent": ("in time %", ".2f"),
}
"""The same for what is measured in some scenarios only."""

LOOKS = COMPARED | OF_SOME
"""The headings and formats of all measures of a comparison."""

TASKS = {
    "completion_s": ("delay\ns", ".3f"),
    "completion_p95_s": ("95 % of\ndelays s", ".3f"),
    "waiting_s": ("waiting\ns", ".3f"),
    "sending_s": ("sending\ns", ".3f"),
    "computing_s": ("comp-\nuting s", ".3f"),
    "own_s": ("own\ns", ".3f"),
    "deadlines_met_percent": ("in time\n%", ".1f"),
    "late": ("drop-\nped", "d"),
    "restarts": ("begun\nanew", "d"),
}
"""The headings and formats of the measures of tasks, in a table of their own."""


def compared(there: Collection[str]) -> dict[str, tuple[str, str]]:
    """Return the headings and formats of those measures of a comparison that are there."""
    return {name: look for name, look in LOOKS.items() if name in there}


def print_table(table: Table) -> None:
    """Print a table as wide as the terminal, or with a fixed width into a file or pipe."""
    width = None if Console().is_terminal else PIPED_WIDTH
    Console(width=width).print(table)


def print_run(summary: dict[str, Any], by_service: list[dict[str, Any]]) -> None:
    """Print the table at the end of a run: all requests, and requests by service."""
    rows = [{"service": "all"} | summary, *by_service]
    title = "{scenario}, {policy}, seed {seed}{world}: {episodes} episode(s), {crashes} crash(es)"
    _print("service", rows, title.format(**summary, world=in_world(summary)))
    _print_tasks("service", rows)
    if "link_handovers" in summary:
        tell(links_in_words(summary))
    if "conflicts" in summary:
        tell(distances_in_words(summary))
    if "energy_wh" in summary:
        tell(energy_in_words(summary))
    tell(summary["run_dir"])


def in_world(summary: dict[str, Any]) -> str:
    """Return the world of a run, if it is not that of its seed."""
    seed, world_seed = summary["seed"], summary.get("world_seed", summary["seed"])
    return "" if seed == world_seed else f" in world {world_seed}"


def print_fork(content: dict[str, Any]) -> None:
    """Print the measures of both branches of a run since the episode of its fork."""
    title = "{scenario}, seed {seed}: {to} instead of {policy} from {episode}:{step} on"
    table = Table(
        title=_text(title.format(**content)),
        box=box.SIMPLE_HEAD,
        padding=(0, 0, 0, 1),
        title_justify="left",
    )
    table.add_column("", no_wrap=True)
    for heading, _ in FORKED.values():
        table.add_column(heading, justify="right")
    rows = {"original": "original", "other": content["to"], "difference": "difference"}
    for name, label in rows.items():
        signed = "+" if name == "difference" else ""
        cells = (_cell(content[name], key, signed + form) for key, (_, form) in FORKED.items())
        table.add_row(_text(label), *cells)
    print_table(table)
    tell(content["run_dir"])


BENCHED = (
    {name: COMPARED[name] for name in ("qoe1_percent", "qoe3_percent")}
    | {
        "qoe3_at_most_percent": ("at most\nQoE3 %", ".2f"),
        "crashes_per_drone_episode": COMPARED["crashes_per_drone_episode"],
        "fairness": ("fairness", ".4f"),
        "worst_tenth_qoe1_percent": ("worst tenth\nQoE1 %", ".2f"),
        "decision_ms": ("decision\nms", ".2f"),
    }
    | OF_ENERGY
)
"""The measures of a seed of a submission: headings and formats."""


def print_bench(content: dict[str, Any]) -> None:
    """Print the rows of a submission to the benchmark."""
    table = Table(
        title=_text("{task}, track {track}: {name}".format(**content)),
        box=box.SIMPLE_HEAD,
        padding=(0, 0, 0, 1),
        title_justify="left",
    )
    trained = ["training"] if len({row["training"] for row in content["rows"]}) > 1 else []
    for heading in (*trained, "seed"):
        table.add_column(heading, justify="right")
    looks = {name: look for name, look in BENCHED.items() if name in content["rows"][0]}
    for heading, _ in looks.values():
        table.add_column(heading, justify="right")
    for row in content["rows"]:
        cells = (_cell(row, name, form) for name, (_, form) in looks.items())
        table.add_row(*(str(row[name]) for name in (*trained, "seed")), *cells)
    print_table(table)


def links_in_words(summary: dict[str, Any]) -> str:
    """Return what happened to links, and what was delivered, of the summary of a run."""
    return (
        "{link_handovers} handover(s) between drones, {ping_pongs} of them ping-pong(s); "
        "{outages} outage(s) of {outage_s:.1f} s in all; {delivered_mbit:.1f} Mbit delivered"
    ).format(**summary)


def distances_in_words(summary: dict[str, Any]) -> str:
    """Return how often and how near drones came to each other, of the summary of a run."""
    form = "{conflicts} conflict(s) between drones, {conflict_s:.1f} s in all"
    if summary["least_distance_m"] is not None:
        form += "; the least distance was {least_distance_m:.1f} m"
    return form.format(**summary)


def energy_in_words(summary: dict[str, Any]) -> str:
    """Return what energy the drones used and were charged with, of the summary of a run."""
    form = "{energy_wh:.2f} Wh used in flight, {charged_wh:.2f} Wh charged"
    if summary["j_per_mbit"] is not None:
        form += "; {j_per_mbit:.2f} J per Mbit of the {served_mbit:.1f} Mbit served"
    return form.format(**summary)


def print_training(summary: dict[str, Any]) -> None:
    """Print the result of a training: the means of its last episodes, and the policy's file."""
    tell(
        "{scenario}, {algorithm}, seed {seed}: {episodes} episode(s); over the last "
        "{over_last}:".format(**summary)
    )
    for name in (*TRAINED, "crashes_per_drone_episode"):
        tell(f"  {name:26s} {_value_text(summary[name])}")
    tell(summary["policy"])


def word(value: object) -> str:
    """Return a value of a key as it is written in a scenario."""
    if value is None:
        return "null"
    return str(value).lower() if isinstance(value, bool) else f"{value}"


def print_summary(summary: dict[str, Any]) -> None:
    """Print each measure on a line of its own."""
    for name, value in summary.items():
        tell(f"{name:22s} {_value_text(value)}")


def print_groups(by: str, rows: list[dict[str, Any]]) -> None:
    """Print a row for each group of requests."""
    _print(by, rows, "")
    _print_tasks(by, rows)


def print_comparison(comparison: dict[str, Any]) -> None:
    """Print the measures of each policy, and its differences from the reference policy."""
    title = "{scenario}, {episodes} episode(s) after {warmup} of warm-up".format(**comparison)
    _print_estimates(
        f"{title}: {mean_words(comparison['policies'])}", "seeds", comparison["policies"]
    )
    if comparison["differences"]:
        title = f"difference from {comparison['against']}, paired by seed"
        _print_estimates(title, "pairs", comparison["differences"])
    for row in comparison["differences"]:
        if not row["seeds"]:
            pair = f"{row['policy']} and {row['against']}"
            tell(f"{pair} have no seed and world in common")
    if have_single(comparison["policies"] + comparison["differences"]):
        tell(NONE_FROM_ONE)


def print_sweep(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a row for each combination and policy; numbers are aligned to the right."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1))
    for number, heading in enumerate(headings):
        left = number <= headings.index("policy")
        table.add_column(_text(heading), justify="left" if left else "right", overflow="fold")
    for row in rows:
        table.add_row(*map(_text, row))
    print_table(table)


def print_findings(findings: list[tuple[str, str, str]]) -> None:
    """Print the verdict, name and message of each finding on a line, which may wrap."""
    table = Table(box=None, show_header=False, padding=(0, 1, 0, 0))
    table.add_column()
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    look = {"ok": "green", "note": "yellow", "problem": "bold red"}
    for verdict, what, words in findings:
        table.add_row(Text(verdict, look[verdict]), _text(what), _text(words))
    print_table(table)


def _print_estimates(title: str, counted: str, rows: list[dict[str, Any]]) -> None:
    """Print a line for each measure and policy."""
    table = Table(title=_text(title), box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1))
    table.title_justify = "left"
    table.add_column("measure", no_wrap=True)
    table.add_column("policy", overflow="fold", max_width=32)
    for heading in (counted, "mean", "", "", ""):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, (label, form) in compared(rows[0]["measures"]).items():
        for number, row in enumerate(rows):
            last = number == len(rows) - 1
            cells = estimate_cells(row["measures"][name], form)
            table.add_row("" if number else label, _text(row["policy"]), *cells, end_section=last)
    print_table(table)


def estimate_cells(estimate: dict[str, Any], form: str) -> tuple[str, ...]:
    """Return the number of replications, mean, half-width, interval, and "≠ 0" if that holds."""
    mean, half_width = _cell(estimate, "mean", form), _cell(estimate, "half_width", form)
    if not half_width:
        return str(estimate["n"]), mean, "", "", ""
    interval = f"[{_cell(estimate, 'low', form)}, {_cell(estimate, 'high', form)}]"
    outside = "≠ 0" if estimate.get("excludes_zero") else ""
    return str(estimate["n"]), mean, f"± {half_width}", interval, outside


def _print_tasks(by: str, rows: list[dict[str, Any]]) -> None:
    """Print the measures of tasks, if there are tasks."""
    if rows and "deadlines_met_percent" in rows[0]:
        _print(by, rows, "", TASKS)


def _print(
    by: str, rows: list[dict[str, Any]], title: str, every: Mapping[str, Any] = MEASURES
) -> None:
    table = Table(
        title=_text(title) if title else None,
        box=box.SIMPLE_HEAD,
        padding=(0, 0, 0, 1),
        title_justify="left",
    )
    table.add_column(by, no_wrap=True)
    looks = {name: look for name, look in every.items() if any(name in row for row in rows)}
    for heading, _ in looks.values():
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(_text(row[by]), *(_cell(row, name, look[1]) for name, look in looks.items()))
    print_table(table)


def _text(value: object) -> Text:
    """Return text of a file without markup and without control characters."""
    return Text(printable(str(value)))


def _cell(row: dict[str, Any], name: str, form: str) -> str:
    value = row.get(name)
    return "" if value is None or math.isnan(value) else format(value, form)


def _value_text(value: object) -> str:
    return (
        f"{value:.6g}"
        if isinstance(value, float)
        else "-"
        if value is None
        else printable(str(value))
    )
