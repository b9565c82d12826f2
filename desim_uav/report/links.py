"""The links of a run's world, as pictures show them: rings of classes, and access points."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from desim_uav.model.energy.battery import WH_UJ
from desim_uav.model.rules import US
from desim_uav.scenario.processor import Processor
from desim_uav.world import World


def rings_m(world: World, z_m: float, drone: int) -> NDArray[np.float64]:
    """Return the radius of each class around a drone at an altitude, the widest first, in metres.

    It is that for users on the ground (or the lowest ones) at the mean loss, without interference;
    between two levels of altitude it is interpolated. A class that holds nowhere has 0.
    """
    return rings_of_type_m(world, z_m, world.type_numbers[drone])


def rings_of_type_m(world: World, z_m: float, number: int) -> NDArray[np.float64]:
    """Return the radius of each class around drones of a type, as ``rings_m`` does for one."""
    levels_m, links = world.grid.levels_m, world.links[number]
    radii_m = np.maximum(links.rings_m[:, 0, :], 0.0)
    rings: NDArray[np.float64] = np.array([np.interp(z_m, levels_m, own) for own in radii_m.T])
    return rings


def point_rings_m(world: World, number: int) -> NDArray[np.float64]:
    """Return the radius of each class around an access point, as ``rings_m`` does for a drone."""
    rings: NDArray[np.float64] = np.maximum(
        world.links[len(world.types) + number].rings_m[0, 0], 0.0
    )
    return rings


def shade(classes: int) -> float:
    """Return the opacity of each of so many rings, which together are as dark as one disc."""
    return float(1.0 - (1.0 - 0.3) ** (1.0 / classes)) if classes > 1 else 0.13


def full_service_s(requests: pd.DataFrame) -> NDArray[np.float64]:
    """Return for how long each request must be served until it is completed, in seconds.

    For a request for a volume it is how long the whole volume would have taken at its mean rate,
    which is infinite if nothing was delivered.
    """
    asked_s = requests["requested_s"].to_numpy(float)
    delivered = requests["qoe1"].to_numpy(float)
    served_s = requests["served_s"].to_numpy(float)
    some = np.isnan(asked_s) & (delivered > 0.0)
    taken_s = np.full(len(asked_s), np.inf)
    taken_s[some] = served_s[some] / delivered[some]
    return np.where(np.isnan(asked_s), taken_s, asked_s)


def mean_rate_bps(requests: pd.DataFrame) -> NDArray[np.float64]:
    """Return the rate of each request while it is served, the mean one of a volume, in bit/s."""
    rates: NDArray[np.float64] = requests["bandwidth_kbps"].to_numpy(float) * 1000.0
    if "throughput_kbps" not in requests:
        return rates
    mean = requests["delivered_mbit"].to_numpy(float) * 1e6
    name = "sending_s" if "sending_s" in requests else "served_s"
    served_s = requests[name].to_numpy(float)
    some = ~np.isnan(mean) & (served_s > 0.0)
    rates[some] = mean[some] / served_s[some]
    return rates


def links_content(world: World) -> dict[str, Any]:
    """Return what a page has to know of links: rings by level, classes and access points."""
    points = world.scenario.access_points
    types = range(len(world.types))
    return {
        "types": [_type_content(world, number) for number in types],
        "type_of": list(world.type_numbers),
        "points": [
            {
                "at": [*map(float, point.at_m), float(point.height_m)],
                "rings_m": _decimetres(point_rings_m(world, number)),
                "processor": _processor(point.processor),
                **_ladder(point.radio),
            }
            for number, point in enumerate(points)
        ],
        "graded": world.graded,
        "interference": bool(world.links[0].radio.reuse),
    }


def _type_content(world: World, number: int) -> dict[str, Any]:
    """Return what a page has to know of a type of drones."""
    own, links, levels_m = world.types[number], world.links[number], world.grid.levels_m
    unlimited = links.radio.graded or math.isinf(links.bandwidth_hz)
    rings = None
    if links.radio.graded:
        rings = {
            "levels_m": list(map(float, levels_m)),
            "radii_m": [_decimetres(rings_of_type_m(world, z_m, number)) for z_m in levels_m],
            **_ladder(links.radio),
        }
    return {
        "name": world.scenario.type_names[number],
        "capacity_us": own.hover_us(own.capacity) if own.limited else None,
        "capacity_wh": own.capacity / WH_UJ if own.in_joules else None,
        "hover_w": own.drain_per_s / US if own.in_joules else None,
        "bandwidth_hz": None if unlimited else round(links.both_hz),
        "footprint_m": links.reach_m,
        "processor": _processor(own.drones.processor),
        "rings": rings,
    }


def _processor(processor: Processor | None) -> dict[str, float] | None:
    return None if processor is None else {"cores": processor.cores, "ghz": processor.ghz}


def _ladder(radio: Any) -> dict[str, list[float]]:
    return {
        "snr_db": [float(one.snr_db) for one in radio.ladder],
        "bit_s_hz": [float(one.bit_s_hz) for one in radio.ladder],
    }


def _decimetres(radii_m: NDArray[np.float64]) -> list[float]:
    return [round(float(radius), 1) for radius in radii_m]
