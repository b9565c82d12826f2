"""A report as one self-contained HTML page: its skeleton, and the parts that all reports have.

Content of a run folder is escaped, and the page's security policy allows no script.
"""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

from desim_uav import __version__
from desim_uav.measures.tally import MEASURED, Tally
from desim_uav.report import markup
from desim_uav.report.inline_svg import drawn
from desim_uav.report.manifest import engine_of
from desim_uav.report.run import Run
from desim_uav.report.text import MEASURES, Looks, Row
from desim_uav.scenario.facts import scenario_facts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OF_EPISODES = {"crashes": ("crashes", "d"), "reward": ("reward", ".2f")}
"""Headings and formats of measures that belong to episodes, not to requests."""

LONGEST_TITLE = 160


@dataclass(frozen=True, kw_only=True)
class Reported(Run):
    """A run in a report, with its ``summary`` over the counted episodes.

    ``link`` is its folder's address relative to the page, or "" if the page is in that folder.
    ``passing``: the run is in memory, and its folder will be gone when the page is read.
    """

    link: str
    summary: dict[str, Any]
    passing: bool = False

    @property
    def place(self) -> str:
        """The path of the run's folder as the page shows it, or that the run is in memory."""
        return "in memory" if self.passing else str(self.folder)

    def groups(self, by: str) -> list[dict[str, Any]]:
        """Return the measures of each group of requests and sensors."""
        there = [name for name in MEASURED if (self.folder / f"{name}.parquet").is_file()]
        return Tally(by).add(**{name: self.counted(name) for name in there}).groups()

    @property
    def has_replay(self) -> bool:
        """Whether the run's folder has a replay."""
        return (self.folder / "replay.html").is_file()


@dataclass(frozen=True)
class Picture:
    """A figure of a page: its title, its caption, and the function that draws it."""

    title: str
    caption: str
    draw: Callable[[], Figure]

    def untitled(self) -> Figure:
        """Return the figure without its heading, as the page has its title."""
        figure = self.draw()
        figure.suptitle("")
        return figure


def page(title: str, lead: object, sections: Iterable[tuple[str, markup.Html]]) -> str:
    """Return a page with its title, a line below the title, and its sections."""
    title = markup.visible(title, LONGEST_TITLE)
    filled = [(_anchor(name), name, content) for name, content in sections if content]
    links = markup.tag(
        "nav", markup.joined(markup.tag("a", name, href=f"#{key}") for key, name, _ in filled)
    )
    body = markup.joined(
        [
            markup.tag(
                "header", markup.tag("h1", title), markup.paragraph(lead, class_="lead"), links
            ),
            *(
                markup.tag("section", markup.tag("h2", name), "\n", content, id=key)
                for key, name, content in filled
            ),
            markup.tag("footer", f"Made by desim-uav {__version__} from the run folders alone."),
        ],
        "\n",
    )
    template = Path(__file__).with_name("page.html").read_text(encoding="utf-8")
    return Template(template).substitute(title=markup.html(title), body=body)


def _anchor(name: str) -> str:
    return re.sub("[^a-z0-9]+", "-", name.lower())


def tiles(pairs: Iterable[tuple[str, str]]) -> markup.Html:
    """Return the most important numbers as tiles."""
    entries = (
        markup.tag("div", markup.tag("dt", name), markup.tag("dd", value)) for name, value in pairs
    )
    return markup.tag("dl", markup.joined(entries), class_="tiles")


def qoe_table(
    by: str,
    rows: Sequence[Row],
    looks: Looks = MEASURES | OF_EPISODES,
) -> markup.Html:
    """Return a table of the measures of groups of requests, as in ``desim-uav qoe``."""
    columns = {name: look for name, look in looks.items() if any(name in row for row in rows)}
    headings = [by, *(heading(label) for label, _ in columns.values())]
    return markup.table(
        headings,
        (
            [row[by], *(number(row.get(name), form) for name, (_, form) in columns.items())]
            for row in rows
        ),
        (0,),
    )


def heading(of_terminal: str) -> markup.Html:
    """Return a heading of a terminal's table with the line breaks of a page.

    Words that were hyphenated become whole again, and a unit stays with its quantity.
    """
    whole = of_terminal.replace("-\n", "").replace("\n", " ")
    whole = whole.replace(" %", "\u00a0%").replace(" it.", "\u00a0it.")
    return markup.Html(markup.html(whole).replace("/", "/<wbr>"))


def count(number: int, noun: str) -> str:
    """Return a number with its noun, as in "1 episode" and "2 episodes"."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def number(value: float | None, form: str) -> str:
    """Return a formatted number, or "" if there is none."""
    return "" if value is None or math.isnan(value) else format(value, form)


def gallery(pictures: Sequence[Picture], first: int) -> markup.Html:
    """Return pictures side by side; ``first`` is the number of figures before them."""
    figures = (
        markup.tag(
            "figure",
            markup.tag("figcaption", markup.tag("strong", picture.title), f". {picture.caption}"),
            drawn(picture.untitled, picture.title, first + k),
            class_="figure",
        )
        for k, picture in enumerate(pictures)
    )
    return markup.tag("div", markup.joined(figures, "\n"), class_="figures")


def scenario_section(run: Reported) -> markup.Html:
    """Return the section on the scenario: its main properties and the whole file."""
    return markup.joined(
        [
            markup.tag("div", markup.facts(scenario_facts(run.scenario)), class_="facts"),
            markup.folded("scenario.yaml, every key", markup.tag("pre", run.yaml, tabindex=0)),
        ]
    )


def provenance_facts(run: Reported) -> list[tuple[str, Any]]:
    """Return the provenance of a run, as far as its manifest tells."""
    manifest = run.manifest
    return [
        ("folder", markup.code(run.place)),
        ("policy", manifest["policy"]),
        ("seed", manifest["seed"]),
        ("world seed", manifest.get("world_seed")),
        ("episodes", manifest.get("episodes")),
        ("warm-up", manifest.get("warmup")),
        ("interrupted", "yes" if manifest.get("interrupted") is True else "no"),
        ("engine", engine_of(manifest)),
        ("command", command_of(run)),
        ("begun", manifest.get("started")),
        ("ended", manifest.get("finished")),
        ("data of the map", manifest.get("attribution")),
        ("scenario, SHA-256", manifest.get("scenario_hash")),
        *version_facts([run]),
    ]


def command_of(run: Reported) -> markup.Html | None:
    """Return the command of a run, if its manifest has it."""
    command = run.manifest.get("command")
    return markup.code(shlex.join(map(str, command))) if isinstance(command, list) else None


def version_facts(runs: Sequence[Reported]) -> list[tuple[str, str]]:
    """Return the packages of some runs with all their versions."""
    versions_of: dict[str, dict[str, None]] = {}
    for run in runs:
        versions = run.manifest.get("versions")
        for name, version in versions.items() if isinstance(versions, dict) else ():
            versions_of.setdefault(name, {})[str(version)] = None
    return [(name, ", ".join(versions)) for name, versions in versions_of.items()]
