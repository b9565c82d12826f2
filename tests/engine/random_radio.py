"""Random scenarios of radio: everything that decides on links, on who serves, and on shares."""

from __future__ import annotations

from typing import Any

import numpy as np

from desim_uav.engine.base import EpisodeLog, RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.sample_path import draw
from desim_uav.world import World
from tests.audit.invariants import audit
from tests.engine.helpers import some_command
from tests.engine.random_parts import Dice, accepted

TOWNS = ("suburban", "urban", "dense_urban", "high_rise")
CLASSES = (
    "cqi",
    "mcs",
    [{"snr_db": 3.0, "bit_s_hz": 1.0}],
    [{"snr_db": -5.0, "bit_s_hz": 0.25}, {"snr_db": 4.0, "bit_s_hz": 1.5}],
)


def path_loss(dice: Dice) -> dict[str, Any]:
    """A path loss of the package."""
    return dict(
        dice.of(
            {"kind": "free_space"},
            {"kind": "log_distance", "exponent": dice.between(2, 4), "at_1m_db": 38},
            {"kind": "al_hourani", "environment": dice.of(*TOWNS)},
            {"kind": "al_hourani", "environment": dice.of(*TOWNS)},
            {"kind": "al_hourani", "a": 10.0, "b": 0.2, "eta_los_db": 1, "eta_nlos_db": 15},
        )
    )


def radio(dice: Dice, built: bool) -> dict[str, Any]:
    """A radio with classes, whose reach is a few cells."""
    loss = path_loss(dice)
    hides = loss["kind"] == "al_hourani"
    sight = dice.of(
        "mean", *(["drawn"] * 2 if hides else []), *(["buildings"] * 2 if built else [])
    )
    shadowed = dice.of(True, False) and (sight != "mean" or not hides)
    return {
        "kind": "link_classes",
        "carrier_ghz": dice.of(0.7, 2.0, 5.0),
        "power_dbm": dice.between(0, 24),
        "bandwidth_mhz": dice.of(0.2, 1.0, 5.0),
        "path_loss": loss,
        "line_of_sight": sight,
        "shadowing": {"los_db": dice.between(0, 4), "nlos_db": 6} if shadowed else None,
        "classes": dice.of(*CLASSES),
        "sharing": dice.of("held", "equal", "max_min", "proportional_fair", "max_rate"),
    }


def services(dice: Dice, elastic: bool) -> dict[str, Any]:
    """One to three services that ask for times or for volumes."""
    rates = {} if elastic else {"bandwidth_kbps": [100, 700]}
    kinds = {
        "call": {"kind": "uniform_choice", "duration_min": [0.5, 2], "bandwidth_kbps": [64, 900]},
        "upload": {"kind": "transfer", "volume_mbit": [0.5, 8, 40], **rates},
        "image": {"kind": "transfer", "volume_mbit": [3], **rates},
    }
    chosen = dice.of(["upload"], ["upload", "call"], ["call", "upload", "image"], ["call"])
    return {name: kinds[name] for name in chosen}


def scenario(seed: int, interference: Any = None) -> dict[str, Any]:
    """A random scenario; with ``interference``, drones and access points have this one."""
    dice = Dice(seed)
    cells = [dice.of(1, 2, 4, 5), dice.of(1, 3, 4)]
    three_d = dice.of(True, False)
    built = three_d and dice.of(True, True, False)
    own = radio(dice, built)
    own["interference"] = interference or dice.of("none", "none", "co_channel", {"reuse": 2})
    elastic = own["sharing"] != "held"
    size_m = [240 * cells[0], 240 * cells[1]]
    points = []
    for _ in range(dice.of(0, 0, 1, 2)):
        theirs = radio(dice, built) | {"interference": own["interference"]}
        if own["interference"] != "none":
            theirs |= {key: own[key] for key in ("carrier_ghz", "bandwidth_mhz")}
        if (theirs["sharing"] != "held") != elastic:
            theirs["sharing"] = own["sharing"]
        at_m = [dice.between(0, size_m[0]), dice.between(0, size_m[1])]
        points.append(
            {
                "at_m": at_m,
                "height_m": dice.of(30, 45.5),
                "radio": theirs,
                "counts_in_reward": dice.of(True, False),
            }
        )
    limited = dice.of(True, False)
    offered = services(dice, elastic)
    count = dice.of(1, 2, 3, 4)
    heights = {"coverage": [0.1, 0.4], "height_m": [10, 70]}
    levels = {"min_altitude_m": 20, "step_m": dice.of(15, 40)}
    return {
        "map": {
            "size_m": size_m,
            "cells": cells,
            "dimensions": 3 if three_d else 2,
            "levels": levels,
            **({"obstacles": heights} if built else {}),
        },
        "drones": {
            "count": count,
            "radio": own,
            "motion": {
                "kind": "bang_coast_bang",
                "timing": dice.of("minimum_time", "fill_epoch"),
            },
            "battery": {
                **dice.of(
                    {"kind": "endurance", "autonomy_min": dice.of(2, 4, 8)},
                    {"kind": "rotary_wing", "capacity_wh": dice.of(5, 12, 22)},
                ),
                "on_crash": dice.of("respawn", "remove"),
                "respawn_after_min": dice.of(0, 1),
            }
            if limited
            else None,
        },
        "association": dice.of(
            "entered_first",
            "strongest",
            {"kind": "a3", "hysteresis_db": dice.of(1, 3), "time_to_trigger_ms": dice.of(0, 640)},
        ),
        "access_points": points,
        "stations": {"count": 1, "pads": 1, "full_charge_min": 2} if limited else {"count": 0},
        "users": {
            "count": dice.of(1, 6, 15),
            "max_height_m": 15,
            "mobility": dice.of(
                {"kind": "static"},
                {"kind": "random_walk"},
                {"kind": "random_walk", "speed_mps": 9, "leg_s": 13},
            ),
        },
        "services": offered,
        "demand": dice.of(
            {"kind": "poisson", "rate_per_hour": 90, "mix": dict.fromkeys(offered, 1)},
            {"kind": "dynamic", "think_time_s": 11, "mix": dict.fromkeys(offered, 1)},
        ),
        "observation": {"kind": dice.of("local", "position")},
        "position_noise": dice.of(None, None, {"probability": 0.3, "sigma_cells": 1}),
        "episode": {
            "steps": dice.of(4, 8),
            "step_s": dice.of(60, 60, 75.25),
            "carry_over": dice.of(True, False),
        },
    }


def world_of(seed: int, interference: Any = None) -> World:
    """The world of a random scenario."""
    return accepted(lambda k: scenario(k, interference), seed)


def audited(world: World) -> list[EpisodeLog]:
    """The logs of two audited episodes of the SimPy engine, under random commands."""
    told = RunSettings(
        (True,) * world.scenario.drone_count, world.scenario.episode.carry_over, keep_events=True
    )
    engine, logs = Simulation(world, told, audit=audit), []
    for episode in range(2):
        rng = np.random.default_rng(episode)
        shown = engine.reset(draw(world, 1, episode))
        while not (shown.terminated or shown.truncated):
            shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
        logs.append(engine.log)
    return logs
