"""Train a network by imitation, and improve it by a search with exact forks, in one file.

python policies/expert.py case8 --seed 0 --out expert_case8.npz
desim-uav run case8 --policy expert_case8.npz

Read it from top to bottom: options, symmetries, the network, the city, the search, learning, the
file. First the network learns what a planner (``--teacher``) would do in the states that the
network's own flights lead to (DAgger). Then, in such states, each drone tries each of its commands
in a fork of the simulation, while the others keep to theirs; all go on by the network for
``--horizon`` steps, and the network's estimate of the value stands for the time after that. What
the tries gain is what the network learns next: commands become more probable by their gains.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from desim_uav.disk import file_place, write_at
from desim_uav.engine.compiled.forks import Forks
from desim_uav.env import UavParallelVectorEnv
from desim_uav.errors import DesimError, MissingExtraError, UsageError
from desim_uav.experiment.provenance import command, commit, processor
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import Action
from desim_uav.policies import load_policy
from desim_uav.policies.mlp import Mlp, description_of, scaling_of
from desim_uav.scenario.load import dump, load
from desim_uav.shipped import find_scenario

try:
    import torch
    from torch import nn
    from torch.nn import functional
except ModuleNotFoundError:
    print(MissingExtraError("policies/expert.py", "ppo"), file=sys.stderr)
    sys.exit(MissingExtraError.exit_code)

DEFAULTS = (
    "observation={kind: radar, cells_x: 7, cells_y: 7, demand: false}",
    "reward={kind: qoe, difference: false, crash: 20}",
)
"""What a drone sees, and what the search adds up: the team's QoE1 and QoE3."""

FIRST_WORLD = 1_000_000
"""The first world to train in; each pass takes the next ones, below the worlds for validation."""

OPTIONS = {
    "seed": (0, 0, 9, "what the network, the worlds and the order of samples are drawn from"),
    "envs": (32, 1, 4096, "environments side by side, each in a world of its own"),
    "steps": (60, 1, 2**16, "steps of each environment in a pass, in worlds that are new"),
    "imitations": (8, 0, 4096, "passes that learn from the teacher"),
    "searches": (12, 0, 4096, "passes that learn from the search"),
    "every": (4, 1, 4096, "steps of an environment between two states that are searched"),
    "horizon": (10, 1, 4096, "steps of a try"),
    "epochs": (3, 1, 100, "times that a pass learns from all samples that are kept"),
    "keep": (8, 1, 4096, "the passes whose samples are kept"),
    "batch": (512, 1, 2**16, "samples of a step of Adam"),
    "rate": (1e-3, 1e-9, 1.0, "the rate of Adam, which falls linearly to 0"),
    "gamma": (0.97, 0.0, 0.99999, "the discount per step"),
    "decay": (0.9, 0.0, 1.0, "lambda of the returns that the value learns"),
    "sharp": (8.0, 0.0, 1e6, "the log of how much more probable a gain of 1 makes a command"),
    "smooth": (0.05, 0.0, 1.0, "what the commands share that the teacher does not give"),
    "hidden": (192, 1, 4096, "units of the first layer; the second has half of them"),
}
"""The default of each option, the least and the greatest value, and what it is."""


def options_of(teacher="greedy:horizon=12", **changes):
    """The options of a training, with these changes. Raises UsageError for what cannot be."""
    options = {name: default for name, (default, *_) in OPTIONS.items()} | changes
    for name, (_, least, most, _) in OPTIONS.items():
        if not least <= options[name] <= most:
            raise UsageError(f"--{name} {options[name]}: must be from {least} to {most}")
    return argparse.Namespace(teacher=teacher, **options)


