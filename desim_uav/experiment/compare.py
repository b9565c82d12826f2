"""Policies compared on common seeds: means, intervals, and differences from a reference policy.

A seed is a replication. On one seed all policies meet the same world, users, walks and requests,
so differences are taken seed by seed.
"""

from __future__ import annotations

import csv
import io
import pickle
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from desim_uav.disk import file_place, write_at
from desim_uav.engine.choose import check_engine, look_ahead
from desim_uav.errors import UsageError, did_you_mean
from desim_uav.escaped import csv_cell
from desim_uav.experiment.evaluate import evaluate
from desim_uav.experiment.interrupt import at_once
from desim_uav.experiment.processes import run_each
from desim_uav.experiment.statistics import LEVEL, estimate, paired
from desim_uav.measures.known import KNOWN, looks
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.policies import load_policy
from desim_uav.policies.base import PolicyLike, as_seen, policy_name
from desim_uav.report import notebook
from desim_uav.report.text import estimate_cells
from desim_uav.scenario.schema import Scenario
from desim_uav.typed import typed
from desim_uav.world import build_world

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RunMeasures = dict[str, float | None]


@dataclass(frozen=True)
class Replication:
    """The measures that a policy achieved on one seed."""

    policy: str
    seed: int
    world_seed: int
    measures: RunMeasures

    @property
    def sample_paths(self) -> tuple[int, int]:
        """The seeds of what was drawn; replications that share them met the same requests."""
        return self.seed, self.world_seed


@dataclass(frozen=True)
class Comparison:
    """Policies compared in one scenario on common seeds; ``against`` is the reference policy."""

    scenario: str
    episodes: int
    warmup: int
    policies: Sequence[str]
    against: str
    replications: Sequence[Replication]
    interrupted: bool = False

    @property
    def measures(self) -> Sequence[str]:
        """The names of the measures."""
        return [*self.replications[0].measures]

    def content(self) -> dict[str, Any]:
        """Return everything as plain data: replications, estimates by policy, and differences."""
        others = [policy for policy in self.policies if policy != self.against]
        return {
            "scenario": self.scenario,
            "episodes": self.episodes,
            "warmup": self.warmup,
            "confidence": LEVEL,
            "against": self.against,
            "interrupted": self.interrupted,
            "better": {name: KNOWN[name].better for name in self.measures},
            "policies": [self._estimates(policy) for policy in self.policies],
            "differences": [self._differences(policy) for policy in others],
            "replications": self.rows(),
        }

    def rows(self) -> list[dict[str, Any]]:
        """Return one row per replication, ordered by policy and seed."""
        return [
            {"policy": r.policy, "seed": r.seed, "world_seed": r.world_seed} | r.measures
            for policy in self.policies
            for r in self._of(policy).values()
        ]

    def as_csv(self) -> str:
        """Return the rows as CSV, each with the scenario and the numbers of episodes."""
        common = {"scenario": self.scenario, "episodes": self.episodes, "warmup": self.warmup}
        columns = [*common, "policy", "seed", "world_seed", *self.measures]
        text = io.StringIO()
        writer = csv.DictWriter(text, columns, lineterminator="\n")
        writer.writeheader()
        rows = ({**common, **row, "policy": csv_cell(row["policy"])} for row in self.rows())
        writer.writerows(rows)
        return text.getvalue()

    @cached_property
    def frame(self) -> pd.DataFrame:
        """One row per policy and seed, with its measures."""
        return pd.DataFrame(self.rows(), columns=["policy", "seed", "world_seed", *self.measures])

    @cached_property
    def estimates(self) -> pd.DataFrame:
        """One row per measure and policy: mean, half-width and interval over the seeds."""
        return _estimates_frame(self.content()["policies"], self.measures)

    @cached_property
    def differences(self) -> pd.DataFrame:
        """One row per measure and policy: the difference from ``against``, paired by seed."""
        return _estimates_frame(self.content()["differences"], self.measures)

    @typed
    def save(self, file: str | Path) -> Path:
        """Write the values of each seed as CSV. Raises UsageError if the file cannot be written."""
        write_at(file_place(Path(file), endings=[".csv"]), self.as_csv().encode())
        return Path(file)

    @typed
    def plot(
        self,
        out: str | Path | None = None,
        *,
        against: str | None = None,
        measure: str | Sequence[str] | None = None,
    ) -> Figure:
        """Draw the intervals of all policies and their differences; a notebook shows the figure.

        Args:
            out: A file that ends in .png, .pdf or .svg, if the figure is to be written.
            against: The policy that the others are compared with. Default: that of the comparison.
            measure: One measure of the comparison or several. Default: the most important ones.

        Raises UsageError for a policy or a measure that is not one of those compared, and for the
        file.
        """
        from desim_uav.experiment.plot import Target, draw

        target = None if out is None else Target(Path(out), "out")
        figure = draw("compare", [self], {"against": against, "measure": measure})
        if target is not None:
            target.write(figure)
        return figure

    def __repr__(self) -> str:
        policies = ", ".join(self.policies)
        seeds = len({r.seed for r in self.replications})
        return f"<Comparison in {self.scenario} of {policies} on {seeds} seed(s)>"

    def _repr_html_(self) -> str:
        content = self.content()
        title = (
            f"{self.scenario}, {self.episodes} episode(s) after {self.warmup} of warm-up: mean "
            f"over seeds, {LEVEL:.0%} interval"
        )
        html = notebook.heading(title) + _html(content["policies"])
        if content["differences"]:
            title = f"difference from {self.against}, paired by seed"
            html += notebook.heading(title) + _html(content["differences"])
        return html

    def _estimates(self, policy: str) -> dict[str, Any]:
        runs = self._of(policy).values()
        return {
            "policy": policy,
            "seeds": [r.seed for r in runs],
            "measures": {
                name: estimate(r.measures[name] for r in runs).values() for name in self.measures
            },
        }

    def _differences(self, policy: str) -> dict[str, Any]:
        runs, reference = self._of(policy), self._of(self.against)
        common = [key for key in runs if key in reference]

        def difference(name: str) -> dict[str, Any]:
            values, references = (
                [of[key].measures[name] for key in common] for of in (runs, reference)
            )
            minus = paired(values, references)
            return minus.values() | {"excludes_zero": minus.excludes_zero}

        return {
            "policy": policy,
            "against": self.against,
            "seeds": [seed for seed, _ in common],
            "measures": {name: difference(name) for name in self.measures},
        }

    def _of(self, policy: str) -> dict[tuple[int, int], Replication]:
        of_policy = (r for r in self.replications if r.policy == policy)
        return {r.sample_paths: r for r in sorted(of_policy, key=lambda r: r.sample_paths)}


