"""Commands that show what a run was like."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from desim_uav.cli.ending import complain
from desim_uav.cli.options import Json, NoProgress, RunDir


def replay(
    run_dir: RunDir,
    beside: Annotated[
        Path | None,
        typer.Argument(
            metavar="[RUN_DIR2]",
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
        str | None, typer.Option(metavar="0-9", help="Which, as 0-3,8; else the counted ones.")
    ] = None,
    open_it: Annotated[bool, typer.Option("--open", help="Show it in the browser.")] = False,
    as_json: Json = False,
    quiet: NoProgress = False,
) -> None:
    """Write a page that plays the episodes of a run in continuous time; any browser opens it.

    With a second run of the same scenario, seed and world, the page plays both side by side.
    """
    from desim_uav.experiment.replay import write_replay

    done = write_replay(run_dir, html, episodes, not quiet, beside=beside)
    if done.left_out:
        complain(
            f"{done.file}: it holds episodes {done.episodes[0]} to {done.episodes[-1]}; with the "
            f"{len(done.left_out)} others it would pass 25 MiB: choose some with --episodes"
        )
    if as_json:
        print(json.dumps(done.summary(), indent=1))
    else:
        print(done.file)
    if open_it:
        import webbrowser

        webbrowser.open(done.file.resolve().as_uri())


def report(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN_DIR…", help="Folders of runs.")],
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE.html", help="Instead of RUN_DIR/report.html, or report.html."),
    ] = None,
    title: Annotated[str | None, typer.Option(metavar="T", help="Of the page.")] = None,
    against: Annotated[
        str | None, typer.Option(metavar="P", help="The policy of reference; else the first.")
    ] = None,
) -> None:
    """Write a page on a run, or on several compared, that needs no network and no server."""
    from desim_uav.experiment.report import report as write_report

    print(write_report(runs, out, title, against))


def plot(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            help="training, compare, visits, policy, battery, episodes, services or snapshot.",
        ),
    ],
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN…", help="The folder of a run or training; for policy also a table."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE", help=".png, .pdf or .svg; else RUN/KIND.png."),
    ] = None,
    episode: Annotated[
        int | None, typer.Option(metavar="N", help="visits, battery, services, snapshot: this one.")
    ] = None,
    minute: Annotated[
        float | None, typer.Option(metavar="M", min=0, help="snapshot: then; else at the end.")
    ] = None,
    drone: Annotated[
        int | None, typer.Option(metavar="D", min=0, help="visits, policy, battery: this one.")
    ] = None,
    window: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="training: episodes of a running mean.")
    ] = None,
    battery_min: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="policy: minutes left; else half.")
    ] = None,
    level: Annotated[
        int | None, typer.Option(metavar="K", min=0, help="policy: from 0, the lowest.")
    ] = None,
    against: Annotated[
        str | None, typer.Option(metavar="P", help="compare: the policy of reference.")
    ] = None,
) -> None:
    """Draw a figure of runs, trainings or a learned policy."""
    from desim_uav.experiment.plot import plot as draw

    asked: dict[str, Any] = {"episode": episode, "minute": minute, "drone": drone, "window": window}
    asked |= {"battery_min": battery_min, "level": level, "against": against}
    print(draw(kind, runs, out, asked))


def video(
    run_dir: RunDir,
    gif: Annotated[Path | None, typer.Option(metavar="FILE.gif", help="An endless one.")] = None,
    mp4: Annotated[
        Path | None, typer.Option(metavar="FILE.mp4", help="H.264 (needs the extra video).")
    ] = None,
    episode: Annotated[
        int | None, typer.Option(metavar="N", help="Else the first that counts.")
    ] = None,
    fps: Annotated[float, typer.Option(metavar="N", min=1, max=60, help="Frames a second.")] = 12,
    speed: Annotated[
        float, typer.Option(metavar="N", min=0.1, max=3600, help="Simulated seconds in a second.")
    ] = 120,
    width: Annotated[
        int, typer.Option(metavar="N", min=160, max=1920, help="In pixels; height is 3/4 of it.")
    ] = 800,
    quiet: NoProgress = False,
) -> None:
    """Film an episode of a run, in continuous time."""
    from desim_uav.experiment.plot import film

    made = film(
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
        print(place)
