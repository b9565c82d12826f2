"""A report as one HTML page that needs nothing beside it: its skeleton and what all reports hold.

Whatever comes from a run folder is text to it: escaped, and under a policy that runs no script.
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
from desim_uav.report.inline_svg import drawn
from desim_uav.report.markup import (
    Html,
    code,
    facts,
    folded,
    html,
    joined,
    paragraph,
    table,
    tag,
    visible,
)
from desim_uav.report.run import Run
from desim_uav.report.text import MEASURES
from desim_uav.scenario.load import to_plain
from desim_uav.scenario.schema import Scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OF_EPISODES = {"crashes": ("crashes", "d"), "reward": ("reward", ".2f")}
"""Headings and formats of what is not of requests, beside ``MEASURES``."""

LONGEST_TITLE = 160


@dataclass(frozen=True, kw_only=True)
class Reported(Run):
    """A run as a page tells of it, with its ``summary`` over the counted episodes.

    ``link`` is its folder's address seen from the page, "" if it is there.
    """

    link: str
    summary: dict[str, Any]

    @property
    def has_replay(self) -> bool:
        """Does the page that plays it stand in its folder?"""
        return (self.folder / "replay.html").is_file()


@dataclass(frozen=True)
class Picture:
    """A figure of a page: its title, what it shows, and how it is drawn."""

    title: str
    caption: str
    draw: Callable[[], Figure]

    def untitled(self) -> Figure:
        """The figure without its heading: its title stands above it."""
        figure = self.draw()
        figure.suptitle("")
        return figure


def page(title: str, lead: Any, sections: Iterable[tuple[str, Html]]) -> str:
    """The page: its title, a line below it and its sections."""
    title = visible(title, LONGEST_TITLE)
    filled = [(_anchor(name), name, content) for name, content in sections if content]
    links = tag("nav", joined(tag("a", name, href=f"#{key}") for key, name, _ in filled))
    body = joined(
        [
            tag("header", tag("h1", title), paragraph(lead, class_="lead"), links),
            *(
                tag("section", tag("h2", name), "\n", content, id=key)
                for key, name, content in filled
            ),
            tag("footer", f"Made by desim-uav {__version__} from the run folders alone."),
        ],
        "\n",
    )
    template = Path(__file__).with_name("page.html").read_text(encoding="utf-8")
    return Template(template).substitute(title=html(title), body=body)


def _anchor(name: str) -> str:
    return re.sub("[^a-z0-9]+", "-", name.lower())


def tiles(pairs: Iterable[tuple[str, str]]) -> Html:
    """The numbers to look at first."""
    shown = (tag("div", tag("dt", name), tag("dd", value)) for name, value in pairs)
    return tag("dl", joined(shown), class_="tiles")


def qoe_table(by: str, rows: Sequence[dict[str, Any]]) -> Html:
    """The measures of groups of requests, as ``desim-uav qoe`` prints them, and of episodes."""
    looks = MEASURES | OF_EPISODES
    shown = {name: look for name, look in looks.items() if any(name in row for row in rows)}
    headings = [by, *(heading(label) for label, _ in shown.values())]
    return table(
        headings,
        (
            [row[by], *(number(row.get(name), form) for name, (_, form) in shown.items())]
            for row in rows
        ),
        (0,),
    )


def heading(of_terminal: str) -> Html:
    """A heading of a terminal's table, broken where this page needs it: "comp-", "leted" is a word.

    A unit stays with its quantity.
    """
    whole = of_terminal.replace("-\n", "").replace("\n", " ")
    whole = whole.replace(" %", "\u00a0%").replace(" it.", "\u00a0it.")
    return Html(html(whole).replace("/", "/<wbr>"))


def count(number: int, noun: str) -> str:
    """One episode, two episodes."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def number(value: float | None, form: str) -> str:
    """A number, or nothing."""
    return "" if value is None or math.isnan(value) else format(value, form)


