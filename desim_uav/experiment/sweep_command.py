"""The work of ``desim-uav sweep``: the plan, the folder, the backend and the table of a sweep."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from desim_uav.errors import UsageError
from desim_uav.experiment.compare import out_of_place, policy_names
from desim_uav.experiment.grid import Axis, axes
from desim_uav.experiment.on_ray import import_ray, ray_backend
from desim_uav.experiment.processes import run_each
from desim_uav.experiment.progress import progress
from desim_uav.experiment.statistics import LEVEL, Estimate
from desim_uav.experiment.sweep import Backend, Failure, Job, Row, estimates, jobs, run_jobs
from desim_uav.experiment.sweep_folder import FAILED, SweepFolder
from desim_uav.experiment.sweep_plan import Arm, arms
from desim_uav.report import notebook
from desim_uav.report.intervals import mean_words, sentence
from desim_uav.run_folder import write_whole
from desim_uav.scenario.draft import named_override

BACKENDS = ("local", "ray")
SHOWN_FAILURES = 10
MEASURES = {
    "qoe1_percent": ("QoE1 %", ".1f"),
    "qoe2_iterations": ("QoE2 it.", ".2f"),
    "qoe3_percent": ("QoE3 %", ".1f"),
    "crashes_per_drone_episode": ("crashes/drone/ep.", ".3f"),
    "reward_mean": ("reward", ".2f"),
}
"""Headings and formats of the table at the end of a sweep."""


@dataclass(frozen=True)
class Asked:
    """The options of a command line; lists are separated by commas.

    ``policies`` None means the baseline, or no policy if something is trained. ``algorithms`` None
    means the scenario's own.
    """

    overrides: Sequence[str]
    policies: str | None
    train: bool
    algorithms: str | None
    seeds: range
    episodes: int
    warmup: int
    engine: str | None

    def policy_names(self) -> list[str]:
        """Return the policies to run. Raises UsageError, or PolicyError if one cannot be loaded."""
        default = "" if self.train else "baseline"
        names = default if self.policies is None else self.policies
        return policy_names(names) if names or self.policies is not None else []

    def algorithm_names(self) -> list[str | None]:
        """Return the algorithms to train by. Raises UsageError for wrong options."""
        if self.algorithms is None:
            return [None] if self.train else []
        if not self.train:
            raise UsageError("--algorithm needs --train")
        if any(override.startswith("learning.algorithm=") for override in self.overrides):
            raise UsageError(
                f"{named_override('learning.algorithm')}: --algorithm sets this key already"
            )
        names = [name.strip() for name in self.algorithms.split(",")]
        for name in names:
            if not name or names.count(name) > 1:
                problem = f"{name!r} is given twice" if name else "a name is empty"
                raise UsageError(f"--algorithm {self.algorithms}: {problem}")
        return list(names)


@dataclass(frozen=True)
class Done:
    """A sweep that has ended or was interrupted."""

    out: Path
    axes: Sequence[Axis]
    jobs: Sequence[Job]
    rows: Sequence[Row]
    failures: Sequence[Failure]
    interrupted: bool

    def content(self) -> dict[str, Any]:
        """Return all as plain data: rows, estimates by combination and policy, and failures."""
        first = self.jobs[0]
        return {
            "scenario": first.arm.scenario.name,
            "out": str(self.out),
            "episodes": first.episodes,
            "warmup": first.warmup,
            "confidence": LEVEL,
            "interrupted": self.interrupted,
            "rows": list(self.rows),
            "estimates": [_plain(arm, found) for arm, found in self._estimates()],
            "failed": [failure.content() for failure in self.failures],
        }

    @property
    def frame(self) -> pd.DataFrame:
        """One row per job that has ended: the values of the keys, the policy and its measures."""
        return pd.DataFrame(list(self.rows))

    def __repr__(self) -> str:
        ended = f"{len(self.rows)} of {len(self.jobs)} jobs have ended"
        return f"<Sweep in {self.out}: {ended}, {len(self.failures)} have failed>"

    def _repr_html_(self) -> str:
        words = range(self.headings().index("policy") + 1)
        return notebook.heading(repr(self)[1:-1]) + notebook.table(
            self.headings(), self.lines(), words
        )

    def headings(self) -> list[str]:
        """Return the table's headings: the keys that vary, the policy, and the measures."""
        return [*self._varied(), "policy", "seeds", *(heading for heading, _ in MEASURES.values())]

    def lines(self) -> list[list[str]]:
        """Return a line of means and half-widths for each combination and policy."""
        return [
            [
                *("null" if (v := arm.combination.cells[k]) is None else f"{v}" for k in varied),
                arm.policy,
                str(found["reward_mean"].n),
                *(format(found[name], form) for name, (_, form) in MEASURES.items()),
            ]
            for varied in [self._varied()]
            for arm, found in self._estimates()
        ]

    def markdown(self, command: Sequence[str]) -> str:
        """Return the table as Markdown, with the command that made it."""
        first = self.jobs[0]
        rule = ["---" for _ in self.headings()]
        lines = [[cell.replace("|", "\\|") for cell in line] for line in self.lines()]
        table = ["| " + " | ".join(row) + " |" for row in (self.headings(), rule, *lines)]
        rows = [{"measures": _measures(found)} for _, found in self._estimates()]
        words = sentence(mean_words(rows)).removesuffix(".")
        about = f"{words}, of {first.episodes} episode(s) after {first.warmup} of warm-up per seed."
        return "\n".join([f"`{' '.join(command)}`", "", about, "", *table]) + "\n"

    def complaint(self) -> str:
        """Return the first failures, and the file that lists all of them."""
        lines = [f"{f.job.arm.name}, seed {f.job.seed}: {f.reason}" for f in self.failures]
        more = len(lines) - SHOWN_FAILURES
        rest = [f"and {more} more"] if more > 0 else []
        rest += [f"{len(lines)} of {len(self.jobs)} jobs failed, see {self.out / FAILED}"]
        return "\n".join(lines[:SHOWN_FAILURES] + rest)

    def _varied(self) -> list[str]:
        return [axis.key for axis in self.axes if len(axis.values) > 1]

    def _estimates(self) -> list[tuple[Arm, dict[str, Estimate]]]:
        return estimates(self.jobs, self.rows)


