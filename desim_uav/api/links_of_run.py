"""The links of a run as tables: over time, and all over the map."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from desim_uav.api.kept import Kept
from desim_uav.typed import typed


class LinksOfRun:
    """The part of a result of runs that makes tables of their links."""

    @property
    def seeds(self) -> list[int]:
        """The seeds of the runs."""
        raise NotImplementedError

    def _of_seed(self, seed: int, argument: str) -> Kept:
        """Return the run on a seed. Raises UsageError, which names the argument."""
        raise NotImplementedError

    @typed
    def levels(
        self,
        user: int | Sequence[int] | None = None,
        drone: int | Sequence[int] | None = None,
        *,
        episode: int | None = None,
        every_s: float | None = None,
        at_s: float | Sequence[float] | None = None,
        seed: int | None = None,
        progress: bool = True,
    ) -> pd.DataFrame:
        """Return the links between users and drones over time: level, SNR, SINR and class.

        A row is for a time ``t_s``, a user and a drone; access point k of N drones is drone N + k.
        ``level_dbm``, ``snr_db`` and ``sinr_db`` are exact at this instant, and null while the
        drone does not transmit. ``link_class`` is the class after all that happens then, and
        ``attached_to`` the drone that the user is attached to, if any.

        Args:
            user: The user, or several of them. Default: all.
            drone: The drone, or several of them. Default: all, and all access points.
            episode: The episode. Default: the first that counts.
            every_s: The step between the times, in seconds, from 0 on.
            at_s: The times, in seconds. Default, without ``every_s``: whenever something of the
                link changes at once (its class, the user's attachment, line of sight, shadowing,
                or who transmits in its band), and both ends of the episode.
            seed: The seed. Default: the first.
            progress: Show the progress, if the run has to be played again for its events.

        Raises:
            UsageError: there is no such user, drone, episode, time or seed, or no radio of the
                scenario has levels.
            NoEventsError: the run has not kept its events, and cannot be played again.
        """
        from desim_uav.experiment.levels import levels_of

        with self._of_seed(self._first(seed), "seed").source() as source:
            return levels_of(
                *(source, user, drone, episode),
                every_s=every_s,
                at_s=at_s,
                show_progress=progress,
            )

    @typed
    def map(
        self,
        minute: float | None = None,
        *,
        episode: int | None = None,
        points: int = 100,
        every_s: float = 10.0,
        seed: int | None = None,
        progress: bool = True,
    ) -> pd.DataFrame:
        """Return what users on the ground would receive all over the map, with a row per place.

        ``link_class``, ``level_dbm``, ``snr_db`` and ``sinr_db`` are those of the best link: of
        the highest level among those that have a class, and else of the highest level. ``drone``
        has this link, and is null if there is none of a class. Draws belong to users, so drawn
        lines of sight are the means of the path loss, and shadowing is left out.

        Args:
            minute: The minute. Default: means over the episode, or over all counted ones, with the
                share ``covered`` of the time in which a place has a link; ``drone`` is then the one
                that has the best link most often.
            episode: The episode. Default: the first that counts, and for means all of them.
            points: The number of places along the longer side of the map.
            every_s: For means: the time between instants, in seconds.
            seed: The seed. Default: the first.
            progress: Show the progress, if the run has to be played again for its events.

        Raises as ``levels`` does.
        """
        from desim_uav.experiment.levels import map_of

        with self._of_seed(self._first(seed), "seed").source() as source:
            return map_of(source, episode, minute, points, every_s, show_progress=progress)

    def _first(self, seed: int | None) -> int:
        return self.seeds[0] if seed is None else seed
