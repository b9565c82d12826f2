"""What drones have left: flight, charging, queueing and crashes over an episode."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from desim_uav.errors import PolicyError, UsageError
from desim_uav.model.rules import US, Mode
from desim_uav.report.batteries import first_battery_s
from desim_uav.report.figures.style import MOST_PANELS, headed, look, styled
from desim_uav.report.figures.visits import chosen_drones
from desim_uav.report.playback import Playback
from desim_uav.report.run import Run

SPANS: dict[Mode, dict[str, Any]] = {
    Mode.RETURNING: {"facecolor": "#FBE9C6", "hatch": "///", "edgecolor": "#E69F00"},
    Mode.QUEUED: {"facecolor": "#E3E3E3", "hatch": "xxx", "edgecolor": "0.45"},
    Mode.CHARGING: {"facecolor": "#CDEBDF", "hatch": "...", "edgecolor": "#009E73"},
    Mode.CHARGED: {"facecolor": "#EAF6F1", "edgecolor": "#009E73"},
    Mode.CRASHED: {"facecolor": "#F8D9C6", "hatch": "\\\\\\\\", "edgecolor": "#D55E00"},
}
"""How the time in each mode is shaded; serving flight is white."""

CRASH: dict[str, Any] = {"marker": "X", "ls": "", "color": "#D55E00", "ms": 9, "mec": "black"}


@styled
def battery_figure(run_dir: Path, episode: int | None = None, drone: int | None = None) -> Figure:
    """The battery of each drone over an episode, one row a drone, its modes shaded behind it.

    Exact where the run kept its events, else from step to step. Raises PolicyError where the
    folder is not a run's or its batteries are unlimited, UsageError for an unknown episode.
    """
    run = Run(run_dir)
    drones, episode = chosen_drones(run, drone), run.episode(episode)
    battery = run.scenario.drones.battery
    if battery is None:
        raise PolicyError(f"{run_dir}: its drones have unlimited batteries")
    if len(drones) > MOST_PANELS:
        raise UsageError(f"{len(drones)} drones, at most {MOST_PANELS}: choose one with --drone")
    exact = all((run_dir / f"{name}.parquet").exists() for name in ("events", "legs"))
    figure = Figure(figsize=(7.2, 0.9 + 1.35 * len(drones)))
    panels = figure.subplots(len(drones), 1, sharex=True, squeeze=False)[:, 0]
    full_min, seen, crashed = battery.autonomy_min, set[Mode](), False
    for axes, number in zip(panels, drones, strict=True):
        t_s, left_s = battery_curve(run, episode, number, exact)
        axes.plot(t_s / 60, left_s / 60, **(look(number) | {"linestyle": "-"}), zorder=3)
        axes.axhline(full_min * battery.return_below, color="0.4", ls=":", linewidth=1)
        for start_s, end_s, mode in modes_of(run, episode, number, exact):
            seen.add(mode)
            if mode in SPANS:
                axes.axvspan(start_s / 60, end_s / 60, linewidth=0, alpha=0.9, **SPANS[mode])
        fallen_min = [t_s / 60 for t_s in crashes_s(run, episode, number, exact)]
        if fallen_min:
            crashed = True
            axes.plot(fallen_min, [0] * len(fallen_min), **CRASH, clip_on=False)
        _label(axes, number, full_min, run.duration_s(episode))
    panels[-1].set_xlabel("time, min")
    how = "" if exact else " (from step to step: the run kept no events)"
    headed(figure, f"Battery. {run.name}, episode {episode}{how}")
    handles: list[Any] = [
        Patch(label=mode.name.lower(), linewidth=0, **SPANS[mode]) for mode in SPANS if mode in seen
    ]
    handles += panels[0].plot([], [], color="0.4", ls=":", label="may return below")
    if crashed:
        handles += panels[0].plot([], [], **CRASH, label="crash")
    figure.legend(handles=handles, loc="outside lower center", ncols=6)
    return figure


def _label(axes: Axes, drone: int, full_min: float, duration_s: float) -> None:
    axes.set(xlim=(0, duration_s / 60), ylim=(0, full_min * 1.06), ylabel="left, min")
    axes.set_title(f"drone {drone}", loc="left", pad=3)
    axes.grid(visible=False, axis="x")


def battery_curve(
    run: Run, episode: int, drone: int, exact: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the battery is known: (t_s, s left). It is linear in between."""
    if exact:
        knots = Playback(run, episode).batteries[drone]
        assert knots is not None
        return knots
    steps = run.of("steps", episode)
    mine = steps[steps["drone"] == drone]
    first_s = first_battery_s(run, episode, drone)
    return np.array([0.0, *mine["t_s"]]), np.array([first_s, *mine["battery_s"]])


def modes_of(
    run: Run, episode: int, drone: int, exact: bool
) -> Iterator[tuple[float, float, Mode]]:
    """A drone's modes: from, to, mode; without events a step counts by its end."""
    if exact:
        for start_us, end_us, mode in Playback(run, episode).spans(drone):
            yield start_us / US, end_us / US, mode
        return
    steps = run.of("steps", episode)
    before_s = 0.0
    for t_s, mode in steps.loc[steps["drone"] == drone, ["t_s", "mode"]].itertuples(index=False):
        yield before_s, t_s, Mode[mode.upper()]
        before_s = t_s


def crashes_s(run: Run, episode: int, drone: int, exact: bool) -> list[float]:
    """When a drone crashed; without events, the end of the step in which it did."""
    if exact:
        events = run.of("events", episode)
        crashes = events[(events["kind"] == "crash") & (events["drone"] == drone)]
        return [t_us / US for t_us in crashes["t_us"].tolist()]
    spans = [*modes_of(run, episode, drone, exact)]
    steps = zip([None, *(mode for *_, mode in spans)], spans, strict=False)
    return [t_s for before, (_, t_s, mode) in steps if mode is Mode.CRASHED and before is not mode]
