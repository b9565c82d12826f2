"""How tests are run: signals as a terminal leaves them, and who gets which test.

A shell's background jobs, tests too, ignore Ctrl-C.
"""

from __future__ import annotations

import signal

import pytest

signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
signal.signal(signal.SIGTERM, signal.SIG_DFL)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Give each process a run of neighbouring files, and half of what is left to whoever is done.

    A file's runs and trainings are made once, in all but the few files that are divided so, and no
    process waits for another. The processes begin with different files, so they hardly ever compile
    the same at the same time.
    """
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log) if config.getoption("dist") == "load" else None
