"""Demand: distributions of requests, and blocking probabilities."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from desim_uav.engine.base import EpisodeLog, RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.model.catalogue import catalogue
from desim_uav.model.demand.demand import Demand, Dynamic, Poisson
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import Action, Outcome
from desim_uav.model.services import PAPER
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine.helpers import merged
from tests.verification.figure import Estimate, Exact, Figure

US = 1_000_000
HORIZON_US = 1800 * US
MIX = {"throughput": 0.5, "edge_computing": 0.25, "data_gathering": 0.15}
DUE, SERVICE, REQUIRED, BANDWIDTH = range(4)
LOSS = {"kind": "tests.engine.helpers:Loss"}
ERLANGS, CHANNELS = 7, 10


def figures(quick: bool = False) -> Iterator[Figure]:
    """As drawn, a replication a user; and as lost, a replication an episode."""
    yield from drawn(5000)
    yield Exact("Erlang B, 7 Erlang, 10 channels", erlang_b(7, 10), 0.0787408830, 5e-11)
    for users in (40, 1000):
        yield blocking(users, hours=12, runs=10 if quick else 40, theory=engset(users, 7, 10))
    if not quick:
        yield erlang()


# ---- as drawn


def drawn(users: int) -> Iterator[Figure]:
    """Poisson counts have their mean as variance, exponential times its square."""
    for rate, none in ((60.0, 0.0), (6.0, 0.0), (60.0, 0.3)):
        rows, _ = ask(Poisson(rate, none=none), users, seed=7)
        counts = np.array([len(of_user) for of_user in rows])
        mean = rate * 0.5 * (1 - none)
        name = f"Poisson, {rate:g} per hour" + (
            f", {100 * none:g} % without request" if none else ""
        )
        yield Estimate.of(f"{name}: mean count in 30 min", counts, mean)
        yield Estimate.of(f"{name}: variance of the count", (counts - mean) ** 2, mean)
    rows, _ = ask(Dynamic(), users, seed=3, horizon_us=86_400 * US)
    thinks = np.array([of_user[1, DUE] for of_user in rows]) / US
    yield Estimate.of("think times: mean, s", thinks, 300.0)
    yield Estimate.of("think times: variance, s²", (thinks - 300.0) ** 2, 300.0**2)


def ask(
    demand: Demand,
    users: int,
    *,
    seed: int = 0,
    episode: int = 0,
    horizon_us: int = HORIZON_US,
) -> tuple[list[np.ndarray], bool]:
    """The rows of each user, and whether they follow one another."""
    services = catalogue(PAPER, getattr(demand, "mix", MIX))
    streams = Streams(seed, Purpose.DEMAND, episode)
    requests = demand.requests(users, services, streams, horizon_us)
    assert requests.offsets[0] == 0
    assert requests.offsets[-1] == len(requests.rows)
    return [requests.rows[a:b] for a, b in pairwise(requests.offsets)], requests.after_previous


# ---- as lost


def erlang_b(erlangs: float, channels: int) -> float:
    blocked = 1.0
    for k in range(1, channels + 1):
        blocked = erlangs * blocked / (k + erlangs * blocked)
    return blocked


def engset(users: int, erlangs: float, channels: int) -> float:
    """Calls lost when ``users`` together would offer ``erlangs``, but none while it is served."""
    blocked, each = 1.0, erlangs / users
    for k in range(1, channels + 1):
        offered = each * (users - k)
        blocked = offered * blocked / (k + offered * blocked)
    return blocked


HOLD_MIN = 3.0


def under_one_drone(users: int, demand: dict[str, Any], hours: int, **changes: Any) -> World:
    """Everybody near a hovering drone with no battery to mind."""
    base = {
        "map": {"size_m": [720, 720], "cells": [3, 3], "dimensions": 2},
        "drones": {"count": 1, "start_cells": [[1, 1]], "battery": None},
        "stations": {"count": 0},
        "users": {"positions_m": [[360, 360]] * users, "mobility": {"kind": "static"}},
        "demand": demand,
        "services": {"unit": {"duration_min": [HOLD_MIN], "bandwidth_kbps": [100]}},
        "episode": {"steps": hours, "step_s": 3600},
    }
    return build_world(from_mapping(merged(base, changes)), 0)


def hovered(world: World, seed: int) -> EpisodeLog:
    engine = Simulation(world, RunSettings((True,), False, keep_events=False))
    engine.reset(draw(world, seed, 0))
    for _ in range(world.scenario.episode.steps):
        engine.step([int(Action.HOVER)])
    return engine.log


def blocked_share(users: int, hours: int, seed: int) -> float:
    """7 Erlang in all on 10 units: of the requests after the first half hour, the share refused."""
    demand = {
        "kind": "poisson",
        "rate_per_hour": ERLANGS * 60 / HOLD_MIN / users,
        "mix": {"unit": 1},
    }
    drones = {"admission": LOSS, "bandwidth_kbps": 1000}
    log = hovered(under_one_drone(users, demand, hours, drones=drones), seed)
    late = [r for r in log.requests if 1800 * US < r.t_request_us < log.duration_us - 180 * US]
    refused = [r for r in late if r.outcome is Outcome.NEVER_SERVED]
    served = [r for r in late if r.outcome is Outcome.COMPLETED]
    assert len(refused) + len(served) == len(late)
    assert all(r.t_end_us == r.t_request_us for r in refused)
    assert all(r.t_end_us - r.t_request_us == r.required == 180 * US for r in served)
    return len(refused) / len(late)


def blocking(users: int, hours: int, runs: int, theory: float) -> Estimate:
    """The share of requests refused, over independent runs."""
    shares = [blocked_share(users, hours, seed) for seed in range(runs)]
    return Estimate.of(f"blocking, {users:,} users: Engset's formula", shares, theory)


def erlang() -> Estimate:
    """So many users that it makes no difference that they do not ask while they are served."""
    shares = [blocked_share(20_000, 60, seed) for seed in range(40)]
    return Estimate.of("blocking, 20,000 users: Erlang's B formula", shares, 0.0787408830)
