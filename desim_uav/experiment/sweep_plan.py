"""The plan of a sweep: the policies and trainings in each combination, and all their problems."""

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
"""Returns the name of the engine that runs a world."""

MOST_PROBLEMS = 100
"""The largest number of problems that are listed."""

LARGEST_POLICY = 2**32
"""The most bytes of a policy's file that are read to tell whether it has changed."""


@dataclass(frozen=True)
class Arm:
    """A policy in a combination, or an ``algorithm`` that learns one there.

    ``source`` is the policy with the absolute path of its file, ``digest`` that file's SHA-256.
    ``engine`` is des or batch.
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
        """The name of the arm in messages."""
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
    """Return what a sweep runs on each seed, by combination, after a check on ``seed``.

    ``algorithms`` are trained; None means the scenario's own. ``engine`` None means the compiled
    engine if it can run the scenario; ``say`` gets each reason why it cannot. Raises ScenarioError
    with all problems of all scenarios, or else PolicyError with all problems of the policies.
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
    """Return the requested engine, or by default the one that fits, and note the reasons.

    Raises ScenarioError if the engine cannot run the world.
    """
    chosen = engine or engine_for(world, reasons.setdefault)
    check_engine(chosen, world)
    return chosen


def policy_digest(policy: str) -> str:
    """Return the SHA-256 of a policy's file or of its class's file; "" for a built-in policy.

    Raises PolicyError if the file cannot be read.
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
    """Return a scenario, its world and the engine. Raises ScenarioError with the file's name."""
    scenario = load(path, settings)
    with located(path):
        drawn = scenario.model_copy(update={"seed": seed})
        world = build_world(drawn, drawn.effective_world_seed)
        chosen = choose(world)
    return scenario, world, chosen


class _Problems:
    """Collects the problems of combinations, each once."""

    def __init__(self) -> None:
        self.combinations: list[Combination] = []
        self._of: dict[type[DesimError], dict[str, list[Combination]]] = {
            ScenarioError: {},
            PolicyError: {},
        }

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Note an error of the block as a problem of the latest combination."""
        try:
            yield
        except (ScenarioError, PolicyError) as error:
            for line in str(error).splitlines():
                where = self._of[type(error)].setdefault(line, [])
                where += self.combinations[-1:] if self.combinations[-1] not in where[-1:] else []

    def complain(self) -> None:
        """Raise the problems of scenarios, or else those of policies, if there are any."""
        for of_type, noted in self._of.items():
            lines = [self._line(problem, where) for problem, where in noted.items()]
            if len(lines) > MOST_PROBLEMS:
                lines[MOST_PROBLEMS:] = [f"and {len(lines) - MOST_PROBLEMS} more"]
            if lines:
                raise of_type(*lines) if of_type is ScenarioError else of_type("\n".join(lines))

    def _line(self, problem: str, where: Sequence[Combination]) -> str:
        """Return a problem with the settings that its combinations share, or with the first one."""
        shared = [text for text in where[0].varied if all(text in c.varied for c in where)]
        alike = [c for c in self.combinations if set(shared) <= set(c.varied)]
        if len(alike) == len(where):
            return f"{problem} (with {', '.join(shared)})" if shared else problem
        return f"{problem} (with {where[0].name} and {len(where) - 1} more combination(s))"


def _hash(scenario: Scenario) -> str:
    return scenario_hash(scenario.model_copy(update={"seed": 0}))


def _source(policy: str) -> str:
    """Return a policy's name with an absolute path, so that it is valid in any folder."""
    _, argument = parts(policy)
    if file_of(policy) is None or not Path(argument).exists():
        return policy
    return f"{policy.removesuffix(argument)}{Path(argument).absolute()}"