def sweep_to_folder(
    path: Path,
    asked: Asked,
    out: Path,
    *,
    resume: bool,
    backend: str = "local",
    workers: int | None = None,
    address: str | None = None,
    command: Sequence[str] = (),
    show_progress: bool = False,
    say: Callable[[str], None] = lambda notice: None,
) -> Done:
    """Run a sweep and keep the row of each job when it has ended.

    ``path`` is the scenario's file, ``workers`` the number of jobs at a time, ``address`` that of a
    Ray cluster. Ctrl-C ends the sweep; finished jobs are kept. Errors in the options, scenario,
    policies or folder are raised before the first job.
    """
    _check_backend(backend, address)
    swept, algorithms = axes(asked.overrides), asked.algorithm_names()
    tried = arms(path, swept, asked.policy_names(), algorithms, asked.seeds[0], asked.engine, say)
    todo = jobs(tried, asked.seeds, asked.episodes, asked.warmup)
    for warning in _warnings(tried, asked.seeds):
        say(warning)
    folder = SweepFolder(out, swept)
    with _backend(backend, workers, address, not show_progress) as run, folder.held():
        folder.open(path, todo, resume, list(command))
        finished = folder.rows(todo)
        left = [job for job in todo if job.id not in finished]
        if finished:
            say(f"{len(finished)} of {len(todo)} jobs had ended before")
        with progress(show_progress, len(left), "jobs", "batch") as advance:
            rows, failures, interrupted = run_jobs(left, folder, run, advance)
        finished |= {row["job"]: row for row in rows}
        if interrupted:  # perhaps after a row was written and before it was noted here
            finished = folder.rows(todo)
        ordered = [finished[job.id] for job in todo if job.id in finished]
        done = Done(out, swept, todo, ordered, failures, interrupted)
        folder.list_failures(failures)
        write_whole(out / "table.md", done.markdown(command).encode())
    return done


def _check_backend(name: str, address: str | None) -> None:
    """Raise UsageError, or MissingExtraError if Ray is needed and not installed."""
    if name == "ray":
        import_ray()
    elif address is not None:
        raise UsageError("--address needs --backend ray")


@contextmanager
def _backend(name: str, workers: int | None, address: str | None, quiet: bool) -> Iterator[Backend]:
    """Yield the backend; it is made before the folder, so a failed connection leaves no folder."""
    if name == "ray":
        with ray_backend(workers, address, quiet) as run:
            yield run
    else:
        yield partial(run_each, jobs=workers or 1)


def _warnings(tried: Sequence[Arm], seeds: range) -> list[str]:
    """Return a warning for each policy that was learned in a world outside the sweep."""
    worlds = {(arm.scenario.world_seed, arm.policy): arm for arm in tried if not arm.algorithm}
    found = (out_of_place(arm.scenario, {arm.policy: arm.policy}, seeds) for arm in worlds.values())
    return list(dict.fromkeys(warning for some in found for warning in some))


def _plain(arm: Arm, found: dict[str, Estimate]) -> dict[str, Any]:
    return arm.combination.cells | {"policy": arm.policy, "measures": _measures(found)}


def _measures(found: dict[str, Estimate]) -> dict[str, dict[str, Any]]:
    return {
        name: {"n": of.n, "mean": of.mean, "half_width": of.half_width}
        for name, of in found.items()
    }
