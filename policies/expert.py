"""Train a network by imitation, and improve it by a search with exact forks, in one file.

python policies/expert.py case8 --seed 0 --out expert_case8.npz
desim-uav run case8 --policy expert_case8.npz

Read it from top to bottom: options, symmetries, the network, the planner, the city, the search,
learning, the file. First the network learns what each action is worth to the planner ``greedy`` in
the states to which its own flights lead (DAgger). Then, in such states, each drone tries each of
its actions in a fork of the simulation; all go on by the network for ``--horizon`` steps, and its
estimate of the value stands for the time after that. The network learns what the tries gain, and
actions become more probable by that.
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
from desim_uav.errors import DesimError, MissingExtraError, UsageError, require_within
from desim_uav.experiment.interrupt import end_politely
from desim_uav.experiment.provenance import command, commit, processor
from desim_uav.model.rules import Action
from desim_uav.policies.mlp import Mlp, description_of, scaling_of
from desim_uav.policies.planning.best_plan import LOST
from desim_uav.policies.planning.ground import grounds_of
from desim_uav.policies.planning.sight import look
from desim_uav.policies.planning.team import Habits, TeamPlanner, commands_of
from desim_uav.rules.radar import Radar
from desim_uav.scenario.load import dump, load
from desim_uav.shipped import find_scenario

try:
    import torch
    from torch import nn
except ModuleNotFoundError:
    print(MissingExtraError("policies/expert.py", "torch"), file=sys.stderr)
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
    "searches": (0, 0, 4096, "passes that learn from the search"),
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
    "near": (1.0, 1e-6, 1e6, "users times steps that make an action e times as probable"),
    "hidden": (192, 1, 4096, "units of the first layer; the second has half of them"),
}
"""The default of each option, the least and the greatest value, and what it is."""


def options_of(**changes):
    """The options of a training, with these changes. Raises UsageError for what cannot be."""
    options = {name: default for name, (default, *_) in OPTIONS.items()} | changes
    require_within(options, {name: bounds for name, (_, *bounds, _) in OPTIONS.items()})
    if not options["imitations"] + options["searches"]:
        raise UsageError("--imitations 0 --searches 0: nothing would be learned")
    return argparse.Namespace(**options)


def require(world):
    """Raise UsageError for worlds for which the search, or the planner's worths, do not hold."""
    if not isinstance(world.scenario.observation, Radar):
        raise UsageError(f"observation {world.scenario.observation}: must be of kind radar")
    if world.free or world.by_event or len(world.types) > 1:
        raise UsageError("all drones must be of one type, fly from cell to cell, decide by clock")


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
    swaps, (sine, cosine) = [("x", "y"), ("y", "x")], ([], [])
    if "bearing_sin" in names:
        sine, cosine = ["bearing_sin"], ["bearing_cos"]
        swaps += [*zip(sine, cosine, strict=True), *zip(cosine, sine, strict=True)]
    steps = [
        operation(cells[..., ::-1, :], (), ["x", *sine], {east: west, west: east}),
        operation(cells[..., ::-1], (), ["y", *cosine], {north: south, south: north}),
    ]
    sides = (shape[2:], world.grid.cells, (world.grid.width_m, world.grid.depth_m))
    if all(one == other for one, other in sides):
        turns = {north: east, east: north, south: west, west: south}
        steps.append(operation(cells.swapaxes(2, 3), swaps, (), turns))
    group = [(np.arange(len(names)), np.ones(len(names), np.float32), np.arange(len(kinds)))]
    for features, signs, actions in [] if any(world.scenario.wind_mps) else steps:
        group += [(f[features], s[features] * signs, a[actions]) for f, s, a in group]
    return group


