"""What drones give their elastic requests, against the textbook allocations of the reference."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.rules.classes import change_class
from desim_uav.rules.service import stop, wait
from desim_uav.rules.stages import leave
from desim_uav.rules.words import ADMISSION, ENTRY
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world
from tests.engine.helpers import path_of
from tests.reference.shares import FLUID, MICRO, hz_for, whole
from tests.selection import by_default

USERS, INSTANCES = 8, 500
ENOUGH = 1e9
"""A required "time" in seconds that is a volume of 1,000 Mbit in millionths of a bit."""


@cache
def busy(sharing: str) -> Simulation:
    """A drone that hovers over users who all transfer something."""
    scenario = {
        "map": {"size_m": [240, 240], "cells": [1, 1], "dimensions": 2},
        "drones": {
            "count": 1,
            "radio": {"kind": "link_classes", "sharing": sharing},
            "battery": None,
        },
        "stations": {"count": 0},
        "users": {"positions_m": [(120 + user, 120) for user in range(USERS)]},
        "services": {"upload": {"kind": "transfer", "volume_mbit": [1000]}},
        "demand": {"kind": "static", "mix": {"upload": 1}},
    }
    world = build_world(from_mapping(scenario), 0)
    simulation = Simulation(world, RunSettings((True,), False))
    simulation.reset(path_of(world, {user: [(0.0, ENOUGH, 0.0)] for user in range(USERS)}))
    return simulation


def divided(sharing: str, seed: int) -> tuple[int, list[int], list[tuple[int, int]]]:
    """A band, the efficiencies of some users, and the (rate, bandwidth) that each of them gets."""
    simulation, rng = busy(sharing), np.random.default_rng([12, seed])
    world, state = simulation.constants, simulation.state
    drone, radio = state.drones[0], world.radios[0]
    users: list[Any] = sorted(rng.choice(USERS, size=rng.integers(1, USERS + 1), replace=False))
    band_hz = int(rng.integers(0, 10 ** int(rng.integers(1, 10))))
    drone.free_hz = band_hz
    drone.sharing.clear()
    drone.shared_hz = 0
    for place, user in enumerate(users):
        drone.sharing.insert(place, int(user))
        state.users[user].classes[0] = int(rng.integers(1, radio.classes + 1))
    simulation.world.links[0].radio.sharing.divide(world, state, drone, ADMISSION)
    requests = [state.users[user].request for user in users]
    efficiencies = [radio.efficiencies[state.users[user].classes[0]] for user in users]
    shares = [(r.rate, r.used_hz) if r.server == 0 else (0, 0) for r in requests]
    return band_hz, efficiencies, shares


@pytest.mark.parametrize("sharing", by_default([next(iter(FLUID))], FLUID))
def test_drones_share_their_bands_as_textbooks_do(sharing: str) -> None:
    for seed in range(INSTANCES):
        band_hz, efficiencies, shares = divided(sharing, seed)
        rates = [rate for rate, _ in shares]
        assert rates == whole(sharing, band_hz, efficiencies)
        assert all(
            a <= b for a, b in zip(rates, FLUID[sharing](band_hz, efficiencies), strict=True)
        )
        assert sum(hz for _, hz in shares) <= band_hz
        for (rate, hz), efficiency in zip(shares, efficiencies, strict=True):
            enough = hz + (sharing == "proportional_fair")  # its parts of a band are rounded down
            assert rate * MICRO <= enough * efficiency
            assert sharing != "max_min" or hz == hz_for(rate, efficiency)


@pytest.mark.parametrize("sharing", by_default(["equal", "proportional_fair"], FLUID))
def test_bands_are_shared_anew_whatever_has_changed_since(sharing: str) -> None:
    """Links pass to other classes, requests leave and join, and the band changes, all by rules."""
    simulation, rng = busy(sharing), np.random.default_rng(13)
    world, state = simulation.constants, simulation.state
    drone, radio = state.drones[0], world.radios[0]
    divided(sharing, 0)
    for user in range(USERS):
        state.users[user].request.queued = int(user in drone.sharing)
    for _ in range(INSTANCES):
        for user in rng.choice(USERS, size=rng.integers(0, 3), replace=False).tolist():
            request, what = state.users[user].request, rng.integers(3)
            if not request.queued:
                wait(world, state, drone, state.users[user])
            elif what == 0 and len(drone.sharing) > 1:
                if request.server >= 0:
                    stop(state, state.users[user], ADMISSION)
                leave(state, drone, state.users[user])
            else:
                graded = int(rng.integers(1, radio.classes + 1))
                change_class(world, state, drone, state.users[user], graded, ENTRY)
        drone.free_hz = int(rng.choice([drone.free_hz, 0, 1000, 10**6]))
        simulation.world.links[0].radio.sharing.divide(world, state, drone, ADMISSION)
        users = [state.users[user] for user in drone.sharing]
        efficiencies = [radio.efficiencies[user.classes[0]] for user in users]
        rates = [user.request.rate if user.request.server == 0 else 0 for user in users]
        assert rates == whole(sharing, drone.free_hz, efficiencies)
