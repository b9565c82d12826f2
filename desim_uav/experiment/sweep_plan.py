"""The plan of a sweep: what it tries in which combination, and what is wrong with any of it."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from desim_uav.engine.choose import check_engine, engine_for
from desim_uav.errors import DesimError, PolicyError, ScenarioError, located
from desim_uav.experiment.grid import Axis, Combination, combinations
from desim_uav.learning.learner import load_algorithm
from desim_uav.learning.training import table_features
from desim_uav.model.streams import Purpose, Streams
from desim_uav.notices import notice
from desim_uav.policies import load_policy
from desim_uav.policies.base import file_of, parts
from desim_uav.registry import names
from desim_uav.regular_file import content_of
from desim_uav.scenario.load import load, scenario_hash
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World, build_world

Choose = Callable[[World], str]
"""Says by which engine a world is run."""

MOST_PROBLEMS = 100

LARGEST_POLICY = 2**32
"""The most bytes of a policy's file that are read to tell whether it has changed."""
"""Said of a sweep's combinations, at most."""


@dataclass(frozen=True)
class Arm:
    """A policy in a combination, or an ``algorithm`` that learns one there.

    ``source``: the policy with the whole path of its file; ``digest``: of that file. ``engine``:
    des or batch.
    """

    combination: Combination
    policy: str
    algorithm: str | None
    source: str
    digest: str
    scenario: Scenario
    scenario_hash: str
    engine: str

    @property
    def name(self) -> str:
        """What a message calls it."""
        return ", ".join(filter(None, (self.combination.name, self.policy)))


def arms(
    path: Path,
    axes: Sequence[Axis],
    policies: Sequence[str],
    algorithms: Sequence[str | None],
    seed: int,
    engine: str | None = None,
    say: Callable[[str], None] = notice,
) -> list[Arm]:
    """Everything a sweep tries on each seed, by combination; each begins in the world of ``seed``.

    ``algorithms``: what is trained; None is the scenario's own. ``engine``: None is the compiled
    one if it can be; ``say`` is told once for each reason why it cannot be. Raises ScenarioError
    with every problem of every combination; then PolicyError, alike.
    """
    found: list[Arm] = []
    problems, reasons = _Problems(), dict[str, None]()
    choose = partial(_chosen, engine, reasons)
    for combination in combinations(axes):
        problems.combinations.append(combination)
        if policies:
            with problems.noted():
                found += _policy_arms(path, combination, policies, seed, choose)
        for algorithm in algorithms:
            with problems.noted():
                found.append(_learning_arm(path, combination, algorithm, seed, choose))
    problems.complain()
    for reason in reasons:
        say(reason)
    return found


def _chosen(engine: str | None, reasons: dict[str, None], world: World) -> str:
    """The engine that was asked for, if it can be; else the one that fits, with the reasons."""
    chosen = engine or engine_for(world, reasons.setdefault)
    check_engine(chosen, world)
    return chosen


def policy_digest(policy: str) -> str:
    """The SHA-256 of a policy's file, or of the file of its class; empty for a built-in.

    Raises PolicyError where it cannot be read.
    """
    file = file_of(policy)
    if file is None and policy in names("policy"):
        return ""
    try:
        file = file or Path(inspect.getsourcefile(type(load_policy(policy))) or "")
        return hashlib.sha256(content_of(file, LARGEST_POLICY)).hexdigest()
    except (OSError, TypeError, ValueError) as error:
        raise PolicyError(f"policy {policy!r}: its file cannot be read: {error}") from error


def _policy_arms(
    path: Path, combination: Combination, policies: Sequence[str], seed: int, choose: Choose
) -> Iterator[Arm]:
    scenario, world, chosen = _prepared(path, combination.settings, seed, choose)
    hashed = _hash(scenario)
    for policy in policies:
        load_policy(policy).begin(world, Streams(seed, Purpose.LEARNER), False)
        source = _source(policy)
        yield Arm(
            combination, policy, None, source, policy_digest(policy), scenario, hashed, chosen
        )


def _learning_arm(
    path: Path, combination: Combination, algorithm: str | None, seed: int, choose: Choose
) -> Arm:
    settings = list(combination.settings)
    settings += [] if algorithm is None else [f'learning.algorithm="{algorithm}"']
    scenario, world, chosen = _prepared(path, settings, seed, choose)
    name = scenario.learning.algorithm
    table_features(world, load_algorithm(name).tables)
    return Arm(combination, name, name, "", "", scenario, _hash(scenario), chosen)


def _prepared(
    path: Path, settings: Sequence[str], seed: int, choose: Choose
) -> tuple[Scenario, World, str]:
    """A scenario, its world on a seed, and the engine. Raises ScenarioError, naming the file."""
    scenario = load(path, settings)
    with located(path):
        drawn = scenario.model_copy(update={"seed": seed})
        world = build_world(drawn, drawn.effective_world_seed)
        chosen = choose(world)
    return scenario, world, chosen


class _Problems:
    """What is wrong with combinations, each problem once."""

    def __init__(self) -> None:
        self.combinations: list[Combination] = []
        self._of: dict[type[DesimError], dict[str, list[Combination]]] = {
            ScenarioError: {},
            PolicyError: {},
        }

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Note what is raised, as of the latest combination."""
        try:
            yield
        except (ScenarioError, PolicyError) as error:
            for line in str(error).splitlines():
                where = self._of[type(error)].setdefault(line, [])
                where += self.combinations[-1:] if self.combinations[-1] not in where[-1:] else []

    def complain(self) -> None:
        """Raise what was noted: of scenarios, else of policies."""
        for of_type, noted in self._of.items():
            lines = [self._line(problem, where) for problem, where in noted.items()]
            if len(lines) > MOST_PROBLEMS:
                lines[MOST_PROBLEMS:] = [f"and {len(lines) - MOST_PROBLEMS} more"]
            if lines:
                raise of_type(*lines) if of_type is ScenarioError else of_type("\n".join(lines))

    def _line(self, problem: str, where: Sequence[Combination]) -> str:
        """A problem and what the combinations that have it share, or the first of them."""
        shared = [text for text in where[0].varied if all(text in c.varied for c in where)]
        alike = [c for c in self.combinations if set(shared) <= set(c.varied)]
        if len(alike) == len(where):
            return f"{problem} (with {', '.join(shared)})" if shared else problem
        return f"{problem} (with {where[0].name} and {len(where) - 1} more combination(s))"


def _hash(scenario: Scenario) -> str:
    return scenario_hash(scenario.model_copy(update={"seed": 0}))


def _source(policy: str) -> str:
    """A policy's name, which means the same in any folder."""
    _, argument = parts(policy)
    if file_of(policy) is None or not Path(argument).exists():
        return policy
    return f"{policy.removesuffix(argument)}{Path(argument).absolute()}"
