"""Links with classes against the simulator with fixed time steps, which shares no code with them.

The scenarios are those of ``convergence.py`` with radios drawn at random: path losses, classes,
interference, association, access points, sharing, and requests for volumes. All links have the mean
loss; ``tests/model/radio/test_marks.py`` looks at line of sight and shadowing.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from tests.staged import staged
from tests.verification.convergence import DTS_S, by_event, scenario_of, slopes
from tests.verification.figure import Figure

MEASURES = ("served_s", "delivered_mbit", "qoe1", "qoe2", "qoe3")
TOWNS = ("suburban", "urban", "dense_urban", "high_rise")


def figures(quick: bool = False) -> Iterator[Figure]:
    """The slope of the error over dt, log over log."""
    seeds, tolerance = (range(12), 0.4) if quick else (range(96), 0.25)
    dts_s = DTS_S[:3] if quick else DTS_S
    yield from slopes(seeds, tolerance, dts_s, linked_scenario_of, MEASURES)


def linked_scenario_of(seed: int) -> dict[str, Any]:
    """A random scenario whose links have classes."""
    scenario = scenario_of(seed)
    rng = np.random.default_rng([9, seed])

    def pick(*options: Any) -> Any:
        return options[rng.integers(len(options))]

    sharing = pick("held", "equal", "max_min", "proportional_fair", "max_rate")
    interference = pick("none", "none", "co_channel", {"reuse": 2})
    radio = {
        "kind": "link_classes",
        "carrier_ghz": 2.0,
        "power_dbm": round(float(rng.uniform(0.0, 12.0)), 3),
        "bandwidth_mhz": pick(1.0, 3.0),
        "path_loss": pick(
            {"kind": "al_hourani", "environment": TOWNS[seed % 4]},
            {"kind": "al_hourani", "a": 9.0, "b": 0.2, "eta_los_db": 1.0, "eta_nlos_db": 15.0},
            {"kind": "log_distance", "exponent": 3.0, "at_1m_db": 40.0},
        ),
        "classes": pick("cqi", "mcs", [{"snr_db": 0.0, "bit_s_hz": 0.5}]),
        "interference": interference,
        "sharing": sharing,
    }
    size_m = scenario["map"]["size_m"]
    points = [
        {
            "at_m": [round(float(rng.uniform(0.0, side)), 2) for side in size_m],
            "height_m": pick(80.0, 95.0),
            "radio": radio,
        }
        for _ in range(pick(0, 0, 1, 2))
    ]
    drones = {
        k: v for k, v in scenario["drones"].items() if "_radius_" not in k and "_kbps" not in k
    }
    rates = {"bandwidth_kbps": [200.0, 800.0]} if sharing == "held" else {}
    mix = pick({"file": 1.0}, {"file": 2.0, "call": 1.0})
    scenario["map"]["levels"]["min_altitude_m"] = 75.0
    demand = pick(
        {"kind": "poisson", "rate_per_hour": 40.0, "mix": mix},
        {"kind": "dynamic", "think_time_s": 40.0, "mix": mix},
    )
    return scenario | {
        "drones": drones | {"radio": radio},
        "access_points": points,
        "association": pick(
            "entered_first",
            "strongest",
            {"kind": "a3", "offset_db": 0.0, "hysteresis_db": 1.5, "time_to_trigger_ms": 2000},
        ),
        "services": {
            "file": {"kind": "transfer", "volume_mbit": [5.0, 30.0, 120.0], **rates},
            "call": {
                "kind": "uniform_choice",
                "duration_min": [0.5, 2.0],
                "bandwidth_kbps": [100.0, 600.0],
            },
        },
        "demand": demand,
    }


def linked_by_event(seed: int) -> dict[str, Any]:
    """The same scenario in minimum time, with drones that are asked by event."""
    mapping = linked_scenario_of(seed)
    mapping["drones"]["motion"]["timing"] = "minimum_time"
    return by_event(mapping, seed)


def narrow_scenario_of(seed: int) -> dict[str, Any]:
    """The same scenario with backhauls that carry less than a band, or hold a call and a file."""
    mapping = linked_scenario_of(seed)
    for k, each in enumerate([mapping["drones"], *mapping["access_points"]]):
        each["backhaul"] = {"kind": "capacity", "kbps": (900.5, 1400.0, 2500.0)[(seed + k) % 3]}
    return mapping


def staged_scenario_of(seed: int) -> dict[str, Any]:
    """The same scenario with services of several stages, some of which are of nothing."""
    mapping = linked_scenario_of(seed)
    held = mapping["drones"]["radio"]["sharing"] == "held"
    mapping["services"]["file"] = staged(held, seed)
    return mapping
