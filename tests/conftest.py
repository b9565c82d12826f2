"""How tests are run: signals as a terminal leaves them, and who gets which test.

A shell's background jobs, tests too, ignore Ctrl-C.
"""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

HERE = Path(__file__).parent

signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
signal.signal(signal.SIGTERM, signal.SIG_DFL)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Give each process a run of neighbouring files, and half of what is left to whoever is done.

    A file's runs and trainings are made once, in all but the few files that are divided so, and no
    process waits for another.
    """
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log) if config.getoption("dist") == "load" else None


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config, items):
    """Let the first of two processes compile the engine, and the second one the training.

    The second process begins in the middle. Both begin with tests that soon need what has to be
    compiled, and the interface that needs everything is tested last.
    """
    if hasattr(config, "workerinput"):
        middle = len(items) // 2
        learning = [item for item in items if within(item, "learning")]
        others = sorted(
            (item for item in items if not within(item, "learning")),
            key=lambda item: within(item, "api"),
        )
        items[:] = [*others[:middle], *learning, *others[middle:]]


def within(item, folder):
    """Is a test in this folder of tests?"""
    return item.path.is_relative_to(HERE / folder)
