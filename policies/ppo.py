"""Train one network for all drones with PPO (pip install -e ".[ppo]"), in one file.

python policies/ppo.py case8 --steps 200000 --seed 0 --out ppo_case8.npz
desim-uav run case8 --seed 0 --policy ppo_case8.npz

Read it from top to bottom: the options, the networks, a rollout, advantages, the update, the file.
All drones share the network, which is not told which drone it flies. A *forced* step (the drone
returns, charges or has crashed) is part of the rollout, but no decision: the policy learns nothing
from it, and the rewards until the next decision belong to the decision before it, discounted by
gamma for each step. With --central (MAPPO) the critic also sees the whole state of the simulation.
"""

import argparse
import itertools
import math
import platform
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from desim_uav.env import UavParallelVectorEnv
from desim_uav.errors import DesimError, MissingExtraError
from desim_uav.policies.mlp import Mlp, description_of
from desim_uav.run_folder import file_place, world_hash, write_at
from desim_uav.scenario.load import load
from desim_uav.shipped import find_scenario
from desim_uav.spaces import features

try:
    import torch
    from torch import nn
except ModuleNotFoundError:
    print(MissingExtraError("policies/ppo.py", "ppo"), file=sys.stderr)
    sys.exit(MissingExtraError.exit_code)

FIRST_SEED = 2**40
"""The seed of the first environment: no run of one's own begins there."""

DEFAULTS = ("observation={kind: radar}", "reward={kind: qoe, crash: 10}")
"""What a drone sees and is paid for; ``-S observation=… -S reward=…`` change that."""


@dataclass(frozen=True)
class Options:
    """What a training can be told, apart from the scenario; each is an option."""

    steps: int = 200_000  # of all drones together
    seed: int = 0
    worlds: str = "own"  # own: the world of the scenario and the seed; or train, validation, test
    central: bool = False  # a critic that sees the whole state (MAPPO)
    envs: int = 32
    rollout: int = 64  # steps of each environment between two updates
    epochs: int = 4
    minibatches: int = 8
    rate: float = 1e-3  # of Adam; falls linearly to 0
    gamma: float = 0.97
    decay: float = 0.95  # lambda of the generalised advantage estimate
    clip: float = 0.2
    entropy: float = 0.01
    largest_gradient: float = 0.5
    hidden: int = 128  # units of each of the two layers


class Agent(nn.Module):
    """The network that chooses actions (actor), and the one that estimates returns (critic)."""

    def __init__(self, low, scale, state, actions, hidden):
        super().__init__()
        self.register_buffer("low", torch.as_tensor(low))
        self.register_buffer("scale", torch.as_tensor(scale))
        self.actor = layers([len(low), hidden, hidden, actions], last_gain=0.01)
        self.critic = layers([len(low) + state, hidden, hidden, 1], last_gain=1.0)

    def logits(self, seen, mask):
        """The logits of the actions; those of masked ones are as low as can be."""
        logits = self.actor((seen - self.low) * self.scale)
        return torch.where(mask, logits, torch.finfo(logits.dtype).min)

    def value(self, seen, state):
        """The estimated return, of rewards times 1 - gamma."""
        return self.critic(torch.cat([(seen - self.low) * self.scale, state], -1)).squeeze(-1)


def layers(sizes, last_gain):
    """Linear layers with ReLU between them, with orthogonal weights."""
    made = []
    for k, (inputs, outputs) in enumerate(itertools.pairwise(sizes)):
        linear = nn.Linear(inputs, outputs)
        nn.init.orthogonal_(linear.weight, last_gain if k == len(sizes) - 2 else math.sqrt(2))
        nn.init.zeros_(linear.bias)
        made += [linear, nn.ReLU()]
    return nn.Sequential(*made[:-1])


def scaling(world):
    """What maps whole numbers to 0 … 1 by their bounds; other features are about that already."""
    shown = features(world)
    low = [feature.low if feature.whole else 0.0 for feature in shown]
    widths = [max(1.0, feature.high - feature.low) if feature.whole else 1.0 for feature in shown]
    return np.array(low, np.float32), (1.0 / np.array(widths)).astype(np.float32)


