"""Train one network for all drones with SAC or TD3 in free flight (pip install -e ".[sb3]").

python policies/train_continuous.py festival sac.zip --algorithm sac --steps 60000 --seed 0
desim-uav run festival --seed 0 --policy sb3:sac.zip

Every drone of every environment is an environment of its own for stable-baselines3, so what each of
them experiences trains the same network, and the network flies every drone. The scenario says what
a drone observes and is paid for.
"""

import argparse
import io
import sys
from copy import deepcopy
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.vec_env import VecEnv

from desim_uav.disk import file_place, write_at
from desim_uav.env import UavParallelVectorEnv
from desim_uav.env.configure import configured
from desim_uav.errors import DesimError, UsageError, require_within
from desim_uav.experiment.interrupt import end_politely

ENVS = 8
"""So many environments side by side, each of which has all drones of the scenario."""

OPTIONS = {
    "learning_starts": 2000,
    "buffer_size": 60_000,
    "batch_size": 128,
    "gradient_steps": 8,
    "gamma": 0.97,
    "learning_rate": 1e-3,
    "policy_kwargs": {"net_arch": [64, 64]},
}
"""Settings of both algorithms."""


class EachDrone(VecEnv):
    """The drones of ``count`` environments of a scenario in one world, one environment each."""

    metadata: ClassVar = {"render_modes": []}

    def __init__(self, scenario, count, seed):
        if not scenario.free:
            raise UsageError(f"{scenario.name}: needs drones.motion: {{space: free}}")
        scenario.require_one_discount("stable-baselines3")
        world_seed = configured(scenario, {"seed": seed}).effective_world_seed
        scenario = configured(scenario, {"world_seed": None})  # every episode begins afresh
        worlds, mode = range(world_seed, world_seed + 1), AutoresetMode.SAME_STEP
        self.many = UavParallelVectorEnv(scenario, count, autoreset_mode=mode, world_seed=worlds)
        self.begins = 2**40 + seed * count  # as no run of one's own begins
        self.render_mode, one = None, self.many.single_observation_space
        super().__init__(count * self.many.drones, one, self.many.single_action_space)

    def reset(self):
        """Begin an episode everywhere."""
        shown, _ = self.many.reset(seed=self.begins)
        return shown.reshape(self.num_envs, -1)

    def step_async(self, actions):
        """Store the actions of the next step."""
        self.actions = actions.reshape(self.many.action_space.shape)

    def step_wait(self):
        """Step all environments; the step that ends an episode also begins the next one."""
        shown, rewards, terminated, truncated, many_infos = self.many.step(self.actions)
        over, infos = (terminated | truncated).reshape(-1), [{} for _ in range(self.num_envs)]
        for k in np.flatnonzero(over):
            last = many_infos["final_obs"].reshape(self.num_envs, -1)
            cut = not terminated.reshape(-1)[k]
            infos[k] = {"terminal_observation": last[k], "TimeLimit.truncated": cut}
        shown = shown.reshape(self.num_envs, -1)
        return shown, rewards.reshape(-1).astype(np.float32), over, infos

    def close(self):
        """Stop the threads."""
        self.many.close()

    def get_attr(self, attr_name, indices=None):
        """Return an attribute of the environments, once for each."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name, value, indices=None):
        """Raise AttributeError: environments cannot be changed."""
        raise AttributeError(attr_name)

    def env_method(self, method_name, *arguments, indices=None, **keywords):
        """Raise AttributeError: there are no further methods."""
        raise AttributeError(method_name)

    def env_is_wrapped(self, wrapper_class, indices=None):
        """Return False for each, because none is wrapped."""
        return [False for _ in self._get_indices(indices)]


def train(algorithm, scenario, steps, seed, **changes):
    """A model that was trained for so many steps of all drones together."""
    torch.set_num_threads(1)  # on several, networks as small as these only wait for each other
    env = EachDrone(configured(scenario, {}), ENVS, seed)
    options = {**deepcopy(OPTIONS), **changes, "seed": seed, "device": "cpu"}
    if algorithm == "td3":  # whose policy is certain, so that it needs noise to explore
        numbers = np.zeros(env.action_space.shape)
        options["action_noise"] = NormalActionNoise(numbers, numbers + 0.3)
    return {"sac": SAC, "td3": TD3}[algorithm]("MlpPolicy", env, **options).learn(steps)


def main(arguments=None):
    """Train and save."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenario", help="a scenario file, or a shipped name: festival")
    parser.add_argument("file", help="where the model goes: model.zip")
    parser.add_argument("--algorithm", choices=("sac", "td3"), default="sac")
    parser.add_argument("--steps", type=int, default=60_000, help="of all drones together")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args(arguments)
    try:
        require_within(vars(asked), {"steps": (1, 2**50), "seed": (0, 2**20)})
        place, model = file_place(Path(asked.file), "the model", [".zip"]), io.BytesIO()
        train(asked.algorithm, asked.scenario, asked.steps, asked.seed).save(model)
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
