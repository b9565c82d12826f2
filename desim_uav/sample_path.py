"""Sample paths: all random draws of an episode, made before its first event."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from desim_uav.copies import Unchanging
from desim_uav.model.demand.requests import Requests
from desim_uav.model.mobility.walking import RowWalks
from desim_uav.model.mobility.walks import Walks
from desim_uav.model.random.philox import key_of
from desim_uav.model.random.streams import (
    Purpose,
    Seeds,
    Streams,
    seed_of_each,
    states_of,
    uniforms,
)
from desim_uav.typed import typed
from desim_uav.world import World

MOST_AT_ONCE, AT_ONCE_FOR = 256, 6144
"""The largest number of episodes that are drawn at once, and of users in all of them."""


@dataclass(frozen=True, eq=False)
class SamplePath(Unchanging):
    """The walks, requests, position errors and respawn stations of one episode.

    ``walking``: the walks; those over rows are drawn when ``walks`` is first used.

    ``position_error``: (drones, steps + 1, 2), the error of a drone's believed cell at each
    decision epoch and at the end of the episode, in cells; None without noise. ``respawn``:
    (drones, steps + 1), the station of a drone's first, second, … respawn. ``link_key``: (2,), the
    key of the draws of links (``model.random.philox``), whose counters name user, drone and cell;
    it is longer in an episode that a planner imagines (``model.radio.draws``).
    """

    episode: int
    walking: Walks | RowWalks
    requests: Requests
    position_error: NDArray[np.float64] | None
    respawn: NDArray[np.int64]
    link_key: NDArray[np.uint64] = field(default_factory=lambda: np.zeros(2, np.uint64))

    @property
    def walks(self) -> Walks:
        """The walks, which are drawn on first use."""
        return self.walking.drawn()


@dataclass(frozen=True, eq=False)
class SamplePaths:
    """The sample paths of several episodes, drawn together.

    ``walking`` and ``requests`` have one entry per episode; ``position_error``, ``respawn`` and
    ``link_keys`` have the episode as an additional first dimension.
    """

    episodes: Sequence[int]
    walking: Sequence[Walks | RowWalks]
    requests: Sequence[Requests]
    position_error: NDArray[np.float64] | None
    respawn: NDArray[np.int64]
    link_keys: NDArray[np.uint64]

    @classmethod
    def of(cls, path: SamplePath) -> SamplePaths:
        """Return the sample path of one episode as a sequence of length one."""
        error = path.position_error
        errors = None if error is None else error[np.newaxis]
        return cls(
            [path.episode],
            [path.walking],
            [path.requests],
            errors,
            path.respawn[np.newaxis],
            path.link_key[np.newaxis],
        )

    def __getitem__(self, k: int) -> SamplePath:
        """Return the sample path at index k, which need not be the number of its episode."""
        errors = self.position_error
        return SamplePath(
            self.episodes[k],
            self.walking[k],
            self.requests[k],
            None if errors is None else errors[k],
            self.respawn[k],
            self.link_keys[k],
        )


@typed
def draw(world: World, seed: int, episode: int) -> SamplePath:
    """Draw the sample path of an episode under the run's seed.

    Warm-up episodes have negative numbers. The same world, seed and episode give the same sample
    path under any policy. One more drone or user does not change the draws of the others.
    """
    return draw_all(world, seed, [episode])[0]


def at_once(world: World) -> int:
    """Return the number of episodes that are best drawn at once."""
    return max(1, min(MOST_AT_ONCE, AT_ONCE_FOR // len(world.homes)))


def draw_all(world: World, seed: Seeds, episodes: Sequence[int]) -> SamplePaths:
    """Draw the sample paths of several episodes, which is faster than one by one.

    ``seed`` is that of one run, or a sequence with the seed of each episode's run.
    """
    count, walks, requests = len(episodes), world.fixed_walks, world.fixed_requests
    return SamplePaths(
        episodes,
        [walks] * count if walks else world.walks_of(seed, episodes),
        [requests] * count if requests else world.requests_of(seed, episodes),
        _position_errors(world, seed, episodes),
        _respawns(world, seed, episodes),
        _link_keys(world, seed, episodes),
    )


def _link_keys(world: World, seed: Seeds, episodes: Sequence[int]) -> NDArray[np.uint64]:
    """Return the keys of the draws of links (episodes, 2); they are 0 if there are none."""
    if not world.marked:
        return np.zeros((len(episodes), 2), np.uint64)
    own = zip(seed_of_each(seed, episodes), episodes, strict=True)
    return np.array([key_of(one, Purpose.LINK, episode) for one, episode in own], np.uint64)


def _position_errors(
    world: World, seed: Seeds, episodes: Sequence[int]
) -> NDArray[np.float64] | None:
    noise = world.scenario.position_noise
    if noise is None:
        return None
    shape = (world.scenario.episode.steps + 1, 2)
    errors = np.empty((len(episodes), world.scenario.drone_count, *shape))
    own = zip(seed_of_each(seed, episodes), episodes, strict=True)
    for k, (one, episode) in enumerate(own):
        streams = Streams(one, Purpose.POSITION_NOISE, episode)
        for drone in range(world.scenario.drone_count):
            rng = streams.generator(drone)
            mistaken = rng.random(shape) < noise.probability
            errors[k, drone] = np.where(mistaken, rng.normal(0.0, noise.sigma_cells, shape), 0.0)
    return errors


def _respawns(world: World, seed: Seeds, episodes: Sequence[int]) -> NDArray[np.int64]:
    drones, epochs = world.scenario.drone_count, world.most_epochs + 1
    if not world.stations or not world.scenario.limited_battery:
        return np.empty((len(episodes), drones, 0), np.int64)
    states = states_of(seed, Purpose.RESPAWN, episodes, drones)
    chosen = uniforms(states.reshape(-1, 4), epochs) * len(world.stations)
    return chosen.astype(np.int64).reshape(len(episodes), drones, epochs)
