"""Many multi-agent environments of one scenario as arrays, which one call steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import logger
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from desim_uav.engine.base import COUNTS, OWN_COUNTS
from desim_uav.env.alone import alone
from desim_uav.env.arguments import typed
from desim_uav.env.compiled import COUNTED, MEASURED, NUMBERS, OWN_COUNTED, as_counts, states_of
from desim_uav.env.configure import Source, WorldSeed
from desim_uav.env.many import Flags, Many, Seed
from desim_uav.env.tasks import Curriculum, TaskChange, tasks_of
from desim_uav.spaces import features, observation_space, state_space

StepResult = tuple[
    NDArray[Any], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]
]


class UavParallelVectorEnv(Many):
    """``num_envs`` environments like ``UavParallelEnv``, in the compiled engine, as arrays.

    Axis 0 is the environment and axis 1 the drone. Drone d of environment k has the numbers of
    agent ``drone_d`` of ``UavParallelEnv`` with the seed of environment k, bit for bit, with any
    number of ``threads``. ``reset(seed=s)`` gives environment k the seed s + k; a list gives each
    its own. For ``world_seed`` and the autoreset modes see ``UavVectorEnv``.

    With ``copy=True`` every array that is returned is the caller's own. With ``copy=False``
    observations, masks, rewards, terminations and truncations are always the same arrays, which
    the next reset or step overwrites; the infos and what is at the end of an episode are copies.

    ``single_observation_space`` and ``single_action_space`` are those of one drone, and
    ``observation_space`` and ``action_space`` those of all (num_envs, drones, …).
    ``single_state_space`` is that of the whole state of an environment.
    Copies and pickles are independent environments (see ``UavEnv``) with threads of their own.
    """

    @typed
    def __init__(
        self,
        scenario: Source,
        num_envs: int,
        config: Mapping[str, Any] | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 1,
        render_mode: str | None = None,
        world_seed: WorldSeed = "scenario",
        copy: bool = True,
        curriculum: Curriculum | Sequence[TaskChange] | None = None,
    ) -> None:
        """Make ``num_envs`` environments of a scenario.

        The parameters and errors are those of ``UavVectorEnv``. ``copy``: whether the arrays of a
        reset or step are new ones.
        """
        tasks = tasks_of(scenario, config, world_seed, curriculum)
        self.make_sessions(tasks, num_envs, autoreset_mode, threads, render_mode)
        self.copy = copy

    def _set_spaces(self) -> None:
        first, num_envs = self.sessions[0], self.num_envs
        self.drones = first.drones
        self.possible_agents = [f"drone_{d}" for d in range(self.drones)]
        self.single_observation_space = observation_space(features(first.world))
        self.single_action_space = self.commands.space_of(1)
        of_one = batch_space(self.single_observation_space, self.drones)
        self.observation_space = batch_space(of_one, num_envs)
        self.single_state_space = state_space(len(first.state_names))
        self.state_space = batch_space(self.single_state_space, num_envs)
        self.action_space = self.commands.space_of_each(num_envs)

    def _set_up(self) -> None:
        super()._set_up()
        outputs, count, drones = self.outputs, self.num_envs, self.sessions[0].drones
        self._written = outputs.observations.reshape(count, drones, -1)
        self._masks = outputs.masks.reshape(count, drones, -1)
        self._own = outputs.own.reshape(count, drones, -1)
        self._rows = self._written.astype(self.sessions[0].dtype)
        self._paid = np.zeros((count, drones))
        self._ends = np.zeros((2, count, drones), np.bool_)

    def __getstate__(self) -> dict[str, Any]:
        """Return everything except arrays and threads, which a copy makes again."""
        own = ("_written", "_masks", "_own", "_rows", "_paid", "_ends")
        return {key: part for key, part in super().__getstate__().items() if key not in own}

    @typed
    @alone
    def reset(
        self, *, seed: Seed = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begin the next episode of every environment; with seeds, the first episodes of new runs.

        Returns the observations (num_envs, drones, features) and the infos (see ``infos``).
        ``options={"reset_mask": mask}`` resets only the environments that the mask (num_envs,),
        bool, names. Errors are those of ``UavVectorEnv.reset``.
        """
        return self._present(self.begin_chosen(seed, options))

    def _present(self, which: Flags) -> tuple[NDArray[Any], dict[str, Any]]:
        return self._observations(), self.infos()

    @alone
    def step(self, actions: NDArray[Any]) -> StepResult:
        """Take the actions (num_envs, drones), whole numbers, one for each drone.

        In free flight, they are the numbers of commands: (num_envs, drones, numbers).

        Returns the observations (num_envs, drones, features), the rewards of the drones, float64
        (num_envs, drones), terminations and truncations, bool (num_envs, drones), and the infos.

        After the end of an episode, the next step ignores the actions of that environment and
        begins its next episode (NEXT_STEP), or the step that ends it also begins the next one
        (SAME_STEP). In the latter case ``final_obs`` of the infos holds the last observations and
        ``final_info`` the last infos; they are 0 where the mask ``_final_obs`` (num_envs,) is
        False. These three keys exist only in a step that ends an episode.

        Raises ResetNeeded before the first reset of an environment and, with
        ``AutoresetMode.DISABLED``, after the end of its episode, and ActionError for an invalid
        action. No environment is stepped in these cases.
        """
        over = self.over()
        self.require_episodes(over)
        self.advance(actions, over, by_drone=True)
        final: dict[str, Any] = {}
        self._paid[:] = self.outputs.paid
        self._ends[:] = self.outputs.over[:, :2].T[:, :, np.newaxis]
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            ended = self.over()
            if ended.any():
                final = self._final(ended)
                self.begin(ended)
        rewards, (terminated, truncated) = self._paid, self._ends
        if self.copy:
            rewards, (terminated, truncated) = rewards.copy(), self._ends.copy()
        return self._observations(), rewards, terminated, truncated, {**self.infos(), **final}

    def infos(self) -> dict[str, Any]:
        """Return the present infos: those of ``UavParallelEnv`` as arrays, under the same keys.

        What a drone has of its own has the shape (num_envs, drones), and the rest (num_envs,).
        ``action_mask``, int8 (num_envs, drones, actions), is one more key.
        """
        numbers, labels, own = self.outputs.numbers.T, self._which.T, self._own.transpose(2, 0, 1)
        world = self.sessions[0].world
        whole = as_counts(COUNTS, numbers[MEASURED:COUNTED], world)
        columns: dict[str, Any] = dict(zip(COUNTS, whole, strict=True))
        columns |= zip(OWN_COUNTS, as_counts(OWN_COUNTS, own[:OWN_COUNTED], world), strict=True)
        values = (*numbers[:MEASURED].copy(), *labels.copy(), *columns.values())
        others = (*numbers[COUNTED:NUMBERS].copy(), *own[OWN_COUNTED:].copy())
        infos = dict(zip(self.sessions[0].keys, (*values, *others), strict=True))
        infos["action_mask"] = self._masks.copy() if self.copy else self._masks
        return infos

    @alone
    def state(self) -> NDArray[np.float32]:
        """Return the whole state of each environment, float32 (num_envs, numbers), a new array.

        For the numbers see ``rules.whole_state``; ``state_names`` are their names. Raises
        ResetNeeded before the first reset of an environment.
        """
        self.require_begun()
        states = states_of(self.outputs.addresses, self.sessions[0])
        return states.astype(np.float32)

    @property
    def state_names(self) -> list[str]:
        """The names of the numbers of a state."""
        return self.sessions[0].state_names

    def action_masks(self) -> NDArray[np.bool_]:
        """Return the masks, bool (num_envs, drones, actions), in a new array."""
        return self._masks.astype(np.bool_)

    @alone
    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return the frame of each environment, (height, width, 3), or None without render mode."""
        if self.render_mode is None:
            logger.warn("render() shows nothing without render_mode='rgb_array'")
            return None
        return self.frames()

    def close(self) -> None:
        """Stop the threads."""
        self.stop_threads()

    def _observations(self) -> NDArray[Any]:
        if self.copy:
            return self._written.astype(self._rows.dtype)
        np.copyto(self._rows, self._written, casting="unsafe")
        return self._rows

    def _final(self, ended: Flags) -> dict[str, Any]:
        """Return the last observations and infos of the episodes that have ended."""
        observations = self._written.astype(self._rows.dtype)
        infos = {key: array.copy() for key, array in self.infos().items()}
        for array in (observations, *infos.values()):
            array[~ended] = 0
        return {"final_obs": observations, "_final_obs": ended, "final_info": infos}
