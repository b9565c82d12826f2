"""The memory and the processors that this process may still use.

Its limits are those of the machine, of its own control group and of all groups above (a batch
system gives each job a group, and a container sees its own as the root), and those of ``ulimit``.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

GROUPS = Path("/proc/self/cgroup")
MOUNT = Path("/sys/fs/cgroup")

MEMORY = (
    ("memory.max", "memory.current", "inactive_file"),
    ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
)
"""The files of the limit and of the memory in use, and the entry of ``memory.stat`` for used
memory that can be freed at once, such as copies of files: in versions 2 and 1 of control groups."""


def available_bytes() -> float:
    """Return the least memory that the machine and all limits leave, in bytes; inf if unknown."""
    groups = (_left_in(folder) for folder in _groups("memory"))
    return min(_of_machine(), _of_address_space(), *groups)


def processors() -> int:
    """Return the number of processors that this process may use at a time, at least 1.

    If a control group allows a part of a processor, this part counts as one.
    """
    try:
        allowed = float(len(os.sched_getaffinity(0)))
    except AttributeError:  # not on this system
        allowed = float(os.cpu_count() or 1)
    return max(1, math.ceil(min(allowed, quota())))


def quota() -> float:
    """Return how many processors' time control groups allow this process; inf without a limit."""
    return min((_quota_of(folder) for folder in _groups("cpu")), default=math.inf)


def _groups(controller: str) -> Iterator[Path]:
    """Yield the folders of this process's control groups: its own, and those above to the root."""
    mounts = [(MOUNT, ""), (MOUNT / "unified", ""), (MOUNT / controller, "")]
    with suppress(OSError, ValueError):
        for line in GROUPS.read_text(encoding="utf-8").splitlines():
            _, controllers, path = line.split(":", 2)
            if not controllers:  # version 2
                mounts += [(MOUNT, path), (MOUNT / "unified", path)]
            elif controller in controllers.split(","):
                mounts.append((MOUNT / controller, path))
    for mount, path in mounts:
        names = [name for name in path.split("/") if name not in ("", "..")]
        for depth in range(len(names), -1, -1):
            yield mount.joinpath(*names[:depth])


def _of_machine() -> float:
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return float(line.split()[1]) * 1024
    with suppress(OSError, ValueError, AttributeError):
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    return math.inf


def _of_address_space() -> float:
    """Return what ``ulimit -v`` and ``ulimit -d`` leave to this process, in bytes."""
    left = math.inf
    with suppress(ImportError, OSError, ValueError, IndexError):
        import resource

        pages = Path("/proc/self/statm").read_text(encoding="ascii").split()
        for kind, used in ((resource.RLIMIT_AS, pages[0]), (resource.RLIMIT_DATA, pages[5])):
            limit, _ = resource.getrlimit(kind)
            if limit != resource.RLIM_INFINITY:
                used_bytes = float(used) * os.sysconf("SC_PAGE_SIZE")
                left = min(left, max(0.0, limit - used_bytes))
    return left


def _left_in(folder: Path) -> float:
    """Return the bytes left in a control group; inf without a limit ("max", or no file)."""
    left = math.inf
    for limit, used, reclaimable in MEMORY:
        with suppress(OSError, ValueError):
            whole, used_bytes = (float((folder / file).read_text()) for file in (limit, used))
            left = min(left, max(0.0, whole - max(0.0, used_bytes - _entry(folder, reclaimable))))
    return left


def _entry(folder: Path, name: str) -> float:
    """Return an entry of the group's ``memory.stat``; 0 if there is none."""
    with suppress(OSError, ValueError):
        for line in (folder / "memory.stat").read_text().splitlines():
            key, _, value = line.partition(" ")
            if key == name:
                return float(value)
    return 0.0


def _quota_of(folder: Path) -> float:
    """Return how many processors' time a control group allows; inf without a limit."""
    with suppress(OSError, ValueError):
        allowed, period = (folder / "cpu.max").read_text().split()
        return float(allowed) / float(period)  # "max" is no number
    with suppress(OSError, ValueError, ZeroDivisionError):
        allowed_us = float((folder / "cpu.cfs_quota_us").read_text())
        period_us = float((folder / "cpu.cfs_period_us").read_text())
        return allowed_us / period_us if allowed_us > 0.0 else math.inf
    return math.inf
