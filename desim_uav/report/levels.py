"""The links of an episode at any instant: levels, SNR, SINR and classes, and who serves whom.

Levels and ratios follow from the exact places and from the marks of a link, which are computed as
the engines do. Classes and attachments are those of the episode's events.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from desim_uav.links import Links
from desim_uav.model.motion.motion import REST
from desim_uav.model.radio.marks import BUILDINGS, KINDS
from desim_uav.model.radio.path_loss import MEAN
from desim_uav.model.radio.places import branches_at, losses_db
from desim_uav.model.radio.tracks import Flight
from desim_uav.model.rules import US, Mode, Phase
from desim_uav.report.link_marks import LinkMarks, MarkMaker
from desim_uav.report.playback import PHASES, Playback

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

OF_LINKS = {"enter": 1, "class": 1, "exit": 0}
"""The events that change the class of a link, and its new class if all links are of one class."""

NO_CHANGES = np.zeros(0, np.int64), np.zeros(1, np.int64)
"""The changes of a link that has class 0 throughout."""


class Received(NamedTuple):
    """What is received of some transmitters at some places or times, each as (transmitters, n).

    Levels and ratios are NaN where nothing is transmitted, and with the paper's disc.
    """

    level_dbm: Floats
    snr_db: Floats
    sinr_db: Floats


@dataclass(frozen=True)
class LinksInTime:
    """All links of an episode; access point k of N drones is the transmitter N + k."""

    playback: Playback

    # ---- transmitters

    @property
    def senders(self) -> range:
        """The numbers of all transmitters."""
        scenario = self.playback.run.scenario
        return range(scenario.drone_count + len(scenario.access_points))

    def links(self, sender: int) -> Links:
        """Return the links of a transmitter."""
        world, point = self.playback.run.world, sender - self._drones
        own = world.type_numbers[sender] if point < 0 else len(world.types) + point
        return world.links[own]

    def band(self, sender: int) -> int:
        """Return the number of the band of a transmitter, which it shares with who interferes."""
        reuse = self.playback.run.world.links[0].radio.reuse
        return sender % reuse if reuse else sender

    def serves(self, sender: int, times_us: Ints) -> NDArray[np.bool_]:
        """Return whether a transmitter is on the air, after all that happens at each time."""
        if sender >= self._drones:
            return np.ones(len(times_us), bool)
        keys, on = self._service[sender]
        serves: NDArray[np.bool_] = on[np.searchsorted(keys, self._keys(times_us), "right") - 1]
        return serves

    def places_m(self, sender: int, times_us: Ints) -> Floats:
        """Return where a transmitter is at some times, as (times, 3)."""
        if sender >= self._drones:
            return np.tile(self._point_m(sender), (len(times_us), 1))
        return self.playback.path_m(sender, times_us)

    @property
    def _drones(self) -> int:
        return self.playback.run.scenario.drone_count

    def _point_m(self, sender: int) -> Floats:
        point = self.playback.run.scenario.access_points[sender - self._drones]
        return np.array([*point.at_m, point.height_m], np.float64)

    @cached_property
    def _service(self) -> list[tuple[Ints, NDArray[np.bool_]]]:
        """For each drone, the keys at which its modes begin, and whether it serves in them."""
        return [
            (keys, np.array([mode is Mode.FLYING for mode in modes]))
            for keys, modes in self.playback.mode_changes
        ]

    # ---- levels

    def received(self, user: int, times_us: Ints) -> Received:
        """Return what a user receives of all transmitters at some times."""
        own_m = self.playback.walks.places_m(user, times_us)
        levels = np.full((len(self.senders), len(times_us)), np.nan)
        for sender in self.senders:
            on = self.serves(sender, times_us)
            if self.links(sender).radio.graded and on.any():
                marks = self._marks_at(sender, user, times_us[on])
                where = self.places_m(sender, times_us[on]), own_m[on]
                levels[sender, on] = self._levels_dbm(sender, *where, *marks)
        return self._ratios(levels)

    def received_at(self, places_m: Floats, t_us: int) -> Received:
        """Return what is received of all transmitters at some places (n, 3) at an instant.

        Nothing is drawn for places: with drawn lines of sight, levels are the means of the path
        loss, and shadowing is left out.
        """
        levels = np.full((len(self.senders), len(places_m)), np.nan)
        now = np.array([t_us], np.int64)
        for sender in self.senders:
            radio = self.links(sender).radio
            if radio.graded and self.serves(sender, now)[0]:
                at_m, none = self.places_m(sender, now), np.zeros(len(places_m))
                branches = np.full(len(places_m), MEAN)
                if radio.marked and KINDS[radio.sight] == BUILDINGS:
                    branches = branches_at(self._maker.buildings, at_m[0], places_m)
                levels[sender] = self._levels_dbm(sender, at_m, places_m, branches, none)
        return self._ratios(levels)

    def _levels_dbm(
        self, sender: int, at_m: Floats, places_m: Floats, branches: Ints, extra_db: Floats
    ) -> Floats:
        radio = self.links(sender).radio
        away = at_m - places_m
        distances_m = np.sqrt(away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1])
        heights_m = np.ascontiguousarray(away[:, 2])
        losses = losses_db(radio.path_loss, radio.carrier_ghz, branches, distances_m, heights_m)
        levels_dbm: Floats = radio.power_dbm - extra_db - losses
        return levels_dbm

    def _ratios(self, levels_dbm: Floats) -> Received:
        """Return levels with their ratios to noise, and to noise and interference."""
        powers_mw = np.nan_to_num(10.0 ** (levels_dbm / 10.0))
        snr_db, sinr_db = np.full((2, *levels_dbm.shape), np.nan)
        for sender in self.senders:
            radio = self.links(sender).radio
            if radio.graded:
                others_mw = np.zeros(levels_dbm.shape[1])
                for other in self.senders:
                    if other != sender and self.band(other) == self.band(sender):
                        others_mw += powers_mw[other]
                noise_dbm = radio.budget.noise_dbm
                below_dbm = 10.0 * np.log10(10.0 ** (noise_dbm / 10.0) + others_mw)
                snr_db[sender] = levels_dbm[sender] - noise_dbm
                alone = others_mw == 0.0
                sinr_db[sender] = levels_dbm[sender] - np.where(alone, noise_dbm, below_dbm)
        return Received(levels_dbm, snr_db, sinr_db)

    # ---- marks

    def _marks_at(self, sender: int, user: int, times_us: Ints) -> tuple[Ints, Floats]:
        """Return the branch of a link's loss, and an additional loss, at some times."""
        marks = self.marks(sender, user)
        if marks is None:
            return np.full(len(times_us), MEAN), np.zeros(len(times_us))
        return marks.at(times_us)

    def marks(self, sender: int, user: int) -> LinkMarks | None:
        """Return the marks of a link; None if it always has the mean loss and no shadowing."""
        radio = self.links(sender).radio
        if not radio.marked:
            return None
        if (sender, user) not in self._known:
            flown, number = self.playback.flights(sender), sender
            if sender >= self._drones:
                at_m, number = self._point_m(sender).tolist(), self._drones - 1 - sender
                flown = [(Flight(REST.rows, (*at_m, *at_m), 0), (0, self.playback.duration_us))]
            walk = self.playback.walks.legs(user)
            self._known[sender, user] = self._maker.marks(radio, number, user, walk, flown)
        return self._known[sender, user]

    @cached_property
    def _known(self) -> dict[tuple[int, int], LinkMarks]:
        return {}

    @cached_property
    def _maker(self) -> MarkMaker:
        run = self.playback.run
        return MarkMaker(run.world, run.settings.seed, self.playback.episode)

    # ---- classes and attachments

    def classes(self, sender: int, user: int, times_us: Ints) -> Ints:
        """Return the class of a link after all that happens at each time."""
        keys, classes = self._changes.get((sender, user), NO_CHANGES)
        after: Ints = classes[np.searchsorted(keys, self._keys(times_us), "right")]
        return after

    def holders(self, user: int, times_us: Ints) -> Ints:
        """Return which transmitter a user is attached to at some times, or -1."""
        spells = self.playback.attachments
        own = np.flatnonzero(spells.user == user)
        own = own[np.argsort(spells.from_key[own], kind="stable")]
        keys = self._keys(times_us)
        last = np.searchsorted(spells.from_key[own], keys, "right") - 1
        rows = own[np.maximum(last, 0)] if len(own) else np.zeros(len(keys), np.int64)
        if not len(own):
            return np.full(len(keys), -1)
        held = (last >= 0) & (keys < spells.to_key[rows])
        return np.where(held, spells.drone[rows], -1)

    def changes_us(self, sender: int, user: int) -> Ints:
        """Return when something of a link changes at once, and both ends of the episode.

        That is its class, whom the user is attached to, who transmits in its band, and the line of
        sight and the shadowing of a link in its band.
        """
        end_us, spells = self.playback.duration_us, self.playback.attachments
        own = spells.user == user
        times = [np.array([0, end_us]), spells.from_us[own], spells.to_us[own]]
        times.append(self._changes.get((sender, user), NO_CHANGES)[0] // PHASES)
        for other in self.senders:
            if self.band(other) == self.band(sender):
                if other < self._drones:
                    times.append(self._service[other][0] // PHASES)
                marks = self.marks(other, user)
                if marks is not None:
                    times.append(marks.since_us)
        every = np.unique(np.concatenate(times))
        return every[(every >= 0) & (every <= end_us)]

    @cached_property
    def _changes(self) -> dict[tuple[int, int], tuple[Ints, Ints]]:
        """By transmitter and user, the keys at which the class changes, and the classes."""
        events = self.playback.events
        events = events[events["kind"].isin(OF_LINKS)]
        classes = events["kind"].map(OF_LINKS)
        if "link_class" in events:
            classes = events["link_class"].fillna(0)
        events = events.assign(after=classes.astype(np.int64))
        groups = events.groupby([events["drone"].astype(int), events["user"].astype(int)])
        return {
            pair: (rows["key"].to_numpy(np.int64), np.array([0, *rows["after"]], np.int64))
            for pair, rows in groups
        }

    def _keys(self, times_us: Ints) -> Ints:
        """Return the keys of the last events that count at some times (see ``playback``)."""
        last = np.where(times_us < self.playback.duration_us, PHASES - 1, int(Phase.ATTACHMENT))
        keys: Ints = times_us * PHASES + last
        return keys


def levels_frame(
    playback: Playback, users: Sequence[int], senders: Sequence[int], times_us: Ints | None
) -> pd.DataFrame:
    """Return the table of ``RunResult.levels`` for an episode.

    Without times, each link has a row whenever something of it changes at once.
    """
    links = LinksInTime(playback)
    parts = []
    for user in users:
        own = [links.changes_us(each, user) if times_us is None else times_us for each in senders]
        at_us = np.unique(np.concatenate(own))
        received, holders = links.received(user, at_us), links.holders(user, at_us)
        for sender, link_us in zip(senders, own, strict=True):
            rows = np.searchsorted(at_us, link_us)
            columns = {
                "episode": playback.episode,
                "t_s": link_us / US,
                "user": user,
                "drone": sender,
                **{name: of[sender, rows] for name, of in received._asdict().items()},
                "link_class": links.classes(sender, user, link_us),
                "attached_to": pd.array(holders[rows], "Int64"),
            }
            parts.append(pd.DataFrame(columns))
    frame = pd.concat(parts, ignore_index=True)
    frame["attached_to"] = frame["attached_to"].mask(frame["attached_to"] < 0)
    return frame.sort_values(["t_s", "user", "drone"], kind="stable", ignore_index=True)
