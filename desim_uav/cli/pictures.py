"""Commands that show what a run was like."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from desim_uav.api import pictures
from desim_uav.api.levels import write_levels
from desim_uav.cli.ending import complain, print_json
from desim_uav.cli.made import made
from desim_uav.cli.terminal import AS_JSON, GIF, MP4, NO_PLUGINS, NO_PROGRESS, OPEN
from desim_uav.notices import tell


@made(
    *(pictures.write_replay, OPEN, AS_JSON, NO_PROGRESS, NO_PLUGINS),
    without=("most_bytes",),
)
def replay(arguments: dict[str, Any], open_it: bool, as_json: bool, quiet: bool) -> None:
    """Print the page's file, and say which episodes there was no room for."""
    page = pictures.write_replay(**arguments)
    assert page.file is not None
    if page.left_out:
        complain(
            f"{page.file}: it holds episodes {page.episodes[0]} to {page.episodes[-1]}; with the "
            f"{len(page.left_out)} others it would pass 25 MiB: choose some with --episodes"
        )
    if as_json:
        print_json(page.summary())
    else:
        tell(page.file)
    if open_it:
        import webbrowser

        webbrowser.open(page.file.resolve().as_uri())


@made(pictures.write_report, NO_PLUGINS)
def report(arguments: dict[str, Any]) -> None:
    """Print the page's file."""
    tell(pictures.write_report(**arguments))


@made(pictures.plot, NO_PLUGINS)
def plot(arguments: dict[str, Any]) -> None:
    """Print the figure's file."""
    place = arguments["out"] or pictures.figure_place(arguments["kind"], arguments["runs"])
    pictures.plot(**arguments | {"out": arguments["out"] or True})
    tell(place)


@made(write_levels, NO_PROGRESS, NO_PLUGINS)
def levels(arguments: dict[str, Any], quiet: bool) -> None:
    """Print the table's file."""
    tell(write_levels(**arguments))


@made(pictures.film, GIF, MP4, NO_PROGRESS, NO_PLUGINS, without=("file",))
def video(arguments: dict[str, Any], gif: Path | None, mp4: Path | None, quiet: bool) -> None:
    """Print the films' files."""
    from desim_uav.experiment.plot import film

    run, shows = arguments.pop("run"), arguments.pop("progress")
    for place in film(run, gif, mp4, **arguments, show_progress=shows):
        tell(place)
