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
import itertools
import sys
import time
from pathlib import Path

import numpy as np

from desim_uav.disk import file_place, write_at
from desim_uav.engine.compiled.forks import Forks
from desim_uav.env import UavParallelVectorEnv
from desim_uav.errors import DesimError, MissingExtraError, UsageError
from desim_uav.experiment.provenance import command, commit, processor
from desim_uav.model.rules import Action
from desim_uav.policies.mlp import Mlp, description_of, scaling_of
from desim_uav.policies.planning.best_plan import LOST
from desim_uav.policies.planning.ground import grounds_of
from desim_uav.policies.planning.sight import look
from desim_uav.policies.planning.team import Habits, TeamPlanner, commands_of
from desim_uav.scenario.load import dump, load
from desim_uav.shipped import find_scenario

try:
    import torch
    from torch import nn
except ModuleNotFoundError:
    print(MissingExtraError("policies/expert.py", "ppo"), file=sys.stderr)
    sys.exit(MissingExtraError.exit_code)

DEFAULTS = (
    "observation={kind: radar, cells_x: 7, cells_y: 7, demand: false}",
    "reward={kind: qoe, difference: false, w1: 0.25, crash: 20}",
)
"""What a drone sees, and what the search adds up: the team's QoE1 and QoE3."""

FIRST_WORLD = 1_000_000
"""The first world to train in; each pass takes the next ones, below the worlds for validation."""

OPTIONS = {
    "seed": (0, 0, 9, "what the network, the worlds and the order of samples are drawn from"),
    "envs": (32, 1, 4096, "environments side by side, each in a world of its own"),
    "steps": (120, 1, 2**16, "steps of each environment in a pass, in worlds that are new"),
    "imitations": (6, 0, 4096, "passes that learn from the teacher"),
    "searches": (12, 0, 4096, "passes that learn from the search"),
    "every": (4, 1, 4096, "steps of an environment between two states that are searched"),
    "horizon": (10, 1, 4096, "steps of a try"),
    "trust": (0.3, 0.0, 1.0, "how much of the value of the state after a try counts"),
    "epochs": (10, 1, 100, "times that a pass of imitation learns from all its samples"),
    "reviews": (2, 1, 100, "times that a pass of search learns from all its samples"),
    "batch": (512, 1, 2**16, "samples of a step of Adam"),
    "rate": (1e-3, 1e-9, 1.0, "the rate of Adam in imitation, which falls linearly to 0"),
    "search_rate": (4e-4, 1e-9, 1.0, "the rate of Adam in search, which falls linearly to 0"),
    "gamma": (0.95, 0.0, 0.99999, "the discount per step"),
    "decay": (0.9, 0.0, 1.0, "lambda of the returns that the value learns"),
    "sharp": (3.0, 0.0, 1e6, "how much the gain of an action is added to its logit"),
    "ahead": (12, 1, 1000, "steps of the teacher's plans"),
    "near": (
        1.0,
        1e-6,
        1e6,
        "the worth (users times steps) that makes an action e times as probable",
    ),
    "hidden": (192, 1, 4096, "units of the first layer; the second has half of them"),
}
"""The default of each option, the least and the greatest value, and what it is."""


def options_of(**changes):
    """The options of a training, with these changes. Raises UsageError for what cannot be."""
    options = {name: default for name, (default, *_) in OPTIONS.items()} | changes
    for name, (_, least, most, _) in OPTIONS.items():
        if not least <= options[name] <= most:
            raise UsageError(f"--{name} {options[name]}: must be from {least} to {most}")
    return argparse.Namespace(**options)


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
        operation(
            cells[..., ::-1, :], (), ["x"] + ["bearing_sin"] * limited, {east: west, west: east}
        ),
        operation(
            cells[..., ::-1], (), ["y"] + ["bearing_cos"] * limited, {north: south, south: north}
        ),
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
    radar = world.scenario.observation
    shape = radar.shape(world.facts)
    channels, middle = list(radar.channels(world.facts)), np.array(shape[2:]) // 2
    size_m = np.array([world.grid.width_m, world.grid.depth_m]) / world.grid.cells
    centres = grid_of(*shape[2:]) - middle
    cells = [
        centres[:, :, None, None] * 3**scale + grid_of(3**scale, 3**scale) - 3**scale // 2
        for scale in range(shape[0])
    ]
    units = []
    for offset in centres.reshape(-1, 2):
        shares = np.zeros((shape[0], *shape[2:]))
        for scale, places in enumerate(cells):
            far_m = np.linalg.norm((places - offset) * size_m, axis=-1)
            inside = np.clip(
                (world.scenario.drones.footprint_radius_m - far_m) / size_m.min() + 0.5, 0.0, 1.0
            )
            finer = scale > 0 and (
                abs(places) <= middle * 3 ** (scale - 1) + 3 ** (scale - 1) // 2
            ).all(-1)
            shares[scale] = np.where(finer, 0.0, inside).mean((2, 3))
        for group in (("free", "own"), ("others",), ("waiting",)):
            weights = np.zeros(shape, np.float32)
            for name in set(group) & set(channels):
                weights[:, channels.index(name)] = shares
            units.append(weights.reshape(-1))
    local = len(world.features_of_types[0]) - units[0].size
    return np.pad(np.array(units), ((0, 0), (local, 0)))


