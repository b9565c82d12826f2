"""Lets the policies of a submission decide again, in a process of their own.

They are code of others. What they decide comes back as the files of another submission, which are
read as those of anybody; nothing else of that process has an effect on the one that verifies.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from desim_uav.errors import DesimError, PolicyError, ScenarioError, UsageError
from desim_uav.experiment.bench.run import submit
from desim_uav.experiment.bench.sealed import revealed
from desim_uav.experiment.bench.submission import Submission, read
from desim_uav.experiment.bench.tasks import find_task, find_track
from desim_uav.experiment.interrupt import INTERRUPTED, end_politely
from desim_uav.experiment.processes import ENDS_WITH_STDIN
from desim_uav.run_folder import RunPlace

FAILURES = {each.exit_code: each for each in (UsageError, ScenarioError, PolicyError)}
_PROGRAM = ENDS_WITH_STDIN + "from desim_uav.experiment.bench.again import main\nmain()\n"


def decided_again(
    submission: Submission, jobs: int = 1, on_run: Callable[[], None] = lambda: None
) -> Submission:
    """Return the submission that the policies of this one make now; ``on_run`` is called by run.

    Raises DesimError if a policy cannot be loaded or run.
    """
    about, set_of = submission.about, submission.track.folder
    with TemporaryDirectory(prefix="desim-uav-") as temporary:
        folder, said = Path(temporary) / "again", Path(temporary) / "said"
        asked = {
            "task": about.task,
            "track": about.track,
            "revealed": None if set_of is None else str(set_of.absolute()),
            "policies": [each.policy for each in about.trainings],
            "seeds": about.seeds,
            "jobs": jobs,
            "out": str(folder),
        }
        command = [sys.executable, "-c", _PROGRAM, json.dumps(asked)]
        paths = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
        pipe = subprocess.PIPE
        with (
            said.open("w") as errors,
            subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=errors, env=paths) as process,
        ):
            assert process.stdout is not None
            for _ in process.stdout:
                on_run()
        if process.returncode == INTERRUPTED:
            raise KeyboardInterrupt
        if process.returncode != 0:
            words = said.read_text(encoding="utf-8", errors="replace").strip()
            raise _failure(process.returncode, words)
        again = read(folder, revealed(set_of))
        if again.about.interrupted:
            raise KeyboardInterrupt
        return again


def _failure(code: int, words: str) -> DesimError:
    """Return the error of a process that has failed."""
    kind: type[DesimError] = FAILURES.get(code, DesimError)
    error = kind(words or f"the policies have ended their process, with the exit code {code}")
    error.exit_code = code if code > 0 else DesimError.exit_code
    return error


def main() -> None:
    """Make a submission as the first argument says; print a line after each run."""
    end_politely()
    asked = json.loads(sys.argv[1])
    try:
        folder = None if asked["revealed"] is None else Path(asked["revealed"])
        submit(
            find_task(asked["task"]),
            find_track(asked["track"], revealed(folder)),
            asked["policies"],
            RunPlace(Path(asked["out"]), "again"),
            seeds=asked["seeds"],
            jobs=asked["jobs"],
            on_run=lambda: print(flush=True),
        )
    except DesimError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
