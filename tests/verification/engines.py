"""The compiled engine against the SimPy engine: every row, observation and float, bit for bit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from desim_uav.engine.base import ClosedRequest, RunSettings
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.des import Simulation
from desim_uav.engine.episode import Engine
from desim_uav.sample_path import draw
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.engine.helpers import some_command
from tests.verification.figure import Exact, Figure

SUMS = (
    *("duration_us", "attached_us", "bandwidth_us_hz", "queueing_us", "distance_m"),
    *("crashed", "charges", "suppressed", "point_steps", "links", "apart"),
)


def figures(quick: bool = False) -> Iterator[Figure]:
    """The nine cases under random commands."""
    unlike = episodes = events = events_of_both = 0
    for case in range(1, 10):
        for seed in range(1 if quick else 10):
            world = build_world(load(scenario_path(f"case{case}")), seed)
            one, other = engines(world, (True,) * world.scenario.drone_count)
            for episode in range(2):
                unlike += bool(differences(one, other, seed, episode))
                episodes += 1
                events += len(one.log.events or ())
                events_of_both += _in_both(one.log.events, other.log.events)
    yield Exact("events that both engines have in common", events_of_both, events, cases=episodes)
    yield Exact("episodes in which anything else differs", unlike, 0, cases=episodes)


def engines(world: World, ceilings: tuple[bool, ...]) -> tuple[Engine, Engine]:
    """Both, told the same."""
    told = RunSettings(ceilings, world.scenario.episode.carry_over, keep_events=True)
    return Simulation(world, told), BatchSimulation(world, told)


def differences(one: Engine, other: Engine, seed: int, episode: int) -> list[str]:
    """In what an episode with random commands differs; one that goes apart is played no further."""
    rng = np.random.default_rng([seed, episode])
    path = draw(one.world, seed, episode)
    shown, seen = one.reset(path), other.reset(path)
    while True:
        unlike = ["snapshot"] * (shown != seen) + _unlike_now(one, other)
        if unlike or shown.terminated or shown.truncated:
            break
        commands = [some_command(one.world, mask, rng) for mask in shown.masks]
        shown, seen = one.step(commands), other.step(commands)
    logs = [(log, [row(r) for r in log.requests]) for log in (one.log, other.log)]
    (log, requests), (others, others_requests) = logs
    names = ("events", "legs", "steps", "updates", "sensors", *SUMS)
    unlike += [name for name in names if getattr(log, name) != getattr(others, name)]
    unlike += ["requests"] * (requests != others_requests)
    return unlike + ["carried"] * (one.carried() != other.carried())


def _unlike_now(one: Engine, other: Engine) -> list[str]:
    unlike = ["measures"] * (one.measures() != other.measures())
    unlike += ["user_states"] * (one.user_states() != other.user_states())
    places = zip(one.positions_m(), other.positions_m(), strict=True)
    return unlike + ["positions_m"] * (not all((ours == theirs).all() for ours, theirs in places))


def row(request: ClosedRequest) -> tuple[Any, ...]:
    """A request as it is logged."""
    return (
        *(request.request_id, request.user, request.service, request.bandwidth_bps),
        *(
            request.required,
            request.done,
            request.served_us,
            request.attached_us,
            request.t_request_us,
        ),
        *(request.t_first_us, request.t_end_us, request.interruptions, request.drones),
        *(request.stage, request.asked_us, request.asked_ubit, request.sent_ubit),
        *(request.asked_cycles, request.deadline_us, request.sending_us, request.computing_us),
        request.restarts,
        request.outcome,
    )


def _in_both(one: list[Any] | None, other: list[Any] | None) -> int:
    return sum(a == b for a, b in zip(one or (), other or (), strict=False))
