"""The work of ``desim-uav sweep``: its jobs are planned, run, kept in the folder and tabulated."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from functools import partial
from pathlib import Path

from desim_uav import __version__
from desim_uav.disk import write_whole
from desim_uav.errors import UsageError
from desim_uav.experiment.interrupt import undisturbed
from desim_uav.experiment.processes import run_each
from desim_uav.experiment.progress import progress
from desim_uav.experiment.sweep.folder import SweepFolder
from desim_uav.experiment.sweep.grid import axes
from desim_uav.experiment.sweep.job import Failure, JobOutcome, jobs, measured, run_job
from desim_uav.experiment.sweep.on_ray import import_ray, ray_backend
from desim_uav.experiment.sweep.plan import SweepPlan, arms, warnings
from desim_uav.experiment.sweep.table import Done

BACKENDS = ("local", "ray")

Backend = Callable[..., Generator[tuple[int, JobOutcome]]]
"""Calls a function with the arguments of each task, on this machine or elsewhere (``run_each``)."""


def sweep_to_folder(
    plan: SweepPlan,
    out: Path,
    *,
    resume: bool,
    backend: str,
    workers: int | None,
    address: str | None,
    command: Sequence[str],
    show_progress: bool,
    say: Callable[[str], None],
) -> Done:
    """Run a sweep and keep the row of each job when it has ended.

    ``workers`` is the number of jobs at a time, ``address`` that of a Ray cluster. Ctrl-C ends the
    sweep; finished jobs are kept. Errors in the options, scenario, policies or folder are raised
    before the first job.
    """
    _check_backend(backend, address)
    swept = axes(plan.values)
    tried = arms(plan, swept, say)
    if len(tried) == 1:
        say(
            "no key has several values, so nothing is swept: one policy is run in one scenario "
            "(-S KEY=V,W gives a key several values)"
        )
    todo = jobs(plan, tried)
    for warning in warnings(tried, plan.seeds):
        say(warning)
    measures = measured(todo, plan.measures)
    folder = SweepFolder(out, swept, measures)
    failures, interrupted = list[Failure](), False
    with _backend(backend, workers, address, not show_progress) as run, folder.held():
        exists = folder.open(plan.source, todo, resume, list(command))
        finished = folder.rows(todo)
        if resume and not exists:
            say(f"--resume: {out} holds no sweep, so there is nothing to resume: it begins anew")
        if finished:
            say(f"{len(finished)} of {len(todo)} jobs had ended before")
        left = [job for job in todo if job.id not in finished]
        ended = run(run_job, [(job, __version__, measures) for job in left], died=JobOutcome.failed)
        try:
            with progress(show_progress, len(left), "jobs", "batch") as advance, closing(ended):
                for number, outcome in ended:
                    job = left[number]
                    if outcome.measures is None:
                        failures.append(Failure(job, outcome.failure))
                    else:
                        finished[job.id] = folder.keep(job, outcome)
                    advance()
        except KeyboardInterrupt:
            interrupted = True
        with suppress(KeyboardInterrupt), undisturbed():
            if interrupted:  # perhaps after a row was written and before it was noted here
                finished = folder.rows(todo)
            rows = [finished[job.id] for job in todo if job.id in finished]
            results = Done(out, swept, todo, rows, failures, interrupted, plan.measures)
            folder.list_failures(failures)
            write_whole(out / "table.md", results.markdown(command).encode())
    return results


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
