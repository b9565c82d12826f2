"""Many tasks on a Ray cluster, or on this machine as one: each a task of Ray's, on one core.

Ray runs a task again whose process or machine has died, so a task must be a function of its
arguments.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from itertools import islice
from typing import Any

from desim_uav.errors import MissingExtraError, UsageError

RETRIES = 3
AT_A_TIME = 1000
"""Tasks that Ray is given together, unless told: enough for its cluster to know what to start."""


def run_each_on_ray(
    function: Callable[..., Any],
    tasks: Sequence[tuple[Any, ...]],
    jobs: int | None,
    address: str | None,
    *,
    on_end: Callable[[int, Any], None],
    on_death: Callable[[int, str], None],
) -> None:
    """Call ``function`` with the arguments of each task, on as many cores as Ray has.

    ``jobs``: at most so many at a time. ``address``: of a cluster, or None: this machine alone.
    ``on_end`` gets a task's number and its result as it ends, ``on_death`` the number of one that
    Ray has given up, and why. Raises UsageError where there is no such cluster.
    """
    ray = import_ray()
    numbers = iter(range(len(tasks)))
    with _connected(ray, address):
        remote = ray.remote(function).options(num_cpus=1, max_retries=RETRIES)
        running: dict[Any, int] = {}
        while True:
            for number in islice(numbers, (jobs or AT_A_TIME) - len(running)):
                running[remote.remote(*tasks[number])] = number
            if not running:
                return
            for ended in ray.wait(list(running))[0]:
                number = running.pop(ended)
                try:
                    result = ray.get(ended)
                except ray.exceptions.RayError as error:
                    on_death(number, f"given up by Ray: {_first_line(error)}")
                else:
                    on_end(number, result)


def import_ray() -> Any:
    """Ray. Raises MissingExtraError."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nobody is told of what is run
    try:
        import ray
    except ImportError as error:
        raise MissingExtraError("--backend ray", "ray") from error
    return ray


@contextmanager
def _connected(ray: Any, address: str | None) -> Iterator[None]:
    """Ray until the end of what is done in here, which hears signals as it did before."""
    before = signal.getsignal(signal.SIGTERM)
    quietly: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    if address is None:
        quietly["include_dashboard"] = False
    try:
        ray.init(address or "local", **quietly)
    except Exception as error:  # ConnectionError, ValueError, RuntimeError, gRPC's own
        where = "on this machine" if address is None else f"--address {address}"
        raise UsageError(f"--backend ray: {where}: {_first_line(error)}") from error
    try:
        with suppress(ValueError, TypeError):  # only the main thread may, and only what it knows
            signal.signal(signal.SIGTERM, before)
        with redirect_stdout(sys.stderr):  # where Ray tells of dead workers, and stdout is data's
            yield
    finally:
        ray.shutdown()


def _first_line(error: Exception) -> str:
    return next(iter(str(error).strip().splitlines()), type(error).__name__)
