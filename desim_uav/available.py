"""The memory that this process may still take: what the machine and its control group leave it."""

from __future__ import annotations

import math
import os
from contextlib import suppress
from pathlib import Path

CGROUPS = (
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    (
        "/sys/fs/cgroup/memory/memory.limit_in_bytes",
        "/sys/fs/cgroup/memory/memory.usage_in_bytes",
    ),
)
"""The limit and the use of the control group, as a container sees them (version 2, version 1)."""


def available_bytes() -> float:
    """The least of what the machine and the control group have left; infinite if neither says."""
    return min(_of_machine(), *(_left(Path(limit), Path(used)) for limit, used in CGROUPS))


def _of_machine() -> float:
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return float(line.split()[1]) * 1024
    with suppress(OSError, ValueError, AttributeError):
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    return math.inf


def _left(limit: Path, used: Path) -> float:
    """What is left of a limit; infinite if there is none ("max", or no such file)."""
    with suppress(OSError, ValueError):
        return max(0.0, float(limit.read_text()) - float(used.read_text()))
    return math.inf
