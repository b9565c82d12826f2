"""What checking the files of a run takes of the time of reading its tables.

python benchmarks/checksums.py RUN_DIR
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

from desim_uav.checksums import verify
from desim_uav.parquet_file import read_table
from desim_uav.records import TABLES

TIMES = 5


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run_dir", type=Path)
    folder = parser.parse_args().run_dir
    names = [name for name in TABLES if (folder / f"{name}.parquet").exists()]
    files = [folder / f"{name}.parquet" for name in names]

    def check() -> None:
        for file in files:
            verify(file)

    def read() -> None:
        for name in names:
            read_table(folder, name, TABLES[name])

    read_s, checked_s = best_s(read), best_s(check)
    size_mb = sum(file.stat().st_size for file in files) / 1e6
    print(f"{size_mb:.0f} MB: read in {read_s:.2f} s, {checked_s / read_s:.1%} of it checksums")


def best_s(action: Callable[[], None]) -> float:
    """The best of some times."""
    found = []
    for _ in range(TIMES):
        begun = time.perf_counter()
        action()
        found.append(time.perf_counter() - begun)
    return min(found)


if __name__ == "__main__":
    main()
