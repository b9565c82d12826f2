"""One seed of a submission: a policy is run, and its commands are kept for a replay."""

from __future__ import annotations

import hashlib
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from desim_uav.commands.given import Command
from desim_uav.engine.episode import Engine
from desim_uav.errors import PolicyError
from desim_uav.experiment.bench import commands as kept
from desim_uav.experiment.bench.commands import Commands
from desim_uav.experiment.bench.present import Present
from desim_uav.experiment.bench.tasks import ENGINE, EPISODES, WARMUP, BenchTrack, Task
from desim_uav.experiment.evaluate import replicated
from desim_uav.experiment.run import Results, run
from desim_uav.measures.known import ALWAYS, KNOWN
from desim_uav.measures.tally import headline
from desim_uav.model.random.streams import Streams
from desim_uav.model.state import Observation
from desim_uav.policies import Policy, load_policy
from desim_uav.policies.base import as_seen, decide_by, show
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World, build_world

MEASURES = (
    *(*ALWAYS, "j_per_mbit", "fairness", "worst_tenth_qoe1_percent", "deadlines_met_percent"),
    *("completion_s", "age_s", "worst_age_s", "outage_s"),
)
"""The measures of a row that follow from the commands; tasks have those that their model has."""

DIGESTED = {
    "requests": (
        *("episode", "request_id", "user", "t_request_s", "t_end_s", "served_s", "attached_s"),
        *("interruptions", "handovers", "qoe1"),
    ),
    "steps": ("episode", "step", "drone", "x_m", "y_m", "z_m", "battery_s", "crashed", "reward"),
}
"""The columns of the tables of a run that its digest covers."""


@dataclass(frozen=True)
class Measured:
    """What a policy achieved on a seed, and its commands."""

    row: dict[str, Any]
    commands: Commands


class Recorder:
    """Lets a policy decide, and notes its commands and its processor time.

    A policy that does not declare that it knows the future (``clairvoyant``) is shown the present
    only (``Present``), also by an observation that is not part of the package.
    """

    def __init__(self, policy: Policy, seed: int) -> None:
        self.policy, self.ceiling = policy, policy.ceiling
        self.observation = getattr(policy, "observation", None)
        self.episodes: list[list[list[Command]]] = []
        self.decisions, self.spent_s = 0, 0.0
        self._present = None if knows_future(policy) else Present(seed)
        self._engine: Engine | None = None
        self._own = self._present is not None and not is_shipped(self.observation)

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Begin an episode."""
        self.episodes.append([])
        self._engine = None
        if self._present is not None:
            world, streams = self._present.world(world), self._present.streams(streams)
        since_s = time.process_time()
        self._world = world
        self.policy.begin(world, streams, carried)
        self.spent_s += time.process_time() - since_s

    def watch(self, engine: Engine) -> None:
        """Show the policy the engine if it is a planner: the true one only if it may look ahead."""
        self._engine = engine
        if not hasattr(self.policy, "watch"):
            return
        if self._present is not None:
            engine = self._present.engine(engine)
        since_s = time.process_time()
        show(self.policy, engine)
        self.spent_s += time.process_time() - since_s

    def act(self, observation: Observation, mask: Sequence[bool]) -> int | Sequence[float]:
        """Return the action of one drone; episodes call ``act_jointly``."""
        return self.policy.act(observation, mask)

    def act_jointly(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> Sequence[Command]:
        """Return the policy's actions, and note them."""
        if self._present is not None and self._engine is not None:
            if self._own:
                observations = self._present.observations(self._engine)
            elif hasattr(self.policy, "watch"):
                self._present.engine(self._engine)
        since_s = time.process_time()
        commands = decide_by(self.policy, observations, masks, self._world)
        self.spent_s += time.process_time() - since_s
        self.decisions += 1
        pairs = zip(commands, masks, strict=True)
        self.episodes[-1].append([_with_a_choice(*pair) for pair in pairs])
        return commands

    def commands(self, world: World) -> Commands:
        """Return all commands so far; where a drone had no choice, its only action."""
        return kept.noted(self.episodes, world)

    @property
    def decision_ms(self) -> float:
        """The mean processor time of a decision of all drones, with its share of preparations."""
        return 1000.0 * self.spent_s / max(self.decisions, 1)


