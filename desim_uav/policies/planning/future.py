"""A future that a planner imagines: drawn from the model, given what can be seen now."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.saved import Rows, SavedState
from desim_uav.model.demand.asking import from_now
from desim_uav.model.demand.requests import DRAWN, DUE_US, Requests, joined_requests
from desim_uav.model.geometry.coverage import all_walked
from desim_uav.model.mobility.walking import RowWalks
from desim_uav.model.mobility.walks import Walks, joined_walks
from desim_uav.model.radio.draws import imagined_links
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import Phase
from desim_uav.policies.planning.links import SeenLinks
from desim_uav.rules.due import ask_slot, key
from desim_uav.sample_path import SamplePath
from desim_uav.user_group import UserGroup
from desim_uav.world import World

WALKS, REQUESTS, NOISE, RESPAWNS, LINKS = range(5)
"""The random streams of an imagined future, by what is drawn from them."""


def imagined(
    saved: SavedState, seed: int, sample: int, links: SeenLinks | None = None
) -> SavedState:
    """Return the state on a sample path whose past is the true one and whose future is new.

    Users walk on from where they are, by the model of mobility as it begins an episode at homes.
    Who has no open request asks after a new think time, or at new arrivals; open requests need what
    they still need. Future position errors and stations of respawns are drawn too, and what is not
    seen of ``links`` whose draws matter (``links.seen_links``). What is drawn depends on the seed,
    the episode, the step and the number of the sample only.
    """
    world, state = saved.world, saved.rows.state
    draws = _Draws(world, seed, saved.path.episode, state.step, sample)
    requests = draws.requests(saved.path.requests.follows)
    walking = draws.walks(saved.path, state.now_us)
    errors, respawn = draws.errors(saved.path), draws.respawns(saved.path)
    key = saved.path.link_key if links is None else draws.links(saved.path, links)
    path = replace(
        saved.path,
        walking=walking,
        requests=requests,
        position_error=errors,
        respawn=respawn,
        link_key=key,
    )
    return replace(saved, path=path, kept=_asking_anew(saved.rows, requests, world.horizon_us))


class _Draws:
    """The draws of one imagined future."""

    def __init__(self, world: World, seed: int, episode: int, step: int, sample: int) -> None:
        self.world, self.step = world, step
        self._key = (seed, step, sample)
        self._episode = episode

    def _streams(self, what: int) -> Streams:
        """Return the streams of one kind of draws."""
        (seed,) = np.random.SeedSequence([*self._key, what]).generate_state(1, np.uint64)
        return Streams(int(seed) >> 1, Purpose.PLANNER, self._episode)

    def walks(self, path: SamplePath, now_us: int) -> Walks | RowWalks:
        """Return walks that are the true ones until now, and then new ones from where users are."""
        groups, true = self.world.user_groups, path.walks
        moves = true.legs["vx_mps"].any() or true.legs["vy_mps"].any()
        if not moves and self.world.fixed_walks is not None:
            return path.walking  # nobody walks
        at_m, streams = all_walked(*true, now_us), self._streams(WALKS)
        new = joined_walks([group.onward(at_m, streams) for group in groups])
        return _joined(true, new, now_us)

    def requests(self, follows: NDArray[np.bool_]) -> Requests:
        """Return the requests that users will make after those that they have made.

        ``follows`` (users,) is that of the true requests.
        """
        groups = self.world.user_groups
        return joined_requests([self._of_group(own, bool(follows[own.first])) for own in groups])

    def _of_group(self, group: UserGroup, follows: bool) -> Requests:
        """Return the requests that the users of a group will make.

        Recorded requests are not known before they are made, so none are expected.
        """
        if not getattr(group.law, "draws", True):
            none = np.zeros((0, DRAWN + group.services.draws), np.int64)
            return Requests(none, np.zeros(group.count + 1, np.int64), True)
        streams = self._streams(REQUESTS).beginning(group.first_stream)
        onward = from_now(group.law, self.step * self.world.step_us)
        own = onward.requests(group.count, group.services, streams, self.world.horizon_us)
        return _without_first(own) if follows else own

    def errors(self, path: SamplePath) -> NDArray[np.float64] | None:
        """Return the position errors, of which those after now are new."""
        noise, errors = self.world.scenario.position_noise, path.position_error
        if errors is None or noise is None:
            return None
        rng = self._streams(NOISE).generator(0)
        normals = rng.normal(0.0, noise.sigma_cells, errors.shape)
        normals = np.where(rng.random(errors.shape) < noise.probability, normals, 0.0)
        normals[:, : self.step + 1] = errors[:, : self.step + 1]
        return normals

    def respawns(self, path: SamplePath) -> NDArray[np.int64]:
        """Return new stations for drones that are replaced."""
        if path.respawn.size == 0:
            return path.respawn
        rng = self._streams(RESPAWNS).generator(0)
        return rng.integers(0, len(self.world.stations), path.respawn.shape)

    def links(self, path: SamplePath, state: SeenLinks) -> NDArray[np.uint64]:
        """Return the key of links' draws, of which those that are not seen are new."""
        new = self._streams(LINKS).generator(0).bit_generator.random_raw(2)
        return imagined_links(path.link_key, new, *state)


def _joined(true: Walks, new: Walks, now_us: int) -> Walks:
    """Return the true legs that begin before now and then the new ones, which begin now."""
    underway = true.legs["begin_us"] < now_us
    users = np.repeat(np.arange(len(true.offsets) - 1), np.diff(true.offsets))[underway]
    after = np.repeat(np.arange(len(new.offsets) - 1), np.diff(new.offsets))
    later = new.legs.copy()
    later["begin_us"] += now_us
    owners = np.concatenate([users, after])
    order = np.argsort(owners, kind="stable")
    legs = np.concatenate([true.legs[underway], later])[order]
    counts = np.bincount(owners, minlength=len(true.offsets) - 1)
    return Walks(legs, np.concatenate([[0], np.cumsum(counts)]))


def _without_first(requests: Requests) -> Requests:
    """Return requests without those at the very start, which users have made already."""
    firsts = requests.offsets[:-1][np.diff(requests.offsets) > 0]
    dropped = firsts[requests.rows[firsts, DUE_US] == 0]
    remains = np.ones(len(requests.rows), bool)
    remains[dropped] = False
    counts = np.add.reduceat(remains, firsts) if len(firsts) else np.zeros(0, np.int64)
    sizes = np.zeros(len(requests.offsets) - 1, np.int64)
    sizes[np.diff(requests.offsets) > 0] = counts
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    return Requests(np.ascontiguousarray(requests.rows[remains]), offsets, requests.after_previous)


def _asking_anew(rows: Rows, requests: Requests, horizon_us: int) -> Rows:
    """Return rows in which users are to make these requests, and no longer those of before."""
    state = rows.state
    users = len(state.users)
    due = [event for event in rows.due if not users <= event[0] < 2 * users]
    for user in state.users:
        first, end = requests.offsets[user.index : user.index + 2].tolist()
        waits = not requests.follows[user.index] or user.request.number < 0
        if waits and first < end:
            t_us = state.now_us + int(requests.rows[first, DUE_US])
            if t_us < horizon_us:
                due.append((ask_slot(state, user.index), t_us, key(Phase.REQUEST, -1, user.index)))
    arrive = np.repeat(~requests.follows, np.diff(requests.offsets))
    requests.rows[arrive, DUE_US] += state.now_us
    asking = [user._replace(next_ask=int(requests.offsets[user.index])) for user in state.users]
    due.sort(key=lambda event: (event[1], event[2]))
    return Rows(state._replace(users=tuple(asking)), rows.routes, tuple(due))
