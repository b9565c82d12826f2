"""Train one network for all drones with proximal policy optimisation (PPO).

python policies/ppo.py case8 --steps 200000 --seed 0 --out ppo_case8.npz
desim-uav run case8 --seed 0 --policy ppo_case8.npz

Read it from top to bottom: options, rollouts, advantages, updates, the file; the networks are those
of desim_uav/learning/actor_critic.py. All drones share one network. A *forced* step (the drone
returns, charges or has crashed) is no decision: the policy learns nothing from it, and the rewards
up to the next decision belong to the one before, discounted by gamma to the power of the time, in
steps. With --central (MAPPO) the critic also sees the whole state. In free flight actions are
normally distributed, and count as from -1 to 1. Slopes are the derivatives of the loss.
"""

import argparse
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # several would only wait for each other
import numpy as np

from desim_uav.disk import file_place, write_at
from desim_uav.env import UavParallelVectorEnv
from desim_uav.errors import DesimError, require_within
from desim_uav.experiment.interrupt import end_politely
from desim_uav.experiment.provenance import command, commit, processor
from desim_uav.learning.actor_critic import Agent, Freely
from desim_uav.policies.mlp import Mlp, description_of, scaling_of
from desim_uav.scenario.load import dump, load
from desim_uav.shipped import find_scenario
from desim_uav.world import build_world

DEFAULTS = ("observation={kind: radar}", "reward={kind: qoe, crash: 10}")
"""What a drone sees and is paid for; ``-S observation=… -S reward=…`` change that."""

SHOWN = ("qoe1_percent", "qoe3_percent", "crashes")  # means over the last 200 episodes
OPTIONS = {
    "steps": (200_000, 1, 2**50, "steps of all drones together"),
    "seed": (0, 0, 2**20, "what the networks, actions and episodes are drawn from"),
    "envs": (32, 1, 2**16, "environments side by side"),
    "rollout": (64, 1, 2**16, "steps of each environment between two updates"),
    "epochs": (2, 1, 100, "passes through a rollout per update"),
    "minibatches": (12, 1, 2**16, "parts of a rollout, each with a step of Adam"),
    "rate": (1e-3, 1e-9, 1.0, "the rate of Adam, which falls linearly to 0"),
    "gamma": (0.97, 0.0, 0.99999, "the discount per step"),
    "decay": (0.95, 0.0, 1.0, "lambda of the generalised advantage estimate"),
    "clip": (0.2, 1e-9, 1.0, "how far the ratio of probabilities counts"),
    "entropy": (0.01, 0.0, 100.0, "the weight of the entropy, which falls linearly to 0"),
    "deviation": (0.6, 1e-3, 10.0, "of the numbers of commands, which falls linearly to a tenth"),
    "hidden": (128, 1, 4096, "units of each of the two hidden layers; of the critic half as many"),
}
"""The default of each option, the least and the greatest value, and what it is."""


def options_of(worlds="own", central=False, **changes):
    """The options of a training, with these changes. Raises UsageError for what cannot be."""
    options = {name: default for name, (default, *_) in OPTIONS.items()} | changes
    require_within(options, {name: bounds for name, (_, *bounds, _) in OPTIONS.items()})
    return argparse.Namespace(worlds=worlds, central=central, **options)


def flat(array):
    """An array (envs, drones, …) as rows, one for each drone."""
    return array.reshape(array.shape[0] * array.shape[1], *array.shape[2:])


