"""Tables of results in the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from desim_uav.errors import printable
from desim_uav.measures.known import KNOWN, looks, narrow
from desim_uav.notices import tell
from desim_uav.report.intervals import NONE_FROM_ONE, have_single, mean_words

PIPED_WIDTH = 200
Row = Mapping[str, Any]
"""The measures of a service, or of another group of requests."""

Looks = Mapping[str, tuple[str, str]]
"""The headings and formats of measures, by name."""

TRAINED = ("reward_mean", "qoe1_percent", "qoe2_iterations", "qoe3_percent")
MEASURES = narrow(
    (
        *("requests", "qoe1_percent", "qoe1_feasible_percent", "qoe2_iterations", "qoe3_percent"),
        *("qoe3_active_percent", "completed", "unfinished", "never_served"),
    )
)
"""The measures of all services: headings and formats. The table fits a terminal of 80 columns."""

TASKS = narrow(
    (
        *("completion_s", "completion_p95_s", "waiting_s", "sending_s", "computing_s", "own_s"),
        "deadlines_met_percent",
    )
)
"""The columns of the table of tasks: how long they last, and how many are done in time."""

DELIVERED = narrow(
    (
        *("throughput_mbps", "late", "restarts", "drone_j_per_task", "user_j_per_task"),
        *("fairness", "worst_tenth_qoe1_percent"),
    )
)
"""The columns of the table of services that ask for volumes: throughput, energy and fairness."""

AGES = narrow(
    (
        *("age_s", "peak_age_s", "worst_age_s", "age_violation_percent", "updates"),
        *("updates_delivered", "updates_dropped", "updates_lost"),
    )
)
"""The columns of the table of sensors: ages, and what became of their updates."""


def print_table(table: Table) -> None:
    """Print a table as wide as the terminal, or with a fixed width into a file or pipe."""
    width = None if Console().is_terminal else PIPED_WIDTH
    Console(width=width).print(table)


def print_run(summary: dict[str, Any], by_service: list[dict[str, Any]]) -> None:
    """Print the table at the end of a run: all requests, and requests by service."""
    rows = [{"service": "all"} | summary, *by_service]
    title = "{scenario}, {policy}, seed {seed}{world}: {episodes} episode(s), {crashes} crash(es)"
    label = f"{summary['name']}: " if "name" in summary else ""
    _print_all("service", rows, label + title.format(**summary, world=in_world(summary)))
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
    tell(title.format(**content))
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1))
    table.add_column("measure", no_wrap=True)
    branches = {"original": "original", "other": content["to"], "difference": "difference"}
    for label in branches.values():
        table.add_column(_text(label), justify="right")
    for name in content["difference"]:
        label, form = KNOWN[name].label, KNOWN[name].form
        forms = (form, form, "+" + form)
        cells = (_cell(content[of], name, own) for of, own in zip(branches, forms, strict=True))
        table.add_row(_text(label), *cells)
    print_table(table)
    tell(content["run_dir"])


BENCHED = (
    looks(("qoe1_percent", "qoe3_percent"))
    | looks(("crashes_per_drone_episode",))
    | narrow(("fairness", "worst_tenth_qoe1_percent"))
    | {"decision_ms": ("decision\nms", ".2f")}
    | looks(("j_per_mbit",))
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
    """Return what happened to links, and what volume was delivered if any, of a run's summary."""
    form = (
        "{link_handovers} handover(s) between drones, {ping_pongs} of them ping-pong(s); "
        "{outages} outage(s) of {outage_s:.1f} s in all"
    )
    if summary["delivered_mbit"]:
        form += "; {delivered_mbit:.1f} Mbit delivered"
    return form.format(**summary)


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
        tell(f"{name:24s} {_value_text(value)}")


def print_groups(by: str, rows: list[dict[str, Any]]) -> None:
    """Print a row for each group of requests."""
    _print_all(by, rows)


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