def footprints(world):
    """The weights (units, features) that add up whom a footprint would cover, cell by cell around.

    Users in coarser cells count by the part of the cell that is covered and not in the finer one.
    The units count free and own users, those of other drones, and open requests that wait.
    """
    radar, radius_m = world.scenario.observation, world.scenario.drones.footprint_radius_m
    shape = radar.shape(world.facts)
    channels, middle = list(radar.channels(world.facts)), np.array(shape[2:]) // 2
    size_m = np.array([world.grid.width_m, world.grid.depth_m]) / world.grid.cells
    centres = np.moveaxis(np.indices(shape[2:]), 0, -1) - middle
    cells, units = [], []
    for side in 3 ** np.arange(shape[0]):
        inner = np.moveaxis(np.indices((side, side)), 0, -1) - side // 2
        cells.append(centres[:, :, None, None] * side + inner)
    for offset in centres.reshape(-1, 2):
        shares = np.zeros((shape[0], *shape[2:]))
        for scale, places in enumerate(cells):
            far_m = np.linalg.norm((places - offset) * size_m, axis=-1)
            inside = np.clip((radius_m - far_m) / size_m.min() + 0.5, 0.0, 1.0)
            window = middle * 3 ** (scale - 1) + 3 ** (scale - 1) // 2
            finer = (abs(places) <= window).all(-1) & (scale > 0)
            shares[scale] = np.where(finer, 0.0, inside).mean((2, 3))
        for group in (("free", "own"), ("others",), ("waiting",)):
            weights = np.zeros(shape, np.float32)
            for name in set(group) & set(channels):
                weights[:, channels.index(name)] = shares
            units.append(weights.reshape(-1))
    local = len(world.features_of_types[0]) - units[0].size
    return np.pad(np.array(units), ((0, 0), (local, 0)))


