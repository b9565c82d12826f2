"""Runs many tasks, several at a time, in processes that all end with this one."""

from __future__ import annotations

import multiprocessing as mp
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from itertools import islice
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar, cast

from desim_uav.errors import SimulationError, UsageError
from desim_uav.experiment.interrupt import asking, at_once, undisturbed
from desim_uav.registry import FAULTS, what_failed

T = TypeVar("T")

ENDS_WITH_STDIN = """
import os, sys, threading
threading.Thread(target=lambda: (os.read(0, 1), os._exit(1)), daemon=True).start()
"""
"""The beginning of a program that ends with the process that holds the other end of its stdin."""

_SCRIPT = (
    ENDS_WITH_STDIN
    + """
import runpy
del sys.argv[0]
sys.path[0] = os.path.dirname(sys.argv[0])
runpy.run_path(sys.argv[0], run_name="__main__")
"""
)

DIED = "a process has died; if memory ran out, run fewer at a time (-j)"

NO_FILE = (
    "a script from standard input cannot be run by several processes, because each of them reads "
    "the script again: save it in a file, or run one at a time (jobs=1)"
)
NO_START = (
    "a process that runs a part of the work has ended before it began, perhaps with a message "
    "above. It first runs the script again, so a script must do its work under "
    '`if __name__ == "__main__":`; or run one at a time (-j 1, jobs=1)'
)


def run_script(words: Sequence[str]) -> tuple[int, str]:
    """Run a Python script with its arguments in a process that ends with this one, however it ends.

    Returns its exit code and what it has written to stderr; its stdout is dropped.
    """
    command, pipe = [sys.executable, "-c", _SCRIPT, *words], subprocess.PIPE
    with subprocess.Popen(
        command, stdin=pipe, stdout=subprocess.DEVNULL, stderr=pipe, text=True
    ) as script:
        assert script.stderr is not None
        said = script.stderr.read()
        return script.wait(), said


class _Started:
    """The first message of a process, by which it says that it has begun."""


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
    Raises UsageError if no process can begin, because of how the program was started.
    """
    if jobs == 1 or len(tasks) < 2:
        for number, task in enumerate(tasks):
            yield number, at_once(function, *task)
        return
    numbers = iter(range(len(tasks)))
    with _workers(function, tasks) as start:
        busy = {_sent(start(), number): number for number in islice(numbers, jobs)}
        some_began = False
        while busy:
            for worker in cast(list[Connection], wait(busy)):
                result = _answer(worker)
                if isinstance(result, _Started):
                    some_began = True
                    continue
                if result is DIED and not some_began:
                    raise UsageError(NO_START)
                if result is DIED and died is None:
                    raise SimulationError(DIED)
                number = busy.pop(worker)
                for following in islice(numbers, 1):
                    busy[_sent(start() if result is DIED else worker, following)] = following
                if isinstance(result, Exception):
                    raise result
                yield number, died(DIED) if result is DIED and died is not None else result


def results_of(
    function: Callable[..., T],
    tasks: Sequence[tuple[Any, ...]],
    jobs: int,
    on_each: Callable[[], None] = lambda: None,
) -> list[T]:
    """Return the results of ``run_each`` in the order of tasks, and call ``on_each`` after each.

    Raises what ``run_each`` raises.
    """
    results: dict[int, T] = {}
    with closing(run_each(function, tasks, jobs)) as ended:
        for number, result in ended:
            results[number] = result
            on_each()
    return [results[number] for number in range(len(tasks))]


def _sent(worker: Connection, number: int) -> Connection:
    """Send a task to a worker and return the worker; ``_answer`` tells if it is dead."""
    with suppress(ConnectionError):
        worker.send(number)
    return worker


def _answer(worker: Connection) -> Any:
    """Return ``_Started`` from a worker that has begun, the result of its task, or ``DIED``."""
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
    if getattr(sys.modules["__main__"], "__file__", None) == "<stdin>":
        raise UsageError(NO_FILE)

    def start() -> Connection:
        ours, theirs = spawn.Pipe()
        process = spawn.Process(target=_work, args=(theirs, function, tasks))
        with _signals_blocked():
            try:
                process.start()
            except OSError as error:
                reason = f"no further process can be started ({error.strerror or error})"
                raise SimulationError(f"{reason}; run fewer at a time (-j)") from error
            except RuntimeError:
                if "__mp_main__" not in sys.modules:
                    raise
                sys.exit(f"desim-uav: {NO_START}")  # this is a process that runs the script again
        processes.append(process)
        theirs.close()
        return ours

    try:
        yield start
    finally:
        with undisturbed():
            for process in processes:
                process.kill()
                process.join()


def _work(
    connection: Connection, function: Callable[..., Any], tasks: Sequence[tuple[Any, ...]]
) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, ConnectionError):  # the parent has ended
        connection.send(_Started())
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
    """Let processes that start in the block ignore the signals that ask their parent to end."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # its start unblocks signals, so it must not come later
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, asking())
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
