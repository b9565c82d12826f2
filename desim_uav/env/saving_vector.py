"""Saved states of vector environments, one for each of their environments."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from os import PathLike
from typing import Any, Self

import numpy as np
from gymnasium import error
from numpy.typing import NDArray

from desim_uav.env.alone import OneThread, alone
from desim_uav.env.arguments import typed
from desim_uav.env.compiled import CompiledSession
from desim_uav.env.render import Screen
from desim_uav.env.saving import EnvState, assign, resume, save


class VectorSaving:
    """The methods of a vector environment that save, restore and fork its environments."""

    num_envs: int
    sessions: list[CompiledSession]
    threads: int
    guard: OneThread
    render_mode: str | None
    _which: NDArray[np.int64]

    def _present(self, which: NDArray[np.bool_]) -> tuple[NDArray[Any], dict[str, Any]]:
        """Return what a reset of the environments ``which`` returns, for their present epochs."""
        raise NotImplementedError

    def _set_spaces(self) -> None:
        """Set the spaces of ``num_envs`` environments."""
        raise NotImplementedError

    @typed
    @alone
    def save(self, k: int = 0) -> EnvState:
        """Return the state of environment k at its present decision epoch.

        Raises ResetNeeded before its first episode.
        """
        return save(self.sessions[k])

    @typed
    @alone
    def restore(
        self, state: EnvState | str | PathLike[str], which: int | Sequence[int] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Let environments go on from a saved state, or from the file of one.

        ``which``: the index of one or of several environments; None: all of them. Returns the
        observations of all environments, and the infos of those. Raises the errors of ``UavEnv``.
        """
        indices = self._indices(which)
        resume(self.sessions[indices[0]], state)
        return self.assign(indices[0], indices)

    @typed
    @alone
    def assign(
        self, k: int, which: int | Sequence[int] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Let environments go on from the present state of environment k, which is not changed.

        ``which`` and what is returned are those of ``restore``. It takes some microseconds for each
        environment in the same world. Raises ResetNeeded before the first episode of k.
        """
        self.sessions[k].require_episode()
        indices = self._indices(which)
        assign(self.sessions[k], [self.sessions[other] for other in indices if other != k])
        self._which[indices] = self.sessions[k].which(self.sessions[k].episode)
        return self._present(_mask(indices, self.num_envs))

    @typed
    @alone
    def fork(self, count: int, k: int = 0) -> Self:
        """Return a new vector environment of this many environments in the state of environment k.

        Raises ResetNeeded before its first episode, and gymnasium's Error for a count below 1.
        """
        self.sessions[k].require_episode()
        if count < 1:
            raise error.Error(f"count {count}: must be 1 or more")
        sessions = [deepcopy(self.sessions[k]) for _ in range(count)]
        other: Any = type(self).__new__(type(self))
        own: Any = self
        other.__setstate__(
            {
                **own.__getstate__(),
                "num_envs": count,
                "sessions": sessions,
                "screens": [Screen(one, self.render_mode) for one in sessions if self.render_mode],
                "threads": min(self.threads, count),
                "_all": np.ones(count, np.bool_),
            }
        )
        other._set_spaces()
        forked: Self = other
        return forked

    def _indices(self, which: int | Sequence[int] | None) -> list[int]:
        """Return indices of environments, of which there must be at least one."""
        if which is None:
            return list(range(self.num_envs))
        indices = [which] if isinstance(which, int | np.integer) else list(which)
        if not indices or not all(0 <= k < self.num_envs for k in indices):
            raise error.Error(f"which {which}: must be from 0 to {self.num_envs - 1}")
        return [int(k) for k in indices]


def _mask(indices: Sequence[int], count: int) -> NDArray[np.bool_]:
    """Return a mask of this length that is True at the chosen indices."""
    mask = np.zeros(count, np.bool_)
    mask[indices] = True
    return mask
