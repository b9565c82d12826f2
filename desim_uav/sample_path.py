"""Every random draw of one episode, made before its first event."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.demand import Requests
from desim_uav.model.kernels import kernel
from desim_uav.model.mobility import Walks
from desim_uav.model.streams import Purpose, Streams, next_uniform
from desim_uav.world import World


@dataclass(frozen=True, eq=False)
class SamplePath:
    """The walks, requests, position errors and respawn places of one episode.

    ``position_error`` (drones, steps + 1, 2): cells by which a drone mistakes its coordinates at
    each decision epoch and at the episode's end; None without noise. ``respawn`` (drones,
    steps + 1): the station of a drone's first, second … respawn.
    """

    episode: int
    walks: Walks
    requests: Requests
    position_error: NDArray[np.float64] | None
    respawn: NDArray[np.int64]


def draw(world: World, seed: int, episode: int) -> SamplePath:
    """The sample path of an episode (negative: warm-up) under the run's seed.

    Whatever the policy, the same world, seed and episode give the same sample path; another drone
    or user changes nobody else's draws.
    """
    return SamplePath(
        episode,
        world.fixed_walks or world.walks(seed, episode),
        world.fixed_requests or world.requests(seed, episode),
        _position_error(world, seed, episode),
        _respawn(world, seed, episode),
    )


def _position_error(world: World, seed: int, episode: int) -> NDArray[np.float64] | None:
    noise = world.scenario.position_noise
    if noise is None:
        return None
    streams = Streams(seed, Purpose.POSITION_NOISE, episode)
    shape = (world.scenario.episode.steps + 1, 2)
    errors = []
    for drone in range(world.scenario.drones.count):
        rng = streams.generator(drone)
        mistaken = rng.random(shape) < noise.probability
        errors.append(np.where(mistaken, rng.normal(0.0, noise.sigma_cells, shape), 0.0))
    return np.array(errors)


def _respawn(world: World, seed: int, episode: int) -> NDArray[np.int64]:
    drones, epochs = world.scenario.drones.count, world.scenario.episode.steps + 1
    if not world.stations or not world.scenario.limited_battery:
        return np.empty((drones, 0), np.int64)
    states = Streams(seed, Purpose.RESPAWN, episode).states(drones)
    return _choices(states, epochs, len(world.stations))


@kernel
def _choices(states: NDArray[np.uint64], count: int, options: int) -> NDArray[np.int64]:
    """``count`` uniform choices among 0 … options-1 from each stream."""
    chosen = np.empty((len(states), count), np.int64)
    for entity in range(len(states)):
        for k in range(count):
            chosen[entity, k] = int(next_uniform(states[entity]) * options)
    return chosen
