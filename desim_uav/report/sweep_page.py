"""The report of a sweep: its table, its figures, its failures and its provenance."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from desim_uav.measures.known import KNOWN, looks
from desim_uav.report.figures import intervals_figure, sweep_figure
from desim_uav.report.intervals import have_interval, mean_words, sentence
from desim_uav.report.markup import Html, code, facts, html, joined, paragraph, table, tag
from desim_uav.report.page import Picture, count, gallery, heading, number, page
from desim_uav.report.text import word

DRAWN = (
    *("qoe1_percent", "qoe2_iterations", "qoe3_percent"),
    *("completion_s", "deadlines_met_percent", "age_s"),
)
"""The measures that are drawn, as far as the sweep has them."""

MOST_FAILURES = 100


@dataclass(frozen=True)
class Swept:
    """A sweep in a report.

    ``content`` is the data of its table and ``shown`` that of its figures (see ``sweep_figure``);
    ``left_out`` says why there are none.
    """

    folder: Path
    manifest: dict[str, Any]
    content: dict[str, Any]
    shown: dict[str, Any]
    left_out: str
    ended: int
    failures: Sequence[dict[str, Any]]


def sweep_page(sweep: Swept, title: str | None) -> str:
    """Return the page as HTML."""
    content = sweep.content
    keys = ", ".join(content["keys"]) or ", ".join(content["policies"])
    default = f"Sweep of {content['scenario']}: {keys}"
    lead = (
        f"{sweep.ended:,} of {count(len(sweep.manifest['jobs']), 'job')} ended, each of "
        f"{count(sweep.manifest['episodes'], 'episode')} after "
        f"{sweep.manifest['warmup']} of warm-up"
    )
    sections = ((name, section(sweep)) for name, section in SECTIONS)
    return page(title or default, lead, sections)


def _results(sweep: Swept) -> Html:
    """Return the table: a row per combination and policy."""
    keys, estimates = list(sweep.content["keys"]), sweep.content["estimates"]
    headings = [*map(_key_heading, keys), "policy", "seeds"]
    shown = looks(estimates[0]["measures"])
    headings += [heading(label) for label, _ in shown.values()]
    rows = (
        [
            *(word(row[key]) for key in keys),
            row["policy"],
            max(of["n"] for of in row["measures"].values()),
            *(_estimate(row["measures"][name], form) for name, (_, form) in shown.items()),
        ]
        for row in estimates
    )
    note = sentence(mean_words(estimates))
    if have_interval(estimates):
        note += " The number after ± is half the width of the interval."
    note += " Each seed counts once: its episodes are averaged."
    words = range(len(keys) + 1)
    results = tag("div", table(headings, rows, words), class_="tall", tabindex=0)
    return joined([results, paragraph(note, class_="note")])


def _key_heading(key: str) -> Html:
    """Return a key, which may be broken where its words end: a table has a column per key."""
    return Html(re.sub(r"([._])", r"\1<wbr>", html(key)))


def _estimate(estimate: dict[str, Any], form: str) -> Html:
    """Return a mean with its half-width below it, because so many columns must fit a page."""
    mean, half_width = number(estimate["mean"], form), estimate["half_width"]
    return joined([mean, None if half_width is None else tag("small", f"± {half_width:{form}}")])


def _figures(sweep: Swept) -> Html:
    content = sweep.shown
    there = content["estimates"][0]["measures"] if content else ()
    titles = {name: KNOWN[name].label for name in DRAWN if name in there}
    if sweep.left_out:
        return paragraph(sweep.left_out, class_="note")
    if not content["keys"]:
        draw = partial(intervals_figure, content["estimates"], content["policies"], titles, False)
        caption = sentence(mean_words(content["estimates"]))
        return gallery([Picture("Policies", caption, draw)], 0)
    fixed = ", ".join(f"{key} = {value}" for key, value in content["held"].items())
    caption = f"Against {' and '.join(content['keys'])}{f', with {fixed}' if fixed else ''}."
    pictures = [
        Picture(titles[name], caption, partial(sweep_figure, content, [name])) for name in titles
    ]
    more = "Other values are drawn by desim-uav plot sweep with --key KEY=VALUE." if fixed else None
    return joined([gallery(pictures, 0), paragraph(more, class_="note") if more else None])


def _failed(sweep: Swept) -> Html:
    missing = len(sweep.manifest["jobs"]) - sweep.ended
    if not missing:
        return Html("")
    text = f"{count(missing, 'job')} of {len(sweep.manifest['jobs']):,} have no row"
    text += f", and {len(sweep.failures):,} of them failed." if sweep.failures else "."
    text += " desim-uav sweep with --resume runs the missing jobs."
    keys = [key for key in sweep.content["keys"] if all(key in row for row in sweep.failures)]
    names = [*keys, "policy", "seed", "reason"]
    rows = ([word(row.get(name, "")) for name in names] for row in sweep.failures[:MOST_FAILURES])
    listed = table(names, rows, range(len(names))) if sweep.failures else None
    return joined([paragraph(text), listed])


def _provenance(sweep: Swept) -> Html:
    manifest, scenario = sweep.manifest, sweep.manifest["scenario"]
    command, versions = manifest.get("command"), manifest.get("versions")
    pairs: list[tuple[str, Any]] = [
        ("folder", code(str(sweep.folder))),
        ("scenario", scenario.get("name")),
        ("scenario file", scenario.get("file")),
        ("its SHA-256", scenario.get("sha256")),
        *((key, ", ".join(map(word, of))) for key, of in sweep.content["keys"].items()),
        ("policies", ", ".join(map(str, manifest.get("policies") or ()))),
        ("trained", ", ".join(map(str, manifest.get("algorithms") or ()))),
        ("seeds", ", ".join(map(str, manifest.get("seeds") or ()))),
        ("episodes", manifest["episodes"]),
        ("warm-up", manifest["warmup"]),
        ("begun", manifest.get("started")),
        ("command", code(shlex.join(map(str, command))) if isinstance(command, list) else None),
        *(versions.items() if isinstance(versions, dict) else ()),
    ]
    return tag("div", facts(pairs), class_="facts")


SECTIONS: tuple[tuple[str, Callable[[Swept], Html]], ...] = (
    ("Results", _results),
    ("Figures", _figures),
    ("Failures", _failed),
    ("Provenance", _provenance),
)
