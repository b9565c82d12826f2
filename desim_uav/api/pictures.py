"""Figures, films and pages of results and of run folders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from desim_uav.api.parameters import verb
from desim_uav.errors import UsageError
from desim_uav.typed import Within

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from desim_uav.api.kinds import Drawn, Shown
    from desim_uav.api.replay import Page, Replay

ANY_EPISODE = Within(-(10**9), 10**9)
COUNTED = Within(0, 10**9)
"""The bounds of what is counted from 0: drones, levels, minutes."""


@verb
def plot(
    kind: str,
    runs: Drawn | Sequence[Drawn] = (),
    out: str | Path | bool | None = None,
    *,
    episode: Annotated[int | None, ANY_EPISODE] = None,
    minute: Annotated[float | None, Within(0.0, 1e9)] = None,
    drone: Annotated[int | None, COUNTED] = None,
    window: Annotated[int | None, Within(1, 10**9)] = None,
    battery_min: Annotated[int | None, COUNTED] = None,
    level: Annotated[int | None, COUNTED] = None,
    at: str | tuple[float, float] | None = None,
    against: str | None = None,
    measure: str | Sequence[str] | None = None,
    key: str | Sequence[str] | None = None,
    progress: bool = True,
) -> Figure:
    """Draw a figure of runs, trainings, a sweep, a learned policy, a radio or of energy.

    In Python, this does what ``desim-uav plot`` does, and returns the figure, which a notebook
    shows; with ``out`` it is written to a file, too.

    Args:
        kind: The kind of figure: training, compare, sweep, visits, policy, battery, energy,
            episodes, services, delay, age, radio, snapshot or map.
        runs: The folder of a run, a training or a sweep; for policy it may be the file of a table,
            and for radio and energy a scenario file or the name of a shipped scenario. For energy
            it may be left out. In Python, it may also be a result of ``run``, ``train``,
            ``compare`` or ``sweep``, a scenario or a world; for training, compare, delay and age,
            it may be a list of them. Of a run on several seeds, the first seed is drawn.
        out: The file, which ends in .png, .pdf or .svg; for map it may also end in .csv or
            .parquet. By default it is RUN/KIND.png, or a file in the working folder if RUN is no
            folder. In Python, True stands for this file; without
            ``out`` no file is written.
        episode: For visits, battery, services, delay, age, snapshot and map: the episode to draw.
        minute: For snapshot and map: the minute to draw. By default it is the end of the episode,
            and for map the mean over the run.
        drone: For visits, policy and battery: the drone to draw, counted from 0. For energy: a
            drone of the type to draw.
        window: For training: the number of episodes that a running mean is over.
        battery_min: For policy: the minutes left of the battery. By default it is half full.
        level: For policy and radio: the level of altitude, counted from 0, the lowest.
        at: For radio: the place of the drone, in metres. By default it is the middle of the map. In
            Python, it may also be a pair, such as ``(1200, 800)``.
        against: For compare: the policy that the others are compared with.
        measure: For sweep and compare: a measure to draw, such as qoe3_percent; it can be given
            several times.
            By default QoE1 to QoE3 are drawn. In Python, it is one or a list.
        key: For sweep: a key to show, the first one along the axis, or to hold at VALUE; it can be
            given several times. In Python, it is one or a list.
        progress: Show the progress, if a run has to be played again for its events.

    Raises:
        UsageError: the kind or an option is not one of those allowed, or ``out`` cannot be written.
        PolicyError: a folder cannot be read.
        NoEventsError: the run has not kept its events, and cannot be played again.
    """
    from desim_uav.api.sources import each_of, in_folders
    from desim_uav.experiment import plot as figures
    from desim_uav.experiment.compare import Comparison
    from desim_uav.scenario.schema import Scenario
    from desim_uav.world import World

    options: dict[str, Any] = {"episode": episode, "minute": minute, "drone": drone}
    options |= {"window": window, "battery_min": battery_min, "level": level, "against": against}
    options |= {"at": at if at is None or isinstance(at, str) else ",".join(map(str, at))}
    options |= {"measure": measure, "key": key}
    results = each_of("runs", runs, Comparison, Scenario, World)
    tabled = figures.chosen(kind, len(results), options).tabled
    target = None
    if out is True:
        target = figures.Target(figure_place(kind, results))
    elif out is not None and out is not False:
        target = figures.Target(Path(out), "--out", tabled)
    objects: list[Any] = []
    others: list[Any] = []
    for one in results:
        (objects if isinstance(one, Comparison | Scenario | World) else others).append(one)
    with in_folders("runs", others) as sources:
        several = figures.KINDS[kind].several
        drawables = [*map(_drawable, objects), *(sources if several else sources[:1])]
        figure = figures.draw(kind, drawables, options, progress)
    if target is not None:
        target.write(figure)
    return figure


def figure_place(kind: str, results: Sequence[Any]) -> Path:
    """Return where a figure is put by default: in the one folder, or else the working folder."""
    place = _folder(results[0]) if len(results) == 1 else None
    if place is not None and place.is_dir():
        return place / f"{kind}.png"
    return Path(f"{place.stem if kind == 'policy' and place is not None else kind}.png")


@verb
def film(
    run: Shown,
    file: str | Path | None = None,
    *,
    episode: Annotated[int | None, ANY_EPISODE] = None,
    fps: Annotated[float, Within(1.0, 60.0)] = 12,
    speed: Annotated[float, Within(0.1, 3600.0)] = 120,
    width: Annotated[int, Within(160, 1920)] = 800,
    progress: bool = True,
) -> Path:
    """Film an episode of a run, in continuous time.

    In Python, this does what ``desim-uav video`` does, and returns the file.

    Args:
        run: The folder of a run, as `run` writes it. In Python, it may also be the result of a run.
            Of several seeds, the first is filmed.
        file: A file that ends in .gif, or in .mp4 (H.264), which needs the extra video. Default:
            ``film.gif`` in the folder of the run, or in the working folder if the run has none.
        episode: The episode to film. By default it is the first that counts.
        fps: The number of frames per second.
        speed: The number of simulated seconds per second of film.
        width: The width in pixels; the height is three quarters of it.
        progress: Show the progress.

    Raises:
        UsageError: an option is not one of those allowed, or the file cannot be written.
        PolicyError: the folder cannot be read.
        NoEventsError: the run has not kept its events, and cannot be played again.
        MissingExtraError: an MP4 needs a package that is not installed.
    """
    from desim_uav.api.sources import in_folders
    from desim_uav.disk import file_place
    from desim_uav.experiment import plot as figures

    place = _default([run], "film.gif") if file is None else Path(file)
    file_place(place, "file", [".gif", ".mp4"])
    ending = place.suffix.lower()
    with in_folders("run", [run]) as sources:
        figures.film(
            sources[0],
            place if ending == ".gif" else None,
            place if ending == ".mp4" else None,
            episode=episode,
            fps=fps,
            speed=speed,
            width=width,
            show_progress=progress,
        )
    return place


@verb
def write_report(
    runs: Shown | Sequence[Shown],
    out: str | Path | None = None,
    title: str | None = None,
    against: str | None = None,
    *,
    progress: bool = True,
) -> Path:
    """Write a page about a run, a sweep, or a comparison of several runs.

    The page needs no network and no server.

    In Python, this does what ``desim-uav report`` does, and returns the file.

    Args:
        runs: The folders of one run or several, or one of a sweep. In Python, they may also be
            results.
        out: Write the page here. By default it is RUN_DIR/report.html, or report.html for several
            runs. In Python, it is also report.html if the run has no folder.
        title: The title of the page.
        against: The policy that the others are compared with. By default it is the first.
        progress: Show the progress, if a run has to be played again for its events.

    Raises:
        UsageError: the file cannot be written, or ``against`` is not one of the policies.
        PolicyError: a folder cannot be read, or the runs cannot be compared.
    """
    from desim_uav.api.sources import each_of
    from desim_uav.disk import file_place
    from desim_uav.experiment.report import NAME

    results = each_of("runs", runs)
    file = _default(results, NAME) if out is None else Path(out)
    file_place(file, "" if out is None else "--out", [".html"])
    return report_of(results, title, against, file, progress).save(file)


def report_of(
    results: Sequence[Shown],
    title: str | None = None,
    against: str | None = None,
    file: Path | None = None,
    progress: bool = True,
) -> Page:
    """Make the page that ``write_report`` writes, to be written to ``file``."""
    from desim_uav.api.replay import Page
    from desim_uav.api.sources import in_folders
    from desim_uav.disk import file_place
    from desim_uav.experiment.report import NAME, make_report

    if file is not None:
        file_place(file, endings=[".html"])
    with in_folders("runs", results) as sources:
        text = make_report(sources, file or Path(NAME), title, against, progress)
    return Page(text.encode(), NAME)


@verb
def write_replay(
    run_dir: Shown,
    html: str | Path | None = None,
    episodes: int | str | Sequence[int] | None = None,
    *,
    beside: Shown | None = None,
    most_bytes: int | None = None,
    progress: bool = True,
) -> Replay:
    """Write a page that plays the episodes of a run in continuous time; any browser opens it.

    With a second run of the same scenario, seed and world, the page plays both side by side.

    In Python, this does what ``desim-uav replay`` does, and returns the page. Of a counterfactual,
    both branches are played side by side.

    Args:
        run_dir: The folder of a run, as `run` writes it. In Python, it may also be the result of a
            run. Of several seeds, the first is played.
        html: Write the page here. By default it is RUN_DIR/replay.html, or RUN_DIR/replay-NAME.html
            for two runs, NAME being the second folder's. In Python, it is replay.html in the
            working folder if the run has no folder.
        episodes: The episodes to show, such as 0-3,8. By default they are all that count, as many
            as 25 MiB hold. In Python, it may also be a number or a list, and ``most_bytes`` says
            how many.
        beside: The folder of a second run on the same seeds, played in step with the first.
        most_bytes: The largest size of the page, if ``episodes`` says nothing. Default: 25 MiB.
        progress: Show the progress, if a run has to be played again for its events.

    Raises:
        UsageError: there is no such episode, or the file cannot be written.
        NoEventsError: a run has not kept its events, and cannot be played again.
        PolicyError: a folder cannot be read, or the two runs differ in scenario, world or episodes.
    """
    from desim_uav.api.arguments import ranges_of
    from desim_uav.api.replay import Replay
    from desim_uav.api.sources import in_folders
    from desim_uav.experiment.replay.page import write_replay as write_page

    file = None if html is None else Path(html)
    if file is None and _folder(run_dir) is None:
        file = Path("replay.html")
    others = [] if beside is None else [beside]
    with in_folders("run_dir", [run_dir]) as first, in_folders("beside", others) as second:
        pair = hasattr(run_dir, "difference") and len(first) == 2  # of a counterfactual
        if pair and beside is not None:
            raise UsageError("beside: a counterfactual has two branches, so nothing fits beside it")
        other = first[1] if pair else second[0] if second else None
        if pair and episodes is None:
            episodes = run_dir.shown  # type: ignore[union-attr]
        text = ranges_of("episodes", episodes)
        return Replay(write_page(first[0], file, text, progress, most_bytes, other))


def _default(results: Sequence[Any], name: str) -> Path:
    """Return the default place of a file: in the folder of the one result, if it has one."""
    folder = _folder(results[0]) if len(results) == 1 else None
    return Path(name) if folder is None else folder / name


def _folder(result: Any) -> Path | None:
    """Return the folder of a result, or None if it has none or several."""
    if isinstance(result, str | Path):
        return Path(result)
    folders = getattr(result, "folders", None)
    if folders is None:
        folder = getattr(result, "folder", None) or getattr(result, "out", None)
        return folder if isinstance(folder, Path) else None
    return folders[0] if len(folders) == 1 else None


def _drawable(source: Any) -> Any:
    """Return the world of a scenario; anything else is drawn as it is."""
    from desim_uav.errors import located
    from desim_uav.scenario.schema import Scenario
    from desim_uav.world import build_world

    if not isinstance(source, Scenario):
        return source
    with located(Path(source.name)):
        return build_world(source, source.effective_world_seed)