def symmetries(world):
    """The flips and transpositions of a map, under which what is seen and done is turned alike.

    Each is three arrays: the feature that a turned one shows, its sign, and the action that a
    turned one is. Places and bearings must be numbers around 0.
    """
    radar, names = world.scenario.observation, [one.name for one in world.features_of_types[0]]
    shape, kinds = radar.shape(world.facts), [getattr(one, "action", one) for one in world.actions]
    own = len(names) - int(np.prod(shape))
    cells = np.arange(own, len(names)).reshape(shape)

    def operation(turned, swaps, negated, moves):
        features, signs = np.arange(len(names)), np.ones(len(names), np.float32)
        features[own:] = turned.reshape(-1)
        for one, other in swaps:
            features[names.index(one)] = names.index(other)
        for name in negated:
            signs[names.index(name)] = -1.0
        return features, signs, np.array([kinds.index(moves.get(one, one)) for one in kinds])

    north, south, east, west = Action.FORWARD, Action.BACKWARD, Action.RIGHT, Action.LEFT
    limited = "bearing_sin" in names
    steps = [
        operation(cells[..., ::-1, :], (), ["x"] + ["bearing_sin"] * limited, {east: west, west: east}),
        operation(cells[..., ::-1], (), ["y"] + ["bearing_cos"] * limited, {north: south, south: north}),
    ]
    grid = world.grid
    if shape[2] == shape[3] and grid.width_m == grid.depth_m and grid.cells[0] == grid.cells[1]:
        swaps = [("x", "y"), ("y", "x")]
        swaps += [("bearing_sin", "bearing_cos"), ("bearing_cos", "bearing_sin")] * limited
        turns = {north: east, east: north, south: west, west: south}
        steps.append(operation(cells.swapaxes(2, 3), swaps, (), turns))
    found = [(np.arange(len(names)), np.ones(len(names), np.float32), np.arange(len(kinds)))]
    if any(world.scenario.wind_mps):
        return found
    for features, signs, actions in steps:
        found += [(f[features], s[features] * signs, a[actions]) for f, s, a in found]
    return found


def footprints(world):
    """The weights (units, features) that add up whom a footprint would cover, cell by cell around.

    Users in coarser cells count by the part of the cell that is covered and not in the finer one.
    The units count free and own users, those of other drones, and open requests that wait.
    """
    radar, facts = world.scenario.observation, world.facts
    scales, channels, columns, rows = shape = radar.shape(facts)
    size_m = np.array([world.grid.width_m, world.grid.depth_m]) / world.grid.cells
    middle, inside = np.array([columns, rows]) // 2, np.zeros(shape[:1] + shape[2:] + (2,))
    radius_m = world.scenario.drones.footprint_radius_m
    centres = np.stack(np.meshgrid(*map(np.arange, (columns, rows)), indexing="ij"), -1) - middle
    parts = []
    for scale in range(scales):
        fine = np.arange(3**scale) - 3**scale // 2
        places = centres[:, :, None, None] * 3**scale + np.stack(np.meshgrid(fine, fine, indexing="ij"), -1)
        parts.append((places, (abs(places) <= middle).all(-1) & (scale > 0)))
    units = []
    for offset in centres.reshape(-1, 2):
        away = [np.linalg.norm((places - offset) * size_m, axis=-1) for places, _ in parts]
        shares = [
            (np.clip((radius_m - far_m) / size_m.min() + 0.5, 0, 1) * ~known).mean((2, 3))
            for far_m, (_, known) in zip(away, parts, strict=True)
        ]
        for group in (("free", "own"), ("others",), ("waiting",)):
            weights = np.zeros(shape)
            for name in group:
                weights[:, list(radar.channels(facts)).index(name)] = shares
            units.append(weights.reshape(-1))
    own = len(world.features_of_types[0]) - units[0].size
    return np.pad(np.array(units, np.float32), ((0, 0), (own, 0)))


