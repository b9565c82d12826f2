"""What users on the ground would receive, all over the map: at an instant, or on average."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from desim_uav.model.rules import US
from desim_uav.report.levels import LinksInTime
from desim_uav.report.playback import Playback
from desim_uav.report.run import Run
from desim_uav.world import World

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


POINTS, EVERY_S = 100, 10.0
"""By default, so many places along the longer side, and an instant in so many seconds of a mean."""

MOST_POINTS = 1000
"""The most places along the longer side."""


class Best(NamedTuple):
    """The best link at some places: its class and transmitter (-1: none), its level and ratios."""

    link_class: Ints
    drone: Ints
    level_dbm: Floats
    snr_db: Floats
    sinr_db: Floats


def places_of(world: World, points: int) -> tuple[Floats, Floats]:
    """Return x and y of places on the ground, so many along the longer side of the map.

    They are the middles of equal squares.
    """
    longer_m = max(world.area)
    counts = [max(1, round(points * side_m / longer_m)) for side_m in world.area]
    xs, ys = (
        (np.arange(count) + 0.5) * side_m / count
        for count, side_m in zip(counts, world.area, strict=True)
    )
    return xs, ys


def best_at(links: LinksInTime, places_m: Floats, t_us: int) -> Best:
    """Return the best link at each of some places (n, 3) at an instant.

    It is that of the highest level among those of class 1 or higher, of the nearest disc where
    links have no level, or else of the highest level of all, which then has class 0.
    """
    received, now = links.received_at(places_m, t_us), np.array([t_us], np.int64)
    classes = np.zeros(received.level_dbm.shape, np.int64)
    merits = np.full(classes.shape, -np.inf)
    for sender in links.senders:
        own = links.links(sender)
        if not links.serves(sender, now)[0]:
            continue
        if own.radio.graded:
            ratios = received.sinr_db[sender]
            classes[sender] = np.searchsorted(own.thresholds_db, ratios, "right")
            merits[sender] = received.level_dbm[sender]
        else:
            away = places_m[:, :2] - links.places_m(sender, now)[0, :2]
            away_m = np.hypot(*away.T)
            classes[sender] = away_m <= own.reach_m
            merits[sender] = -away_m - DISC
    merits = np.where(classes > 0, merits + COVERS, merits)
    first, columns = merits.argmax(axis=0), np.arange(len(places_m))
    chosen = [values[first, columns] for values in (classes, *received)]
    drones = np.where(chosen[0] > 0, first, -1)
    return Best(chosen[0], drones, *chosen[1:])


DISC, COVERS = 1e9, 1e12
"""What a disc is worth less than any level, and what a link is worth more than none."""


def map_frame(playback: Playback, points: int, t_us: int) -> pd.DataFrame:
    """Return the map at an instant of an episode, with a row for each place."""
    xs, ys = places_of(playback.run.world, points)
    best = best_at(LinksInTime(playback), _ground(xs, ys), t_us)
    return _framed(xs, ys, best)


def mean_map_frame(playbacks: Sequence[Playback], points: int, every_s: float) -> pd.DataFrame:
    """Return the means of maps of some episodes, in the middle of each ``every_s`` seconds.

    The ratios are means where something is transmitted, and the class is the mean over all times.
    The drone is the one that most often has the best link.
    """
    world = playbacks[0].run.world
    xs, ys = places_of(world, points)
    places_m, links = _ground(xs, ys), [LinksInTime(each) for each in playbacks]
    sums, heard = np.zeros((4, len(places_m))), np.zeros(len(places_m))
    shares, times = np.zeros((len(links[0].senders), len(places_m))), 0
    for one in links:
        for t_us in _middles(one.playback.duration_us, round(every_s * US)):
            best, times = best_at(one, places_m, t_us), times + 1
            sums[0] += best.link_class
            heard += np.isfinite(best.level_dbm)
            sums[1:] += np.nan_to_num(best[2:])
            covered = np.flatnonzero(best.drone >= 0)
            shares[best.drone[covered], covered] += 1
    drones = np.where(shares.any(axis=0), shares.argmax(axis=0), -1)
    with np.errstate(invalid="ignore"):
        ratios = sums[1:] / np.where(heard > 0, heard, np.nan)
    frame = _framed(xs, ys, Best(sums[0] / times, drones, *ratios))
    return frame.assign(covered=shares.sum(axis=0) / times)


def frame_of(
    run: Run,
    episode: int | None = None,
    minute: float | None = None,
    points: int = POINTS,
    every_s: float = EVERY_S,
) -> pd.DataFrame:
    """Return the numbers of the maps (see ``RunResult.map``). Raises UsageError."""
    if minute is None:
        chosen = run.counted_episodes if episode is None else [run.episode(episode)]
        run.need(chosen)
        return mean_map_frame([Playback(run, each) for each in chosen], points, every_s)
    t_us = run.instant_us(run.episode(episode), minute)
    return map_frame(playback_of(run, episode), points, t_us)


def playback_of(run: Run, episode: int | None) -> Playback:
    """Return an episode of a run, by default the first that counts."""
    number = run.episode(episode)
    run.need([number])
    return Playback(run, number)


def _middles(duration_us: int, every_us: int) -> list[int]:
    """Return the middles of stretches of an episode, of which the last one may be shorter."""
    starts = range(0, max(duration_us, 1), every_us)
    return [(start + min(start + every_us, duration_us)) // 2 for start in starts]


def _ground(xs: Floats, ys: Floats) -> Floats:
    """Return the places (y by y) on the ground."""
    x, y = np.meshgrid(xs, ys)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def _framed(xs: Floats, ys: Floats, best: Best) -> pd.DataFrame:
    x, y = np.meshgrid(xs, ys)
    frame = pd.DataFrame({"x_m": x.ravel(), "y_m": y.ravel(), **best._asdict()})
    drones = frame["drone"].astype("Int64")
    return frame.assign(drone=drones.mask(drones < 0))
