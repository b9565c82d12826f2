"""All drones of a session under one controller, in either engine: the basis of ``UavEnv``."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain
from typing import Any, Protocol

import numpy as np
from gymnasium import error
from numpy.typing import NDArray

from desim_uav.env.compiled import Compiled, CompiledSession
from desim_uav.env.session import ActionError, Session
from desim_uav.model.sums import in_order
from desim_uav.scenario.schema import Scenario
from desim_uav.spaces import features, flat_mask, observation_space

ALL = np.ones(1, np.bool_)


class Joint(Protocol):
    """One environment with a single controller; ``UavEnv`` explains the values it returns."""

    session: Session

    def begin(self, seed: int | None) -> None:
        """Begin the next episode; with a ``seed``, the first of a new run."""

    def step(self, action: Any) -> tuple[float, bool, bool]:
        """Take one action per drone; return reward, terminated and truncated.

        Raises ResetNeeded outside an episode, and ActionError for an invalid action.
        """

    def observation(self) -> NDArray[Any]:
        """Return the drones' encoded observations, one after the other."""

    def masks(self) -> NDArray[np.bool_]:
        """Return the drones' masks, one after the other."""

    def info(self) -> dict[str, Any]:
        """Return the info at the present decision epoch."""


def joint(engine: str, scenario: Scenario) -> Joint:
    """Make the environment in the engine of this name.

    Raises gymnasium's Error for an unknown engine, and ScenarioError for an invalid scenario.
    """
    if engine == "des":
        return OnSimPy(Session(scenario))
    if engine == "batch":
        return InKernels(CompiledSession(scenario))
    raise error.Error(f"engine {engine!r}: must be 'des' or 'batch'")


class OnSimPy:
    """An environment on the SimPy engine."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.drones = session.scenario.drones.count
        self._dtype = observation_space(features(session.world)).dtype

    def begin(self, seed: int | None) -> None:
        """See ``Joint``, here and below."""
        self.session.reset(seed)

    def step(self, action: Any) -> tuple[float, bool, bool]:
        """See ``Joint``; the reward is the mean over the drones."""
        shown = self.session.step([action] if self.drones == 1 else _each(action))
        return in_order(shown.rewards) / self.drones, shown.terminated, shown.truncated

    def observation(self) -> NDArray[Any]:
        """See ``Joint``; the scenario's observation component encodes."""
        return np.array(
            list(chain.from_iterable(self.session.encoded(self.session.shown))), self._dtype
        )

    def masks(self) -> NDArray[np.bool_]:
        """See ``Joint``."""
        return self.session.action_masks()

    def info(self) -> dict[str, Any]:
        """See ``Joint``; the terms of the reward are means over the drones."""
        session, drones = self.session, self.drones
        shown = session.shown
        terms = session.terms(shown)
        return {
            **session.info(shown),
            "attached_users": sum(seen.attached_users for seen in shown.observations),
            "crashes": session.engine.log.crashes,
            **{
                key: in_order(float(own[name]) for own in terms) / drones
                for name, key in session.term_keys.items()
            },
            "action_mask": flat_mask(shown.masks),
        }


class InKernels:
    """An environment on the compiled engine."""

    def __init__(self, session: CompiledSession) -> None:
        self._stand_on(Compiled([session]))
        self._over = True

    def __getstate__(self) -> tuple[Compiled, bool]:
        """Return everything except views of arrays, which a copy makes of its own arrays."""
        return self.compiled, self._over

    def __setstate__(self, kept: tuple[Compiled, bool]) -> None:
        """See ``__getstate__``."""
        compiled, self._over = kept
        self._stand_on(compiled)

    def _stand_on(self, compiled: Compiled) -> None:
        self.compiled = compiled
        self.session: Session = compiled.sessions[0]
        self._values, self._masks = compiled.values[0], compiled.masks[0]
        self._rewards, self._ends = compiled.rewards, compiled.over[0]

    def begin(self, seed: int | None) -> None:
        """See ``Joint``, here and below."""
        self.compiled.begin(ALL, [seed])
        self._over = False

    def step(self, action: Any) -> tuple[float, bool, bool]:
        """See ``Joint``."""
        if self._over:
            raise error.ResetNeeded("call reset first: the episode is over, or none has begun")
        compiled = self.compiled
        compiled.step(compiled.commands(action), ALL)
        terminated, truncated = self._ends.tolist()
        self._over = terminated or truncated
        return self._rewards.item(), terminated, truncated

    def observation(self) -> NDArray[Any]:
        """See ``Joint``; a kernel encodes."""
        shown: NDArray[Any] = self._values.astype(self.compiled.dtype)
        return shown

    def masks(self) -> NDArray[np.bool_]:
        """See ``Joint``. Raises ResetNeeded before the first episode."""
        if self.session.episode < 0:
            raise error.ResetNeeded("call reset first: no episode has begun")
        masks: NDArray[np.bool_] = self._masks.astype(np.bool_)
        return masks

    def info(self) -> dict[str, Any]:
        """See ``Joint``; the terms of the reward are means over the drones."""
        return self.compiled.info_of(0)


def _each(action: Any) -> Iterable[Any]:
    """Return the entries of an action, one per drone."""
    if isinstance(action, np.ndarray):
        action = action.tolist()
    if not isinstance(action, Iterable):
        raise ActionError(f"an action must have one entry per drone, not {action!r}")
    return action