def compare_policies(
    scenario: Scenario,
    policies: Mapping[str, PolicyLike],
    seeds: Sequence[int],
    episodes: int,
    warmup: int,
    *,
    against: str | None,
    jobs: int,
    engine: str,
    measures: Sequence[str] | None = None,
    on_replication: Callable[[], None] = lambda: None,
) -> Comparison:
    """Run each policy on each seed; the seed draws the world, too, unless the scenario names one.

    ``policies`` maps names to policies; ``engine`` is auto, des or batch; ``measures`` are names of
    measures, by default those that comparisons have in the scenario. After Ctrl-C the finished
    replications are returned. Raises KeyboardInterrupt if there is none.
    """
    reference = reference_of(list(policies), against)
    measured = partial(evaluate, measures=measures)
    if jobs > 1:
        _check_portable(policies)
    pairs = [(policy, seed) for seed in seeds for policy in policies]
    tasks = [(scenario, policies[policy], seed, episodes, warmup, engine) for policy, seed in pairs]
    replications: list[Replication] = []
    interrupted = False
    try:
        with closing(run_each(measured, tasks, jobs)) as ended:
            for number, values in ended:
                policy, seed = pairs[number]
                replications.append(
                    Replication(policy, seed, world_seed_of(scenario, seed), values)
                )
                on_replication()
    except KeyboardInterrupt:
        if not replications:
            raise
        interrupted = True
    return Comparison(
        scenario.name, episodes, warmup, list(policies), reference, replications, interrupted
    )


def _check_portable(policies: Mapping[str, PolicyLike]) -> None:
    """Raise UsageError if a policy cannot be sent to another process."""
    for name, policy in policies.items():
        try:
            pickle.dumps(policy)
        except Exception as error:  # a user's object may raise anything
            raise UsageError(
                f"-j, jobs: policy {name!r} cannot be sent to another process ({error}); use jobs=1"
            ) from error


def policy_names(texts: Sequence[str]) -> list[str]:
    """Return the policies of a command line's list, which was separated at its commas.

    Raises UsageError if a name is empty or given twice, and PolicyError if one cannot be loaded.
    """
    text, names = ",".join(texts), [name.strip() for name in texts]
    for name in names:
        if not name:
            raise UsageError(
                f"--policies {text}: a name is empty (names are separated by commas, "
                "so none can contain a comma)"
            )
        if names.count(name) > 1:
            raise UsageError(f"--policies {text}: {name!r} is given twice")
    for name in names:
        load_policy(name)
    return names


