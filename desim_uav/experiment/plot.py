"""The work of ``desim-uav plot`` and ``video`` around a drawing: the folders and the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from desim_uav.errors import PolicyError, UsageError, located
from desim_uav.experiment.compare_runs import compare_runs
from desim_uav.experiment.interrupt import at_once
from desim_uav.policies.tabular import read_table
from desim_uav.registry import did_you_mean
from desim_uav.run_folder import file_place, write_at
from desim_uav.shipped import find_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Kind:
    """A kind of figure: how it is drawn, its options, and whether it takes several folders.

    If it is ``optional``, it takes none too.
    """

    draw: Callable[..., Figure]
    options: Sequence[str] = ()
    several: bool = field(default=False)
    optional: bool = field(default=False)


ZENG = "{name: zeng2019, map: {obstacles: null}, drones: {battery: {kind: rotary_wing}}}"
"""The scenario whose energy is drawn by default."""


def _training(folders: Sequence[Path], **options: Any) -> Figure:
    from desim_uav.report.figures import training_figure

    return training_figure(folders, **options)


def _compare(folders: Sequence[Path], against: str | None = None) -> Figure:
    from desim_uav.report.figures import compare_figure

    return compare_figure(compare_runs(folders, against).content())


def _sweep(folder: Path, **options: Any) -> Figure:
    from desim_uav.experiment.sweep.pictures import plot_sweep

    return plot_sweep(folder, **options)


def _policy(source: Path, **options: Any) -> Figure:
    """Draw the table in a file, in the folder of a training, or of a shipped name."""
    from desim_uav.report.figures import policy_figure

    if source.is_dir() and not (source / "policy.npz").exists():
        raise PolicyError(f"{source}: not a training folder: it has no policy.npz")
    file = source / "policy.npz" if source.is_dir() else find_table(str(source))
    return policy_figure(read_table(file), str(source), **options)


def _radio(source: Path, at: str | None = None, **options: Any) -> Figure:
    """Draw the radio of a scenario file, of a shipped scenario, or of the folder of a run."""
    from desim_uav.report.figures import radio_figure
    from desim_uav.report.run import Run
    from desim_uav.scenario.load import load
    from desim_uav.world import build_world

    if at is not None:
        options["at_m"] = _point(at)
    if source.is_dir():
        return radio_figure(Run(source).world, **options)
    scenario = at_once(load, source)
    with located(source):
        world = at_once(build_world, scenario, scenario.effective_world_seed)
    return radio_figure(world, **options)


def _energy(source: Path | None, **options: Any) -> Figure:
    """Draw the energy of a scenario, of the folder of a run, or of a drone with the defaults."""
    from desim_uav.report.figures import energy_figure
    from desim_uav.report.run import Run
    from desim_uav.scenario.load import load, loads
    from desim_uav.world import build_world

    if source is not None and source.is_dir():
        return energy_figure(Run(source).world, **options)
    scenario = loads(ZENG) if source is None else at_once(load, source)
    with located(source or Path("energy")):
        world = at_once(build_world, scenario, scenario.effective_world_seed)
    return energy_figure(world, **options)


def _point(text: str) -> tuple[float, float]:
    """Return the numbers of a text such as ``1200,800``. Raises UsageError for any other text."""
    try:
        x_m, y_m = map(float, text.split(","))
    except ValueError:
        raise UsageError(f"--at {text}: write X,Y in metres, such as 1200,800") from None
    return x_m, y_m


def _of_run(kind: str) -> Callable[..., Figure]:
    """Return a function that draws a run, which is played again if it kept no events."""

    def draw(folder: Path, **options: Any) -> Figure:
        from desim_uav.experiment.replay import playable
        from desim_uav.report import figures

        figure: Figure = getattr(figures, f"{kind}_figure")(playable(folder), **options)
        return figure

    return draw


KINDS: Mapping[str, Kind] = {
    "training": Kind(_training, ("window",), several=True),
    "compare": Kind(_compare, ("against",), several=True),
    "sweep": Kind(_sweep, ("measure", "key")),
    "visits": Kind(_of_run("visits"), ("episode", "drone")),
    "policy": Kind(_policy, ("battery_min", "level", "drone")),
    "battery": Kind(_of_run("battery"), ("episode", "drone")),
    "energy": Kind(_energy, ("drone",), optional=True),
    "episodes": Kind(_of_run("episodes")),
    "services": Kind(_of_run("services"), ("episode",)),
    "radio": Kind(_radio, ("level", "at")),
    "snapshot": Kind(_of_run("snapshot"), ("episode", "minute")),
}


def plot(kind: str, sources: Sequence[Path], out: Path | None, options: Mapping[str, Any]) -> Path:
    """Draw a figure, write it in one step and return its file. Options that are None are ignored.

    Raises UsageError for wrong arguments, and PolicyError if a folder cannot be read.
    """
    from desim_uav.report.figures.style import ending, to_bytes

    if kind not in KINDS:
        raise UsageError(f"{kind}{did_you_mean(kind, KINDS)}; allowed: {', '.join(KINDS)}")
    chosen, asked = KINDS[kind], {key: v for key, v in options.items() if v is not None}
    for key in asked:
        if key not in chosen.options:
            of = [name for name, other in KINDS.items() if key in other.options]
            raise UsageError(
                f"--{key.replace('_', '-')} is an option of {', '.join(of)}, not of {kind}"
            )
    if not sources and not chosen.optional:
        raise UsageError(f"{kind}: give a folder to draw: desim-uav plot {kind} RUN")
    if len(sources) > 1 and not chosen.several:
        many = ", ".join(map(str, sources))
        raise UsageError(f"{kind}: give one folder, not {len(sources)}: {many}")
    place = _default(kind, sources) if out is None else out
    suffix = ending(place)
    target = file_place(place, "" if out is None else "--out")
    source = sources[0] if sources else None
    figure = chosen.draw(list(sources) if chosen.several else source, **asked)
    write_at(target, to_bytes(figure, suffix))
    return place


def _default(kind: str, sources: Sequence[Path]) -> Path:
    """Return the default file: in the one folder, or else in the working folder."""
    if len(sources) == 1 and sources[0].is_dir():
        return sources[0] / f"{kind}.png"
    if kind == "policy":
        return Path(f"{sources[0].stem}.png")
    return Path(f"{kind}.png")


def film(
    folder: Path,
    gif: Path | None,
    mp4: Path | None,
    *,
    episode: int | None,
    fps: float,
    speed: float,
    width: int,
    show_progress: bool,
) -> list[Path]:
    """Write an episode as a GIF, an MP4, or both, and return the files.

    Raises UsageError for wrong arguments, PolicyError if the folder cannot be read, NoEventsError
    if the run cannot be played again, and MissingExtraError for an MP4 without imageio-ffmpeg.
    """
    from desim_uav.experiment.progress import progress
    from desim_uav.experiment.replay import playable
    from desim_uav.report import video
    from desim_uav.report.playback import Playback

    asked = [(gif, ".gif", video.write_gif), (mp4, ".mp4", video.write_mp4)]
    wanted = [(out, end, write) for out, end, write in asked if out is not None]
    if not wanted:
        raise UsageError("name the file to write: --gif FILE.gif or --mp4 FILE.mp4")
    for out, end, _ in wanted:
        if out.suffix.lower() != end:
            raise UsageError(f"--{end[1:]} {out}: the file's name must end in {end}")
    if mp4 is not None:
        video.need_ffmpeg()
    places = [file_place(out, f"--{end[1:]}") for out, end, _ in wanted]
    run = playable(folder, show_progress)
    number = run.episode(episode)
    run.need([number])
    made = video.Film(Playback(run, number), fps, speed, width)
    with progress(show_progress, len(made) * len(wanted), "frames") as advance:
        for place, (_, _, write) in zip(places, wanted, strict=True):
            write(made, place, advance)
    return [out for out, *_ in wanted]
