"""A semi-Markov decision process of two states, by hand.

A drone is in the west or in the east of two cells, and a user stands in the east. A move takes a
step, and a hover three. The reward of a transition is its duration, in steps, if it ends in the
east, else 0. The discount of a step is a half.
"""

from __future__ import annotations

from typing import Any

GAMMA = 0.5
EAST, WEST, HOVER = 2, 3, 4
"""Indices of actions; the others are blocked, and are therefore hovers."""

TWO: dict[str, Any] = {
    "name": "two",
    "world_seed": 0,
    "map": {"size_m": [480, 240], "cells": [2, 1], "dimensions": 2},
    "drones": {
        "count": 1,
        "start_cells": [[0, 0]],
        "footprint_radius_m": 120,
        "bandwidth_kbps": None,
        "battery": None,
    },
    "stations": {"count": 0},
    "users": {"positions_m": [[360, 120]], "mobility": {"kind": "static"}},
    "demand": {"kind": "continuous"},
    "decisions": {"kind": "event", "patience_s": 180},
    "episode": {"steps": 12, "carry_over": False},
    "reward": {"kind": "coverage"},
    "learning": {"gamma": GAMMA},
}

WAY = [HOVER, EAST, HOVER, WEST, EAST, HOVER]
DURATIONS = [3.0, 1.0, 3.0, 1.0, 1.0, 3.0]
REWARDS = [0.0, 1.0, 3.0, 0.0, 1.0, 3.0]
"""An episode, which ends after its sixth transition."""

DISCOUNTS = [1 / 8, 1 / 2, 1 / 8, 1 / 2, 1 / 2, 1 / 8]

BEST = {("west", EAST): 1 + 24 / 7 / 2, ("east", HOVER): 24 / 7}
"""The values of the best actions: to hover in the east is worth 3 + 1/8 of the same again."""

OTHERS = {("west", HOVER): 19 / 7 / 8, ("east", WEST): 19 / 7 / 2}
"""Those of the other actions, after which the best ones follow."""
