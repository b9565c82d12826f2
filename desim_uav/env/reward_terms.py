"""An environment whose reward is a vector, in the conventions of MO-Gymnasium."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from desim_uav.engine.constants import term_names
from desim_uav.env.single import UavEnv
from desim_uav.errors import ScenarioError

Vector = NDArray[np.float32]


class UavMoEnv(UavEnv):
    """``UavEnv`` with the terms of the reward as a vector, for learners with several objectives.

    ``step`` returns a float32 array of shape (terms,) in the place of the reward, as environments
    of MO-Gymnasium do; ``reward_space`` describes it. Entry k is the mean over the drones of the
    term ``reward_terms[k]``, the same number as ``reward_TERM`` in the info. The sum of the entries
    is the reward of ``UavEnv``, but for rounding. MO-Gymnasium is not needed.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        """Make the environment of a scenario, with the arguments of ``UavEnv``.

        Raises the errors of ``UavEnv``, and ScenarioError if the reward does not work on rows,
        because its terms are then not known before an episode.
        """
        super().__init__(*args, **options)
        self.reward_terms = term_names(self.session.world)
        if not self.reward_terms:
            name = type(self.session.scenario.reward).__name__
            raise ScenarioError(
                f"reward: {name!r} does not name its terms; a vector of rewards needs a reward "
                "over rows (RowReward)"
            )
        count = (len(self.reward_terms),)
        self.reward_space = Box(-np.inf, np.inf, count, np.float32)
        self.reward_dim = len(self.reward_terms)

    def step(  # type: ignore[override]
        self, action: object
    ) -> tuple[NDArray[Any], Vector, bool, bool, dict[str, Any]]:
        """Take one action per drone and run to the next decision epoch (see ``UavEnv.step``)."""
        observation, _, terminated, truncated, info = super().step(action)
        paid = np.array([info[f"reward_{name}"] for name in self.reward_terms], np.float32)
        return observation, paid, terminated, truncated, info
