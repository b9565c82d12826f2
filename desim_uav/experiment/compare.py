"""Policies compared on common seeds: means and intervals, and what each differs from a reference.

A seed is a replication. On one seed all policies meet the same world, users, walks and requests,
so differences are taken seed by seed.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desim_uav.engine.choose import check_engine
from desim_uav.errors import PolicyError, UsageError
from desim_uav.experiment.command import read_summary
from desim_uav.experiment.evaluate import MEASURES, evaluate
from desim_uav.experiment.processes import run_each
from desim_uav.experiment.statistics import LEVEL, Estimate, estimate, paired
from desim_uav.model.streams import Purpose, Streams
from desim_uav.policies import load_policy
from desim_uav.records import EPISODES
from desim_uav.registry import did_you_mean
from desim_uav.run_folder import read_scenario, read_table
from desim_uav.scenario.load import scenario_hash, seedless, to_plain
from desim_uav.scenario.schema import Scenario
from desim_uav.world import build_world

Measures = dict[str, float | None]


@dataclass(frozen=True)
class Replication:
    """What a policy achieved on a seed."""

    policy: str
    seed: int
    world_seed: int
    measures: Measures

    @property
    def sample_paths(self) -> tuple[int, int]:
        """What was drawn: replications that agree here met the same users and requests."""
        return self.seed, self.world_seed


@dataclass(frozen=True)
class Comparison:
    """Replications of some policies in one scenario; ``against`` is the policy of reference."""

    scenario: str
    episodes: int
    warmup: int
    policies: Sequence[str]
    against: str
    replications: Sequence[Replication]
    interrupted: bool = False

    def content(self) -> dict[str, Any]:
        """Everything as plain data: replications, estimates by policy, differences."""
        others = [policy for policy in self.policies if policy != self.against]
        return {
            "scenario": self.scenario,
            "episodes": self.episodes,
            "warmup": self.warmup,
            "confidence": LEVEL,
            "against": self.against,
            "interrupted": self.interrupted,
            "policies": [self._estimates(policy) for policy in self.policies],
            "differences": [self._differences(policy) for policy in others],
            "replications": self.rows(),
        }

    def rows(self) -> list[dict[str, Any]]:
        """A row a replication, by policy and seed."""
        return [
            {"policy": r.policy, "seed": r.seed, "world_seed": r.world_seed} | r.measures
            for policy in self.policies
            for r in self._of(policy).values()
        ]

    def as_csv(self) -> str:
        """The rows, with what all of them have in common."""
        common = {"scenario": self.scenario, "episodes": self.episodes, "warmup": self.warmup}
        columns = [*common, "policy", "seed", "world_seed", *MEASURES]
        text = io.StringIO()
        writer = csv.DictWriter(text, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(common | row for row in self.rows())
        return text.getvalue()

    def _estimates(self, policy: str) -> dict[str, Any]:
        found = self._of(policy)
        return {
            "policy": policy,
            "seeds": [r.seed for r in found.values()],
            "measures": {
                name: _plain(estimate(r.measures[name] for r in found.values()))
                for name in MEASURES
            },
        }

    def _differences(self, policy: str) -> dict[str, Any]:
        found, reference = self._of(policy), self._of(self.against)
        common = [drawn for drawn in found if drawn in reference]

        def difference(name: str) -> dict[str, Any]:
            values, references = (
                [of[drawn].measures[name] for drawn in common] for of in (found, reference)
            )
            minus = paired(values, references)
            return _plain(minus) | {"excludes_zero": minus.excludes_zero}

        return {
            "policy": policy,
            "against": self.against,
            "seeds": [seed for seed, _ in common],
            "measures": {name: difference(name) for name in MEASURES},
        }

    def _of(self, policy: str) -> dict[tuple[int, int], Replication]:
        of_policy = (r for r in self.replications if r.policy == policy)
        return {r.sample_paths: r for r in sorted(of_policy, key=lambda r: r.sample_paths)}


def compare_policies(
    scenario: Scenario,
    policies: Sequence[str],
    seeds: range,
    episodes: int,
    warmup: int,
    *,
    against: str | None = None,
    jobs: int = 1,
    engine: str = "des",
    on_replication: Callable[[], None] = lambda: None,
) -> Comparison:
    """Run each policy on each seed. A seed draws the world too, unless the scenario gives one.

    ``engine``: des or batch. Ctrl-C keeps the replications that have ended; where none has, the
    KeyboardInterrupt goes on.
    """
    reference = _reference(policies, against)
    drawn = [(policy, seed) for seed in seeds for policy in policies]
    tasks = [(scenario, policy, seed, episodes, warmup, engine) for policy, seed in drawn]
    done: list[Replication] = []

    def on_end(number: int, measured: Measures) -> None:
        policy, seed = drawn[number]
        done.append(Replication(policy, seed, _world_seed(scenario, seed), measured))
        on_replication()

    interrupted = False
    try:
        run_each(evaluate, tasks, jobs, on_end)
    except KeyboardInterrupt:
        if not done:
            raise
        interrupted = True
    return Comparison(scenario.name, episodes, warmup, policies, reference, done, interrupted)


def policy_names(text: str) -> list[str]:
    """The policies of a list with commas. Raises UsageError, and PolicyError as they are loaded."""
    found = [name.strip() for name in text.split(",")]
    for name in found:
        if not name:
            raise UsageError(
                f"--policies {text}: a name is empty (names are separated by commas, "
                "so none can hold a comma)"
            )
        if found.count(name) > 1:
            raise UsageError(f"--policies {text}: {name!r} stands there twice")
    for name in found:
        load_policy(name)
    return found


def the_scenario(arguments: Sequence[str]) -> str:
    """The one scenario to run policies in. Raises UsageError."""
    if len(arguments) != 1:
        raise UsageError(f"--policies: one scenario, not {len(arguments)}")
    return arguments[0]


def try_on(scenario: Scenario, policies: Sequence[str], seeds: range, engine: str = "des") -> None:
    """Let each policy begin once, before anything is run. Raises PolicyError for a misfit.

    ScenarioError where the engine has no kernel for a component.
    """
    world = build_world(scenario, _world_seed(scenario, seeds[0]))
    check_engine(engine, world)
    for name in policies:
        load_policy(name).begin(world, Streams(seeds[0], Purpose.LEARNER), False)


def out_of_place(scenario: Scenario, policies: Sequence[str], seeds: range) -> list[str]:
    """What to warn of: policies that know a world other than those they are compared in."""
    worlds = {_world_seed(scenario, seed) for seed in seeds}
    warnings = []
    for name in policies:
        known = getattr(load_policy(name), "world_seed", None)
        if known is not None and worlds != {known}:
            where = f"world {min(worlds)}" if len(worlds) == 1 else "a world for each seed"
            warnings.append(
                f"{name} was learned in world {known} and is compared in {where}; "
                f"-S world_seed={known} compares it there"
            )
    return warnings


def compare_runs(folders: Sequence[Path], against: str | None = None) -> Comparison:
    """Compare finished runs: each is the replication of its policy on its seed.

    Raises PolicyError for folders that cannot be read, and for runs that are not of one scenario
    and one length, or of one policy and seed.
    """
    runs = [_read(folder) for folder in folders]
    first = runs[0]
    of_seed: dict[tuple[str, int], Path] = {}
    for run in runs:
        _fits(run, first)
        policy, seed = run.replication.policy, run.replication.seed
        if (policy, seed) in of_seed:
            raise PolicyError(
                f"{run.folder}: {policy} on seed {seed} once more; "
                f"{of_seed[policy, seed]} is that already"
            )
        of_seed[policy, seed] = run.folder
    policies = list(dict.fromkeys(policy for policy, _ in of_seed))
    return Comparison(
        first.scenario.name,
        first.episodes,
        first.warmup,
        policies,
        _reference(policies, against),
        [run.replication for run in runs],
    )


@dataclass(frozen=True)
class _Run:
    """A finished run; ``scenario`` is without its seeds."""

    folder: Path
    scenario: Scenario
    episodes: int
    warmup: int
    replication: Replication


def _read(folder: Path) -> _Run:
    if not folder.is_dir():
        raise PolicyError(
            f"{folder}: no such run folder (for a scenario, say which policies: --policies)"
        )
    summary, _ = read_summary(folder)
    numbers = read_table(folder, "episodes", EPISODES)["episode"]
    scenario = read_scenario(folder)
    if not summary["episodes"]:
        raise PolicyError(f"{folder}: no episode was counted")
    policy, seed = summary["policy"], summary["seed"]
    summary["crashes_per_drone_episode"] = summary["crashes"] / (
        summary["episodes"] * scenario.drones.count
    )
    return _Run(
        folder,
        seedless(scenario),
        summary["episodes"],
        int((numbers < 0).sum()),
        Replication(
            policy, seed, _world_seed(scenario, seed), {name: summary[name] for name in MEASURES}
        ),
    )


def _fits(run: _Run, first: _Run) -> None:
    if scenario_hash(run.scenario) != scenario_hash(first.scenario):
        where = _difference(to_plain(run.scenario), to_plain(first.scenario)) or "a file it names"
        raise PolicyError(f"{run.folder}: another scenario than {first.folder}: {where}")
    if (run.episodes, run.warmup) != (first.episodes, first.warmup):
        raise PolicyError(
            f"{run.folder}: {run.episodes} episode(s) after {run.warmup} of warm-up, "
            f"but {first.folder}: {first.episodes} after {first.warmup}"
        )


def _difference(one: Any, other: Any, path: tuple[str, ...] = ()) -> str | None:
    """The first key in which two scenarios differ, their names apart."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in [*one, *(key for key in other if key not in one)]:
            found = _difference(one.get(key), other.get(key), (*path, key))
            if found and (*path, key) != ("name",):
                return found
        return None
    return None if one == other else f"{'.'.join(path)} is {one}, not {other}"


def _reference(policies: Sequence[str], against: str | None) -> str:
    if against is None:
        return policies[0]
    if against not in policies:
        raise UsageError(
            f"--against {against}: not one of the policies{did_you_mean(against, policies)}: "
            f"{', '.join(policies)}"
        )
    return against


def _world_seed(scenario: Scenario, seed: int) -> int:
    return seed if scenario.world_seed is None else scenario.world_seed


def _plain(found: Estimate) -> dict[str, Any]:
    return {
        "n": found.n,
        "mean": found.mean,
        "half_width": found.half_width,
        "low": found.low,
        "high": found.high,
    }