class Net(nn.Module):
    """A trunk that is shared by the logits of the actions and by a drone's part of the value."""

    def __init__(self, world, hidden):
        super().__init__()
        self.turns = [tuple(map(torch.from_numpy, one)) for one in symmetries(world)]
        inputs, outputs = len(world.features_of_types[0]), 2 * len(world.actions) + 1
        sizes = (inputs, hidden, (hidden + 1) // 2, outputs)
        self.layers = nn.ModuleList(nn.Linear(*pair) for pair in itertools.pairwise(sizes))
        for k, one in enumerate(self.layers):
            nn.init.orthogonal_(one.weight, 0.1 if k == 2 else 2**0.5)
            nn.init.zeros_(one.bias)
        known = torch.from_numpy(footprints(world))[:hidden]
        with torch.no_grad():
            self.layers[0].weight[: len(known)] = known

    def forward(self, seen):
        """Logits and gains of the actions (…, actions), and the drone's part of the value (…)."""
        for one in self.layers[:-1]:
            seen = torch.relu(one(seen))
        out = self.layers[-1](seen)
        return *out[..., :-1].chunk(2, -1), out[..., -1]

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
        shown = (team.plans[:, 0], snapshot.observations, snapshot.masks)
        return commands_of(self.grounds, engine, *shown), worths


class City:
    """The environments of a training, each with the teacher in its world, and forks of them."""

    def __init__(self, scenario, options):
        self.options, self.passes = options, 0
        self.env = UavParallelVectorEnv(scenario, options.envs)
        self.low, self.scale = scaling(self.env.sessions[0].world)
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
        scaled = ((seen - self.low) * self.scale).astype(np.float32)
        return torch.from_numpy(scaled), torch.from_numpy(masks != 0)

    def taught(self):
        """The commands of the teacher now (envs, drones), and the worth of each action, if any."""
        pairs = zip(self.teachers, self.env.sessions, strict=True)
        commands, worths = zip(*[one.teach(session) for one, session in pairs], strict=True)
        return torch.tensor(commands), torch.tensor(np.array(worths))

    def search(self, net, which, best, masks):
        """What each action of each drone gains over ``best`` in environments: (which, …)."""
        forks, changes, commands = [], [], []
        for k in which:
            engine = self.env.sessions[k].engine
            if self.forks[k] is None or self.forks[k].engine is not engine:
                self.forks[k] = Forks(engine, 1 + masks[k].numel())
            others = masks[k] & (torch.arange(masks.shape[-1]) != best[k][:, None])
            changes.append(changed := others.nonzero())
            commands.append(best[k].repeat(1 + len(changed), 1))
            commands[-1][1 + torch.arange(len(changed)), changed[:, 0]] = changed[:, 1]
            forks.append(self.forks[k])
        while (returns := self.follow(net, forks, commands)) is None:
            for k in (k for k in which if self.forks[k].outputs.over[:, 2].any()):
                self.forks[k].more_room()
        gains = torch.zeros(len(which), *masks.shape[1:])
        for k, (changed, of_state) in enumerate(zip(changes, returns, strict=True)):
            gains[k, changed[:, 0], changed[:, 1]] = of_state[1:] - of_state[0]
        return gains

    def follow(self, net, forks, commands):
        """The returns of commands (tries, drones) in forks; None if one has run out of room."""
        counts, gamma = [len(one) for one in commands], self.options.gamma
        for one in forks:
            one.take()
        returns, over = torch.zeros(sum(counts)), torch.zeros(sum(counts), dtype=torch.bool)
        actions = torch.cat(commands)
        for step in range(self.options.horizon):
            if sum([stepped(*one) for one in zip(forks, actions.split(counts), strict=True)]):
                return None
            rows = zip(*(one.outputs for one in forks), strict=True)
            rows = ([part[:n] for part, n in zip(one, counts, strict=True)] for one in rows)
            seen, masks, rewards, _, ended, *_ = map(np.concatenate, rows)
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
    every = np.resize(commands, (forks.count, commands.shape[1]))
    return forks.step(every, np.arange(forks.count) < len(commands))


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
    states, losses = max(1, options.batch // wholes[0].shape[1]), []
    for _ in range(options.reviews if searched else options.epochs):
        for batch in torch.randperm(len(wholes[0])).split(states):
            features, signs, actions = net.turns[torch.randint(len(net.turns), ())]
            seen, masks, targets, before, best, counts, returns = (one[batch] for one in wholes)
            seen = seen[..., features] * signs
            masks, targets, before = (one[..., actions][counts] for one in (masks, targets, before))
            logits, gains, values = net(seen)
            worth = 20 * (values.mean(-1) - returns).square().mean()
            missed = torch.zeros(())
            if searched:
                best, gains = torch.argsort(actions)[best[counts]], gains[counts]
                missed = gains - gains.gather(-1, best[:, None]) - targets
                missed = missed[masks].square().mean()
                wanted = before + options.sharp * gains.detach()
                targets = torch.where(masks, wanted, -torch.inf).softmax(-1)
            logits = torch.where(masks, logits[counts], -1e9).log_softmax(-1)
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
    require(world)
    net = Net(world, options.hidden)
    optimizer = torch.optim.Adam(net.parameters(), options.rate)
    for searched, passes in ((False, options.imitations), (True, options.searches)):
        samples, rate = [], options.search_rate if searched else options.rate
        for k in range(passes):
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
    training = vars(options) | {"scenario_yaml": dump(world.scenario)}
    pairs = [(one.weight.T, one.bias) for one in net.layers]
    pairs[-1] = tuple(part[..., : len(world.actions)] for part in pairs[-1])
    arrays = [tuple(part.detach().numpy().copy() for part in pair) for pair in pairs]
    return Mlp(*scaling(world), tuple(arrays), description_of(world) | {"training": training})


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
    written = ["no file"]

    def save(network):
        network.about["training"] |= told | {"command": command(sys.argv)}
        written.append(write_at(place, network.to_bytes()))

    try:
        name, out, changes = (asked.pop(key) for key in ("scenario", "out", "changes"))
        scenario, options = load(find_scenario(name), [*DEFAULTS, *changes]), options_of(**asked)
        place = file_place(out or Path(f"expert_{scenario.name}.npz"), "--out", [".npz"])
        train(scenario, options, save, lambda line: print(line, file=sys.stderr, flush=True))
    except DesimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"interrupted; {written[-1]} has the policy of the last pass", file=sys.stderr)
        return 130
    print(f"desim-uav run {name} --policy {place}")
    return 0


if __name__ == "__main__":
    end_politely()
    sys.exit(main())
