"""Runs many tasks on a Ray cluster, or with Ray on this machine, each on one core.

Ray repeats a task whose process or machine has died, so the result of a task must depend on its
arguments only.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from desim_uav.available import processors
from desim_uav.errors import MissingExtraError, UsageError
from desim_uav.experiment.processes import ENDS_WITH_STDIN

RETRIES = 3
AT_A_TIME = 1000
"""The default number of tasks submitted at a time: enough for a cluster to start more machines."""

CONNECT_S, ANSWER_S = 5.0, 20.0
"""Time limits in seconds: for connecting to a machine, and for joining its cluster."""

JOIN = (
    ENDS_WITH_STDIN
    + """
import ray
print("imported", flush=True)
ray.init(sys.argv[1], log_to_driver=False, logging_level="ERROR")
"""
)


@contextmanager
def ray_backend(
    jobs: int | None, address: str | None, quiet: bool = False
) -> Iterator[Callable[..., Generator[tuple[int, Any]]]]:
    """Connect to Ray and yield a function that runs tasks on it, as ``run_each`` does.

    ``jobs`` is the largest number of tasks at a time, ``address`` that of a cluster (None: this
    machine alone). ``quiet`` hides what Ray prints about its nodes. Raises MissingExtraError if Ray
    is not installed, and UsageError if there is no such cluster.
    """
    ray = import_ray()
    if address not in (None, "auto"):
        _require_cluster(address)
    with _connected(ray, address, quiet):
        yield partial(_run_each, ray, jobs)


def _run_each(
    ray: Any,
    jobs: int | None,
    function: Callable[..., Any],
    tasks: Sequence[tuple[Any, ...]],
    died: Callable[[str], Any],
) -> Generator[tuple[int, Any]]:
    """Call ``function`` with the arguments of each task, on as many cores as Ray has.

    Yields the number and the result of each task when it has ended; ``died`` makes the result of a
    task that Ray has given up of the reason.
    """
    numbers = iter(range(len(tasks)))
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
                result = died(f"Ray has given it up: {_first_line(error)}")
            yield number, result


def _require_cluster(address: str) -> None:
    """Raise UsageError within half a minute if no cluster can be joined at HOST:PORT.

    Ray itself would try for a quarter of an hour and ignore Ctrl-C meanwhile. Therefore a process
    that can be killed joins the cluster first.
    """
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise UsageError(f"--address {address}: write auto or HOST:PORT")
    complaint = f"--backend ray: --address {address}: no Ray cluster answers there"
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=CONNECT_S).close()
    except OSError as error:
        raise UsageError(f"{complaint}: {error.strerror or error}") from error
    with subprocess.Popen(
        [sys.executable, "-c", JOIN, address],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as joining:
        try:
            assert joining.stdout is not None
            joining.stdout.readline()  # importing Ray may take long; the time limit begins after it
            code = joining.wait(ANSWER_S)
        except subprocess.TimeoutExpired:
            raise UsageError(f"{complaint} within {ANSWER_S:.0f} s") from None
        finally:
            joining.kill()
    if code != 0:
        raise UsageError(f"{complaint}, or it runs another version of Ray or Python")


def import_ray() -> Any:
    """Import and return Ray. Raises MissingExtraError if it is not installed."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # send no usage statistics
    try:
        import ray
    except ImportError as error:
        raise MissingExtraError("--backend ray", "ray") from error
    return ray


@contextmanager
def _connected(ray: Any, address: str | None, quiet: bool) -> Iterator[None]:
    """Connect to Ray while the block runs; the handling of signals stays as it was."""
    before = signal.getsignal(signal.SIGTERM)
    quietly: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    if address is None:
        quietly["include_dashboard"] = False
        quietly["num_cpus"] = processors()  # Ray itself does not see the limits of a batch job
    try:
        ray.init(address or "local", **quietly)
    except Exception as error:  # ConnectionError, ValueError, RuntimeError, gRPC's own
        where = "on this machine" if address is None else f"--address {address}"
        raise UsageError(f"--backend ray: {where}: {_first_line(error)}") from error
    try:
        with suppress(ValueError, TypeError):  # outside the main thread, or for a foreign handler
            signal.signal(signal.SIGTERM, before)
        with _rays_words(quiet):
            yield
    finally:
        ray.shutdown()


@contextmanager
def _rays_words(quiet: bool) -> Iterator[None]:
    """Send what Ray prints about its nodes to stderr, or nowhere; stdout is for data only."""
    if not quiet:
        with redirect_stdout(sys.stderr):
            yield
        return
    with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
        yield


def _first_line(error: Exception) -> str:
    return next(iter(str(error).strip().splitlines()), type(error).__name__)