def gallery(pictures: Sequence[Picture], first: int) -> Html:
    """Pictures side by side; the page's figures so far are ``first``."""
    figures = (
        tag(
            "figure",
            tag("figcaption", tag("strong", picture.title), f". {picture.caption}"),
            drawn(picture.untitled, picture.title, first + k),
            class_="figure",
        )
        for k, picture in enumerate(pictures)
    )
    return tag("div", joined(figures, "\n"), class_="figures")


def scenario_section(run: Reported) -> Html:
    """What was simulated: the key facts, and the whole file."""
    return joined(
        [
            tag("div", facts(scenario_facts(run.scenario)), class_="facts"),
            folded("scenario.yaml, every key", tag("pre", run.yaml, tabindex=0)),
        ]
    )


def scenario_facts(scenario: Scenario) -> list[tuple[str, str]]:
    """The few keys by which one scenario is told from another, in words."""
    plain = to_plain(scenario)
    drones, users, stations = plain["drones"], plain["users"], plain["stations"]
    width, depth = plain["map"]["size_m"]
    nx, ny = plain["map"]["cells"]
    battery, episode = drones["battery"], plain["episode"]
    return [
        ("name", plain["name"]),
        ("map", f"{width:g} × {depth:g} m, {nx} × {ny} cells, {plain['map']['dimensions']}D"),
        ("drones", f"{drones['count']}, footprint {drones['footprint_radius_m']:g} m"),
        ("bandwidth", _or_unlimited(drones["bandwidth_kbps"], "{:g} kbit/s a drone")),
        ("battery", "unlimited" if battery is None else _component(battery)),
        ("motion", _component(drones["motion"])),
        ("stations", f"{stations['count']}, {count(stations['pads'], 'pad')} each"),
        ("users", f"{len(users.get('positions_m') or []) or users['count']}"),
        ("mobility", _component(users["mobility"])),
        ("demand", _component(plain["demand"])),
        ("services", ", ".join(plain["services"])),
        ("reward", _component(plain["reward"])),
        ("position noise", _component(plain["position_noise"] or {}) or "none"),
        ("episode", f"{episode['steps']} steps of {episode['step_s']:g} s"),
        ("carry-over", "yes" if episode["carry_over"] else "no"),
    ]


def _or_unlimited(value: float | None, form: str) -> str:
    return "unlimited" if value is None else form.format(value)


def _component(plain: dict[str, Any]) -> str:
    """A component's kind and its simple parameters."""
    told = (
        f"{key} {value:g}" if type(value) in (int, float) else f"{key} {value}"
        for key, value in plain.items()
        if key != "kind" and isinstance(value, int | float | str)
    )
    return ", ".join([*([str(plain["kind"])] if "kind" in plain else []), *told])


def provenance_facts(run: Reported) -> list[tuple[str, Any]]:
    """Where a run comes from, as far as its manifest says."""
    said = run.manifest
    return [
        ("folder", code(str(run.folder))),
        ("policy", said["policy"]),
        ("seed", said["seed"]),
        ("world seed", said.get("world_seed")),
        ("episodes", said.get("episodes")),
        ("warm-up", said.get("warmup")),
        ("interrupted", "yes" if said.get("interrupted") is True else "no"),
        ("engine", said.get("engine")),
        ("command", command_of(run)),
        ("begun", said.get("started")),
        ("ended", said.get("finished")),
        ("scenario, SHA-256", said.get("scenario_hash")),
        *version_facts([run]),
    ]


def command_of(run: Reported) -> Html | None:
    """What was typed."""
    command = run.manifest.get("command")
    return code(shlex.join(map(str, command))) if isinstance(command, list) else None


def version_facts(runs: Sequence[Reported]) -> list[tuple[str, str]]:
    """What ran: each version there was of it."""
    found: dict[str, dict[str, None]] = {}
    for run in runs:
        versions = run.manifest.get("versions")
        for name, version in versions.items() if isinstance(versions, dict) else ():
            found.setdefault(name, {})[str(version)] = None
    return [(name, ", ".join(versions)) for name, versions in found.items()]