class Rollouts:
    """Plays the environments; one tensor (rollout + 1, envs, drones, …) for each quantity."""

    def __init__(self, env, agent, options):
        self.env, self.agent, self.options = env, agent, options
        first = FIRST_SEED + options.seed * options.envs
        seen, infos = env.reset(seed=first)
        shape = (options.rollout + 1, *seen.shape[:2])
        states = env.single_state_space.shape[0] if options.central else 0
        self.seen = torch.zeros(*shape, seen.shape[-1])
        self.masks = torch.zeros(*shape, env.single_action_space.n, dtype=torch.bool)
        self.states = torch.zeros(*shape, states)
        self.actions = torch.zeros(shape, dtype=torch.long)
        self.chances, self.values, self.rewards = torch.zeros(3, *shape)
        self.terminated, self.over = torch.zeros(2, *shape, dtype=torch.bool)
        self.ends = {"qoe1_percent": [], "qoe3_percent": [], "crashes": []}
        self.put(-1, seen, infos)

    def put(self, t, seen, infos):
        """Note what the drones observe at step t."""
        self.seen[t] = torch.from_numpy(seen)
        self.masks[t] = torch.from_numpy(infos["action_mask"] != 0)
        if self.options.central:
            self.states[t] = torch.from_numpy(self.env.state())[:, None]

    @torch.no_grad()
    def play(self):
        """Go on for as many steps as a rollout has, with actions drawn from the policy."""
        for whole in (self.seen, self.masks, self.states, self.terminated, self.over):
            whole[0] = whole[-1]
        for t in range(self.options.rollout):
            logs = self.agent.logits(self.seen[t], self.masks[t]).log_softmax(-1)
            drawn = torch.multinomial(logs.exp().flatten(0, 1), 1).view(logs.shape[:2])
            self.actions[t] = drawn
            self.chances[t] = logs.gather(-1, drawn[..., None]).squeeze(-1)
            self.values[t] = self.agent.value(self.seen[t], self.states[t])
            seen, rewards, terminated, truncated, infos = self.env.step(drawn.numpy())
            self.rewards[t] = torch.from_numpy(rewards)
            self.terminated[t + 1] = torch.from_numpy(terminated)
            self.over[t + 1] = torch.from_numpy(terminated | truncated)
            self.put(t + 1, seen, infos)
            self.note((terminated | truncated)[:, 0], infos)
        self.values[-1] = self.agent.value(self.seen[-1], self.states[-1])

    def note(self, over, infos):
        """Note how the episodes that are over went."""
        for name, values in self.ends.items():
            ended = infos[name][over]
            values.extend(ended.mean(-1).tolist() if ended.ndim > 1 else ended.tolist())

    def advantages(self):
        """The generalised advantage estimates (rollout, envs, drones).

        The sum runs through forced steps undiminished, so that their values cancel out: from a
        decision to the next one it is that of the rewards, with gamma to the power of the steps.
        At a step that is over the environment only begins its next episode: the sum stops there.
        """
        gamma, found = self.options.gamma, torch.zeros_like(self.values)
        forced = self.masks.sum(-1) == 1
        for t in reversed(range(self.options.rollout)):
            following = torch.where(self.terminated[t + 1], 0.0, self.values[t + 1])
            through = torch.where(forced[t + 1], 1.0, self.options.decay) * ~self.over[t + 1]
            gained = self.rewards[t] * (1 - gamma) + gamma * following - self.values[t]
            found[t] = (gained + gamma * through * found[t + 1]) * ~self.over[t]
        return found[:-1]


def update(agent, optimizer, rollouts, options):
    """Improve the networks on a rollout by the clipped objective; return the mean entropy."""
    gains = rollouts.advantages().flatten()
    targets = gains + rollouts.values[:-1].flatten()
    whole = (rollouts.seen, rollouts.masks, rollouts.states, rollouts.actions, rollouts.chances)
    seen, masks, states, actions, chances = (one[:-1].flatten(0, 2) for one in whole)
    lived = (~rollouts.over[:-1]).flatten().nonzero().squeeze(-1)
    entropies = []
    for _ in range(options.epochs):
        mixed = lived[torch.randperm(len(lived))]
        for batch in mixed.chunk(options.minibatches):
            errors = agent.value(seen[batch], states[batch]) - targets[batch]
            loss = 0.5 * errors.square().mean()
            free = batch[masks[batch].sum(-1) > 1]  # the steps at which there was a choice
            if len(free) > 1:
                logs = agent.logits(seen[free], masks[free]).log_softmax(-1)
                ratios = (logs.gather(-1, actions[free, None]).squeeze(-1) - chances[free]).exp()
                gain = (gains[free] - gains[free].mean()) / (gains[free].std() + 1e-8)
                clipped = ratios.clamp(1 - options.clip, 1 + options.clip)
                entropy = -(logs.exp() * logs * masks[free]).sum(-1).mean()
                loss = loss - torch.minimum(ratios * gain, clipped * gain).mean()
                loss = loss - options.entropy * entropy
                entropies.append(entropy.item())
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), options.largest_gradient)
            optimizer.step()
    return float(np.mean(entropies)) if entropies else 0.0


