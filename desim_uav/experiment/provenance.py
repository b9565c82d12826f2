"""When and with which versions a run, a training or a sweep was made, for its manifest."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from importlib.metadata import version

from desim_uav import __version__

PACKAGES = ("numba", "numpy", "pandas", "pyarrow", "pydantic", "simpy")


def clock() -> Callable[[], str]:
    """Return a clock that never runs backwards, even if the system's clock is set back."""
    last, since_s = datetime.now(UTC), time.monotonic()

    def now() -> str:
        nonlocal last, since_s
        before_s, since_s = since_s, time.monotonic()
        last = max(last + timedelta(seconds=since_s - before_s), datetime.now(UTC))
        return last.isoformat()

    return now


def versions() -> dict[str, str]:
    """Return the versions of Python, this package and the packages that its results depend on."""
    own = {"desim-uav": __version__, "python": platform.python_version()}
    return own | {name: version(name) for name in PACKAGES} | {"platform": platform.platform()}
