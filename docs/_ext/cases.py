"""The nine cases of the paper, as their scenario files have them."""

from __future__ import annotations

from markdown_table import table

from desim_uav.scenario.load import load, to_plain
from desim_uav.shipped import scenario_names, scenario_path

HEADINGS = (
    *("Case", "Map", "Drones", "Battery", "Stations", "Bandwidth", "Users", "Clusters"),
    *("Users move", "Demand", "Reward", "Position noise"),
)


def markdown() -> str:
    """A row for each case."""
    names = [name for name in scenario_names() if name.startswith("case")]
    return table(HEADINGS, map(_row, names))


def _row(name: str) -> list[str]:
    scenario = load(scenario_path(name))
    plain = to_plain(scenario)
    drones, users = plain["drones"], plain["users"]
    return [
        name.removeprefix("case"),
        f"{scenario.map.dimensions}D",
        str(drones["count"]),
        "limited" if scenario.limited_battery else "unlimited",
        str(plain["stations"]["count"]),
        "limited" if drones["bandwidth_kbps"] else "unlimited",
        str(users["count"]),
        str(users["clusters"]["count"]),
        "no" if users["mobility"]["kind"] == "static" else "yes",
        f"`{plain['demand']['kind']}`",
        f"`{plain['reward']['kind']}`",
        "yes" if plain["position_noise"] else "no",
    ]