class Replayer:
    """Gives the commands of a submission again. Raises ValueError where there are none."""

    def __init__(self, commands: Commands, ceiling: bool) -> None:
        self._commands, self.ceiling = commands, ceiling
        self._episodes: Iterator[list[list[Command]]] | None = None
        self._left: Iterator[list[Command]] = iter(())

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Go on to the next episode."""
        self.end()
        if self._episodes is None:
            self._episodes = kept.given(self._commands, world)
        self._left = iter(next(self._episodes))

    def end(self) -> None:
        """Raise PolicyError if commands of the present episode are left."""
        if next(self._left, None) is not None:
            raise PolicyError("the commands have more decision epochs than an episode")

    def act(self, observation: Observation, mask: Sequence[bool]) -> int | Sequence[float]:
        """Return the action of one drone; episodes call ``act_jointly``."""
        raise TypeError("a replay commands all drones at once; call act_jointly")

    def act_jointly(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> Sequence[Command]:
        """Return the commands of the next decision epoch."""
        commands = next(self._left, None)
        if commands is None:
            raise ValueError("the commands have fewer decision epochs than an episode")
        return commands


def _with_a_choice(command: Command, mask: Sequence[bool]) -> Command:
    """Return a command, or the only action that a mask allows."""
    return list(mask).index(True) if sum(mask) == 1 else command


def knows_future(policy: object) -> bool:
    """Return whether a policy declares that it knows the future."""
    return bool(getattr(policy, "clairvoyant", False))


def is_shipped(part: object) -> bool:
    """Return whether an object is of a class of the package, as None is."""
    own = type(part)
    package, _, _ = own.__module__.partition(".")
    there = getattr(sys.modules.get(own.__module__), own.__name__, None)
    return part is None or (package == "desim_uav" and there is own)


def measure(task: Task, track: BenchTrack, policy: str, seed: int) -> Measured:
    """Run a policy on a seed by the protocol."""
    recorder = Recorder(load_policy(policy), seed)
    world, results = _run(task, track, seed, recorder, policy)
    scenario = world.scenario
    row = {
        "seed": seed,
        "world_seed": world.seed,
        **measures(results, scenario),
        "digest": digest(results),
        "decision_ms": recorder.decision_ms,
    }
    return Measured(row, recorder.commands(world))


def replay(
    task: Task, track: BenchTrack, seed: int, commands: Commands, ceiling: bool
) -> dict[str, Any]:
    """Give the commands of a submission again, and return its row without times.

    Raises DesimError if they do not fit the run.
    """
    world, results = flown_again(task, track, seed, commands, ceiling)
    values = measures(results, world.scenario)
    return {"world_seed": world.seed, **values, "digest": digest(results)}


def flown_again(
    task: Task, track: BenchTrack, seed: int, commands: Commands, ceiling: bool
) -> tuple[World, Results]:
    """Give the commands of a submission again, and return the world and the results of the run.

    Raises DesimError if they do not fit the run.
    """
    replayer = Replayer(commands, ceiling)
    flown = _run(task, track, seed, replayer, "the submission")
    replayer.end()
    return flown


def replayed(scenario: Scenario) -> tuple[str, ...]:
    """Return the measures of a row in a scenario that follow from the commands."""
    return tuple(name for name in MEASURES if KNOWN[name].where.holds(scenario))


def measures(results: Results, scenario: Scenario) -> dict[str, float | None]:
    """Return the measures of the counted episodes of a run."""
    found = headline(results.requests, results.episodes, results.sensors)
    return replicated(found, scenario, replayed(scenario))


def digest(results: Results) -> str:
    """Return a SHA-256 of a run: of its requests and of the drones' states after each step."""
    sha256 = hashlib.sha256()
    for name, columns in DIGESTED.items():
        frame = getattr(results, name)
        for column in columns:
            values = frame[column].to_numpy(dtype=np.float64, na_value=np.nan)
            sha256.update(f"{name}.{column}:{len(values)};".encode())
            sha256.update(np.where(np.isnan(values), np.nan, values).astype("<f8").tobytes())
    return sha256.hexdigest()


def _run(
    task: Task, track: BenchTrack, seed: int, policy: Policy, name: str
) -> tuple[World, Results]:
    scenario = as_seen(task.scenario(track), policy).model_copy(update={"seed": seed})
    world = build_world(scenario, scenario.effective_world_seed)
    return world, run(world, policy, name, seed, EPISODES, WARMUP, engine=ENGINE)
