"""The plan of a sweep: the policies and trainings in each combination of values."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desim_uav.engine.choose import check_engine, engine_for, look_ahead
from desim_uav.errors import PolicyError, UsageError
from desim_uav.experiment.compare import begin_once, out_of_place, policy_names
from desim_uav.experiment.interrupt import at_once
from desim_uav.experiment.sweep.grid import Axis, Combination, combinations
from desim_uav.experiment.sweep.problems import Problems
from desim_uav.learning.algorithm import load_algorithm
from desim_uav.learning.training import table_features
from desim_uav.policies import load_policy
from desim_uav.policies.base import base_of, file_of, parts
from desim_uav.registry import names
from desim_uav.rowcode.regular_file import content_of
from desim_uav.scenario.description import code_of
from desim_uav.scenario.doubts import doubts
from desim_uav.scenario.draft import blaming, named_override
from desim_uav.scenario.load import (
    Overrides,
    dump,
    from_mapping,
    load,
    scenario_hash,
    to_plain,
)
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World, build_world

LARGEST_POLICY = 2**32
"""The most bytes of a policy's file that are read to tell whether it has changed."""


@dataclass(frozen=True)
class ScenarioSource:
    """The scenario of a sweep: a file, or what Python has: its content, or a loaded scenario."""

    scenario: Path | Mapping[str, Any] | Scenario

    def load(self, settings: Sequence[str]) -> Scenario:
        """Return the scenario with these settings. Raises ScenarioError, UsageError."""
        if isinstance(self.scenario, Path):
            return load(self.scenario, settings)
        if isinstance(self.scenario, Scenario):
            plain, source = to_plain(self.scenario), f"<{self.scenario.name}>"
            return from_mapping(plain, source=source, overrides=settings)
        return from_mapping(self.scenario, overrides=settings)

    def located(self, settings: Sequence[str]) -> AbstractContextManager[None]:
        """Name the override or the file in problems that are found only in drawing a world."""
        return blaming(self.scenario if isinstance(self.scenario, Path) else None, settings)

    def about(self) -> dict[str, Any]:
        """Return the file, if there is one, and the digest of the content, for the manifest."""
        if isinstance(self.scenario, Path):
            content, file = self.scenario.read_bytes(), str(self.scenario)
            return {"file": file, "sha256": hashlib.sha256(content).hexdigest()}
        content = dump(self.load(())).encode()
        return {"file": None, "sha256": hashlib.sha256(content).hexdigest()}


@dataclass(frozen=True)
class SweepPlan:
    """What a sweep is to run in a scenario.

    ``values`` are those of ``axes``. ``policies`` None means the baseline, or no policy if
    something is trained, and ``algorithms`` None the scenario's own.
    """

    scenario: Path | Mapping[str, Any] | Scenario
    values: Overrides
    policies: Sequence[str] | None
    train: bool
    algorithms: Sequence[str] | None
    seeds: range
    episodes: int
    warmup: int
    engine: str = "auto"
    measures: Sequence[str] = ()
    """More measures than those of comparisons, which are shown at the end."""

    @property
    def source(self) -> ScenarioSource:
        """The scenario, as it was given."""
        return ScenarioSource(self.scenario)

    def policy_names(self) -> list[str]:
        """Return the policies to run. Raises UsageError, or PolicyError if one cannot be loaded."""
        if self.policies is None:
            return [] if self.train else ["baseline"]
        return policy_names(self.policies or [""])

    def algorithm_names(self, swept: Sequence[Axis]) -> list[str | None]:
        """Return the algorithms to train by. Raises UsageError for wrong options."""
        if self.algorithms is None:
            return [None] if self.train else []
        if not self.train:
            raise UsageError("--algorithm needs --train")
        if any(axis.key == "learning.algorithm" for axis in swept):
            raise UsageError(
                f"{named_override('learning.algorithm')}: --algorithm sets this key already"
            )
        names = [name.strip() for name in self.algorithms]
        for name in names:
            if not name or names.count(name) > 1:
                problem = f"{name!r} is given twice" if name else "a name is empty"
                raise UsageError(f"--algorithm {','.join(self.algorithms)}: {problem}")
        return list(names)


