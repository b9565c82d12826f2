"""Which lines and branches do the tests run? By hand; it takes half an hour and more.

python tests/covered.py [-n 2] [--keep DIR] [-- PYTEST ARGUMENTS]

The whole suite runs as it is, with kernels compiled anew; then the tests of kernels run once more
with kernels as plain Python (``tests/interpreted.py``), whose lines a coverage tool could not see
otherwise. A line counts if one of the two runs has run it. The rules are plain Python in the SimPy
engine, except for those that only the compiled engine calls, such as the observations. The clock of
the compiled engine, and what else reads rows in memory, runs as machine code only, so its share is
printed, but nothing is asked of it. Needs ``pip install pytest-cov``. The
exit code is 6 if too little has been run.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PLAIN = (
    *("tests/model", "tests/engine", "tests/learning", "tests/env", "tests/test_sample_path.py"),
    *("tests/experiment/test_optimum_cover.py", "tests/experiment/test_optimum_gain.py"),
)
NOT_MEASURED = (  # no file may be large, that of the coverage neither
    *("--deselect", "tests/faults/test_disk_full.py::test_a_limit_on_the_size_of_files"),
)
COMPILED_ONLY = (
    "engine/compiled/",
    "learning/fused.py",
    "rowcode/compiled_apart.py",
    "rowcode/compiled_types.py",
    "rowcode/compiled_entries.py",
    "rowcode/compiled_rows.py",
    "rowcode/compiled_queues.py",
    "rowcode/compiled_registers.py",
    "sky/",
    "model/radio/air.py",
    "model/radio/bounds.py",
    "model/radio/links.py",
    "model/radio/passing.py",
    "model/radio/search.py",
    "model/radio/stretches.py",
)
WHOLE = (
    *("model/", "engine/", "qoe.py"),
    *("run_folder.py", "lock.py", "disk.py", "parquet_file.py"),
)
ENOUGH, TOO_LITTLE = 90.0, 6


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", default="auto", help="tests at a time")
    parser.add_argument("--keep", type=Path, help="the folder of what was found, or is there")
    parser.add_argument("--only", choices=["compiled", "plain", "report"], help="this part alone")
    parser.add_argument("pytest", nargs="*", help="for the run with compiled kernels")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = (args.keep or Path(scratch)).absolute()
        folder.mkdir(parents=True, exist_ok=True)
        if args.only in (None, "compiled"):
            kernels = {"NUMBA_CACHE_DIR": str(Path(scratch) / "kernels")}
            pytest(folder / "compiled", args.n, [*NOT_MEASURED, *args.pytest], kernels)
        if args.only in (None, "plain"):
            pytest(folder / "plain", args.n, ["-p", "tests.interpreted", *PLAIN])
        return 0 if args.only in ("compiled", "plain") else report(folder)


def pytest(data: Path, at_a_time: str, arguments: list[str], variables: Any = None) -> None:
    """Run tests and write their coverage to a file; tests that fail count all the same."""
    command = [sys.executable, "-m", "pytest", "-n", at_a_time, "--cov", "--cov-report="]
    environment = {**os.environ, "COVERAGE_FILE": str(data), **(variables or {})}
    subprocess.run([*command, *arguments], cwd=ROOT, env=environment, check=False)


def report(folder: Path) -> int:
    """Print a line for each file with something missing, and a summary; return the exit code."""
    coverage = [sys.executable, "-m", "coverage"]
    together = f"--data-file={folder / 'together'}"
    found = [str(folder / name) for name in ("compiled", "plain") if (folder / name).exists()]
    subprocess.run([*coverage, "combine", "-q", "--keep", together, *found], cwd=ROOT, check=True)
    written = folder / "coverage.json"
    subprocess.run([*coverage, "json", "-q", together, "-o", written], cwd=ROOT, check=True)
    files = json.loads(written.read_text(encoding="utf-8"))["files"]
    unseen = {name: of for name, of in files.items() if inside(name).startswith(COMPILED_ONLY)}
    seen = {name: of for name, of in files.items() if name not in unseen}
    whole = {name: of for name, of in seen.items() if inside(name).startswith(WHOLE)}
    rest = {name: of for name, of in seen.items() if name not in whole}
    for name, of in seen.items():
        if of["missing_lines"] or of["missing_branches"]:
            branches = [f"{a}->{b}" for a, b in of["missing_branches"]]
            print(f"{inside(name)}: {share({name: of}):.1f} %", *of["missing_lines"], *branches)
    print(f"{', '.join(WHOLE)}: {share(whole):.2f} % of lines and branches (asked: 100)")
    print(f"elsewhere: {share(rest):.2f} % (asked: {ENOUGH:g})")
    print(f"{', '.join(COMPILED_ONLY)}: {share(unseen):.2f} %, the rest of it as machine code only")
    return 0 if share(whole) == 100 and share(rest) >= ENOUGH else TOO_LITTLE


def inside(name: str) -> str:
    """A file's name within the package."""
    return name.removeprefix("desim_uav/")


def share(files: dict[str, Any]) -> float:
    """Per cent of lines and branches that were run."""
    sums = [of["summary"] for of in files.values()]
    done = sum(s["covered_lines"] + s["covered_branches"] for s in sums)
    return 100 * done / max(1, sum(s["num_statements"] + s["num_branches"] for s in sums))


if __name__ == "__main__":
    sys.exit(main())
