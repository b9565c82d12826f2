"""Train one network for all drones with PPO (pip install -e ".[ppo]"), in one file.

python policies/ppo.py case8 --steps 200000 --seed 0 --out ppo_case8.npz
desim-uav run case8 --seed 0 --policy ppo_case8.npz

Read it from top to bottom: options, networks, rollouts, advantages, updates, the file. All drones
share one network. A *forced* step (the drone returns, charges or has crashed) is no decision: the
policy learns nothing from it, and the rewards up to the next decision belong to the one before,
discounted by gamma to the power of the time, in steps. With --central (MAPPO) the critic also sees
the whole state. In free flight actions are normally distributed, and count as from -1 to 1.
"""

import argparse
import itertools
import sys
import time
from pathlib import Path

import numpy as np

from desim_uav.disk import file_place, write_at
from desim_uav.env import UavParallelVectorEnv
from desim_uav.errors import DesimError, MissingExtraError, UsageError
from desim_uav.experiment.provenance import command, commit, processor
from desim_uav.policies.mlp import Mlp, description_of, scaling_of
from desim_uav.scenario.load import dump, load
from desim_uav.shipped import find_scenario
from desim_uav.world import build_world

try:
    import torch
    from torch import distributions, nn
except ModuleNotFoundError:
    print(MissingExtraError("policies/ppo.py", "ppo"), file=sys.stderr)
    sys.exit(MissingExtraError.exit_code)

DEFAULTS = ("observation={kind: radar}", "reward={kind: qoe, crash: 10}")
"""What a drone sees and is paid for; ``-S observation=… -S reward=…`` change that."""

SHOWN = ("qoe1_percent", "qoe3_percent", "crashes")  # means over the last 200 episodes
OPTIONS = {
    "steps": (200_000, 1, 2**50, "steps of all drones together"),
    "seed": (0, 0, 2**20, "what the networks, actions and episodes are drawn from"),
    "envs": (32, 1, 2**16, "environments side by side"),
    "rollout": (64, 1, 2**16, "steps of each environment between two updates"),
    "epochs": (4, 1, 100, "passes through a rollout per update"),
    "minibatches": (8, 1, 2**16, "parts of a rollout, each with a step of Adam"),
    "rate": (1e-3, 1e-9, 1.0, "the rate of Adam, which falls linearly to 0"),
    "gamma": (0.97, 0.0, 0.99999, "the discount per step"),
    "decay": (0.95, 0.0, 1.0, "lambda of the generalised advantage estimate"),
    "clip": (0.2, 1e-9, 1.0, "how far the ratio of probabilities counts"),
    "entropy": (0.01, 0.0, 100.0, "the weight of the entropy, which falls linearly to 0"),
    "deviation": (0.6, 1e-3, 10.0, "of the numbers of commands, which falls linearly to a tenth"),
    "hidden": (128, 1, 4096, "units of each of the two hidden layers"),
}
"""The default of each option, the least and the greatest value, and what it is."""


def options_of(worlds="own", central=False, **changes):
    """The options of a training, with these changes. Raises UsageError for what cannot be."""
    options = {name: default for name, (default, *_) in OPTIONS.items()} | changes
    for name, (_, least, most, _) in OPTIONS.items():
        if not least <= options[name] <= most:
            raise UsageError(f"--{name} {options[name]}: must be from {least} to {most}")
    return argparse.Namespace(worlds=worlds, central=central, **options)


class Agent(nn.Module):
    """The network that chooses actions (actor), and the one that estimates returns (critic)."""

    def __init__(self, seen, state, actions, hidden):
        super().__init__()
        self.actor = layers(seen, hidden, hidden, *(actions.shape or [actions.n]), last_gain=0.01)
        self.critic = layers(seen + state, hidden, hidden, 1, last_gain=1.0)
        self.free, self.deviation = bool(actions.shape), 1.0

    def policy(self, seen, mask):
        """The distribution of actions, which gives masked ones the probability 0."""
        told = self.actor(seen)
        if self.free:
            return distributions.Independent(distributions.Normal(told, self.deviation), 1)
        return distributions.Categorical(logits=torch.where(mask, told, -torch.inf))

    def value(self, seen, state):
        """The estimated return, of rewards times 1 - gamma."""
        return self.critic(torch.cat([seen, state], -1)).squeeze(-1)


