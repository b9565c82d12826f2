"""Many tasks, several at a time: each in a process of its own, and all of them end with ours."""

from __future__ import annotations

import multiprocessing as mp
import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any, cast

from desim_uav.errors import SimulationError


def run_each(
    function: Callable[..., Any],
    tasks: Sequence[tuple[Any, ...]],
    jobs: int,
    on_end: Callable[[int, Any], None],
) -> None:
    """Call ``function`` with the arguments of each task, ``jobs`` at a time.

    ``on_end`` gets a task's number and its result as it ends. The first error ends them all.
    """
    if jobs == 1 or len(tasks) < 2:
        for number, task in enumerate(tasks):
            on_end(number, function(*task))
        return
    numbers = iter(range(len(tasks)))
    with _workers(min(jobs, len(tasks)), function, tasks) as workers:
        busy = {worker for worker in workers if _send_next(worker, numbers)}
        while busy:
            for worker in cast(list[Connection], wait(busy)):
                with _alive():
                    number, result = worker.recv()
                if not _send_next(worker, numbers):
                    busy.remove(worker)
                if isinstance(result, Exception):
                    raise result
                on_end(number, result)


def _send_next(worker: Connection, numbers: Iterator[int]) -> bool:
    """Give a worker the next task; is there one?"""
    for number in numbers:
        with _alive():
            worker.send(number)
        return True
    return False


@contextmanager
def _alive() -> Iterator[None]:
    """Talk to a worker, which should be there."""
    try:
        yield
    except (EOFError, ConnectionError) as error:
        raise SimulationError(
            "a process has died; if memory ran out, run fewer at a time (-j)"
        ) from error


@contextmanager
def _workers(
    count: int, function: Callable[..., Any], tasks: Sequence[tuple[Any, ...]]
) -> Iterator[list[Connection]]:
    """Processes that each take the number of a task, and answer with it and the result."""
    spawn = mp.get_context("spawn")
    pipes = [spawn.Pipe() for _ in range(count)]
    processes = [spawn.Process(target=_work, args=(theirs, function, tasks)) for _, theirs in pipes]
    try:
        with _deaf_to_signals():
            for process in processes:
                process.start()
        for _, theirs in pipes:
            theirs.close()
        yield [ours for ours, _ in pipes]
    finally:
        for process in processes:
            if process.pid is not None:
                process.kill()
                process.join()


def _work(
    connection: Connection, function: Callable[..., Any], tasks: Sequence[tuple[Any, ...]]
) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, ConnectionError):  # the parent has gone
        while True:
            number = connection.recv()
            try:
                result = function(*tasks[number])
            except Exception as error:
                result = _portable(error)
            connection.send((number, result))


def _end_with_parent() -> None:
    parent = mp.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _portable(error: Exception) -> Exception:
    """An error as it is, or what it says, where it cannot be sent."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return SimulationError(f"{type(error).__name__}: {error}")
    return error


@contextmanager
def _deaf_to_signals() -> Iterator[None]:
    """Processes started meanwhile never hear Ctrl-C and its like, which are for their parent."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # started later, it would make us hear again
    heard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, heard)