class Rollouts:
    """Plays the environments; one array (rollout + 1, envs, drones, …) for each quantity."""

    def __init__(self, env, scaling, options):
        self.env, self.options, self.ends, (self.low, self.scale) = env, options, [], scaling
        seen, infos = env.reset(seed=2**40 + options.seed * options.envs)  # as no run of one's own
        shape, actions = (options.rollout + 1, *seen.shape[:2]), env.single_action_space
        self.seen = np.zeros((*shape, seen.shape[-1]), np.float32)
        self.masks = np.zeros((*shape, infos["action_mask"].shape[-1]), np.bool_)
        self.states = np.zeros((*shape, len(env.state_names) * options.central), np.float32)
        self.actions = np.zeros((*shape, *actions.shape), actions.dtype)
        self.chances, self.values, self.rewards, self.discounts = np.zeros((4, *shape), np.float32)
        self.terminated, self.over = np.zeros((2, *shape), np.bool_)
        self.put(-1, seen, infos)

    def put(self, t, seen, infos):
        """Note what the drones observe at step t."""
        np.multiply(seen - self.low, self.scale, out=self.seen[t])
        self.masks[t] = infos["action_mask"]
        if self.options.central:
            self.states[t] = self.env.state()[:, None]

    def play(self, agent):
        """Go on for as many steps as a rollout has, with actions drawn by the agent."""
        for whole in (self.seen, self.masks, self.states, self.terminated, self.over):
            whole[0] = whole[-1]
        for t in range(self.options.rollout):
            drawn = agent.decide(*(flat(one[t]) for one in (self.seen, self.masks, self.states)))
            for of, one in zip((self.actions, self.chances, self.values), drawn, strict=True):
                of[t] = one.reshape(of.shape[1:])
            seen, self.rewards[t], ended, cut, infos = self.env.step(self.actions[t])
            self.discounts[t] = infos["discount"][:, None]
            self.terminated[t + 1], self.over[t + 1] = ended, ended | cut
            self.put(t + 1, seen, infos)
            for k in self.over[t + 1, :, 0].nonzero()[0]:
                self.ends.append([infos[of][k].mean() for of in SHOWN])
        last = agent.worth(flat(self.seen[-1]), flat(self.states[-1]))[-1]
        self.values[-1] = last.reshape(self.values.shape[1:])

    def advantages(self):
        """The generalised advantage estimates (rollout, envs, drones).

        The sum runs through forced steps undiminished, so that their values cancel out: from a
        decision to the next one it is that of the rewards, each discounted for the time before it.
        At a step that is over the environment only begins its next episode: the sum stops there.
        """
        forced, found = self.masks.sum(-1) == 1, np.zeros_like(self.values)
        for t, gamma in reversed([*enumerate(self.discounts[:-1])]):
            following = np.where(self.terminated[t + 1], 0.0, self.values[t + 1])
            through = np.where(forced[t + 1], 1.0, self.options.decay) * ~self.over[t + 1]
            gained = self.rewards[t] * (1 - self.options.gamma) + gamma * following - self.values[t]
            found[t] = (gained + gamma * through * found[t + 1]) * ~self.over[t]
        return found[:-1]


def update(agent, rollouts, options, rate, weight):
    """Improve the networks on a rollout, by the clipped objective and ``weight`` of entropy."""
    gains = rollouts.advantages()
    of_steps = (rollouts.seen, rollouts.masks, rollouts.states, rollouts.actions, rollouts.chances)
    steps = (*(one[:-1] for one in of_steps), gains, gains + rollouts.values[:-1])
    steps = [one.reshape(gains.size, *one.shape[3:]) for one in steps]
    lived = np.flatnonzero(~rollouts.over[:-1])
    for _ in range(options.epochs):
        for batch in np.array_split(agent.rng.permutation(lived), options.minibatches):
            own = (one.take(batch, 0) for one in steps)
            seen, masks, states, actions, before, gain, targets = own
            layers, of_critic = agent.actor.forward(seen), agent.worth(seen, states)
            logs, of_logs, of_entropy = agent.actions.slopes(layers[-1], masks, actions)
            free = masks.sum(-1) > 1  # where there was a choice
            of_outputs = np.zeros_like(layers[-1])
            if (count := free.sum()) > 1:
                gain = (gain - gain[free].mean()) / (gain[free].std() + 1e-8)
                ratios = np.exp(logs - before)
                clipped = np.clip(ratios, 1 - options.clip, 1 + options.clip)
                push = np.where(ratios * gain <= clipped * gain, ratios * gain, 0.0)
                of_outputs += (free / -count)[:, None] * (
                    push[:, None] * of_logs + weight * of_entropy
                )
            agent.actor.back(layers, of_outputs)
            agent.critic.back(
                of_critic, (of_critic[-1] - targets[:, None]) / np.float32(len(batch))
            )
            agent.adam.step(rate)


