"""Random scenarios of radio in which drones are asked by event."""

from __future__ import annotations

from typing import Any

from desim_uav.world import World
from tests.engine import random_radio
from tests.engine.random_parts import Dice, accepted


def scenario(seed: int, interference: Any = None) -> dict[str, Any]:
    """A random scenario of ``random_radio``, decided by event: legs end at different times."""
    made, dice = random_radio.scenario(seed, interference), Dice(seed + 700_000)
    patience_s = dice.of(11, 20, 45.5, 90)
    made["decisions"] = {"kind": "event", "patience_s": patience_s}
    if made["drones"]["battery"] is not None:
        made["drones"]["battery"]["respawn_after_min"] += patience_s / 60
    return made


def world_of(seed: int, interference: Any = None) -> World:
    """The world of a random scenario."""
    return accepted(lambda k: scenario(k, interference), seed)


def together(seed: int, decided: str) -> World:
    """A random scenario in which all legs are steps, decided by clock or by event.

    There are no batteries, so that nobody is free but at the end of a step.
    """

    def make(k: int) -> dict[str, Any]:
        made = random_radio.scenario(k)
        step_s = made["episode"]["step_s"]
        made["decisions"] = {"kind": "event", "patience_s": step_s}
        if decided == "clock":
            made["decisions"] = "clock"
        made["drones"]["battery"], made["stations"] = None, {"count": 0}
        made["drones"]["motion"]["timing"] = "fill_epoch"
        return made

    return accepted(make, seed)


def cut(seed: int, longer: int) -> World:
    """A random scenario whose steps are ``longer`` times as long, which shall not matter by event.

    Access points are looked at for a step ahead, and all others are looked at anew then, if they
    interfere; so links are cut into other spans.
    """

    def make(k: int) -> dict[str, Any]:
        made = scenario(k)
        made["drones"]["motion"]["timing"] = "minimum_time"
        made["position_noise"] = None
        made["episode"] |= {"steps": 8 // longer, "step_s": 60 * longer}
        return made

    return accepted(make, seed, lambda found: len(found.access_points) > 0)