def grid_of(columns, rows):
    """The column and row of each cell (columns, rows, 2)."""
    return np.stack(np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij"), -1)


class Net(nn.Module):
    """A trunk that is shared by the logits of the actions and by a drone's part of the value."""

    def __init__(self, world, hidden):
        super().__init__()
        seen = len(world.features_of_types[0])
        sizes = (seen, hidden, (hidden + 1) // 2, 2 * len(world.actions) + 1)
        self.layers = nn.ModuleList(nn.Linear(*pair) for pair in itertools.pairwise(sizes))
        for k, one in enumerate(self.layers):
            nn.init.orthogonal_(one.weight, 0.1 if k == 2 else 2**0.5)
            nn.init.zeros_(one.bias)
        known = torch.from_numpy(footprints(world))[:hidden]
        with torch.no_grad():
            self.layers[0].weight[: len(known)] = known

    def forward(self, seen):
        """The logits and the gains of the actions (…, actions), and the drone's part of the value."""
        for one in self.layers[:-1]:
            seen = torch.relu(one(seen))
        out = self.layers[-1](seen)
        logits, gains = out[..., :-1].chunk(2, -1)
        return logits, gains, out[..., -1]

    @torch.no_grad()
    def best(self, seen, masks):
        """The most probable allowed actions, and the values of the whole states."""
        logits, _, values = self(seen)
        return torch.where(masks, logits, -torch.inf).argmax(-1), values.mean(-1)


def scaling(world):
    """``low`` and ``scale`` of the features, with places around 0, as symmetries need them."""
    low, scale = scaling_of(world)
    places = [one.name in ("x", "y") for one in world.features_of_types[0]]
    low[places], scale[places] = 0.5, 2.0
    return low, scale


class Teacher:
    """The planner ``greedy`` in one world, which tells the worth of each action of each drone."""

    def __init__(self, world, options):
        self.grounds, self.plans, self.episode = grounds_of(world), (), -1
        self.habits = Habits(options.ahead, 1.0, 5.0, 1)

    def teach(self, session):
        """The planner's commands, and the worth of each action (drones, actions)."""
        world, engine, (ground, *_) = session.world, session.engine, self.grounds
        worths = np.full((len(self.grounds), len(world.actions)), LOST)
        if engine.terminated or engine.truncated:
            return [0] * len(worths), worths  # the next step only begins an episode
        snapshot = session.snapshot
        sight = look(engine, self.grounds, snapshot.observations)
        team = TeamPlanner(self.grounds, sight, self.habits)
        team.begin_with(self.plans if session.episode == self.episode else (), 1)
        team.improve(self.habits.rounds)
        self.plans, self.episode = team.plans, session.episode
        moves = [*ground.flights.moves, Action.GOTO_CHARGING_STATION, Action.CHARGE]
        places = [world.actions.index(one) if one in world.actions else 0 for one in moves]
        for d, standing in enumerate(sight.drones):
            if standing.ready == 0:
                np.maximum.at(worths[d], places, team.worths(d))
        plans = team.plans[:, 0]
        shown = (snapshot.observations, snapshot.masks)
        return commands_of(self.grounds, engine, plans, *shown), worths


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
        self.teachers = [Teacher(one.world, self.options) for one in self.env.sessions]
        return self.tensors(seen, infos["action_mask"])

    def tensors(self, seen, masks):
        """What a network gets of what drones see (…, features), and of their masks."""
        return torch.from_numpy(
            ((seen - self.low) * self.scale).astype(np.float32)
        ), torch.from_numpy(masks != 0)

    def taught(self):
        """The commands of the teacher now (envs, drones), and the worth of each action, if any."""
        commands, worths = [], []
        for session, teacher in zip(self.env.sessions, self.teachers, strict=True):
            given, worth = teacher.teach(session)
            commands.append(given)
            worths.append(worth)
        return torch.tensor(commands), torch.tensor(np.array(worths))

    def search(self, net, which, best, masks):
        """What each action of each drone would gain (states, drones, actions) in the environments.

        ``best`` (envs, drones) are the actions that are compared with.
        """
        forks, changes, commands = [], [], []
        for k in which:
            engine = self.env.sessions[k].engine
            if self.forks[k] is None or self.forks[k].engine is not engine:
                self.forks[k] = Forks(engine, 1 + masks[k].numel())
            allowed = masks[k] & (masks[k].sum(-1, keepdim=True) > 1)
            allowed[range(len(best[k])), best[k]] = False
            changes.append(allowed.nonzero())
            commands.append(best[k].repeat(1 + len(changes[-1]), 1))
            commands[-1][1 + torch.arange(len(changes[-1])), changes[-1][:, 0]] = changes[-1][:, 1]
            forks.append(self.forks[k])
        while (returns := self.follow(net, forks, commands)) is None:
            for k in which:  # a fork has run out of room
                self.forks[k].more_room()
                self.env.sessions[k].write_to(self.env.outputs, k)  # its state has moved
        gains = torch.zeros(len(which), *masks.shape[1:])
        for k, (changed, of_state) in enumerate(zip(changes, returns, strict=True)):
            gains[k, changed[:, 0], changed[:, 1]] = of_state[1:] - of_state[0]
        return gains

    def follow(self, net, forks, commands):
        """The returns of commands (tries, drones) in forks of each state, as the network goes on.

        It is None if a fork has run out of room.
        """
        counts, gamma = [len(one) for one in commands], self.options.gamma
        for one in forks:
            one.take()
        returns, over = torch.zeros(sum(counts)), torch.zeros(sum(counts), dtype=torch.bool)
        for step in range(self.options.horizon):
            parts = commands if step == 0 else actions.split(counts)
            if sum([stepped(*one) for one in zip(forks, parts, strict=True)]):
                return None
            rewards, ended, seen, masks = (
                np.concatenate(
                    [getattr(one.outputs, name)[:n] for one, n in zip(forks, counts, strict=True)]
                )
                for name in ("reward", "over", "observations", "mask")
            )
            shape = (len(seen), self.env.drones, -1)
            actions, values = net.best(*self.tensors(seen.reshape(shape), masks.reshape(shape)))
            ended = torch.from_numpy(ended.any(1)) | (step == self.options.horizon - 1)
            paid = torch.from_numpy(rewards[:, 0]).float()
            paid += torch.where(ended, self.options.trust * gamma / (1 - gamma) * values, 0.0)
            returns += torch.where(over, 0.0, gamma**step * paid)
            over |= ended
        return returns.split(counts)


def stepped(forks, commands):
    """Step as many forks as there are commands; return how many have run out of room."""
    some = np.zeros((forks.count, commands.shape[1]), np.int64)
    some[: len(commands)] = commands
    return forks.step(some, np.arange(forks.count) < len(commands))


@torch.no_grad()
def play(city, net, share, searched):
    """Play a pass; return a tensor (states, …) for each quantity, and the mean reward of a step.

    They are what was seen, masks, targets (what is learned of each action), logits and the best
    actions of the network, which drones have targets (states, drones), and returns. The teacher
    commands a ``share`` of the environments, or none if the network's actions are ``searched``.
    """
    options, (seen, masks) = city.options, city.begin()
    led, kept = torch.arange(options.envs) < share * options.envs, []
    for t in range(options.steps):
        best, values = net.best(seen, masks)
        begins, commands = torch.from_numpy(city.env.over()), best
        counts = (masks.sum(-1) > 1) & ~begins[:, None]
        if searched:
            counts &= ((torch.arange(options.envs) + t) % options.every == 0)[:, None]
            which, targets = counts.any(-1).nonzero()[:, 0].tolist(), torch.zeros(masks.shape)
            if which:
                targets[which] = city.search(net, which, best, masks)
        else:
            given, worths = city.taught()
            worths = torch.where(masks, worths, LOST)
            targets = (worths / options.near).softmax(-1).float()
            counts &= worths.max(-1).values > LOST / 2
            commands = torch.where(led[:, None], given, best)
        after, rewards, ended, cut, infos = city.env.step(commands.numpy())
        paid, over = torch.from_numpy(rewards).float().mean(-1), torch.from_numpy(ended | cut)[:, 0]
        kept.append((seen, masks, targets, net(seen)[0], best, counts, begins, values, paid, over))
        seen, masks = city.tensors(after, infos["action_mask"])
    *states, begins, values, paid, over = (torch.stack(one) for one in zip(*kept, strict=True))
    values = torch.cat([values, net.best(seen, masks)[1][None]])
    returns, some = returns_of(values, paid, over, options), states[-1].any(-1)
    return [one[some] for one in (*states, returns)], paid[~begins].mean()


def returns_of(values, rewards, over, options):
    """The lambda-returns of the states (steps, envs); what ends goes on as its last state does."""
    found, last = torch.zeros_like(rewards), values[-1]
    for t in reversed(range(len(rewards))):
        mixed = options.decay * last + (1 - options.decay) * values[t + 1]
        after = torch.where(over[t], values[t + 1], mixed)
        found[t] = last = (1 - options.gamma) * rewards[t] + options.gamma * after
    return found


def learn(net, optimizer, samples, searched, options):
    """Learn from all samples: the teacher's commands or the search's gains, and the values."""
    wholes = [torch.cat(one) for one in zip(*samples, strict=True)]
    turns = [tuple(map(torch.from_numpy, one)) for one in net.turns]
    states, losses = max(1, options.batch // wholes[0].shape[1]), []
    for _ in range(options.reviews if searched else options.epochs):
        for batch in torch.randperm(len(wholes[0])).split(states):
            features, signs, actions = turns[torch.randint(len(turns), ())]
            seen, masks, targets, before, best, counts, returns = (one[batch] for one in wholes)
            seen = seen[..., features] * signs
            masks, targets, before = (one[..., actions][counts] for one in (masks, targets, before))
            logits, gains, values = net(seen)
            logits, gains = logits[counts], gains[counts]
            worth = 20 * (values.mean(-1) - returns).square().mean()
            missed = worth.new_zeros(())
            if searched:
                best = torch.argsort(actions)[best[counts]]
                gained = gains - gains.gather(-1, best[:, None])
                missed = (gained - targets)[masks].square().mean()
                targets = torch.where(
                    masks, before + options.sharp * gains.detach(), -torch.inf
                ).softmax(-1)
            logits = torch.where(masks, logits, -1e9).log_softmax(-1)
            chosen = -(targets * logits).sum(-1).mean()
            loss = chosen + 0.2 * missed + worth
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            optimizer.step()
            losses.append((chosen.item(), missed.item(), worth.item()))
    return dict(zip(("commands", "gains", "values"), np.mean(losses, axis=0), strict=True))


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
    for searched, passes in ((False, options.imitations), (True, options.searches)):
        samples = []
        for k in range(passes):
            rate = options.search_rate if searched else options.rate
            optimizer.param_groups[0]["lr"] = rate * (1 - k / passes)
            parts, reward = play(city, net, 1.0 if k == 0 else 0.25, searched)
            samples.append(parts)
            losses = learn(net, optimizer, samples, searched, options)
            words = ", ".join(f"{name} {loss:.3f}" for name, loss in losses.items())
            taken_s, what = time.process_time() - began, ("imitation", "search")[searched]
            say(f"{what} {k + 1} of {passes}, {taken_s:.0f} CPU-s: reward {reward:.3f}, {words}")
            save(network_of(net, world, options))
    return net


def network_of(net, world, options):
    """The network without its value as desim-uav runs it, with where it comes from."""
    about = description_of(world) | {
        "training": vars(options) | {"scenario_yaml": dump(world.scenario)}
    }
    pairs = [
        [one.weight.T.detach().numpy().copy(), one.bias.detach().numpy().copy()]
        for one in net.layers
    ]
    pairs[-1] = [part[..., : len(world.actions)].copy() for part in pairs[-1]]
    return Mlp(*scaling(world), tuple(map(tuple, pairs)), about)


def main(arguments=None):
    """Train, and write the policy file after each pass."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenario", help="a scenario file, or a shipped name: case8")
    parser.add_argument("--out", type=Path, help="the policy file; default: expert_SCENARIO.npz")
    parser.add_argument("-S", dest="changes", action="append", default=[], metavar="KEY=VALUE")
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
