"""Train one network for all drones with BenchMARL (pip install -e ".[benchmarl]").

python policies/train_benchmarl.py case8 mappo.npz --algorithm mappo --steps 200000 --seed 0
desim-uav run case8 --seed 0 --policy mappo.npz

BenchMARL needs an environment of its own; a run needs neither BenchMARL nor PyTorch.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from desim_uav.disk import file_place
from desim_uav.errors import DesimError, require_within
from desim_uav.experiment.interrupt import end_politely
from desim_uav.scenario.load import load
from desim_uav.shipped import find_scenario

DEFAULTS = ("observation={kind: radar}", "reward={kind: qoe, crash: 10}")
"""What a drone sees and is paid for; ``-S observation=… -S reward=…`` change that."""

ALGORITHMS = ("mappo", "ippo", "qmix", "vdn", "iql")

ENVS = 32
"""Environments side by side."""

ROLLOUT = 60
"""Steps of each environment between two updates."""


def settings_of(iterations, folder, gamma):
    """The settings of an experiment for networks as small as these, on the CPU."""
    from benchmarl.experiment import ExperimentConfig

    settings = ExperimentConfig.get_from_yaml()
    settings.max_n_iters, settings.max_n_frames = iterations, None
    settings.gamma = gamma
    settings.evaluation = False
    settings.loggers = ["csv"]
    settings.create_json = False
    settings.save_folder = str(folder)
    settings.lr = 1e-3
    settings.clip_grad_val = 0.5
    settings.on_policy_n_envs_per_worker = settings.off_policy_n_envs_per_worker = ENVS
    settings.on_policy_collected_frames_per_batch = ENVS * ROLLOUT
    settings.on_policy_minibatch_size = ENVS * ROLLOUT // 8
    settings.on_policy_n_minibatch_iters = 4
    settings.off_policy_collected_frames_per_batch = ENVS * ROLLOUT
    settings.off_policy_n_optimizer_steps = 64
    settings.off_policy_train_batch_size = 256
    settings.off_policy_memory_size = 100_000
    return settings


def algorithm_of(name):
    """The settings of an algorithm."""
    from benchmarl.algorithms import algorithm_config_registry

    algorithm = algorithm_config_registry[name].get_from_yaml()
    if name in ("mappo", "ippo"):
        algorithm.entropy_coef = 0.01
        algorithm.lmbda = 0.95
        algorithm.share_param_critic = name == "ippo"  # MAPPO: what each drone can expect differs
    return algorithm


def experiment(
    scenario, folder, name="mappo", steps=200_000, seed=0, worlds="own", gamma=0.97, callbacks=()
):
    """An experiment of BenchMARL that is ready to run. ``steps`` are those of all drones."""
    import torch
    from benchmarl.experiment import Experiment
    from benchmarl.models.mlp import MlpConfig

    from desim_uav.env.benchmarl import UavTask

    torch.set_num_threads(1)  # on several, networks as small as these only wait for each other
    own = scenario.model_copy(update={"seed": seed}).effective_world_seed
    scenario = scenario.model_copy(update={"world_seed": None})  # every episode begins afresh
    task = UavTask.of(scenario, world_seed=range(own, own + 1) if worlds == "own" else worlds)
    layers = [128, 128], torch.nn.Linear, torch.nn.ReLU  # what a policy file can hold
    iterations = max(1, steps // (ENVS * ROLLOUT * scenario.drone_count))
    return Experiment(
        task=task,
        algorithm_config=algorithm_of(name),
        model_config=MlpConfig(*layers),
        critic_model_config=MlpConfig(*layers),
        seed=seed,
        config=settings_of(iterations, folder, gamma),
        callbacks=list(callbacks),
    )


def main(arguments=None):
    """Train, and write the policy file after each update."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenario", help="a scenario file, or a shipped name: case8")
    parser.add_argument("file", type=Path, help="the policy file: mappo.npz")
    parser.add_argument("-S", dest="changes", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--algorithm", choices=ALGORITHMS, default="mappo")
    parser.add_argument("--steps", type=int, default=200_000, help="of all drones together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--worlds", choices=("own", "train"), default="own", help="to fly in")
    parser.add_argument("--folder", type=Path, help="where BenchMARL puts its tables and pickles")
    asked = parser.parse_args(arguments)
    try:
        train(asked)
    except DesimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt as end:
        written = str(end) or "no file"
        print(f"interrupted; {written} has the policy of the last update", file=sys.stderr)
        return 130
    print(f"desim-uav run {asked.scenario} --seed {asked.seed} --policy {asked.file}")
    return 0


def train(asked):
    """Train what is asked for. Raises DesimError, before anything begins."""
    require_within(vars(asked), {"steps": (1, 2**50), "seed": (0, 2**20)})
    file_place(asked.file, "the policy file")
    scenario = load(find_scenario(asked.scenario), [*DEFAULTS, *asked.changes])
    from desim_uav.env.benchmarl import SavePolicy  # raises MissingExtraError

    with tempfile.TemporaryDirectory() as unwanted:
        folder = (asked.folder or Path(unwanted)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        saving = [SavePolicy(asked.file)]
        options = (asked.algorithm, asked.steps, asked.seed, asked.worlds)
        training = experiment(scenario, folder, *options, callbacks=saving)  # writes the file
        try:
            training.run()
        except KeyboardInterrupt:
            raise KeyboardInterrupt(asked.file) from None


if __name__ == "__main__":
    end_politely()
    sys.exit(main())
