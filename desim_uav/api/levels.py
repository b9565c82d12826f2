"""The links of a finished run over time, as a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from desim_uav.api.parameters import verb
from desim_uav.typed import Within

NUMBERED = Within(0, 10**9)
TIME = Within(0.0, 1e9)


@verb
def write_levels(
    run_dir: str | Path,
    out: str | Path | None = None,
    *,
    user: Annotated[int | None, NUMBERED] = None,
    drone: Annotated[int | None, NUMBERED] = None,
    episode: Annotated[int | None, Within(-(10**9), 10**9)] = None,
    every_s: Annotated[float | None, TIME] = None,
    at_s: Annotated[float | None, TIME] = None,
    progress: bool = True,
) -> Path:
    """Write the level, SNR, SINR and class of links over time, and whom users are attached to.

    Each row is exact at its time. By default a link has a row whenever its class changes, or
    something else of it at once, and at both ends of the episode.

    In Python, ``RunResult.levels`` returns this table, and takes several users, drones and times.

    Args:
        run_dir: The folder of a run, as `run` writes it.
        out: The file, which ends in .csv or .parquet. By default it is RUN/levels.csv.
        user: The user, counted from 0. By default all.
        drone: The drone, counted from 0; access points come after the drones. By default all.
        episode: The episode. By default it is the first that counts.
        every_s: The step between the times, in seconds, from 0 on.
        at_s: The only time, in seconds.
        progress: Show the progress, if the run has to be played again for its events.

    Raises:
        UsageError: there is no such user, drone, episode or time, no radio of the scenario has
            levels, or the file cannot be written.
        PolicyError: the folder cannot be read.
        NoEventsError: the run has not kept its events, and cannot be played again.
    """
    from desim_uav.api.run_result import of_folder
    from desim_uav.experiment.table_file import TableTarget

    place = Path(run_dir) / "levels.csv" if out is None else Path(out)
    target = TableTarget(place)
    target.write(
        of_folder(run_dir).levels(
            *(user, drone), episode=episode, every_s=every_s, at_s=at_s, progress=progress
        )
    )
    return place
