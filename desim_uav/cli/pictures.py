"""Commands that show what a run was like."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from desim_uav.cli.ending import complain
from desim_uav.cli.options import Json, NoProgress, RunDir, between, within
from desim_uav.notices import tell


def replay(
    run_dir: RunDir,
    beside: Annotated[
        Path | None,
        typer.Argument(
            metavar="RUN_DIR2",
            help="The folder of a second run on the same seeds, played in step with the first.",
        ),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write the page here. By default it is RUN_DIR/replay.html, or "
            "RUN_DIR/replay-NAME.html for two runs, NAME being the second folder's.",
        ),
    ] = None,
    episodes: Annotated[
        str | None,
        typer.Option(
            metavar="0-9",
            help="The episodes to show, such as 0-3,8. By default they are all that count, as many "
            "as 25 MiB hold.",
        ),
    ] = None,
    open_it: Annotated[bool, typer.Option("--open", help="Show the page in the browser.")] = False,
    as_json: Json = False,
    quiet: NoProgress = False,
) -> None:
    """Write a page that plays the episodes of a run in continuous time; any browser opens it.

    With a second run of the same scenario, seed and world, the page plays both side by side.
    """
    import desim_uav as du

    done = du.write_replay(run_dir, html, episodes, beside=beside, progress=not quiet)
    assert done.file is not None
    if done.left_out:
        complain(
            f"{done.file}: it holds episodes {done.episodes[0]} to {done.episodes[-1]}; with the "
            f"{len(done.left_out)} others it would pass 25 MiB: choose some with --episodes"
        )
    if as_json:
        print(json.dumps(done.summary(), indent=1))
    else:
        tell(done.file)
    if open_it:
        import webbrowser

        webbrowser.open(done.file.resolve().as_uri())


def report(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN_DIR…", help="The folders of one run or several, or one of a sweep."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.html",
            help="Write the page here. By default it is RUN_DIR/report.html, or report.html for "
            "several runs.",
        ),
    ] = None,
    title: Annotated[
        str | None, typer.Option(metavar="TITLE", help="The title of the page.")
    ] = None,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="POLICY",
            help="The policy that the others are compared with. By default it is the first.",
        ),
    ] = None,
) -> None:
    """Write a page about a run, a sweep, or a comparison of several runs.

    The page needs no network and no server.
    """
    from desim_uav.experiment.report import report as write_report

    tell(write_report(runs, out, title, against))


def plot(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            help="The kind of figure: training, compare, sweep, visits, policy, battery, "
            "energy, episodes, services, radio or snapshot.",
        ),
    ],
    runs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="RUN…",
            help="The folder of a run, a training or a sweep; for policy it may be the file of a "
            "table, and for radio and energy a scenario file or the name of a shipped scenario. "
            "For energy it may be left out.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            metavar="FILE",
            help="The file, which ends in .png, .pdf or .svg. By default it is RUN/KIND.png, "
            "or a file in the working folder if RUN is no folder.",
        ),
    ] = None,
    episode: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="For visits, battery, services and snapshot: the episode to draw.",
        ),
    ] = None,
    minute: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            callback=between(0, 1e9),
            help="For snapshot: the minute to draw. By default it is the end of the episode.",
        ),
    ] = None,
    drone: Annotated[
        int | None,
        typer.Option(
            metavar="D",
            callback=within(0, 10**9),
            help="For visits, policy and battery: the drone to draw, counted from 0. For energy: "
            "a drone of the type to draw.",
        ),
    ] = None,
    window: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            callback=within(1, 10**9),
            help="For training: the number of episodes that a running mean is over.",
        ),
    ] = None,
    battery_min: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            callback=within(0, 10**9),
            help="For policy: the minutes left of the battery. By default it is half full.",
        ),
    ] = None,
    level: Annotated[
        int | None,
        typer.Option(
            metavar="K",
            callback=within(0, 10**9),
            help="For policy and radio: the level of altitude, counted from 0, the lowest.",
        ),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y",
            help="For radio: the place of the drone, in metres. By default it is the middle of the "
            "map.",
        ),
    ] = None,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="POLICY",
            help="For compare: the policy that the others are compared with.",
        ),
    ] = None,
    measure: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="For sweep: a measure to draw, such as qoe3_percent; it can be given several "
            "times. By default QoE1 to QoE3 are drawn.",
        ),
    ] = None,
    key: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY[=VALUE]",
            help="For sweep: a key to show, the first one along the axis, or to hold at VALUE; it "
            "can be given several times.",
        ),
    ] = None,
) -> None:
    """Draw a figure of runs, trainings, a sweep, a learned policy, a radio or of energy."""
    from desim_uav.experiment.plot import plot as write_figure

    asked: dict[str, Any] = {"episode": episode, "minute": minute, "drone": drone, "window": window}
    asked |= {"battery_min": battery_min, "level": level, "at": at, "against": against}
    asked |= {"measure": measure or None, "key": key or None}
    tell(write_figure(kind, runs or [], out, asked))


def video(
    run_dir: RunDir,
    gif: Annotated[
        Path | None, typer.Option(metavar="FILE.gif", help="Write a GIF that repeats for ever.")
    ] = None,
    mp4: Annotated[
        Path | None,
        typer.Option(metavar="FILE.mp4", help="Write an MP4 (H.264), which needs the extra video."),
    ] = None,
    episode: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="The episode to film. By default it is the first that counts."
        ),
    ] = None,
    fps: Annotated[
        float,
        typer.Option(metavar="N", callback=between(1, 60), help="The number of frames per second."),
    ] = 12,
    speed: Annotated[
        float,
        typer.Option(
            metavar="N",
            callback=between(0.1, 3600),
            help="The number of simulated seconds per second of film.",
        ),
    ] = 120,
    width: Annotated[
        int,
        typer.Option(
            metavar="N",
            callback=within(160, 1920),
            help="The width in pixels; the height is three quarters of it.",
        ),
    ] = 800,
    quiet: NoProgress = False,
) -> None:
    """Film an episode of a run, in continuous time."""
    from desim_uav.experiment.plot import film as write_films

    made = write_films(
        run_dir,
        gif,
        mp4,
        episode=episode,
        fps=fps,
        speed=speed,
        width=width,
        show_progress=not quiet,
    )
    for place in made:
        tell(place)
