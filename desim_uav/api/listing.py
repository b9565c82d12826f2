"""List the runs and trainings in a folder."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from desim_uav.api.parameters import verb
from desim_uav.errors import UsageError

if TYPE_CHECKING:
    import pandas as pd


@verb
def list_runs(root: str | Path = "runs") -> pd.DataFrame:
    """List the runs and trainings in a folder, with their measures and what differs.

    Runs of one scenario are compared with each other: each key of the scenario in which they
    differ is shown, such as users.count=12.

    In Python, this returns a frame with a row for each run and training, the latest last: its
    folder, label, scenario, policy or algorithm, seed, episodes and measures, what differs as a
    text, and a column for each key that differs. A folder that cannot be read is left out, with a
    notice.

    Args:
        root: The folder that holds the folders of runs, at any depth.

    Raises:
        UsageError: there is no such folder.
    """
    import pandas as pd

    from desim_uav.experiment.listing import TRAINING, differences, listed
    from desim_uav.report.text import word

    place = Path(root)
    if not place.is_dir():
        raise UsageError(f"{place}: there is no such folder")
    runs = listed(place)
    differing = differences(runs)
    frame = pd.DataFrame(
        {
            "run": str(run.folder),
            "name": run.entries.name,
            "kind": TRAINING if run.entries.kind == TRAINING else "run",
            "scenario": run.entries.scenario,
            "policy": run.entries.policy or run.entries.algorithm,
            "seed": run.entries.seed,
            "episodes": run.entries.episodes,
            **{name: math.nan if value is None else value for name, value in run.measures.items()},
            "differs": " ".join(f"{key}={word(value)}" for key, value in keys.items()),
        }
        for run, keys in zip(runs, differing, strict=True)
    )
    for key in dict.fromkeys(key for keys in differing for key in keys):
        frame[key] = pd.Series([keys.get(key) for keys in differing], dtype=object)
    return frame
