"""The main properties of a scenario, in words, and how a table of such properties is shown."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

from desim_uav.errors import printable
from desim_uav.scenario.load import to_plain
from desim_uav.scenario.schema import Scenario

Pairs = Sequence[tuple[str, str]]
"""Names and values."""


def scenario_facts(scenario: Scenario) -> list[tuple[str, str]]:
    """Return the main properties of a scenario, in words."""
    plain = to_plain(scenario)
    stations, episode = plain["stations"], plain["episode"]
    width, depth = plain["map"]["size_m"]
    nx, ny = plain["map"]["cells"]
    return [
        ("name", plain["name"]),
        ("map", f"{width:g} × {depth:g} m, {nx} × {ny} cells, {plain['map']['dimensions']}D"),
        *_fleet_facts(plain),
        (
            "stations",
            f"{stations['count']}, {stations['pads']} pad{'s' * (stations['pads'] != 1)} each",
        ),
        *_user_facts(plain),
        ("services", ", ".join(plain["services"])),
        ("reward", _component(plain["reward"])),
        ("position noise", _component(plain["position_noise"] or {}) or "none"),
        ("episode", f"{episode['steps']} steps of {episode['step_s']:g} s"),
        ("carry-over", "yes" if episode["carry_over"] else "no"),
    ]


def _user_facts(plain: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the properties of the users; a group of users has one line."""
    users = plain["users"]
    if isinstance(users, dict):
        mobility, demand = _component(users["mobility"]), _component(plain["demand"])
        return [("users", str(_count(users))), ("mobility", mobility), ("demand", demand)]
    groups = []
    for own in users:
        asks = _component(own["demand"] or plain["demand"])
        line = f"{_count(own)}; mobility {_component(own['mobility'])}; demand {asks}"
        groups.append((own["name"], line))
    return [("users", str(sum(map(_count, users)))), *groups]


def _count(users: dict[str, Any]) -> int:
    return len(users.get("positions_m") or []) or users["count"]


def _fleet_facts(plain: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the properties of the drones and of access points; a type of drones has one line."""
    drones = plain["drones"]
    if isinstance(drones, dict):
        return _type_facts(drones, _radio_facts(plain, drones["radio"]))
    graded = [own["radio"] for own in drones if own["radio"]["kind"] != "disc"]
    shared = _radio_facts(plain, (graded or [drones[0]["radio"]])[0])
    types = []
    for own in drones:
        facts = _type_facts(own, [("radio", _component(own["radio"]))])
        count, *rest = [value if name == "drones" else f"{name} {value}" for name, value in facts]
        types.append((own["name"], "; ".join([count, *rest])))
    return [*types, *(fact for fact in shared if fact[0] != "radio")]


def _type_facts(
    drones: dict[str, Any], radio_facts: list[tuple[str, str]]
) -> list[tuple[str, str]]:
    battery = drones["battery"]
    return [
        ("drones", f"{drones['count']}{_footprint(drones)}"),
        ("bandwidth", _bandwidth(drones)),
        *radio_facts,
        ("battery", "unlimited" if battery is None else _component(battery)),
        ("motion", _component(drones["motion"])),
    ]


def _footprint(drones: dict[str, Any]) -> str:
    radius_m = drones.get("footprint_radius_m")
    return "" if radius_m is None else f", footprint {radius_m:g} m"


def _bandwidth(drones: dict[str, Any]) -> str:
    if "bandwidth_mhz" in drones["radio"]:
        return f"{drones['radio']['bandwidth_mhz']:g} MHz per drone"
    return _or_unlimited(drones["bandwidth_kbps"], "{:g} kbit/s per drone")


def _radio_facts(plain: dict[str, Any], radio: dict[str, Any]) -> list[tuple[str, str]]:
    """Return a radio, the association and the access points, if links have classes."""
    points = plain.get("access_points") or []
    if radio["kind"] == "disc" and not points:
        return []
    facts = [("radio", _component(radio)), ("association", _component(plain["association"]))]
    return facts + ([("access points", str(len(points)))] if points else [])


def _or_unlimited(value: float | None, form: str) -> str:
    return "unlimited" if value is None else form.format(value)


def _component(plain: dict[str, Any]) -> str:
    """Return a component's kind and its simple parameters."""
    parameters = (
        f"{key} {value:g}" if type(value) in (int, float) else f"{key} {value}"
        for key, value in plain.items()
        if key != "kind" and isinstance(value, int | float | str)
    )
    return ", ".join([*([str(plain["kind"])] if "kind" in plain else []), *parameters])


def as_text(title: str, facts: Pairs) -> str:
    """Return a table of facts for a terminal."""
    width = max(len(name) for name, _ in facts)
    lines = [f"  {name:{width}s}  {printable(value)}" for name, value in facts if value]
    return "\n".join([printable(title), *lines])


def as_html(title: str, facts: Pairs) -> str:
    """Return a table of facts for a notebook."""
    rows = "".join(
        f'<tr><td style="text-align: left">{escape(name)}</td>'
        f'<td style="text-align: left">{escape(printable(value))}</td></tr>'
        for name, value in facts
        if value
    )
    return f"<div><b>{escape(printable(title))}</b></div><table>{rows}</table>"
