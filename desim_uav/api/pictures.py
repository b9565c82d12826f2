"""Figures, films and pages of results and of run folders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from desim_uav.api.arguments import between, ranges_of, whole
from desim_uav.api.replay import Page, Replay
from desim_uav.api.sources import InFolders, each_of, in_folders
from desim_uav.errors import UsageError, located
from desim_uav.experiment import plot as figures
from desim_uav.experiment.compare import Comparison
from desim_uav.experiment.replay.page import write_replay as write_page
from desim_uav.experiment.report import NAME, make_report
from desim_uav.run_folder import file_place
from desim_uav.scenario.schema import Scenario
from desim_uav.typed import typed
from desim_uav.world import World, build_world

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["film", "plot", "write_replay", "write_report"]

Drawn = str | Path | InFolders | Comparison | Scenario | World
"""What a figure is drawn of: a result, a comparison, the path of a folder or a file, the name of a
shipped scenario or policy, a scenario, or a world."""

Shown = str | Path | InFolders
"""What a page or a film is made of: a result, or the path of a folder."""


@typed
def plot(
    kind: str,
    runs: Drawn | Sequence[Drawn] = (),
    out: str | Path | None = None,
    *,
    episode: int | None = None,
    minute: float | None = None,
    drone: int | None = None,
    window: int | None = None,
    battery_min: int | None = None,
    level: int | None = None,
    at: str | tuple[float, float] | None = None,
    against: str | None = None,
    measure: str | Sequence[str] | None = None,
    key: str | Sequence[str] | None = None,
    progress: bool = True,
) -> Figure:
    """Draw a figure, which a notebook shows; with ``out`` it is written to a file, too.

    This is ``desim-uav plot``, which has a default for ``out``.

    Args:
        kind: training, compare, sweep, visits, policy, battery, energy, episodes, services, radio
            or snapshot.
        runs: What to draw: a result of ``run``, ``train``, ``compare`` or ``sweep``, or the path of
            its folder. For policy, it may be the file or the shipped name of a table, and for radio
            and energy a scenario or its name, or a world. For training and compare, it may be a
            list of them. Of a run on several seeds, the first seed is drawn.
        out: A file that ends in .png, .pdf or .svg.
        episode: For visits, battery, services and snapshot: the episode.
        minute: For snapshot: the minute. Default: the end of the episode.
        drone: For visits, policy and battery: the drone, counted from 0. For energy: a drone of the
            type to draw.
        window: For training: the number of episodes that a running mean is over.
        battery_min: For policy: the minutes left of the battery. Default: half of it.
        level: For policy and radio: the level of altitude, counted from 0.
        at: For radio: the place of the drone in metres, ``(1200, 800)`` or ``"1200,800"``. Default:
            the middle of the map.
        against: For compare: the policy that the others are compared with.
        measure: For sweep: one measure or several, such as ``"qoe3_percent"``.
        key: For sweep: keys to show, the first along the axis, or ``"KEY=VALUE"`` to hold one.
        progress: Show the progress, if a run has to be played again for its events.

    Raises:
        UsageError: the kind or an option is not one of those allowed, or ``out`` cannot be written.
        PolicyError: a folder cannot be read.
        NoEventsError: the run has not kept its events, and cannot be played again.
    """
    options: dict[str, Any] = {"episode": episode, "minute": minute, "drone": drone}
    options |= {"window": window, "battery_min": battery_min, "level": level, "against": against}
    options |= {"at": at if at is None or isinstance(at, str) else ",".join(map(str, at))}
    options |= {"measure": measure, "key": key}
    for name in ("episode", "drone", "window", "battery_min", "level"):
        if options[name] is not None:
            low = -(10**9) if name == "episode" else 1 if name == "window" else 0
            options[name] = whole(name, options[name], low, 10**9)
    if minute is not None:
        options["minute"] = between("minute", minute, 0.0, 1e9)
    given = each_of("runs", runs, Comparison, Scenario, World)
    figures.chosen(kind, len(given), options)
    target = None if out is None else figures.Target(Path(out), "out")
    drawn: list[Any] = []
    others: list[Any] = []
    for one in given:
        (drawn if isinstance(one, Comparison | Scenario | World) else others).append(one)
    with in_folders("runs", others) as sources:
        several = figures.KINDS[kind].several
        found = [*map(_drawable, drawn), *(sources if several else sources[:1])]
        figure = figures.draw(kind, found, options, progress)
    if target is not None:
        target.write(figure)
    return figure


@typed
def film(
    run: Shown,
    file: str | Path | None = None,
    *,
    episode: int | None = None,
    fps: float = 12,
    speed: float = 120,
    width: int = 800,
    progress: bool = True,
) -> Path:
    """Film an episode of a run in continuous time, and return the file.

    This is ``desim-uav video``.

    Args:
        run: The result of a run, or the path of its folder. Of several seeds, the first is filmed.
        file: A file that ends in .gif, or in .mp4 (H.264), which needs the extra video. Default:
            ``film.gif`` in the folder of the run, or in the working folder if the run has none.
        episode: The episode. Default: the first that counts.
        fps: Frames per second, from 1 to 60.
        speed: Simulated seconds per second of film, from 0.1 to 3600.
        width: The width in pixels, from 160 to 1920; the height is three quarters of it.
        progress: Show the progress.

    Raises:
        UsageError: an option is not one of those allowed, or the file cannot be written.
        PolicyError: the folder cannot be read.
        NoEventsError: the run has not kept its events, and cannot be played again.
        MissingExtraError: an MP4 needs a package that is not installed.
    """
    place = _default([run], "film.gif") if file is None else Path(file)
    ending = place.suffix.lower()
    if ending not in (".gif", ".mp4"):
        raise UsageError(f"file {place}: the file's name must end in .gif or .mp4")
    with in_folders("run", [run]) as sources:
        figures.film(
            sources[0],
            place if ending == ".gif" else None,
            place if ending == ".mp4" else None,
            episode=None if episode is None else whole("episode", episode, -(10**9), 10**9),
            fps=between("fps", fps, 1, 60),
            speed=between("speed", speed, 0.1, 3600),
            width=whole("width", width, 160, 1920),
            show_progress=progress,
        )
    return place


@typed
def write_report(
    runs: Shown | Sequence[Shown],
    out: str | Path | None = None,
    title: str | None = None,
    against: str | None = None,
    *,
    progress: bool = True,
) -> Path:
    """Write a page about a run, a sweep, or several runs compared, and return its file.

    This is ``desim-uav report``. The page needs no network and no server.

    Args:
        runs: Results of runs or of a sweep, or the paths of their folders: one or several.
        out: The file. Default: ``report.html`` in the folder of the run or the sweep, or in the
            working folder if there are several runs, or the run has no folder.
        title: The title of the page.
        against: The policy that the others are compared with. Default: the first.
        progress: Show the progress, if a run has to be played again for its events.

    Raises:
        UsageError: the file cannot be written, or ``against`` is not one of the policies.
        PolicyError: a folder cannot be read, or the runs cannot be compared.
    """
    given = each_of("runs", runs)
    file = _default(given, NAME) if out is None else Path(out)
    return report_of(given, title, against, file, progress).save(file)


def report_of(
    given: Sequence[Shown],
    title: str | None = None,
    against: str | None = None,
    file: Path | None = None,
    progress: bool = True,
) -> Page:
    """Make the page that ``write_report`` writes, to be written to ``file``."""
    if file is not None:
        file_place(file)
    with in_folders("runs", given) as sources:
        text = make_report(sources, file or Path(NAME), title, against, progress)
    return Page(text.encode(), NAME)


@typed
def write_replay(
    run_dir: Shown,
    html: str | Path | None = None,
    episodes: int | str | Sequence[int] | None = None,
    *,
    beside: Shown | None = None,
    most_bytes: int | None = None,
    progress: bool = True,
) -> Replay:
    """Write a page that plays the episodes of a run in continuous time, and return the page.

    This is ``desim-uav replay``. Of a counterfactual, both branches are played side by side.

    Args:
        run_dir: The result of a run, or the path of its folder. Of several seeds, the first is
            played.
        html: The file. Default: ``replay.html`` in the folder of the run (``replay-NAME.html``
            beside a second run, whose folder is called NAME), or in the working folder if the run
            has none.
        episodes: The episodes to show, such as ``"0-3,8"``, 0 or ``[0, 1]``. Default: all that
            count, as many as ``most_bytes`` hold.
        beside: A second run of the same scenario, seed and world, which is played in step.
        most_bytes: The largest size of the page, if ``episodes`` says nothing. Default: 25 MiB.
        progress: Show the progress, if a run has to be played again for its events.

    Raises:
        UsageError: there is no such episode, or the file cannot be written.
        NoEventsError: a run has not kept its events, and cannot be played again.
        PolicyError: a folder cannot be read, or the two runs differ in scenario, world or episodes.
    """
    file = None if html is None else Path(html)
    if file is None and _folder(run_dir) is None:
        file = Path("replay.html")
    others = [] if beside is None else [beside]
    with in_folders("run_dir", [run_dir]) as shown, in_folders("beside", others) as second:
        pair = hasattr(run_dir, "difference") and len(shown) == 2  # of a counterfactual
        if pair and beside is not None:
            raise UsageError("beside: a counterfactual has two branches, so nothing fits beside it")
        other = shown[1] if pair else second[0] if second else None
        if pair and episodes is None:
            episodes = run_dir.shown  # type: ignore[union-attr]
        wanted = ranges_of("episodes", episodes)
        return Replay(write_page(shown[0], file, wanted, progress, most_bytes, other))


def _default(given: Sequence[Any], name: str) -> Path:
    """Return the default place of a file: in the folder of the one result, if it has one."""
    folder = _folder(given[0]) if len(given) == 1 else None
    return Path(name) if folder is None else folder / name


def _folder(given: Any) -> Path | None:
    """Return the folder of a result, or None if it has none or several."""
    if isinstance(given, str | Path):
        return Path(given)
    folders = getattr(given, "folders", None)
    if folders is None:
        found = getattr(given, "folder", None) or getattr(given, "out", None)
        return found if isinstance(found, Path) else None
    return folders[0] if len(folders) == 1 else None


def _drawable(given: Comparison | Scenario | World) -> Comparison | World:
    if not isinstance(given, Scenario):
        return given
    with located(Path(given.name)):
        return build_world(given, given.effective_world_seed)
