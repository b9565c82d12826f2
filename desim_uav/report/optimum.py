"""How well any policy could do, in the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from desim_uav.errors import printable
from desim_uav.notices import tell
from desim_uav.report.text import print_table

OptimumRow = tuple[str, str, str, str, str, Any]
"""What is the best, its QoE3, its reward, what is proven, its cells, and its policy or None."""


HEADINGS = ("the best", "QoE3\n%", "reward\nper step", "proven\nat most", "cells")


def title_of(solution: dict[str, Any]) -> str:
    """Return what was solved."""
    title = "{scenario}, world seed {world_seed}: {drones} drone(s), {users} user(s)"
    return printable(title.format(**solution))


def print_optimum(solution: dict[str, Any]) -> None:
    """Print how well any policy could do: a row for each optimum, and the best flights."""
    rows = list(optima(solution))
    table = Table(
        title=Text(title_of(solution)),
        box=box.SIMPLE_HEAD,
        padding=(0, 0, 0, 1),
        title_justify="left",
    )
    first, *numbers, last = HEADINGS
    table.add_column(first, no_wrap=True)
    for heading in numbers:
        table.add_column(heading, justify="right")
    table.add_column(last)
    for name, qoe3, reward, at_most, cells, _ in rows:
        table.add_row(name, qoe3, reward, at_most, cells)
    print_table(table)
    for name, *_, policy in rows:
        if policy is not None:
            tell(f"{name}: {_itinerary(policy)}")
    if solution["runs"] is not None:
        tell(runs_in_words(solution["runs"]))
    if solution["runs_refused"] is not None:
        tell(f"no bounds of runs: {solution['runs_refused']}")


def optima(solution: dict[str, Any]) -> Iterator[OptimumRow]:
    """Yield the rows of the table."""
    if solution["cover"] is not None:
        yield from _hovering(solution)
    if solution["one_drone"] is not None:
        yield from _alone(solution["one_drone"])
    if solution["discounted"] is not None:
        best = solution["discounted"]
        name, value = f"return, γ = {best['gamma']:g}", f"{best['return']:.4f}"
        yield f"{name}: {value}", "", f"{best['reward_per_step']:.4f}", "", "", best["policy"]
    if solution["runs"] is not None:
        yield from _in_runs(solution["runs"])


def _hovering(solution: dict[str, Any]) -> Iterator[OptimumRow]:
    """Yield the rows of the best cells."""
    cover, fair = solution["cover"], solution["fair_cover"]
    at_most = f"{solution['instant_at_most_percent']:.1f} %"
    yield "QoE3, at any instant", "", "", at_most, "", None
    qoe3, at_most = f"{cover['qoe3_percent']:.1f}", f"{cover['at_most_percent']:.1f} %"
    yield "QoE3, hovering", qoe3, "", at_most, _cells(cover), None
    if fair is not None:
        low, high = fair["least_qoe3_percent"], f"{fair['qoe3_percent']:.1f}"
        qoe3 = high if low is None or f"{low:.1f}" == high else f"{low:.1f}-{high}"
        reward, at_most = f"{fair['reward_per_step']:.4f}", f"{fair['at_most_per_step']:.4f}"
        yield "reward, hovering", qoe3, reward, at_most, _cells(fair), None


def _alone(lone: dict[str, Any]) -> Iterator[OptimumRow]:
    """Yield the rows of the best of one drone."""
    for name in ("reward", "QoE3"):
        best = lone[f"best_{name.lower()}"]
        qoe3, reward = f"{best['qoe3_percent']:.1f}", f"{best['reward_per_step']:.4f}"
        at_most = f"{best['high']:.4f}" if name == "reward" else f"{best['high']:.1f} %"
        yield f"{name}, {lone['over']}", qoe3, reward, at_most, "", best["policy"]


def _in_runs(runs: dict[str, Any]) -> Iterator[OptimumRow]:
    """Yield the rows of bounds of runs."""
    means, over = runs["means"], f"in a run of {runs['episodes']} episode(s)"
    if "age_at_least_s" in means:
        least = f"at least {means['age_at_least_s']['mean']:.1f} s"
        yield f"mean age, {over}", "", "", least, "", None
        return
    reached = means["schedule_qoe3_percent"]["mean"]
    any_policy, crash_free = (
        f"{means[name]['mean']:.1f} %"
        for name in ("qoe3_at_most_percent", "crash_free_at_most_percent")
    )
    reaches = "" if reached is None else f"{reached:.1f}"
    if crash_free == any_policy:
        yield f"QoE3, {over}", reaches, "", any_policy, "", None
    else:
        yield f"QoE3, {over}", "", "", any_policy, "", None
        yield "QoE3, without crashes", reaches, "", crash_free, "", None
    if means["qoe1_at_most_percent"]["mean"] is not None:
        at_most = f"{means['qoe1_at_most_percent']['mean']:.1f} %"
        yield f"QoE1, {over}", "", "", at_most, "", None


def runs_in_words(runs: dict[str, Any]) -> str:
    """Return what the bounds of runs mean, and how close they are."""
    means, rows = runs["means"], runs["seeds"]
    seeds = f"seed {rows[0]['seed']}" if len(rows) == 1 else f"{len(rows)} seeds"
    if "age_at_least_s" in means:
        least = _estimate(means["age_at_least_s"])
        return f"In a run on {seeds}, no policy has a mean age below {least} s."
    qoe3, crash_free, qoe1, reached = (
        means[f"{name}_percent"]
        for name in ("qoe3_at_most", "crash_free_at_most", "qoe1_at_most", "schedule_qoe3")
    )
    sentences = f"In a run on {seeds}, no policy exceeds a QoE3 of {_estimate(qoe3)} %"
    differs = f"{crash_free['mean']:.2f}" != f"{qoe3['mean']:.2f}"
    if differs:
        sentences += f", and none without crashes one of {_estimate(crash_free)} %"
    if reached["mean"]:
        gap = 100.0 * (crash_free["mean"] / reached["mean"] - 1.0)
        sentences += (
            f"; a schedule {'without crashes ' * differs}that knows all walks reaches "
            f"{_estimate(reached)} %, so this bound is at most {gap:.1f} % too high"
        )
    if qoe1["mean"] is not None:
        sentences += f". No policy exceeds a QoE1 of {_estimate(qoe1)} %"
        if qoe1["mean"] >= 100.0 and qoe3["mean"] < 100.0:
            sentences += ", which says nothing: the bound of QoE1 is not tight here"
    return f"{sentences}."


def _estimate(estimate: dict[str, Any]) -> str:
    """Return a mean with the half-width of its interval, if it has one."""
    half_width = estimate["half_width"]
    return f"{estimate['mean']:.2f}" + ("" if half_width is None else f" ± {half_width:.2f}")


def _cells(best: dict[str, Any]) -> str:
    return " ".join(f"[{ix}, {iy}]" for ix, iy in best["cells"])


def _itinerary(policy: dict[str, Any]) -> str:
    """Return a policy in words: its actions, each with the number of steps it takes."""
    steps, again_from = policy["steps"], policy["again_from"]
    if again_from is None:
        return _words(steps)
    begin = f"{_words(steps[:again_from])}; then " if again_from else ""
    return f"{begin}forever: {_words(steps[again_from:])}"


def _words(steps: list[dict[str, Any]]) -> str:
    counts: list[list[Any]] = []
    for step in steps:
        if counts and step["action"] in (None, counts[-1][0]):
            counts[-1][1] += 1
        else:
            counts.append([step["action"], 1])
    return ", ".join(name if count == 1 else f"{name} x {count}" for name, count in counts)
