"""Gymnasium's environment: one controller of all drones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import chain
from typing import Any

import gymnasium
import numpy as np
from gymnasium import error
from numpy.typing import NDArray

from desim_uav.env.compiled import Compiled, CompiledSession
from desim_uav.env.configure import Source
from desim_uav.env.render import RENDERING, Screen
from desim_uav.env.session import ActionError, Session
from desim_uav.model.sums import in_order
from desim_uav.spaces import action_space, features, flat_mask, observation_space

ALL = np.ones(1, np.bool_)


class UavEnv(gymnasium.Env[NDArray[Any], Any]):
    """The drones of a scenario under one controller; a step is a decision epoch.

    The observation is the drones' encodings, one after the other (int64, or float32 where the
    scenario's encoding has real numbers); an action is one for each drone, or, of a single drone,
    just it. The reward is the mean over the drones, and so are its terms in the info; attached
    users and crashes are of all. The masks, in the info and by ``action_masks``, are those of the
    drones one after the other, none of them all 0. The time limit truncates an episode; a crash
    terminates it where the scenario says so.
    """

    metadata = RENDERING

    def __init__(
        self,
        scenario: Source,
        config: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
        engine: str = "des",
    ) -> None:
        """``scenario``: a file, a shipped name, a mapping or a Scenario; ``config``: changes to it.

        ``engine``: des (SimPy), or batch (compiled: the same numbers, sooner). Raises ScenarioError
        with every problem of the scenario, UnsupportedMode where the render mode is unknown or
        "human" has no display.
        """
        if engine not in ("des", "batch"):
            raise error.Error(f"engine {engine!r}: must be 'des' or 'batch'")
        self.compiled: Compiled | None = None
        if engine == "batch":
            self.session: Session = CompiledSession(scenario, config)
        else:
            self.session = Session(scenario, config)
        self.screen = Screen(self.session, render_mode)
        self.render_mode = render_mode
        self.drones = self.session.scenario.drones.count
        world = self.session.world
        self.observation_space = observation_space(features(world) * self.drones)
        self.action_space = action_space(len(world.actions), self.drones)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begin the next episode; with a ``seed``, the first of a new run (see ``Session``).

        There are no ``options``.
        """
        super().reset(seed=seed)
        if isinstance(self.session, CompiledSession):
            if self.compiled is None:
                self.compiled = Compiled([self.session])
            self.compiled.begin(ALL, [seed])
            self._over = False
        else:
            self.session.reset(seed)
        self.screen.refresh()
        return self._observation(), self._info()

    def step(self, action: Any) -> tuple[NDArray[Any], float, bool, bool, dict[str, Any]]:
        """One action a drone, (drones,).

        A masked action becomes the only allowed one, or hover. Raises ResetNeeded outside an
        episode, ActionError for what is no action.
        """
        if isinstance(self.session, CompiledSession):
            return self._step_compiled(action)
        shown = self.session.step([action] if self.drones == 1 else _each(action))
        self.screen.refresh()
        reward = in_order(shown.rewards) / self.drones
        return self._observation(), reward, shown.terminated, shown.truncated, self._info()

    def _step_compiled(self, action: Any) -> tuple[NDArray[Any], float, bool, bool, dict[str, Any]]:
        compiled = self.compiled
        if compiled is None or self._over:
            raise error.ResetNeeded("call reset first: the episode is over, or none has begun")
        compiled.step(compiled.commands(action), ALL)
        self.screen.refresh()
        terminated, truncated = compiled.over[0].tolist()
        self._over = terminated or truncated
        return (
            self._observation(),
            float(compiled.rewards[0]),
            terminated,
            truncated,
            self._info(),
        )

    def action_masks(self) -> NDArray[np.bool_]:
        """The masks of all drones, one after the other: (drones * actions,)."""
        if self.compiled is not None:
            masks: NDArray[np.bool_] = self.compiled.masks[0].astype(np.bool_)
            return masks
        return self.session.action_masks()

    def render(self) -> NDArray[np.uint8] | None:
        """The present frame (height, width, 3), or None where a window shows it."""
        return self.screen.render()

    def close(self) -> None:
        """Close the window, if there is one."""
        self.screen.close()

    def _observation(self) -> NDArray[Any]:
        if self.compiled is not None:
            shown: NDArray[Any] = self.compiled.values[0].astype(self.compiled.dtype)
            return shown
        values = list(chain.from_iterable(self.session.encoded()))
        return np.array(values, self.observation_space.dtype)

    def _info(self) -> dict[str, Any]:
        if self.compiled is not None:
            return self.compiled.info_of(0)
        session, drones = self.session, self.drones
        shown, rewards = session.shown, session.reward_info()
        return {
            **session.info(),
            "attached_users": sum(seen.attached_users for seen in shown.observations),
            "crashes": session.engine.log.crashes,
            **{key: in_order(terms[key] for terms in rewards) / drones for key in rewards[0]},
            "action_mask": flat_mask(shown.masks),
        }


def _each(action: Any) -> Iterable[Any]:
    """An action, drone by drone."""
    if isinstance(action, np.ndarray):
        action = action.tolist()
    if not isinstance(action, Iterable):
        raise ActionError(f"one action for each drone, not {action!r}")
    return action
