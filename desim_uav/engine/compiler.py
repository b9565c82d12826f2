"""The process that compiles the engine for a world, with low priority (see ``engine.ahead``)."""

from __future__ import annotations

import os
import pickle
import signal
import socket
import sys
import threading
from contextlib import suppress
from typing import Any

NICE = 10
"""What is added to the niceness: a tenth of a processor remains if others want all of it."""

STEPS = 10_000
"""The most steps of an episode that is played, so that what is compiled at its first use is met."""

MOST_CPU_S, MOST_S = 900, 3600
"""The seconds of processor time, and of any time, after which the process is ended."""


def main(line: int) -> None:
    """Compile for the worlds on stdin; ``line`` is the socket to the process that wants them.

    This process ends at once if that one is killed, or at Ctrl-C.
    """
    _be_humble()
    threading.Thread(target=_watch, args=(socket.socket(fileno=line),), daemon=True).start()
    for scenario, world_seed in pickle.load(sys.stdin.buffer):
        compile_for(scenario, world_seed)


def compile_for(scenario: Any, world_seed: int) -> None:
    """Compile all that the compiled engine needs for a world, in runs and environments."""
    import numpy as np

    from desim_uav.engine.base import RunSettings
    from desim_uav.engine.compiled import BatchSimulation, calls
    from desim_uav.sample_path import draw
    from desim_uav.world import build_world

    world = build_world(scenario, world_seed)
    settings = RunSettings((True,) * scenario.drone_count, scenario.episode.carry_over)
    engine = BatchSimulation(world, settings)
    calls.load(calls.OF_STEPS | calls.OTHERS)
    stream, snapshot = np.random.default_rng(0), engine.reset(draw(world, 0, 0))
    for _ in range(STEPS):
        if snapshot.terminated or snapshot.truncated:
            break
        masks, of = enumerate(snapshot.masks), world.commands.of
        commands: Any = [of(drone).drawn(drone, stream, mask) for drone, mask in masks]
        snapshot = engine.step(commands)
    engine.restore(engine.save())


def _be_humble() -> None:
    """Let all others go first, and end after some time."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT, signal.SIGALRM])
    signal.alarm(MOST_S)
    with suppress(OSError):
        os.nice(NICE)
    import resource

    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU_S, MOST_CPU_S))


def _watch(line: socket.socket) -> None:
    """End this process when the other one has been killed, which closes the line without a word."""
    with suppress(OSError):
        if line.recv(1):
            return
    os._exit(1)
