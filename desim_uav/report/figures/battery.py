"""The batteries of drones over an episode, with flight, charging, queueing and crashes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from desim_uav.errors import PolicyError, UsageError
from desim_uav.model.energy.battery import WH_UJ
from desim_uav.model.rules import US, Mode
from desim_uav.report.figures.style import MOST_PANELS, NARROW, Figure, drone_look, headed, styled
from desim_uav.report.figures.visits import chosen_drones
from desim_uav.report.playback import Playback
from desim_uav.report.run import Run, opened

SPANS: dict[Mode, dict[str, Any]] = {
    Mode.RETURNING: {"facecolor": "#FBE9C6", "hatch": "///", "edgecolor": "#E69F00"},
    Mode.QUEUED: {"facecolor": "#E3E3E3", "hatch": "xxx", "edgecolor": "0.45"},
    Mode.CHARGING: {"facecolor": "#CDEBDF", "hatch": "...", "edgecolor": "#009E73"},
    Mode.CHARGED: {"facecolor": "#EAF6F1", "edgecolor": "#009E73"},
    Mode.CRASHED: {"facecolor": "#F8D9C6", "hatch": "\\\\\\\\", "edgecolor": "#D55E00"},
}
"""The shade of the time in each mode; serving flight is white."""

HALO = withStroke(linewidth=3.5, foreground="white")
"""The outline of a curve, which makes it visible on any shade."""

CRASH: dict[str, Any] = {"marker": "X", "ls": "", "color": "#D55E00", "ms": 9, "mec": "black"}


@styled
def battery_figure(
    run: Run | Path, episode: int | None = None, drone: int | None = None, width: float = 7.2
) -> Figure:
    """Draw the battery of each drone over an episode, one row per drone, with its modes as shades.

    Drones with an unlimited battery have no row. ``width`` is in inches. Raises PolicyError if the
    folder is not that of a run or these are all unlimited, NoEventsError without events,
    and UsageError for an unknown episode or drone, or for too many drones.
    """
    run = opened(run)
    drones, episode = chosen_drones(run, drone), run.episode(episode)
    batteries = {d: run.world.type_of(d).drones.battery for d in drones}
    limited = {d: battery for d, battery in batteries.items() if battery is not None}
    if not limited:
        raise PolicyError(f"{run.folder}: its drones have unlimited batteries")
    if len(limited) > MOST_PANELS:
        raise UsageError(
            f"{len(limited)} drones are too many (at most {MOST_PANELS}); choose one with --drone"
        )
    figure = Figure(figsize=(width, 0.9 + 1.35 * len(limited)))
    panels = figure.subplots(len(limited), 1, sharex=True, squeeze=False)[:, 0]
    playback, modes = Playback(run, episode), set[Mode]()
    for axes, (number, battery) in zip(panels, limited.items(), strict=True):
        own = run.world.type_of(number)
        of_second, unit = (own.drain_per_s / WH_UJ, "Wh") if own.in_joules else (1 / 60, "min")
        full = own.capacity * of_second / own.drain_per_s
        t_s, left_s = playback.batteries[number]
        colour = drone_look(number)["color"]
        axes.plot(t_s / 60, left_s * of_second, "-", color=colour, path_effects=[HALO], zorder=3)
        axes.axhline(full * battery.return_below, color="0.4", ls=":", linewidth=1)
        modes |= _shade(axes, playback, number)
        _label(axes, run.drone_name(number), full, unit, run.duration_s(episode))
    panels[-1].set_xlabel("time, min")
    headed(figure, f"Battery. {run.name}, episode {episode}")
    handles: list[Any] = [
        Patch(label=mode.name.lower(), linewidth=0, **SPANS[mode])
        for mode in SPANS
        if mode in modes
    ]
    handles += panels[0].plot([], [], color="0.4", ls=":", label="may return below")
    if Mode.CRASHED in modes:
        handles += panels[0].plot([], [], **CRASH, label="crash")
    figure.legend(handles=handles, loc="outside lower center", ncols=6 if width > NARROW else 3)
    return figure


def _shade(axes: Axes, playback: Playback, drone: int) -> set[Mode]:
    """Shade a drone's modes, mark its crashes, and return the modes."""
    modes = set()
    for start_us, end_us, mode in playback.spans(drone):
        modes.add(mode)
        if mode in SPANS:
            start_min, end_min = start_us / US / 60, end_us / US / 60
            axes.axvspan(start_min, end_min, linewidth=0, alpha=0.9, **SPANS[mode])
    fallen_min = [t_us / US / 60 for t_us in playback.crashes_us(drone)]
    if fallen_min:
        axes.plot(fallen_min, [0] * len(fallen_min), **CRASH, clip_on=False)
        modes.add(Mode.CRASHED)  # a crash at the very end has no span
    return modes


def _label(axes: Axes, drone: str, full: float, unit: str, duration_s: float) -> None:
    axes.set(xlim=(0, duration_s / 60), ylim=(0, full * 1.06), ylabel=f"left, {unit}")
    axes.set_title(drone, loc="left", pad=3)
    axes.grid(visible=False, axis="x")
