"""The work of ``desim-uav plot`` and ``video`` around a drawing: the folders and the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from desim_uav.disk import file_place, write_at
from desim_uav.errors import PolicyError, UsageError, did_you_mean, located
from desim_uav.experiment.compare import Comparison, reference_of
from desim_uav.experiment.compare_runs import compare_runs
from desim_uav.experiment.interrupt import at_once
from desim_uav.experiment.replay.again import Source
from desim_uav.experiment.table_file import ENDINGS as TABLES
from desim_uav.experiment.table_file import table_bytes
from desim_uav.measures.known import check, names_of
from desim_uav.policies.tabular import read_table
from desim_uav.shipped import find_table
from desim_uav.world import World, build_world

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Kind:
    """A kind of figure: how it is drawn, its options, and whether it takes several folders.

    If it is ``optional``, it takes none too. ``again``: a run that kept no events is played again.
    ``tabled``: its numbers can be written to a file instead.
    """

    draw: Callable[..., Figure]
    options: Sequence[str] = ()
    several: bool = field(default=False)
    optional: bool = field(default=False)
    again: bool = field(default=False)
    tabled: bool = field(default=False)


ZENG = "{name: zeng2019, map: {obstacles: null}, drones: {battery: {kind: rotary_wing}}}"
"""The scenario whose energy is drawn by default."""


Drawable = Source | Comparison | World
"""What a figure is drawn from: a folder or a file, a comparison, or a world."""


def _training(sources: Sequence[Drawable], **options: Any) -> Figure:
    from desim_uav.report.figures import training_figure

    return training_figure([_path(source, "training") for source in sources], **options)


def _compare(
    sources: Sequence[Drawable],
    against: str | None = None,
    measure: str | Sequence[str] | None = None,
) -> Figure:
    from desim_uav.report.figures import compare_figure

    names = list(dict.fromkeys(names_of(measure))) or None
    first = sources[0]
    if isinstance(first, Comparison) and len(sources) == 1:
        reference = reference_of(first.policies, first.against if against is None else against)
        for name in names or ():
            if name not in first.measures:
                check(name)
                raise UsageError(f"measure: {name}: the comparison does not have it")
        return compare_figure(replace(first, against=reference).content(), names)
    comparison = compare_runs([_path(s, "compare") for s in sources], against, names)
    return compare_figure(comparison.content(), names)


def _of_runs(kind: str) -> Callable[..., Figure]:
    """Return a function that draws several runs from their tables."""

    def draw(sources: Sequence[Drawable], **options: Any) -> Figure:
        from desim_uav.report import figures

        paths = [_path(source, kind) for source in sources]
        figure: Figure = getattr(figures, f"{kind}_figure")(paths, **options)
        return figure

    return draw


def _sweep(source: Drawable, **options: Any) -> Figure:
    from desim_uav.experiment.sweep.pictures import plot_sweep

    lists = {name: names_of(it) for name, it in options.items()}
    return plot_sweep(_path(source, "sweep"), **lists)


def _path(source: Drawable, kind: str) -> Path:
    """Return the folder or file that a figure is drawn from. Raises UsageError for other things."""
    if isinstance(source, Source):
        return source.folder
    what = "a comparison" if isinstance(source, Comparison) else "a world"
    raise UsageError(f"{kind}: {what} cannot be drawn so; give a result or a folder")


def _policy(drawable: Drawable, **options: Any) -> Figure:
    """Draw the table in a file, in the folder of a training, or of a shipped name."""
    from desim_uav.report.figures import policy_figure

    source = _path(drawable, "policy")
    if source.is_dir() and not (source / "policy.npz").exists():
        raise PolicyError(f"{source}: not a training folder: it has no policy.npz")
    file = source / "policy.npz" if source.is_dir() else find_table(str(source))
    return policy_figure(read_table(file), str(source), **options)


def _radio(source: Drawable, at: str | None = None, **options: Any) -> Figure:
    """Draw the radio of a scenario file, of a shipped scenario, or of the folder of a run."""
    from desim_uav.report.figures import radio_figure

    if at is not None:
        options["at_m"] = _point(at)
    return radio_figure(_world(source, "radio"), **options)


def _energy(source: Drawable | None, **options: Any) -> Figure:
    """Draw the energy of a scenario, of the folder of a run, or of a drone with the defaults."""
    from desim_uav.report.figures import energy_figure
    from desim_uav.scenario.load import loads

    if source is None:
        scenario = loads(ZENG)
        return energy_figure(build_world(scenario, scenario.effective_world_seed), **options)
    return energy_figure(_world(source, "energy"), **options)


def _world(source: Drawable, kind: str) -> World:
    """Return the world of the folder of a run, of a scenario file or of a shipped scenario."""
    from desim_uav.report.run import Run
    from desim_uav.scenario.load import load

    if isinstance(source, World):
        return source
    path = _path(source, kind)
    if path.is_dir():
        return Run(path).world
    scenario = at_once(load, path)
    with located(path):
        return at_once(build_world, scenario, scenario.effective_world_seed)


def _point(text: str) -> tuple[float, float]:
    """Return the numbers of a text such as ``1200,800``. Raises UsageError for any other text."""
    try:
        x_m, y_m = map(float, text.split(","))
    except ValueError:
        raise UsageError(f"at: {text}: write X,Y in metres, such as 1200,800") from None
    return x_m, y_m


def _of_run(kind: str) -> Callable[..., Figure]:
    """Return a function that draws a run, which is played again if it kept no events."""

    def draw(source: Drawable, show_progress: bool = True, **options: Any) -> Figure:
        from desim_uav.experiment.replay import playable
        from desim_uav.report import figures

        policy = source.policy if isinstance(source, Source) else None
        run = playable(Source(_path(source, kind), policy), show_progress)
        figure: Figure = getattr(figures, f"{kind}_figure")(run, **options)
        return figure

    return draw


KINDS: Mapping[str, Kind] = {
    "training": Kind(_training, ("window",), several=True),
    "compare": Kind(_compare, ("against", "measure"), several=True),
    "sweep": Kind(_sweep, ("measure", "key")),
    "visits": Kind(_of_run("visits"), ("episode", "drone"), again=True),
    "policy": Kind(_policy, ("battery_min", "level", "drone")),
    "battery": Kind(_of_run("battery"), ("episode", "drone"), again=True),
    "energy": Kind(_energy, ("drone",), optional=True),
    "episodes": Kind(_of_run("episodes"), again=True),
    "services": Kind(_of_run("services"), ("episode",), again=True),
    "delay": Kind(_of_runs("delay"), ("episode",), several=True),
    "age": Kind(_of_runs("age"), ("episode",), several=True),
    "radio": Kind(_radio, ("level", "at")),
    "snapshot": Kind(_of_run("snapshot"), ("episode", "minute"), again=True),
    "map": Kind(_of_run("map"), ("episode", "minute"), again=True, tabled=True),
}


class Target:
    """The file of a figure, which is checked before the figure is drawn.

    If its numbers may be ``tabled``, it can also be a table. Raises UsageError for a file of
    another kind, or one that cannot be written.
    """

    def __init__(self, out: Path, option: str = "", tabled: bool = False) -> None:
        from desim_uav.report.figures.style import ENDINGS

        endings = (*ENDINGS, *TABLES) if tabled else ENDINGS
        self._place, self._suffix = file_place(out, option, endings), out.suffix.lower()

    def write(self, figure: Any) -> None:
        """Write the figure in one step."""
        from desim_uav.report.figures.style import to_bytes

        if self._suffix in TABLES:
            content = table_bytes(figure.table, self._suffix)
        else:
            content = to_bytes(figure, self._suffix)
        write_at(self._place, content)


def draw(
    kind: str,
    sources: Sequence[Drawable],
    options: Mapping[str, Any],
    show_progress: bool = True,
) -> Figure:
    """Draw a figure. Options that are None are ignored. Raises as ``plot`` does."""
    entry = chosen(kind, len(sources), options)
    settings = {key: value for key, value in options.items() if value is not None}
    if entry.again:
        settings["show_progress"] = show_progress
    source = sources[0] if sources else None
    return entry.draw(list(sources) if entry.several else source, **settings)


def chosen(kind: str, sources: int, options: Mapping[str, Any]) -> Kind:
    """Return a kind of figure. Raises UsageError for unknown ones, and for wrong arguments."""
    if kind not in KINDS:
        raise UsageError(
            f"unknown figure {kind!r}{did_you_mean(kind, KINDS)}; allowed: {', '.join(KINDS)}"
        )
    entry = KINDS[kind]
    for key, value in options.items():
        if value is not None and key not in entry.options:
            of = [name for name, other in KINDS.items() if key in other.options]
            raise UsageError(f"{key} is an option of {', '.join(of)}, not of {kind}")
    if not sources and not entry.optional:
        raise UsageError(f"{kind}: give a folder to draw: desim-uav plot {kind} RUN")
    if sources > 1 and not entry.several:
        raise UsageError(f"{kind}: give one folder, not {sources}")
    return entry


def film(
    source: Path | Source,
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

    films = [(gif, ".gif", video.write_gif), (mp4, ".mp4", video.write_mp4)]
    outputs = [(out, end, write) for out, end, write in films if out is not None]
    if not outputs:
        raise UsageError("name the file to write: --gif FILE.gif or --mp4 FILE.mp4")
    places = [file_place(out, f"--{end[1:]}", [end]) for out, end, _ in outputs]
    if mp4 is not None:
        video.need_ffmpeg()
    run = playable(source, show_progress)
    number = run.episode(episode)
    run.need([number])
    frames = video.Film(Playback(run, number), fps, speed, width)
    with progress(show_progress, len(frames) * len(outputs), "frames") as advance:
        for place, (_, _, write) in zip(places, outputs, strict=True):
            write(frames, place, advance)
    return [out for out, *_ in outputs]
