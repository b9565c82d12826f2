"""All drones of a session under one controller, in either engine: what ``UavEnv`` stands on."""

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
    """One environment: see ``UavEnv`` for what its methods tell."""

    session: Session

    def begin(self, seed: int | None) -> None:
        """The next episode; with a ``seed``, the first of a new run."""

    def step(self, action: Any) -> tuple[float, bool, bool]:
        """One action a drone: reward, terminated, truncated. Raises ResetNeeded, ActionError."""

    def observation(self) -> NDArray[Any]:
        """The drones' encodings, one after the other."""

    def masks(self) -> NDArray[np.bool_]:
        """The drones' masks, one after the other."""

    def info(self) -> dict[str, Any]:
        """What else is told."""


def joint(engine: str, scenario: Scenario) -> Joint:
    """In the engine of this name. Raises gymnasium's Error where there is none, ScenarioError."""
    if engine == "des":
        return OnSimPy(Session(scenario))
    if engine == "batch":
        return InKernels(CompiledSession(scenario))
    raise error.Error(f"engine {engine!r}: must be 'des' or 'batch'")


class OnSimPy:
    """By what the session shows."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.drones = session.scenario.drones.count
        self._dtype = observation_space(features(session.world)).dtype

    def begin(self, seed: int | None) -> None:
        """See ``Joint``, here and below."""
        self.session.reset(seed)

    def step(self, action: Any) -> tuple[float, bool, bool]:
        """Session by session's means."""
        shown = self.session.step([action] if self.drones == 1 else _each(action))
        return in_order(shown.rewards) / self.drones, shown.terminated, shown.truncated

    def observation(self) -> NDArray[Any]:
        """Encoded by the scenario's component."""
        return np.array(
            list(chain.from_iterable(self.session.encoded(self.session.shown))), self._dtype
        )

    def masks(self) -> NDArray[np.bool_]:
        """Those of the snapshot."""
        return self.session.action_masks()

    def info(self) -> dict[str, Any]:
        """Means of the drones' terms."""
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
    """By the arrays of the compiled engine."""

    def __init__(self, session: CompiledSession) -> None:
        self._stand_on(Compiled([session]))
        self._over = True

    def __getstate__(self) -> tuple[Compiled, bool]:
        """Everything but the rows of arrays, which a copy takes of its own arrays."""
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
        """In one call."""
        if self._over:
            raise error.ResetNeeded("call reset first: the episode is over, or none has begun")
        compiled = self.compiled
        compiled.step(compiled.commands(action), ALL)
        terminated, truncated = self._ends.tolist()
        self._over = terminated or truncated
        return self._rewards.item(), terminated, truncated

    def observation(self) -> NDArray[Any]:
        """Encoded by a kernel."""
        shown: NDArray[Any] = self._values.astype(self.compiled.dtype)
        return shown

    def masks(self) -> NDArray[np.bool_]:
        """Those of the arrays. Raises ResetNeeded before the first episode."""
        if self.session.episode < 0:
            raise error.ResetNeeded("call reset first: no episode has begun")
        masks: NDArray[np.bool_] = self._masks.astype(np.bool_)
        return masks

    def info(self) -> dict[str, Any]:
        """Means by a kernel."""
        return self.compiled.info_of(0)


def _each(action: Any) -> Iterable[Any]:
    """An action, drone by drone."""
    if isinstance(action, np.ndarray):
        action = action.tolist()
    if not isinstance(action, Iterable):
        raise ActionError(f"one action for each drone, not {action!r}")
    return action
