"""Which of the transmitters that cover a user it is attached to, at each tick."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.reference.inputs import NEVER, Inputs, Result

DECIMALS = 9
"""To how many decimals of a decibel levels are compared."""


class Attachments:
    """Who is attached to whom: ``holder`` of each user, -1 for nobody.

    ``entered_us`` (transmitters, users): since when a user is covered. ``exceeds_us``: since when a
    transmitter has exceeded the holder of a user by the margin (A3), NEVER if it does not now.
    """

    def __init__(self, inputs: Inputs, result: Result) -> None:
        self.rule, self.result = inputs.association, result
        shape = (len(inputs.links) + len(inputs.access_points), len(inputs.legs))
        self.covered = np.zeros(shape, bool)
        self.entered_us = np.zeros(shape, np.int64)
        self.exceeds_us = np.full(shape, NEVER)
        self.holder = np.full(shape[1], -1)
        self.users = np.arange(shape[1])

    def follow(
        self,
        t_us: int,
        covered: np.ndarray,
        level_dbm: np.ndarray,
        later_dbm: Callable[[], np.ndarray],
    ) -> list[int]:
        """Attach users by the rule, and return those whose holder has changed.

        Levels that differ by rounding are equal. Of equal ones the higher is that which is so a
        tick later (``later_dbm``): drones that are in one place now may fly apart.
        """
        level_dbm = np.round(level_dbm, DECIMALS)
        self.later_dbm = later_dbm
        if (covered != self.covered).any():
            self.entered_us[covered & ~self.covered] = t_us
            self.covered = covered
        elif self.rule.kind == "entered_first":
            return []
        holder = self._holders(t_us, level_dbm)
        changed = np.flatnonzero(holder != self.holder)
        both = (holder[changed] >= 0) & (self.holder[changed] >= 0)
        self.result.handovers += int(both.sum())
        self.holder = holder
        return changed.tolist()

    def _holders(self, t_us: int, level_dbm: np.ndarray) -> np.ndarray:
        anybody = self.covered.any(axis=0)
        strongest = np.where(anybody, self._strongest(level_dbm, self.covered), -1)
        if self.rule.kind == "strongest":
            return strongest
        lost = (self.holder < 0) | ~self.covered[self.holder, self.users]
        if self.rule.kind == "entered_first":
            earliest = np.where(self.covered, self.entered_us, NEVER).argmin(axis=0)
            return np.where(lost, np.where(anybody, earliest, -1), self.holder)
        self.exceeds_us[:, lost] = NEVER
        return self._after_a3(t_us, level_dbm, np.where(lost, strongest, self.holder))

    def _strongest(self, level_dbm: np.ndarray, among: np.ndarray) -> np.ndarray:
        """The strongest transmitter of each user, of equal ones the first."""
        level_dbm = np.where(among, level_dbm, -np.inf)
        equal = among & (level_dbm == level_dbm.max(axis=0))
        if (equal.sum(axis=0) > 1).any():
            level_dbm = np.where(equal, np.round(self.later_dbm(), DECIMALS), -np.inf)
        return level_dbm.argmax(axis=0)

    def _after_a3(self, t_us: int, level_dbm: np.ndarray, holder: np.ndarray) -> np.ndarray:
        """Leave holders that another has exceeded for long enough; then the timers start anew.

        Of several that have, the strongest takes the user.
        """
        for _ in range(len(level_dbm)):
            wanted_dbm = level_dbm[holder, self.users] + self.rule.margin_db
            exceeds = self.covered & (level_dbm > np.round(wanted_dbm, DECIMALS))
            exceeds[holder, self.users] = False
            self.exceeds_us[~exceeds] = NEVER
            self.exceeds_us[exceeds & (self.exceeds_us == NEVER)] = t_us
            due = exceeds & (t_us - self.exceeds_us >= self.rule.trigger_us)
            leaves = due.any(axis=0)
            if not leaves.any():
                break
            holder = np.where(leaves, self._strongest(level_dbm, due), holder)
            self.exceeds_us[:, leaves] = NEVER
        return holder
