"""The report of one run."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from desim_uav.errors import NoEventsError
from desim_uav.measures.known import KNOWN
from desim_uav.report import figures
from desim_uav.report.figures.style import MOST_PANELS, NARROW
from desim_uav.report.markup import Html, facts, folded, joined, paragraph, tag
from desim_uav.report.page import (
    Picture,
    Reported,
    count,
    gallery,
    number,
    page,
    provenance_facts,
    qoe_table,
    scenario_section,
    tiles,
)
from desim_uav.report.text import tables_of
from desim_uav.report.worst import worst_requests

MOST_EPISODES = 200
"""The largest number of episodes that have a row."""


def run_page(run: Reported, title: str | None) -> str:
    """Return the page as HTML."""
    default = "{scenario}, {policy}, seed {seed}".format(**run.summary)
    title = title or run.manifest.get("name")
    size = (
        f"{count(run.summary['episodes'], 'episode')}, {count(run.summary['requests'], 'request')}"
    )
    lead = size if title is None else f"{default}: {size}"
    return page(title or default, lead, ((name, section(run)) for name, section in SECTIONS))


def _quality(run: Reported) -> Html:
    """Return the tables of QoE."""
    summary = run.summary
    served = f"{summary['completed']} of {summary['requests']}"
    first = [
        ("QoE1", f"{number(summary['qoe1_percent'], '.1f') or '-'} %"),
        ("QoE2", f"{number(summary['qoe2_iterations'], '.2f') or '-'} steps"),
        ("QoE3", f"{number(summary['qoe3_percent'], '.1f') or '-'} %"),
        ("requests completed", served),
        ("crashes", str(summary["crashes"])),
        ("reward per episode", number(summary["reward_mean"], ".2f") or "-"),
    ]
    if "link_handovers" in summary:
        first += [
            ("handovers", f"{summary['link_handovers']}"),
            ("ping-pongs", f"{summary['ping_pongs']}"),
            ("outages", f"{summary['outages']}, {number(summary['outage_s'], '.0f')} s"),
            ("delivered", f"{number(summary['delivered_mbit'], '.0f')} Mbit"),
        ]
    if "conflicts" in summary:
        least = number(summary["least_distance_m"], ".1f")
        first += [
            ("conflicts", f"{summary['conflicts']}, {number(summary['conflict_s'], '.0f')} s"),
            ("least distance", f"{least} m" if least else "-"),
        ]
    if "energy_wh" in summary:
        first += [
            ("energy used", f"{number(summary['energy_wh'], '.1f')} Wh"),
            ("per Mbit served", f"{number(summary['j_per_mbit'], '.1f') or '-'} J"),
        ]
    first += [
        (KNOWN[name].label, number(summary.get(name), KNOWN[name].short) or "-")
        for name in ("completion_p95_s", "deadlines_met_percent", "age_s", "worst_age_s")
        if name in summary
    ]
    groups = "group" in run.counted("requests")
    return joined(
        [
            tiles(first),
            tag("h3", "By service"),
            *_by("service", run),
            *([tag("h3", "By group of users"), *_by("group", run)] if groups else ()),
            paragraph(
                "QoE1: the share of the requested time that was served, a mean over requests. "
                "QoE2: the time a request was open and not served, in steps. QoE3: the share of "
                "users attached to a drone, over time. One seed is one replication: its requests "
                "and episodes depend on each other, so there are no intervals here.",
                class_="note",
            ),
            tag("h3", "By episode"),
            _by_episode(run),
        ]
    )


def _by(by: str, run: Reported) -> list[Html]:
    """Return the tables of services, or of other groups, each below everything together."""
    rows = [{by: "all"} | run.summary, *run.groups(by)]
    return [qoe_table(by, own, looks) for looks, own in tables_of(rows)]


def _by_episode(run: Reported) -> Html:
    of_requests = {row["episode"]: row for row in run.groups("episode")}
    columns = ["episode", "qoe3_percent", "crashes", "reward"]
    rows = [
        {"requests": 0} | of_requests.get(row["episode"], {}) | row
        for row in run.counted("episodes")[columns].to_dict("records")
    ]
    table = tag("div", qoe_table("episode", rows[:MOST_EPISODES]), class_="tall", tabindex=0)
    if len(rows) <= 12:
        return table
    more = paragraph(
        f"These are the first {MOST_EPISODES} of {len(rows)} episodes; "
        "desim-uav qoe --by episode prints all.",
        class_="note",
    )
    return folded(f"{len(rows)} episodes", table, more if len(rows) > MOST_EPISODES else None)


def _figures(run: Reported) -> Html:
    first = run.counted_episodes[0]
    pictures = [
        Picture(
            "Map",
            "The end of the first counted episode, with users' walks and drones' paths.",
            partial(figures.case_picture, run, first, width=NARROW),
        ),
        Picture(
            "QoE over episodes",
            "All counted episodes.",
            partial(figures.episodes_figure, run, NARROW),
        ),
    ]
    if run.summary["requests"]:
        caption = "The outcomes, waiting times and QoE1 of requests."
        draw = partial(figures.services_figure, run, width=NARROW)
        pictures.append(Picture("Services", caption, draw))
    requests = run.counted("requests")
    if "gigacycles" in requests and requests["gigacycles"].any():
        caption = "The mean delay of tasks and its parts, and how many were done within a time."
        pictures.append(Picture("Delay", caption, partial(figures.delay_figure, run, width=NARROW)))
    if (run.folder / "sensors.parquet").is_file():
        caption = "The mean age of sensors over time, and the time average of each sensor."
        pictures.append(Picture("Age", caption, partial(figures.age_figure, run, width=NARROW)))
    problem = _no_battery(run, first)
    if problem is None:
        caption = "The first counted episode. Shaded times are those in which a drone cannot serve."
        draw = partial(figures.battery_figure, run, first, width=NARROW)
        pictures.append(Picture("Battery", caption, draw))
    return joined([gallery(pictures, 0), paragraph(problem, class_="note") if problem else None])


def _no_battery(run: Reported, episode: int) -> str | None:
    """Return why the batteries cannot be drawn, or None if they can."""
    if not run.scenario.limited_battery:
        return "Batteries are unlimited."
    if run.scenario.drone_count > MOST_PANELS:
        return (
            "There are too many drones to draw all batteries; "
            "desim-uav plot battery --drone draws one."
        )
    try:
        run.need([episode])
    except NoEventsError as error:
        return f"The batteries cannot be drawn. {error}"
    return None


def _worst(run: Reported) -> Html:
    return worst_requests([run]) if run.summary["requests"] else Html("")


def _provenance(run: Reported) -> Html:
    return tag("div", facts(provenance_facts(run)), class_="facts")


SECTIONS: tuple[tuple[str, Callable[[Reported], Html]], ...] = (
    ("Quality of experience", _quality),
    ("Figures", _figures),
    ("Worst requests", _worst),
    ("Scenario", scenario_section),
    ("Provenance", _provenance),
)