def layers(*sizes, last_gain):
    """Linear layers with ReLU between them, with orthogonal weights."""
    made = [nn.Linear(*pair) for pair in itertools.pairwise(sizes)]
    for one in made:
        nn.init.orthogonal_(one.weight, last_gain if one is made[-1] else 2**0.5)
        nn.init.zeros_(one.bias)
    return nn.Sequential(*[part for one in made for part in (one, nn.ReLU())][:-1])


class Rollouts:
    """Plays the environments; one tensor (rollout + 1, envs, drones, …) for each quantity."""

    def __init__(self, env, scaling, options):
        self.env, self.options, self.ends, (self.low, self.scale) = env, options, [], scaling
        seen, infos = env.reset(seed=2**40 + options.seed * options.envs)  # as no run of one's own
        shape = (options.rollout + 1, *seen.shape[:2])
        self.seen = torch.zeros(*shape, seen.shape[-1])
        self.masks = torch.zeros(*shape, infos["action_mask"].shape[-1], dtype=torch.bool)
        self.states = torch.zeros(*shape, len(env.state_names) if options.central else 0)
        self.actions = torch.zeros(*shape, *env.single_action_space.shape)
        self.chances, self.values, self.rewards, self.discounts = torch.zeros(4, *shape)
        self.terminated, self.over = torch.zeros(2, *shape, dtype=torch.bool)
        self.put(-1, seen, infos)

    def put(self, t, seen, infos):
        """Note what the drones observe at step t."""
        self.seen[t] = torch.from_numpy((seen - self.low) * self.scale)
        self.masks[t] = torch.from_numpy(infos["action_mask"] != 0)
        if self.options.central:
            self.states[t] = torch.from_numpy(self.env.state())[:, None]

    @torch.no_grad()
    def play(self, agent):
        """Go on for as many steps as a rollout has, with actions drawn from the policy."""
        for whole in (self.seen, self.masks, self.states, self.terminated, self.over):
            whole[0] = whole[-1]
        for t in range(self.options.rollout):
            policy = agent.policy(self.seen[t], self.masks[t])
            self.actions[t] = drawn = policy.sample()
            self.chances[t] = policy.log_prob(drawn)
            self.values[t] = agent.value(self.seen[t], self.states[t])
            seen, rewards, ended, cut, infos = self.env.step(drawn.numpy())
            paid, over = (rewards, infos["discount"][:, None]), ended | cut
            self.rewards[t], self.discounts[t] = map(torch.from_numpy, paid)
            self.terminated[t + 1], self.over[t + 1] = map(torch.from_numpy, (ended, over))
            self.put(t + 1, seen, infos)
            self.ends += [[infos[of][k].mean() for of in SHOWN] for k in over[:, 0].nonzero()[0]]
        self.values[-1] = agent.value(self.seen[-1], self.states[-1])

    def advantages(self):
        """The generalised advantage estimates (rollout, envs, drones).

        The sum runs through forced steps undiminished, so that their values cancel out: from a
        decision to the next one it is that of the rewards, each discounted for the time before it.
        At a step that is over the environment only begins its next episode: the sum stops there.
        """
        forced, found = self.masks.sum(-1) == 1, torch.zeros_like(self.values)
        for t, gamma in reversed([*enumerate(self.discounts[:-1])]):
            following = torch.where(self.terminated[t + 1], 0.0, self.values[t + 1])
            through = torch.where(forced[t + 1], 1.0, self.options.decay) * ~self.over[t + 1]
            gained = self.rewards[t] * (1 - self.options.gamma) + gamma * following - self.values[t]
            found[t] = (gained + gamma * through * found[t + 1]) * ~self.over[t]
        return found[:-1]