def policies_by_name(
    policies: Sequence[PolicyLike] | Mapping[str, PolicyLike],
) -> dict[str, PolicyLike]:
    """Return policies by their names in tables. Raises UsageError if a name is given twice."""
    if isinstance(policies, Mapping):
        by_name = dict(policies)
    else:
        policies = list(policies)
        names = [policy_name(policy) for policy in policies]
        for name in names:
            if names.count(name) > 1:
                raise UsageError(
                    f"policies: {name!r} is given twice; use a mapping to give each a name"
                )
        by_name = dict(zip(names, policies, strict=True))
    if not by_name:
        raise UsageError("policies: the list is empty")
    for policy in by_name.values():
        load_policy(policy)
    return by_name


def the_scenario(arguments: Sequence[str]) -> str:
    """Return the one scenario to run policies in. Raises UsageError for any other number."""
    if len(arguments) != 1:
        raise UsageError(f"--policies: give one scenario, not {len(arguments)}")
    return arguments[0]


def try_on(
    scenario: Scenario,
    policies: Mapping[str, PolicyLike],
    seeds: Sequence[int],
    engine: str,
) -> None:
    """Let each policy begin once, before anything is run.

    Raises PolicyError if a policy does not fit the scenario, and ScenarioError if the engine cannot
    run a component.
    """
    world = at_once(build_world, scenario, world_seed_of(scenario, seeds[0]))
    check_engine(engine, world)
    look_ahead(engine, world)
    for policy in policies.values():
        begin_once(scenario, policy, seeds[0])


def begin_once(scenario: Scenario, policy: PolicyLike, seed: int) -> None:
    """Let a policy begin in the world of a seed. Raises PolicyError if it does not fit."""
    loaded = load_policy(policy)
    world = at_once(build_world, as_seen(scenario, loaded), world_seed_of(scenario, seed))
    loaded.begin(world, Streams(seed, Purpose.LEARNER), False)


def out_of_place(
    scenario: Scenario, policies: Mapping[str, PolicyLike], seeds: Sequence[int]
) -> list[str]:
    """Return a warning for each policy that was learned in a world other than the compared ones."""
    worlds = {world_seed_of(scenario, seed) for seed in seeds}
    warnings = []
    for name, policy in policies.items():
        world_seed = getattr(load_policy(policy), "world_seed", None)
        if world_seed is not None and worlds != {world_seed}:
            where = f"world {min(worlds)}" if len(worlds) == 1 else "a world for each seed"
            warnings.append(
                f"{name} was learned in world {world_seed} and is compared in {where}; "
                f"set the world seed to {world_seed} to compare it in its own world"
            )
    return warnings


def reference_of(policies: Sequence[str], against: str | None) -> str:
    """Return the policy with which others are compared, by default the first. Raises UsageError."""
    if against is None:
        return policies[0]
    if against not in policies:
        raise UsageError(
            f"against: {against}: this is not one of the policies"
            f"{did_you_mean(against, policies)}: "
            f"{', '.join(policies)}"
        )
    return against


def world_seed_of(scenario: Scenario, seed: int) -> int:
    """Return the seed of the world of a run on this seed."""
    return seed if scenario.world_seed is None else scenario.world_seed


def _estimates_frame(rows: Sequence[dict[str, Any]], measures: Sequence[str]) -> pd.DataFrame:
    records = [
        {"measure": name, "policy": row["policy"]} | row["measures"][name]
        for name in measures
        for row in rows
    ]
    columns = ["n", "mean", "half_width", "low", "high"]
    columns += ["excludes_zero"] if rows and "excludes_zero" in records[0] else []
    frame = pd.DataFrame(records, columns=["measure", "policy", *columns])
    numbers = dict.fromkeys(["mean", "half_width", "low", "high"], "float64")
    return frame.astype(numbers).set_index(["measure", "policy"])


def _html(rows: Sequence[dict[str, Any]]) -> str:
    """Return a table with a row per measure and policy."""
    cells = [
        [label if first else "", row["policy"], *estimate_cells(name, row["measures"][name], form)]
        for name, (label, form) in looks(rows[0]["measures"]).items()
        for first, row in zip([True, *[False] * len(rows)], rows, strict=False)
    ]
    headings = ["measure", "policy", "seeds", "mean", "", "", ""]
    return notebook.table(headings, cells, words=[0, 1])