def train(scenario, options, save=lambda network: None, say=lambda line: None):
    """Train for so many steps of all drones. ``save`` gets the network after each update."""
    torch.manual_seed(options.seed)
    torch.set_num_threads(1)  # on several, networks as small as these only wait for each other
    torch.use_deterministic_algorithms(True)
    if options.worlds == "own":
        seed = options.seed if scenario.world_seed is None else scenario.world_seed
        scenario = scenario.model_copy(update={"world_seed": seed})
    worlds = "scenario" if options.worlds == "own" else options.worlds
    env = UavParallelVectorEnv(scenario, options.envs, world_seed=worlds)
    world = env.sessions[0].world
    low, scale = scaling(world)
    states = env.single_state_space.shape[0] if options.central else 0
    agent = Agent(low, scale, states, len(world.actions), options.hidden)
    optimizer = torch.optim.Adam(agent.parameters(), options.rate, eps=1e-5)
    rollouts, began = Rollouts(env, agent, options), time.monotonic()
    of_rollout = options.rollout * options.envs * env.drones
    updates = max(1, options.steps // of_rollout)
    for k in range(updates):
        optimizer.param_groups[0]["lr"] = options.rate * (1 - k / updates)
        rollouts.play()
        entropy = update(agent, optimizer, rollouts, options)
        done, ends = (k + 1) * of_rollout, rollouts.ends
        means = [np.mean(one[-200:]) if one else math.nan for one in ends.values()]
        say(
            f"{done:>10,} steps  {time.monotonic() - began:6.0f} s  reward "
            f"{rollouts.rewards[:-1].mean():6.3f}  entropy {entropy:.3f}  "
            "QoE1 {:.1f} %  QoE3 {:.1f} %  {:.3f} crashes".format(*means)
        )
        save(network_of(agent, world, scenario, options, done))
    return agent, env


def network_of(agent, world, scenario, options, steps):
    """The actor as desim-uav runs it, with the description of where it comes from."""
    one_world = options.worlds == "own"
    training = {"algorithm": "MAPPO" if options.central else "PPO", "steps_done": steps}
    training |= {"command": [Path(sys.argv[0]).name, *sys.argv[1:]], "commit": commit()}
    training |= {"processor": processor(), "torch": torch.__version__}
    about = description_of(world) | {
        "world_seed": scenario.world_seed if one_world else None,
        "world_hash": world_hash(world) if one_world else None,
        "training": training | asdict(options),
    }
    parts = [(one.weight.T, one.bias) for one in agent.actor if isinstance(one, nn.Linear)]
    arrays = tuple(tuple(one.detach().numpy().copy() for one in pair) for pair in parts)
    return Mlp(agent.low.numpy(), agent.scale.numpy(), arrays, about)


def commit():
    """The commit of the checkout, or "" if there is none."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short=12", "HEAD"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    except OSError:
        return ""


def processor():
    """The name of the processor, as far as the system tells."""
    told = Path("/proc/cpuinfo")
    lines = told.read_text(encoding="utf-8").splitlines() if told.exists() else []
    names = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    family = "".join(f", {key} {names[key]}" for key in ("cpu family", "model") if key in names)
    return names.get("model name", platform.processor() or platform.machine()) + family


def main(arguments=None):
    """Train, and write the policy file after each update."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenario", help="a scenario file, or a shipped name: case8")
    parser.add_argument("--out", type=Path, help="the policy file; default: ppo_SCENARIO.npz")
    parser.add_argument("-S", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--quiet", action="store_true", help="show no progress")
    for name, default in asdict(Options()).items():
        how = {"action": "store_true"} if default is False else {"type": type(default)}
        parser.add_argument(f"--{name.replace('_', '-')}", default=default, **how)
    asked = vars(parser.parse_args(arguments))
    options = Options(**{name: asked[name] for name in asdict(Options())})
    try:
        scenario = load(find_scenario(asked["scenario"]), [*DEFAULTS, *asked["overrides"]])
        place = file_place(asked["out"] or Path(f"ppo_{scenario.name}.npz"), "--out")
        say = (lambda line: None) if asked["quiet"] else lambda line: print(line, file=sys.stderr)
        train(scenario, options, lambda network: write_at(place, network.to_bytes()), say)
    except DesimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("interrupted; the policy of the last update is kept, if there was one", file=sys.stderr)
        return 130
    print(f"desim-uav run {asked['scenario']} --policy {place}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