def update(agent, optimizer, rollouts, options, weight):
    """Improve the networks on a rollout, by the clipped objective and ``weight`` of entropy."""
    gains = rollouts.advantages().flatten()
    targets = gains + rollouts.values[:-1].flatten()
    whole = (rollouts.seen, rollouts.masks, rollouts.states, rollouts.actions, rollouts.chances)
    seen, masks, states, actions, chances = (one[:-1].flatten(0, 2) for one in whole)
    lived = (~rollouts.over[:-1]).flatten().nonzero().squeeze(-1)
    for _ in range(options.epochs):
        for batch in lived[torch.randperm(len(lived))].chunk(options.minibatches):
            loss = 0.5 * (agent.value(seen[batch], states[batch]) - targets[batch]).square().mean()
            free = batch[masks[batch].sum(-1) > 1]  # the steps at which there was a choice
            if len(free) > 1:
                policy = agent.policy(seen[free], masks[free])
                ratios = (policy.log_prob(actions[free]) - chances[free]).exp()
                gain = (gains[free] - gains[free].mean()) / (gains[free].std() + 1e-8)
                clipped = ratios.clamp(1 - options.clip, 1 + options.clip)
                bonus = weight * policy.entropy().mean()
                loss -= torch.minimum(ratios * gain, clipped * gain).mean() + bonus
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
            optimizer.step()


def train(scenario, options, save=lambda network: None, say=lambda line: None):
    """Train for so many steps of all drones. ``save`` gets the network after each update."""
    torch.manual_seed(options.seed)
    torch.set_num_threads(1)  # on several, networks as small as these only wait for each other
    torch.use_deterministic_algorithms(True)
    own = scenario.model_copy(update={"seed": options.seed}).effective_world_seed
    worlds = range(own, own + 1) if options.worlds == "own" else options.worlds
    learning = scenario.learning.model_copy(update={"gamma": options.gamma})
    scenario = scenario.model_copy(update={"world_seed": None, "learning": learning})
    env = UavParallelVectorEnv(scenario, options.envs, world_seed=worlds)  # episodes begin afresh
    world = build_world(scenario, own)
    rollouts, began = Rollouts(env, scaling_of(world), options), time.monotonic()
    sizes = [each.shape[-1] for each in (rollouts.seen, rollouts.states)]
    agent = Agent(*sizes, env.single_action_space, options.hidden)
    optimizer = torch.optim.Adam(agent.parameters(), options.rate, eps=1e-5)
    of_rollout = rollouts.rewards[1:].numel()
    for k in range(updates := max(1, options.steps // of_rollout)):
        left = 1 - k / updates  # the best action is taken in the end, so draws must become certain
        optimizer.param_groups[0]["lr"] = options.rate * left
        agent.deviation = options.deviation * max(left, 0.1)
        rollouts.play(agent)
        update(agent, optimizer, rollouts, options, options.entropy * left)
        done, last = (k + 1) * of_rollout, zip(*rollouts.ends[-200:], strict=True)
        words = [f"reward {rollouts.rewards[:-1].mean():.3f}"]
        words += [f"{name} {np.mean(of):.3f}" for name, of in zip(SHOWN, last, strict=False)]
        say(f"{done:,} steps, {time.monotonic() - began:.0f} s: {', '.join(words)}")
        save(network_of(agent, world, options, done))
    return agent


def network_of(agent, world, options, steps):
    """The actor as desim-uav runs it, with a description of where it comes from."""
    training = vars(options) | {"steps_done": steps, "scenario_yaml": dump(world.scenario)}
    about = description_of(world, own=options.worlds == "own") | {"training": training}
    pairs = [(one.weight.T.detach(), one.bias.detach()) for one in agent.actor[::2]]
    arrays = tuple((weights.numpy().copy(), biases.numpy().copy()) for weights, biases in pairs)
    return Mlp(*scaling_of(world), arrays, about)


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
    told = {"torch": torch.__version__, "commit": commit(), "processor": processor()}

    def save(network):
        network.about["training"] |= told | {"command": command(sys.argv)}
        write_at(place, network.to_bytes())

    try:
        name, out, changes = (asked.pop(key) for key in ("scenario", "out", "changes"))
        scenario, options = load(find_scenario(name), [*DEFAULTS, *changes]), options_of(**asked)
        place = file_place(out or Path(f"ppo_{scenario.name}.npz"), "--out")
        train(scenario, options, save, lambda line: print(line, file=sys.stderr))
    except DesimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"interrupted; {place} has the policy of the last update", file=sys.stderr)
        return 130
    print(f"desim-uav run {name} --policy {place}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