def train(scenario, options, save=lambda network: None, say=lambda line: None):
    """Train for so many steps of all drones. ``save`` gets the network after each update."""
    own = scenario.model_copy(update={"seed": options.seed}).effective_world_seed
    worlds = range(own, own + 1) if options.worlds == "own" else options.worlds
    learning = scenario.learning.model_copy(update={"gamma": options.gamma})
    scenario = scenario.model_copy(update={"world_seed": None, "learning": learning})
    env = UavParallelVectorEnv(scenario, options.envs, world_seed=worlds)  # episodes begin afresh
    world = build_world(scenario, own)
    scaling, began = scaling_of(world), time.monotonic()
    training = vars(options) | {"scenario_yaml": dump(world.scenario)}
    about = description_of(world, own=options.worlds == "own")
    rollouts = Rollouts(env, scaling, options)
    sizes = [each.shape[-1] for each in (rollouts.seen, rollouts.states)]
    actions = env.single_action_space
    choices = 0 if actions.shape else actions.n
    agent = Agent(*sizes, actions.shape, choices, options.hidden, options.seed)
    of_rollout = rollouts.rewards[1:].size
    for k in range(updates := max(1, options.steps // of_rollout)):
        left = 1 - k / updates  # the best action is taken in the end, so draws must become certain
        if isinstance(agent.actions, Freely):
            agent.actions.deviation = options.deviation * max(left, 0.1)
        rollouts.play(agent)
        update(agent, rollouts, options, options.rate * left, options.entropy * left)
        done, last = (k + 1) * of_rollout, zip(*rollouts.ends[-200:], strict=True)
        words = [f"reward {rollouts.rewards[:-1].mean():.3f}"]
        words += [f"{name} {np.mean(of):.3f}" for name, of in zip(SHOWN, last, strict=False)]
        say(f"{done:,} steps, {time.monotonic() - began:.0f} s: {', '.join(words)}")
        arrays = tuple((one[:-1].copy(), one[-1].copy()) for one in agent.actor.layers)
        save(Mlp(*scaling, arrays, about | {"training": training | {"steps_done": done}}))
    return agent


def main(arguments=None):
    """Train, and write the policy file after each update."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenario", help="a scenario file, or a shipped name: case8")
    parser.add_argument("--out", type=Path, help="the policy file; default: ppo_SCENARIO.npz")
    parser.add_argument("-S", dest="changes", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--worlds", choices=("own", "train"), default="own", help="to fly in")
    parser.add_argument("--central", action="store_true", help="a critic that sees all (MAPPO)")
    for name, (default, _, _, meaning) in OPTIONS.items():
        parser.add_argument(f"--{name}", type=type(default), default=default, help=meaning)
    asked = vars(parser.parse_args(arguments))
    told = {"numpy": np.__version__, "commit": commit(), "processor": processor()}
    written = ["no file"]

    def save(network):
        network.about["training"] |= told | {"command": command(sys.argv)}
        written.append(write_at(place, network.to_bytes()))

    try:
        name, out, changes = (asked.pop(key) for key in ("scenario", "out", "changes"))
        scenario, options = load(find_scenario(name), [*DEFAULTS, *changes]), options_of(**asked)
        place = file_place(out or Path(f"ppo_{scenario.name}.npz"), "--out", [".npz"])
        train(scenario, options, save, lambda line: print(line, file=sys.stderr))
    except DesimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"interrupted; {written[-1]} has the policy of the last update", file=sys.stderr)
        return 130
    print(f"desim-uav run {name} --policy {place}")
    return 0


if __name__ == "__main__":
    end_politely()
    sys.exit(main())
