"""``python -m tests.frozen``: compare every frozen run with its digests, or write them anew.

A run is written only if both engines give the same tables. The digests of another checkout's
engines are written with ``PYTHONPATH=CHECKOUT python -m tests.frozen --write``, in a folder that
holds a copy of ``tests/frozen`` and nothing else.
"""

from __future__ import annotations

import sys

from tests.frozen.known import circumstances, differences, known, write


def main(arguments: list[str]) -> int:
    """Compare, or write with ``--write``; return the exit code."""
    if arguments not in ([], ["--write"]):
        print("usage: python -m tests.frozen [--write]", file=sys.stderr)
        return 2
    found = write() if arguments else differences()
    for line in [*found, *(circumstances() if found else [])]:
        print(line, file=sys.stderr)
    print(f"{len(known()['programs'])} runs and trainings: {len(found)} tables differ")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
