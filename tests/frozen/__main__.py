"""``python -m tests.frozen [--write] [SET …]``: compare frozen runs with their digests, or write.

A run is written only if both engines give the same tables. The digests of another checkout's
engines are written with ``PYTHONPATH=CHECKOUT python -m tests.frozen --write``, in a folder that
holds a copy of ``tests/frozen`` and of what it imports, and nothing else.
"""

from __future__ import annotations

import sys

from tests.frozen.known import circumstances, differences, known, write
from tests.frozen.programs import sets


def main(arguments: list[str]) -> int:
    """Compare, or write with ``--write``; return the exit code."""
    writes, chosen = "--write" in arguments, [word for word in arguments if word != "--write"]
    if not set(chosen) <= set(sets()):
        print(f"usage: python -m tests.frozen [--write] {[*sets()]}", file=sys.stderr)
        return 2
    failed = False
    for name in chosen or sets():
        found = write(name) if writes else differences(name)
        for line in [*found, *(circumstances(name) if found else [])]:
            print(line, file=sys.stderr)
        print(f"{name}: {len(known(name)['programs'])} programs, {len(found)} tables differ")
        failed = failed or bool(found)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