LISTED = looks(("qoe1_percent", "qoe2_iterations", "qoe3_percent", "crashes"))
"""The measures of a run in a list: headings and formats."""


def print_runs(rows: Sequence[Row]) -> None:
    """Print a row for each run or training of a list."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1))
    table.add_column("run", overflow="fold")
    named = any(row["name"] for row in rows)
    if named:
        table.add_column("name", overflow="fold")
    for heading in ("episodes", *(heading for heading, _ in LISTED.values())):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("differs", overflow="fold")
    for row in rows:
        cells = (_cell(row, name, form) for name, (_, form) in LISTED.items())
        first = [_text(row[key]) for key in ("run", "name") if key == "run" or named]
        table.add_row(*first, str(row["episodes"]), *cells, _text(row["differs"]))
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
    for name, (label, form) in looks(rows[0]["measures"]).items():
        for number, row in enumerate(rows):
            last = number == len(rows) - 1
            cells = estimate_cells(name, row["measures"][name], form)
            table.add_row("" if number else label, _text(row["policy"]), *cells, end_section=last)
    print_table(table)


def estimate_cells(measure: str, estimate: dict[str, Any], form: str) -> tuple[str, ...]:
    """Return the number of replications, mean, half-width, interval, and what a difference means.

    The last is "≠ 0" if its interval excludes zero, and whether this is better or worse.
    """
    mean, half_width = _cell(estimate, "mean", form), _cell(estimate, "half_width", form)
    if not half_width:
        return str(estimate["n"]), mean, "", "", ""
    interval = f"[{_cell(estimate, 'low', form)}, {_cell(estimate, 'high', form)}]"
    outside = ""
    if estimate.get("excludes_zero"):
        verdict = KNOWN[measure].verdict(estimate["mean"])
        outside = f"≠ 0, {verdict}" if verdict else "≠ 0"
    return str(estimate["n"]), mean, f"± {half_width}", interval, outside


MORE: Sequence[tuple[str, Looks]] = (
    ("restarts", TASKS),
    ("throughput_mbps", DELIVERED),
    ("age_s", AGES),
)
"""Further tables, each with a measure that services have which belong into it."""


def tables_of(rows: Sequence[Row]) -> list[tuple[Looks, Sequence[Row]]]:
    """Return the tables of the measures of services, or of other groups, each with its rows.

    The first has all rows. The others have those rows that belong into them, and the measures that
    one of these has; a table without rows is left out.
    """
    whole = {name: look for name, look in MEASURES.items() if any(name in row for row in rows)}
    tables: list[tuple[Looks, Sequence[Row]]] = [(whole, rows)]
    for mark, every in MORE:
        own = [row for row in rows if row.get(mark) is not None]
        there = [name for name in every if any(row.get(name) is not None for row in own)]
        tables += [({name: every[name] for name in there}, own)] if own else []
    return tables


def _print_all(by: str, rows: Sequence[Row], title: str = "") -> None:
    """Print the tables of the measures of some rows, and the title above the first one."""
    for number, (looks_of, own) in enumerate(tables_of(rows)):
        _print(by, own, title if number == 0 else "", looks_of)


def _print(by: str, rows: Sequence[Row], title: str, looks_of: Looks) -> None:
    table = Table(
        title=_text(title) if title else None,
        box=box.SIMPLE_HEAD,
        padding=(0, 0, 0, 1),
        title_justify="left",
    )
    table.add_column(by, no_wrap=True)
    for heading, _ in looks_of.values():
        table.add_column(heading, justify="right")
    for row in rows:
        cells = (_cell(row, name, form) for name, (_, form) in looks_of.items())
        table.add_row(_text(row[by]), *cells)
    print_table(table)


def _text(value: object) -> Text:
    """Return text of a file without markup and without control characters."""
    return Text(printable(str(value)))


def _cell(row: Row, name: str, form: str) -> str:
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