@dataclass(frozen=True)
class Arm:
    """A policy in a combination, or an ``algorithm`` that learns one there.

    ``source`` is the policy with the absolute path of its file, ``digest`` that file's SHA-256.
    ``engine`` is auto, des or batch.
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
    plan: SweepPlan, swept: Sequence[Axis], say: Callable[[str], None] = lambda notice: None
) -> list[Arm]:
    """Return what a sweep runs on each seed, by combination, after a check on its first seed.

    ``say`` gets the warnings of each scenario, and why the compiled engine cannot run it. Raises
    ScenarioError with all problems of all scenarios, or else PolicyError with all of the policies.
    """
    algorithms, policies = plan.algorithm_names(swept), plan.policy_names()
    listing: list[Arm] = []
    problems, reasons = Problems(), dict[str, None]()
    for combination in combinations(swept):
        problems.combinations.append(combination)
        if policies:
            with problems.noted():
                listing += _policy_arms(plan, combination, policies, reasons)
        for algorithm in algorithms:
            with problems.noted():
                listing.append(_learning_arm(plan, combination, algorithm, reasons))
    problems.complain()
    for reason in reasons:
        say(reason)
    return listing


def warnings(tried: Sequence[Arm], seeds: range) -> list[str]:
    """Return a warning for each policy that was learned in a world outside the sweep."""
    worlds = {(arm.scenario.world_seed, arm.policy): arm for arm in tried if not arm.algorithm}
    notices = (
        out_of_place(arm.scenario, {arm.policy: arm.policy}, seeds) for arm in worlds.values()
    )
    return list(dict.fromkeys(warning for some in notices for warning in some))


def policy_digest(policy: str) -> str:
    """Return the SHA-256 of a policy's file or of its class's code; "" for a built-in policy.

    For a policy with a base it is that of the base. Raises PolicyError if the file cannot be read.
    """
    base = base_of(policy)
    if base is not None:
        return policy_digest(base)
    file = file_of(policy)
    if file is None and policy in names("policy"):
        return ""
    try:
        if file is None:
            return code_of(type(load_policy(policy)))
        return hashlib.sha256(content_of(file, LARGEST_POLICY)).hexdigest()
    except (OSError, TypeError, ValueError) as error:
        raise PolicyError(f"policy {policy!r}: its file cannot be read: {error}") from error


def _policy_arms(
    plan: SweepPlan, combination: Combination, policies: Sequence[str], reasons: dict[str, None]
) -> Iterator[Arm]:
    scenario, world, engine = _prepared(plan, combination.settings, reasons)
    look_ahead(engine, world)
    hashed = unseeded_hash(scenario)
    for policy in policies:
        begin_once(scenario, policy, plan.seeds[0])
        source = _source(policy)
        digest = policy_digest(policy)
        yield Arm(combination, policy, None, source, digest, scenario, hashed, engine)


def _learning_arm(
    plan: SweepPlan, combination: Combination, algorithm: str | None, reasons: dict[str, None]
) -> Arm:
    own = () if algorithm is None else (f'learning.algorithm="{algorithm}"',)
    scenario, world, engine = _prepared(plan, combination.settings + own, reasons)
    name = scenario.learning.algorithm
    table_features(world, load_algorithm(name).tables)
    return Arm(combination, name, name, "", "", scenario, unseeded_hash(scenario), engine)


def _prepared(
    plan: SweepPlan, settings: Sequence[str], reasons: dict[str, None]
) -> tuple[Scenario, World, str]:
    """Return a scenario, its world and the engine; note its warnings, and why SimPy runs it.

    Raises ScenarioError with the file's name.
    """
    scenario = at_once(plan.source.load, settings)
    with plan.source.located(settings):
        first = scenario.model_copy(update={"seed": plan.seeds[0]})
        world = at_once(build_world, first, first.effective_world_seed)
        engine = plan.engine
        if engine == "auto" and engine_for(world, reasons.setdefault) == "des":
            engine = "des"
        check_engine(engine, world)
    for doubt in doubts(scenario):
        reasons.setdefault(f"warning: {doubt}")
    return scenario, world, engine


def unseeded_hash(scenario: Scenario) -> str:
    """Return the hash of a scenario without its seed."""
    return scenario_hash(scenario.model_copy(update={"seed": 0}))


def _source(policy: str) -> str:
    """Return a policy's name with an absolute path, so that it is valid in any folder."""
    base = base_of(policy)
    if base is not None:
        kind, _, rest = policy.partition(":")
        return f"{kind}:{_source(base)}{rest.removeprefix(base)}"
    module, colon, own = policy.rpartition(":")
    if module.endswith(".py"):
        return f"{Path(module).absolute()}{colon}{own}"
    _, argument = parts(policy)
    if file_of(policy) is None or not Path(argument).exists():
        return policy
    return f"{policy.removesuffix(argument)}{Path(argument).absolute()}"
