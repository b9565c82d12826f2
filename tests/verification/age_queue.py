"""A sensor that sends its updates one after the other, once more: no code of the simulator's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

Keeps = Literal["newest", "oldest", "last"]
INF = float("inf")


def received(
    generated: Sequence[float],
    needs: Sequence[float],
    room: float = INF,
    keeps: Keeps = "newest",
    preempts: bool = False,
    sends: Literal["first", "last"] = "first",
) -> list[float]:
    """Return when each update has been sent whole; infinity if it was dropped.

    ``room`` is how many may wait or be sent together, ``keeps`` what happens beyond it, and
    ``sends`` which of those that wait is sent next.
    """
    until, buffer, since = [INF] * len(generated), list[int](), 0.0

    def send(now: float) -> None:
        nonlocal since
        while buffer and since + needs[buffer[0]] <= now:
            since += needs[buffer[0]]
            until[buffer.pop(0)] = since
            if sends == "last" and buffer:
                buffer.insert(0, buffer.pop())

    for update, now in enumerate(generated):
        send(now)
        if keeps == "last":
            del buffer[0 if preempts else 1 :]
        elif keeps == "newest" and len(buffer) >= max(room, 2):
            del buffer[1]
        if len(buffer) < room:
            since = since if buffer else now
            buffer.append(update)
    send(INF if not buffer else since + sum(needs[k] for k in buffer) + 1.0)
    return until


def mean_age(
    generated: Sequence[float], delivered: Sequence[float], begin: float, end: float
) -> float:
    """Return the mean over time, from ``begin`` to ``end``, of the time since the freshest update.

    Before the first delivery, the freshest one is of time 0.
    """
    there = np.isfinite(delivered) & (np.asarray(delivered) < end)
    born, come = np.asarray(generated)[there], np.asarray(delivered)[there]
    order = np.argsort(come, kind="stable")
    freshest = np.maximum.accumulate(np.r_[0.0, born[order]])
    edges = np.clip(np.r_[0.0, come[order], end], begin, end)
    first, last = edges[:-1] - freshest, edges[1:] - freshest
    return float(((first + last) / 2 * np.diff(edges)).sum() / (end - begin))