class Net(nn.Module):
    """A trunk that is shared by the logits of the actions and by a drone's part of the value."""

    def __init__(self, world, hidden):
        super().__init__()
        seen = len(world.features_of_types[0])
        sizes = (seen, hidden, (hidden + 1) // 2, len(world.actions) + 1)
        self.layers = nn.ModuleList(nn.Linear(*pair) for pair in zip(sizes, sizes[1:], strict=False))
        for k, one in enumerate(self.layers):
            nn.init.orthogonal_(one.weight, 0.1 if k == 2 else 2**0.5)
            nn.init.zeros_(one.bias)
        known = torch.from_numpy(footprints(world))[:hidden]
        with torch.no_grad():
            self.layers[0].weight[: len(known)] = known

    def forward(self, seen):
        """The logits of the actions (…, actions), and the drone's part of the value (…)."""
        for one in self.layers[:-1]:
            seen = torch.relu(one(seen))
        out = self.layers[-1](seen)
        return out[..., :-1], out[..., -1]

    @torch.no_grad()
    def best(self, seen, masks):
        """The most probable allowed actions, and the values of the whole states."""
        logits, values = self(seen)
        return torch.where(masks, logits, -torch.inf).argmax(-1), values.mean(-1)


def scaling(world):
    """``low`` and ``scale`` of the features, with places around 0, as symmetries need them."""
    low, scale = scaling_of(world)
    places = [one.name in ("x", "y") for one in world.features_of_types[0]]
    low[places], scale[places] = 0.5, 2.0
    return low, scale


class City:
    """The environments of a training, each with the teacher in its world, and forks of them."""

    def __init__(self, scenario, options, net=None):
        self.options, self.passes = options, 0
        self.env = UavParallelVectorEnv(scenario, options.envs)
        self.low, self.scale = scaling(self.env.sessions[0].world)
        self.rng = np.random.default_rng(options.seed)
        self.forks = [None] * options.envs

    def begin(self):
        """Begin in worlds that are new."""
        first = FIRST_WORLD * (1 + self.options.seed / 10) + self.passes * self.options.envs
        self.passes += 1
        seen, infos = self.env.reset(seed=int(first))
        self.teachers = [load_policy(self.options.teacher) for _ in self.env.sessions]
        self.begun = [-1] * len(self.teachers)
        return self.tensors(seen, infos["action_mask"])

    def tensors(self, seen, masks):
        """What a network gets of what drones see (…, features), and of their masks."""
        return torch.from_numpy(((seen - self.low) * self.scale).astype(np.float32)), torch.from_numpy(masks != 0)

    def taught(self):
        """The commands of the teacher now (envs, drones)."""
        commands = []
        for k, (session, teacher) in enumerate(zip(self.env.sessions, self.teachers, strict=True)):
            if self.begun[k] != session.episode:
                streams = Streams(session.seed, Purpose.LEARNER, session.episode)
                teacher.begin(session.world, streams, self.begun[k] >= 0)
                teacher.watch(session.engine)
                self.begun[k] = session.episode
            if session.engine.terminated or session.engine.truncated:
                commands.append([0] * self.env.drones)  # the step only begins the next episode
                continue
            snapshot = session.snapshot
            commands.append(teacher.act_jointly(snapshot.observations, snapshot.masks))
        return torch.tensor(commands)

    def search(self, net, which, best, masks):
        """What each action of each drone would gain (states, drones, actions) in the environments.

        ``best`` (envs, drones) are the actions that are compared with.
        """
        tries, forks = [], []
        for k in which:
            engine = self.env.sessions[k].engine
            if self.forks[k] is None or self.forks[k].engine is not engine:
                self.forks[k] = Forks(engine, 1 + masks[0].numel())
            allowed = masks[k] & (masks[k].sum(-1, keepdim=True) > 1)
            allowed[range(len(best[k])), best[k]] = False
            changes = allowed.nonzero()
            commands = best[k].repeat(self.forks[k].count, 1)
            commands[1 + torch.arange(len(changes)), changes[:, 0]] = changes[:, 1]
            tries.append((changes, commands.numpy()))
            forks.append(self.forks[k])
        gained = self.follow(net, forks, [one for _, one in tries], [len(one) + 1 for one, _ in tries])
        gains = torch.zeros(len(which), *masks.shape[1:])
        for k, ((changes, _), found) in enumerate(zip(tries, gained, strict=True)):
            gains[k, changes[:, 0], changes[:, 1]] = found[1:] - found[0]
        return gains

    def follow(self, net, forks, commands, counts):
        """What forks of the present states gain by first commands, and then by the network."""
        while any([self.first(*one) for one in zip(forks, commands, counts, strict=True)]):
            pass
        gained = [torch.zeros(count) for count in counts]
        over, discount = [np.zeros(count, bool) for count in counts], 1.0
        for step in range(self.options.horizon):
            rewards = [one.outputs.reward[:n, 0] for one, n in zip(forks, counts, strict=True)]
            for k, reward in enumerate(rewards):
                gained[k] += torch.from_numpy(np.where(over[k], 0.0, discount * reward)).float()
            discount *= self.options.gamma
            last, worth = step == self.options.horizon - 1, discount / (1 - self.options.gamma)
            seen, masks = self.shown(forks, counts)
            actions, values = net.best(seen, masks)
            at = 0
            for k, (one, n) in enumerate(zip(forks, counts, strict=True)):
                ended = one.outputs.over[:n].any(1)
                now = (ended | last) & ~over[k]
                gained[k] += torch.where(torch.from_numpy(now), worth * values[at : at + n], 0.0)
                over[k] |= ended
                chosen = np.zeros((one.count, actions.shape[1]), np.int64)
                chosen[:n] = actions[at : at + n].numpy()
                if not last:
                    one.step(chosen, np.arange(one.count) < n)
                at += n
        return gained

    def first(self, forks, commands, count):
        """Step forks by their first commands; return whether they needed more room."""
        forks.take()
        stopped = forks.step(commands, np.arange(forks.count) < count)
        if stopped:
            forks.more_room()
        return stopped > 0

    def shown(self, forks, counts):
        """What all drones in forks see, and their masks."""
        shape = (sum(counts), self.env.drones, -1)
        seen = np.concatenate([one.outputs.observations[:n] for one, n in zip(forks, counts, strict=True)])
        masks = np.concatenate([one.outputs.mask[:n] for one, n in zip(forks, counts, strict=True)])
        return self.tensors(seen.reshape(shape), masks.reshape(shape))


def play(city, net, share, searches):
    """Play a pass; return samples: what was seen, masks, targets, which of them count, returns.

    The teacher commands a ``share`` of the environments. Targets are its commands, or if it is a
    pass that ``searches``, what the search makes of the network's.
    """
    options, (seen, masks) = city.options, city.begin()
    led = torch.arange(options.envs) < share * options.envs
    kept = []
    for t in range(options.steps):
        best, values = net.best(seen, masks)
        targets, counts = torch.zeros(masks.shape), masks.sum(-1) > 1
        commands = best
        if searches:
            which = [k for k in range(options.envs) if (k + t) % options.every == 0]
            counts[[k for k in range(options.envs) if k not in which]] = False
            over = city.env.over()
            counts[torch.from_numpy(over)] = False
            which = [k for k in which if not over[k]]
            if which:
                targets[which] = improved(net, seen[which], masks[which], city.search(net, which, best, masks), options)
        else:
            commands = city.taught()
            targets = smoothed(commands, masks, options.smooth)
            commands = torch.where(led[:, None], commands, best)
        after, rewards, ended, cut, infos = city.env.step(commands.numpy())
        over = torch.from_numpy(cut | ended)[:, 0]
        kept.append((seen, masks, targets, counts, values, torch.from_numpy(rewards).float().mean(-1), over))
        seen, masks = city.tensors(after, infos["action_mask"])
    seen_all, masks_all, targets, counts, values, rewards, over = (torch.stack(one) for one in zip(*kept, strict=True))
    returns = returns_of(torch.cat([values, net.best(seen, masks)[1][None]]), rewards, over, options)
    lived = torch.cat([torch.zeros_like(over[:1]), over[:-1]])  # its action was not taken
    counts &= ~lived[..., None]
    some = counts.any(-1)
    ends = city.env.outputs.numbers
    text = f"reward {rewards[~lived].mean() / 2:.4f}"
    return [one[some] for one in (seen_all, masks_all, targets, counts, returns)], text


def smoothed(commands, masks, smooth):
    """The probabilities of commands, of which the other allowed ones share a small part."""
    allowed = masks / masks.sum(-1, keepdim=True)
    return smooth * allowed + (1 - smooth) * functional.one_hot(commands, masks.shape[-1])


@torch.no_grad()
def improved(net, seen, masks, gains, options):
    """The network's probabilities times exp(sharp * gain)."""
    logits = torch.where(masks, net(seen)[0] + options.sharp * gains, -torch.inf)
    return logits.softmax(-1)


def returns_of(values, rewards, over, options):
    """The lambda-returns of the states (steps, envs); what ends goes on as its last state does."""
    found, last = torch.zeros_like(rewards), values[-1]
    for t in reversed(range(len(rewards))):
        mixed = options.decay * last + (1 - options.decay) * values[t + 1]
        after = torch.where(over[t], values[t + 1], mixed)
        found[t] = last = (1 - options.gamma) * rewards[t] + options.gamma * after
    return found


def learn(net, optimizer, samples, options):
    """Learn from all samples: commands by their probabilities, and values by the returns."""
    seen, masks, targets, counts, returns = (torch.cat(one) for one in zip(*samples, strict=True))
    turns = [tuple(map(torch.from_numpy, one)) for one in net.turns]
    states, losses = max(1, options.batch // seen.shape[1]), []
    for _ in range(options.epochs):
        for batch in torch.randperm(len(seen)).split(states):
            features, signs, actions = turns[torch.randint(len(turns), ())]
            logits, values = net(seen[batch][..., features] * signs)
            allowed, wanted = masks[batch][..., actions], targets[batch][..., actions]
            logits = torch.where(allowed, logits, -1e9)
            chosen = -(wanted * logits.log_softmax(-1)).sum(-1)[counts[batch]]
            missed = (values.mean(-1) - returns[batch]).square().mean()
            loss = chosen.mean() + missed
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            optimizer.step()
            losses.append((chosen.mean().item(), missed.item()))
    return np.mean(losses, axis=0)


def train(scenario, options, save=lambda network: None, say=lambda line: None):
    """Train by imitation and then by search. ``save`` gets the network after each pass."""
    torch.manual_seed(options.seed)
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    city, began = City(scenario, options), time.process_time()
    world = city.env.sessions[0].world
    net = Net(world, options.hidden)
    net.turns = symmetries(world)
    optimizer = torch.optim.Adam(net.parameters(), options.rate)
    samples, passes = [], options.imitations + options.searches
    for k in range(passes):
        optimizer.param_groups[0]["lr"] = options.rate * (1 - k / passes)
        searches = k >= options.imitations
        if k == options.imitations:
            samples.clear()
        share = 1.0 if k == 0 else 0.25
        parts, measures = play(city, net, share, searches)
        played = time.process_time() - began
        samples = [*samples, parts][-options.keep :]
        losses = learn(net, optimizer, samples, options)
        say(f"pass {k + 1} of {passes}, {played:.0f} + {time.process_time() - began - played:.0f} CPU-s: {measures}, losses {losses}")
        save(network_of(net, world, options))
    return net


def network_of(net, world, options):
    """The network without its value as desim-uav runs it, with where it comes from."""
    about = description_of(world) | {"training": vars(options) | {"scenario_yaml": dump(world.scenario)}}
    pairs = [[one.weight.T.detach().numpy().copy(), one.bias.detach().numpy().copy()] for one in net.layers]
    pairs[-1] = [part[..., :-1] for part in pairs[-1]]
    return Mlp(*scaling(world), tuple(map(tuple, pairs)), about)


def main(arguments=None):
    """Train, and write the policy file after each pass."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenario", help="a scenario file, or a shipped name: case8")
    parser.add_argument("--out", type=Path, help="the policy file; default: expert_SCENARIO.npz")
    parser.add_argument("-S", dest="changes", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--teacher", default="greedy:horizon=12", help="a policy to imitate")
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
        place = file_place(out or Path(f"expert_{scenario.name}.npz"), "--out")
        train(scenario, options, save, lambda line: print(line, file=sys.stderr, flush=True))
    except DesimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"interrupted; {place} has the policy of the last pass", file=sys.stderr)
        return 130
    print(f"desim-uav run {name} --policy {place}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
