"""When and with which versions a run, a training or a sweep was made, for its manifest."""

from __future__ import annotations

import platform
import subprocess
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from pathlib import Path

from desim_uav import __version__

PACKAGES = (
    "llvmlite",
    "numba",
    "numpy",
    "pandas",
    "pyarrow",
    "pydantic",
    "scipy",
    "shapely",
    "simpy",
)
"""Those that compute numbers or read and write them."""


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


def commit() -> str:
    """Return the commit of the checkout that the package is imported from, or "" without one."""
    folder = Path(__file__).resolve().parent
    command = ["git", "-C", str(folder), "rev-parse", "--short=12", "HEAD"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    except OSError:
        return ""


def command(words: Sequence[str]) -> list[str]:
    """Return the words of a command without the places of files on this machine.

    An absolute path is given from the checkout's root if the file is in it, and otherwise, as a
    policy's file always, by its name.
    """
    root = Path(__file__).resolve().parents[2]

    def portable(word: str) -> str:
        path = Path(word)
        if path.suffix == ".npz" or (path.is_absolute() and not path.is_relative_to(root)):
            return path.name
        return path.relative_to(root).as_posix() if path.is_absolute() else word

    return list(map(portable, words))


def processor() -> str:
    """Return the name of the processor, with its family and model if the system tells them."""
    file = Path("/proc/cpuinfo")
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    pairs = [line.partition(":") for line in lines]
    facts = {key.strip(): value.strip() for key, _, value in pairs}
    name = facts.get("model name") or platform.processor() or platform.machine()
    return ", ".join(
        [name, *(f"{key} {facts[key]}" for key in ("cpu family", "model") if key in facts)]
    )
