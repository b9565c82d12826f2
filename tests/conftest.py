"""How tests are run: signals as a terminal leaves them, and who gets which test.

A shell's background jobs, tests too, ignore Ctrl-C.
"""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

HERE = Path(__file__).parent

signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
signal.signal(signal.SIGTERM, signal.SIG_DFL)

os.environ.setdefault("DESIM_UAV_COMPILE_AHEAD", "0")  # no test starts a compiler unless it asks


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Give each process a run of neighbouring files, and half of what is left to whoever is done.

    A file's runs and trainings are made once, in all but the few files that are divided so, and no
    process waits for another.
    """
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log) if config.getoption("dist") == "load" else None


def pytest_itemcollected(item):
    """Let the tests of THOROUGH be thorough."""
    if within(item, *THOROUGH):
        item.add_marker(pytest.mark.thorough)


THOROUGH = (
    "browser",
    "clients",
    "env/test_pictures.py",
    "experiment/test_interrupt.py",
    "experiment/test_optimum_command.py",
    "experiment/test_optimum_cover.py",
    "experiment/test_optimum_discounted.py",
    "experiment/test_optimum_run.py",
    "experiment/test_plot.py",
    "experiment/test_reproduce.py",
    "experiment/test_sweep.py",
    "experiment/test_sweep_pictures.py",
    "faults",
    "report/figures",
    "report/test_playback.py",
    "report/test_video.py",
    "test_analysis.py",
)
"""Tests that take long together, and that seldom fail alone: of pictures, scripts, bounds, clients,
sweeps, kills and damaged files. They are thorough."""


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config, items):
    """Let one of two processes compile the engine, while the other one runs what does not need it.

    The second process begins in the middle. The first one begins with the engine's tests, and the
    interface that needs everything is tested last.
    """
    if hasattr(config, "workerinput"):
        apart = [item for item in items if within(item, *WITHOUT_ENGINE)]
        others = [item for item in items if not within(item, *WITHOUT_ENGINE)]
        others.sort(key=lambda item: within(item, "api") - within(item, "engine"))
        middle = len(items) // 2
        items[:] = [*others[:middle], *apart, *others[middle:]]


WITHOUT_ENGINE = ("model", "scenario", "report")
"""The folders of tests of which few or none need the compiled engine."""


def within(item, *folders):
    """Is a test in one of these folders of tests?"""
    return any(item.path.is_relative_to(HERE / folder) for folder in folders)
