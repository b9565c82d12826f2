"""The options that only a terminal has: how results and progress are shown, and whose code runs."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Annotated, Any

import typer

from desim_uav.cli.looks import OUTPUT, SCENARIO
from desim_uav.plug_ins import ADMISSION


def _flag(name: str, *flags: str, about: str, heading: str | None = OUTPUT, **more: Any) -> Any:
    option: Any = typer.Option(*flags, help=about, rich_help_panel=heading, **more)
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=False, annotation=Annotated[bool, option])


def _file(name: str, metavar: str, about: str) -> Any:
    option: Any = typer.Option(metavar=metavar, help=about)
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=None, annotation=Annotated[Path | None, option])


def _begin(refuses: bool) -> bool:
    ADMISSION.begin(refuses)
    return refuses


AS_JSON = _flag("as_json", "--json", about="Print one JSON object instead of a table.")
QUIET = _flag("quiet", "-q", "--quiet", about="Print neither progress nor a table.")
NO_PROGRESS = _flag("quiet", "-q", "--quiet", about="Print no progress.")
QUIETS = (QUIET, NO_PROGRESS)
CHECK = _flag("check", "--check", about="End with exit code 6 if a gate does not hold.")
OPEN = _flag("open_it", "--open", about="Show the page in the browser.", heading=None)
NO_PLUGINS = _flag(
    *("no_plugins", "--no-plugins"),
    about="Refuse components of one's own. Without this, what a scenario, the folder of a run or "
    "--policy names as module:Class is imported, which runs its code.",
    heading=SCENARIO,
    callback=_begin,
    is_eager=True,
)
GIF = _file("gif", "FILE.gif", "Write a GIF that repeats for ever.")
MP4 = _file("mp4", "FILE.mp4", "Write an MP4 (H.264), which needs the extra video.")
CONTEXT = inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)
