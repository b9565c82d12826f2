"""Runs many tasks, several at a time, in processes that all end with this one."""

from __future__ import annotations

import multiprocessing as mp
import os
import pickle
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar, cast

from desim_uav.errors import SimulationError
from desim_uav.experiment.interrupt import at_once
from desim_uav.registry import FAULTS, what_failed

T = TypeVar("T")

DIED = "a process has died; if memory ran out, run fewer at a time (-j)"


def run_each(
    function: Callable[..., T],
    tasks: Sequence[tuple[Any, ...]],
    jobs: int,
    died: Callable[[str], T] | None = None,
) -> Generator[tuple[int, T]]:
    """Call ``function`` with the arguments of each task, ``jobs`` at a time.

    Yields the number and the result of each task when it has ended; the other tasks end if the
    iterator is closed. The first error ends all tasks, and so does a process that dies. With
    ``died``, which makes a result of the reason, a new process continues with the other tasks.
    """
    if jobs == 1 or len(tasks) < 2:
        for number, task in enumerate(tasks):
            yield number, at_once(function, *task)
        return
    numbers = iter(range(len(tasks)))
    with _workers(function, tasks) as start:
        busy = {_sent(start(), number): number for number in islice(numbers, jobs)}
        while busy:
            for worker in cast(list[Connection], wait(busy)):
                number, result = busy.pop(worker), _answer(worker)
                if result is DIED and died is None:
                    raise SimulationError(DIED)
                for following in islice(numbers, 1):
                    busy[_sent(start() if result is DIED else worker, following)] = following
                if isinstance(result, Exception):
                    raise result
                yield number, died(DIED) if result is DIED and died is not None else result


def _sent(worker: Connection, number: int) -> Connection:
    """Send a task to a worker and return the worker; ``_answer`` tells if it is dead."""
    with suppress(ConnectionError):
        worker.send(number)
    return worker


def _answer(worker: Connection) -> Any:
    """Return the result of a worker's task, or ``DIED``."""
    try:
        return worker.recv()
    except (EOFError, ConnectionError):
        return DIED


@contextmanager
def _workers(
    function: Callable[..., Any], tasks: Sequence[tuple[Any, ...]]
) -> Iterator[Callable[[], Connection]]:
    """Yield a function that starts a process, which takes numbers of tasks and returns results."""
    spawn = mp.get_context("spawn")
    processes = []

    def start() -> Connection:
        ours, theirs = spawn.Pipe()
        process = spawn.Process(target=_work, args=(theirs, function, tasks))
        processes.append(process)
        with _signals_blocked():
            process.start()
        theirs.close()
        return ours

    try:
        yield start
    finally:
        for process in processes:
            if process.pid is not None:
                process.kill()
                process.join()


def _work(
    connection: Connection, function: Callable[..., Any], tasks: Sequence[tuple[Any, ...]]
) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, ConnectionError):  # the parent has ended
        while True:
            number = connection.recv()
            try:
                result = function(*tasks[number])
            except FAULTS as error:
                result = _portable(error)
            connection.send(result)


def _end_with_parent() -> None:
    parent = mp.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _portable(error: BaseException) -> Exception:
    """Return an error, or its message as a SimulationError if it cannot be sent to the parent."""
    if not isinstance(error, Exception):
        return SimulationError(what_failed(error))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return SimulationError(f"{type(error).__name__}: {error}")
    return error


@contextmanager
def _signals_blocked() -> Iterator[None]:
    """Let processes that are started in the block ignore Ctrl-C, which is for their parent."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # its start unblocks signals, so it must not come later
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
