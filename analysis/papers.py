"""Measure the commands of published papers, for the documentation and `desim-uav paper`.

python analysis/papers.py [NAME…]

Each paper, by default each of all, is computed by `desim-uav paper NAME` in a process and an empty
folder of its own, with nothing compiled before. What it prints goes into the record of all papers,
desim_uav/experiment/papers/measured.json. The exit code is 6 if a figure does not hold; then the
record keeps the old entry of this paper.
"""

import json
import os
import subprocess
import sys
import tempfile

from desim_uav.disk import write_whole
from desim_uav.experiment.papers import ENTRIES, work

FAILED = 6


def main(*names):
    """Measure the papers and return the exit code."""
    known, code = dict(work.measured()), 0
    for name in names or ENTRIES:
        done = measured(name)
        if done.returncode:
            print(f"{name}: exit code {done.returncode}\n{done.stderr}", file=sys.stderr)
            code = FAILED
            continue
        known[name] = json.loads(done.stdout)
        write(known)
        print(name, known[name]["seconds"], "s", flush=True)
    return code


def measured(name):
    """Run the command of a paper where nothing is compiled."""
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": f"{folder}/compiled"}
        return subprocess.run(
            [sys.executable, "-m", "desim_uav", "paper", name, "--json", "--quiet"],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )


def write(known):
    """Write the record, in the order of the papers."""
    ordered = {name: known[name] for name in ENTRIES if name in known}
    write_whole(work.MEASURED, (json.dumps(ordered, indent=1) + "\n").encode())


if __name__ == "__main__":
    if sys.argv[1:] and sys.argv[1].startswith("-"):
        print(__doc__)
        sys.exit(0)
    sys.exit(main(*sys.argv[1:]))
