"""Train the drones with PPO of RLlib (pip install -e ".[rllib]" in an environment of its own).

python policies/train_rllib.py case1 checkpoint --steps 20000 --seed 0
desim-uav run case1 --seed 0 --policy rllib:checkpoint
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import torch
from ray import tune
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.connectors.env_to_module import MeanStdFilter
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv

from desim_uav import UavParallelEnv
from desim_uav.env.configure import configured
from desim_uav.errors import DesimError, require_within
from desim_uav.experiment.interrupt import end_politely
from desim_uav.policies.rllib import save
from desim_uav.policies.rllib.masking import AddActionMask, EncodeObservation, MaskedModule

ENVS = 8
"""So many runs of the world side by side: drones that go on from each other's ends see little."""

STEPS = 400
"""Steps of all environments between two updates."""


class Restarts(ParallelPettingZooEnv):
    """Begins every third episode, or whatever the scenario says, at the drones' starts.

    Where episodes go on from one another, a policy soon stays where it is good to be, and forgets
    how it came there.
    """

    def __init__(self, scenario):
        super().__init__(UavParallelEnv(scenario))
        self.every = scenario.learning.restart_every
        self.rng = np.random.default_rng()
        self.begun = 0

    def reset(self, *, seed=None, options=None):
        """Begin the next episode, or a new run."""
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        seed = None
        if self.begun == 0 or (self.every and self.begun % self.every == 0):
            seed = int(self.rng.integers(2**32, 2**48))  # no run of one's own begins there
        self.begun += 1
        return super().reset(seed=seed, options=options)


def connectors(env=None, spaces=None, device=None):
    """What is done to an observation before the network sees it."""
    return [EncodeObservation(), MeanStdFilter(multi_agent=True), AddActionMask()]


def configuration(scenario, seed, shared=False):
    """PPO in the world that ``desim-uav run --seed`` draws: a network a drone, or one for all."""
    scenario = configured(scenario, {"seed": seed})
    scenario = configured(scenario, {"world_seed": scenario.effective_world_seed})
    scenario.require_one_discount("RLlib")
    drones = [f"drone_{drone}" for drone in range(scenario.drone_count)]
    tune.register_env("drones", lambda _: Restarts(scenario))
    return (
        PPOConfig()
        .environment("drones")
        .multi_agent(
            policies=["all"] if shared else drones,
            policy_mapping_fn=lambda agent, episode, **_: "all" if shared else agent,
        )
        .env_runners(
            num_env_runners=0,
            num_envs_per_env_runner=ENVS,
            rollout_fragment_length=STEPS // ENVS,
            env_to_module_connector=connectors,
        )
        .rl_module(
            rl_module_spec=RLModuleSpec(module_class=MaskedModule),
            model_config=DefaultModelConfig(fcnet_hiddens=[64, 64], vf_share_layers=False),
        )
        .training(
            train_batch_size_per_learner=STEPS,
            minibatch_size=100,
            num_epochs=5,
            lr=1e-3,
            gamma=scenario.learning.gamma,
            entropy_coeff=0.01,
        )
        .debugging(seed=seed, log_level="ERROR")
    )


def train(scenario, steps, seed, shared=False):
    """An algorithm that has learned for so many steps of all drones together."""
    algorithm = configuration(scenario, seed, shared).build_algo()
    for _ in range(max(1, steps // STEPS)):
        algorithm.train()
    return algorithm


def main(arguments=None):
    """Train and save."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenario", help="a scenario file, or a shipped name: case5")
    parser.add_argument("folder", help="where RLlib's checkpoint goes, and what a run reads of it")
    parser.add_argument("--steps", type=int, default=100_000, help="of all drones together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--shared", action="store_true", help="one network for all drones")
    asked = parser.parse_args(arguments)
    torch.set_num_threads(1)  # on several, networks as small as these only wait for each other
    written = "no file has been written"
    try:
        require_within(vars(asked), {"steps": (1, 2**50), "seed": (0, 2**20)})
        algorithm = train(asked.scenario, asked.steps, asked.seed, asked.shared)
        written = f"the checkpoint in {asked.folder} may be incomplete"
        algorithm.save_to_path(Path(asked.folder).resolve())  # to go on with it in RLlib
        save(algorithm, asked.folder)  # for the run
    except DesimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"interrupted; {written}", file=sys.stderr)
        return 130
    algorithm.stop()
    print(f"desim-uav run {asked.scenario} --seed {asked.seed} --policy rllib:{asked.folder}")
    return 0


if __name__ == "__main__":
    end_politely()
    sys.exit(main())
