"""The paper's figure 2: reward and QoE during training, over seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from numpy.typing import NDArray

from desim_uav.errors import PolicyError, UsageError
from desim_uav.parquet_file import no_such, read_table
from desim_uav.records import TRAINING
from desim_uav.report.figures.style import Figure, headed, look, styled
from desim_uav.report.json_file import Form, read_json
from desim_uav.run_folder import read_scenario
from desim_uav.scenario.load import to_plain

CURVES = {
    "reward": "reward per episode",
    "qoe1_percent": "QoE1, %",
    "qoe2_iterations": "QoE2, steps",
    "qoe3_percent": "QoE3, %",
    "crashes": "crashes per drone and episode",
}
"""The titles of the curves; each is a mean over the drones, which have QoE in common."""

WINDOWS = 50
"""By default a curve is smoothed over the training's length divided by this number."""


class Manifest(Form):
    """The entries of a training's ``manifest.json`` that a figure needs."""

    algorithm: str
    seed: int
    world_seed: int


@dataclass(frozen=True)
class TrainedCurves:
    """The content of a training folder; ``settings`` are the scenario without its seeds."""

    folder: Path
    algorithm: str
    seeds: tuple[int, int]
    settings: dict[str, Any]
    curves: pd.DataFrame


@styled
def training_figure(folders: Sequence[Path], window: int | None = None) -> Figure:
    """Draw the curves of trainings by algorithm: means over seeds, with standard deviations.

    Each curve is a running mean over ``window`` episodes, by default a fiftieth of them. An
    algorithm with one seed has no band, and the legend says so. Raises PolicyError if a folder is
    not that of a finished training or the scenarios differ, and UsageError if ``window`` is too
    long.
    """
    trainings = [read_training(folder) for folder in folders]
    check_alike(trainings)
    shortest = min(len(training.curves) for training in trainings)
    window = max(1, shortest // WINDOWS) if window is None else window
    if window > shortest:
        raise UsageError(f"window: {window}: there are {shortest} episodes")
    by_algorithm: dict[str, list[TrainedCurves]] = {}
    for training in trainings:
        by_algorithm.setdefault(training.algorithm, []).append(training)

    figure = Figure(figsize=(9.6, 5.0))
    panels = figure.subplots(2, 3, sharex=True).ravel()
    for axes, (name, label) in zip(panels, CURVES.items(), strict=False):
        for number, (algorithm, of_seeds) in enumerate(by_algorithm.items()):
            seeds = f"{len(of_seeds)} seed" + "s" * (len(of_seeds) > 1)
            _draw(axes, of_seeds, name, window, number, f"{algorithm}, {seeds}")
        axes.set(ylabel=label, xlim=(0, max(len(t.curves) for t in trainings)))
        if name != "reward":
            top = 102 if name.endswith("_percent") else max(axes.get_ylim()[1], 0.1)
            axes.set_ylim(0, top)
        axes.set_xlabel("episode")
        axes.tick_params(labelbottom=True)
    _explain(panels[-1], panels[0], window, [len(curves) for curves in by_algorithm.values()])
    headed(figure, f"Training. {trainings[0].settings['name']}")
    return figure


def smoothed(curves: Sequence[pd.Series], window: int) -> tuple[NDArray[Any], ...]:
    """Return the last episode of each window, and mean and deviation over seeds.

    ``curves`` has one curve per seed.
    """
    running = [curve.rolling(window, min_periods=1).mean()[window - 1 :] for curve in curves]
    together = np.array(running)
    deviation = together.std(axis=0, ddof=1) if len(together) > 1 else np.zeros(together.shape[1])
    return np.arange(window, window + together.shape[1]), together.mean(axis=0), deviation


def _draw(
    axes: Axes, trainings: list[TrainedCurves], name: str, window: int, number: int, label: str
) -> None:
    episodes, mean, deviation = smoothed([t.curves[name] for t in trainings], window)
    dressed = look(number)
    if len(trainings) > 1:
        low, high = mean - deviation, mean + deviation
        axes.fill_between(episodes, low, high, color=dressed["color"], alpha=0.2, linewidth=0)
    axes.plot(episodes, mean, label=label, **dressed)


def _explain(axes: Axes, panel: Axes, window: int, seeds: Sequence[int]) -> None:
    """Write the legend into the last panel; ``seeds`` has the number of seeds of each curve."""
    axes.set_axis_off()
    title = f"running means over {window} episode(s)"
    title += "\nbands: ± 1 standard deviation over seeds" if max(seeds) > 1 else ""
    title += "\none seed allows no band" if min(seeds) == 1 else ""
    handles, names = panel.get_legend_handles_labels()
    legend = axes.legend(handles, names, loc="center", title=title, fontsize=9, title_fontsize=8)
    legend.set_alignment("left")


def read_training(folder: Path) -> TrainedCurves:
    """Read a training folder. Raises PolicyError if it is not one or has not ended."""
    if not folder.is_dir():
        raise no_such(folder, "training folder")
    if not (folder / "training.parquet").exists():
        has_checkpoint = (folder / "checkpoint.npz").exists()
        raise PolicyError(
            f"{folder}: the training has not ended; continue it with --resume"
            if has_checkpoint
            else f"{folder}: not a training folder: it has no training.parquet"
        )
    table = read_table(folder, "training", TRAINING)
    manifest = read_json(folder / "manifest.json", Manifest, "the manifest of a training")
    plain = to_plain(read_scenario(folder))
    if table.empty:
        raise PolicyError(f"{folder}: no episode has ended")
    settings = {key: value for key, value in plain.items() if key not in ("seed", "world_seed")}
    curves = table.groupby("episode")[list(CURVES)].mean().reset_index(drop=True)
    seeds = manifest["seed"], manifest["world_seed"]
    return TrainedCurves(folder, manifest["algorithm"], seeds, settings, curves)


def check_alike(trainings: Sequence[TrainedCurves]) -> None:
    """Raise PolicyError unless trainings have the same scenario and differ in algorithm or seeds.

    Trainings of the same algorithm must also have the same learning parameters.
    """
    first = trainings[0]
    by_algorithm: dict[str, TrainedCurves] = {}
    of_seed: dict[tuple[str, tuple[int, int]], Path] = {}
    for training in trainings:
        _compare(training, first, ("learning", "name"))
        same = by_algorithm.setdefault(training.algorithm, training)
        _compare(training, same, ("name",))
        before = of_seed.setdefault((training.algorithm, training.seeds), training.folder)
        if before is not training.folder:
            raise PolicyError(
                f"{training.folder}: {training.algorithm} on seed {training.seeds[0]} is given "
                f"twice; {before} has the same algorithm and seed"
            )


def _compare(one: TrainedCurves, other: TrainedCurves, but: tuple[str, ...]) -> None:
    for key, value in one.settings.items():
        if key not in but and value != other.settings.get(key):
            raise PolicyError(
                f"{one.folder}: its scenario is not that of {other.folder}: {key} is "
                f"{value}, not {other.settings.get(key)}"
            )
