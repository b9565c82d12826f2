"""Train one controller of all drones with MaskablePPO (pip install -e ".[sb3]").

python policies/train_maskable_ppo.py case1 model.zip --steps 20000 --seed 0
desim-uav run case1 --seed 0 --policy sb3:model.zip
"""

import argparse
import io
import sys
from pathlib import Path

import gymnasium
import numpy as np
import torch
from sb3_contrib import MaskablePPO
from stable_baselines3.common.env_util import make_vec_env

from desim_uav.disk import file_place, write_at
from desim_uav.env import UavEnv
from desim_uav.env.configure import configured
from desim_uav.errors import DesimError, require_within
from desim_uav.experiment.interrupt import end_politely

ENVS = 8
"""So many runs of the world side by side: drones that go on from each other's ends see little."""


class Restarts(gymnasium.Wrapper):
    """Begins every third episode, or whatever the scenario says, at the drones' starts.

    Where episodes go on from one another, a policy soon stays where it is good to be, and forgets
    how it came there.
    """

    def __init__(self, env):
        super().__init__(env)
        self.every = env.session.scenario.learning.restart_every
        self.begun = 0

    def reset(self, *, seed=None, options=None):
        """Begin the next episode, or a new run."""
        if seed is not None:
            self.np_random = np.random.default_rng(seed)
        if self.begun == 0 or (self.every and self.begun % self.every == 0):
            seed = int(self.np_random.integers(2**32, 2**48))  # no run of one's own begins there
        self.begun += 1
        return self.env.reset(seed=seed, options=options)


def train(scenario, steps, seed):
    """A model that was trained in the world that ``desim-uav run --seed`` draws."""
    scenario = configured(scenario, {"seed": seed})
    scenario = configured(scenario, {"world_seed": scenario.effective_world_seed})
    scenario.require_one_discount("stable-baselines3")
    model = MaskablePPO(
        "MlpPolicy",
        make_vec_env(lambda: Restarts(UavEnv(scenario)), ENVS),
        n_steps=50,
        batch_size=100,
        n_epochs=5,
        learning_rate=1e-3,
        gamma=scenario.learning.gamma,
        ent_coef=0.01,
        seed=seed,
        device="cpu",
    )
    return model.learn(steps)


def main(arguments=None):
    """Train and save."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenario", help="a scenario file, or a shipped name: case5")
    parser.add_argument("file", help="where the model goes: model.zip")
    parser.add_argument("--steps", type=int, default=100_000, help="of all drones together")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args(arguments)
    torch.set_num_threads(1)  # on several, networks as small as these only wait for each other
    try:
        require_within(vars(asked), {"steps": (1, 2**50), "seed": (0, 2**20)})
        place, model = file_place(Path(asked.file), "the model", [".zip"]), io.BytesIO()
        train(asked.scenario, asked.steps, asked.seed).save(model)
        write_at(place, model.getvalue())
    except DesimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("interrupted; no file has been written", file=sys.stderr)
        return 130
    print(f"desim-uav run {asked.scenario} --seed {asked.seed} --policy sb3:{asked.file}")
    return 0


if __name__ == "__main__":
    end_politely()
    sys.exit(main())
