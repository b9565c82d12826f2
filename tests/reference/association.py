"""Which of the transmitters that cover a user it is attached to, at each tick."""

from __future__ import annotations

import numpy as np

from tests.reference.inputs import NEVER, Inputs, Result


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

    def follow(self, t_us: int, covered: np.ndarray, level_dbm: np.ndarray) -> list[int]:
        """Attach users by the rule, and return those whose holder has changed."""
        unlike = covered != self.covered
        if unlike.any():
            self.entered_us[covered & ~self.covered] = t_us
            self.covered = covered
        elif self.rule.kind == "entered_first":
            return []
        looked_at = unlike.any(axis=0)
        if self.rule.kind != "entered_first":
            looked_at |= covered.any(axis=0)
        changed = []
        for user in np.flatnonzero(looked_at):
            before = self.holder[user]
            after = self._holder(user, t_us, level_dbm[:, user])
            if after != before:
                self.holder[user] = after
                self.result.handovers += bool(before >= 0 and after >= 0)
                changed.append(int(user))
        return changed

    def _holder(self, user: int, t_us: int, level_dbm: np.ndarray) -> int:
        covered, holder = self.covered[:, user], self.holder[user]
        if not covered.any():
            self.exceeds_us[:, user] = NEVER
            return -1
        if self.rule.kind == "entered_first":
            if holder >= 0 and covered[holder]:
                return int(holder)
            return int(np.where(covered, self.entered_us[:, user], NEVER).argmin())
        strongest = int(np.where(covered, level_dbm, -np.inf).argmax())
        if self.rule.kind == "strongest":
            return strongest
        if holder < 0 or not covered[holder]:
            holder = strongest
            self.exceeds_us[:, user] = NEVER
        return self._after_a3(user, t_us, level_dbm, int(holder))

    def _after_a3(self, user: int, t_us: int, level_dbm: np.ndarray, holder: int) -> int:
        """Leave a holder that another has exceeded for long enough; then the timers start anew."""
        since_us = self.exceeds_us[:, user]
        for _ in range(len(since_us)):
            exceeds = self.covered[:, user] & (level_dbm >= level_dbm[holder] + self.rule.margin_db)
            exceeds[holder] = False
            since_us[~exceeds] = NEVER
            since_us[exceeds & (since_us == NEVER)] = t_us
            due = np.flatnonzero(exceeds & (t_us - since_us >= self.rule.trigger_us))
            if not len(due):
                break
            holder = int(due[0])
            since_us[:] = NEVER
        return holder
