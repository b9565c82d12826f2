"""Train the drones with MAPPO of BenchMARL (extra marl-test, in an environment of its own).

python policies/train_benchmarl.py case8 runs/mappo --iterations 10 --seed 0

The networks stay with BenchMARL: ``desim-uav run`` cannot fly them.
"""

import argparse
from pathlib import Path

import torch
from benchmarl.algorithms import MappoConfig
from benchmarl.environments import TaskClass
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig
from torchrl.envs.libs.pettingzoo import PettingZooWrapper

from desim_uav import UavParallelEnv

ENVS = 4
"""Environments side by side."""

EPISODES = 4
"""Episodes of each environment between two updates."""


class DronesTask(TaskClass):
    """A scenario as a task of BenchMARL; ``config`` holds the arguments of ``UavParallelEnv``.

    BenchMARL's networks take real numbers, so the scenario's observation must be ``local``.
    """

    @staticmethod
    def env_name():
        """The folder in which BenchMARL would look for settings of the task."""
        return "desim_uav"

    def get_env_fun(self, num_envs, continuous_actions, seed, device):
        """What makes an environment."""
        return lambda: PettingZooWrapper(UavParallelEnv(**self.config), seed=seed, device=device)

    def supports_continuous_actions(self):
        """Actions are discrete."""
        return False

    def supports_discrete_actions(self):
        """Actions are discrete."""
        return True

    def has_state(self):
        """There is no state beside the observations; MAPPO's critic sees all of these."""
        return False

    def has_render(self, env):
        """Frames only if the environment was asked for them."""
        return env.render_mode == "rgb_array"

    def max_steps(self, env):
        """The steps of an episode."""
        return env.session.scenario.episode.steps

    def group_map(self, env):
        """One group of all drones."""
        return env.group_map

    def state_spec(self, env):
        """There is no state beside the observations."""
        return

    def observation_spec(self, env):
        """What the networks see."""
        return _only("observation", env)

    def action_mask_spec(self, env):
        """What says which actions are allowed."""
        return _only("action_mask", env)

    def info_spec(self, env):
        """What else is told."""
        return _only("info", env)

    def action_spec(self, env):
        """One action per drone."""
        return env.full_action_spec


def _only(kept, env):
    """The specification of what is shown, with one key per group."""
    spec = env.observation_spec.clone()
    for group in env.group_map:
        for key in set(spec[group].keys()) - {kept}:
            del spec[group][key]
    return spec


def experiment(scenario, folder, seed, iterations, config=None):
    """MAPPO with shared networks on a scenario, in the world of seed 0."""
    settings = ExperimentConfig.get_from_yaml()
    steps = UavParallelEnv(scenario, config).session.scenario.episode.steps
    settings.max_n_iters = iterations
    settings.max_n_frames = None
    settings.on_policy_n_envs_per_worker = ENVS
    settings.on_policy_collected_frames_per_batch = ENVS * EPISODES * steps
    settings.on_policy_minibatch_size = 4 * steps
    settings.on_policy_n_minibatch_iters = 5
    settings.lr = 1e-3
    settings.evaluation = False
    settings.loggers = ["csv"]
    settings.create_json = False
    settings.save_folder = str(folder)
    changes = {"observation.kind": "local", "world_seed": 0, **(config or {})}
    return Experiment(
        task=DronesTask("DRONES", {"scenario": scenario, "config": changes, "engine": "batch"}),
        algorithm_config=MappoConfig.get_from_yaml(),
        model_config=MlpConfig.get_from_yaml(),
        critic_model_config=MlpConfig.get_from_yaml(),
        seed=seed,
        config=settings,
    )


def main(arguments=None):
    """Train."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenario", help="a scenario file, or a shipped name: case5")
    parser.add_argument("folder", type=Path, help="where BenchMARL puts its tables")
    parser.add_argument("--iterations", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args(arguments)
    asked.folder.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)  # on several, networks as small as these only wait for each other
    experiment(asked.scenario, asked.folder.resolve(), asked.seed, asked.iterations).run()


if __name__ == "__main__":
    main()
