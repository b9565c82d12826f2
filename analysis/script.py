"""The command line of an analysis script: run folders, an optional picture, and clear errors."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from desim_uav.disk import file_place, write_whole
from desim_uav.errors import DesimError, PolicyError, UsageError, drop, printable
from desim_uav.notices import replace_lacking

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

PICTURES = (".png", ".svg", ".pdf")

Analysis = Callable[["pd.DataFrame", bool], "Figure | None"]
"""Prints a table about the requests of some runs; returns a figure if the flag asks for one."""


def row(cells: Iterable[object]) -> str:
    """Return a row of a Markdown table."""
    return "| " + " | ".join(map(str, cells)) + " |"


def count(most: int = 2**20) -> Callable[[str], int]:
    """Return the type of an option of a script that is a whole number from 1 to ``most``."""

    def read(text: str) -> int:
        if not text.isdecimal() or not 1 <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"must be a whole number from 1 to {most}, not {text}")
        return int(text)

    return read


def run_script(analysis: Analysis, about: str | None) -> None:
    """Analyse the run folders that the command line names, ``RUN_DIR… [FILE.png]``.

    The analysis gets the frame of ``read_runs``. If a policy has only one seed, a note below the
    table says that there is no interval. An error ends the program with one message and its exit
    code. ``about``, the script's docstring, is its help text.
    """
    from runs import read_runs

    replace_lacking()
    arguments = sys.argv[1:]
    if not arguments or {"-h", "--help"} & set(arguments):
        print(about, file=sys.stdout if arguments else sys.stderr)
        sys.exit(0 if arguments else UsageError.exit_code)
    try:
        folders, picture = _paths(arguments)
        runs = read_runs(folders)
        if runs.empty:
            raise PolicyError("these runs have no requests")
        _analyse(analysis, runs, picture)
        if runs.groupby("policy")["seed"].nunique().min() == 1:
            print("no interval from a single seed: its requests and episodes are correlated")
        print(end="", flush=True)
    except DesimError as error:
        print(printable(f"{Path(sys.argv[0]).name}: {error}"), file=sys.stderr)
        sys.exit(error.exit_code)
    except BrokenPipeError:  # the reader of stdout has ended
        drop(sys.stdout)


def _paths(arguments: list[str]) -> tuple[list[Path], Path | None]:
    """Return the run folders and the picture's file. Raises UsageError if there is no folder."""
    *others, last = map(Path, arguments)
    if last.suffix.lower() not in PICTURES or last.is_dir():
        return [*others, last], None
    if not others:
        raise UsageError(f"{last}: name the run folders before the picture")
    return others, last


def _analyse(analysis: Analysis, runs: pd.DataFrame, picture: Path | None) -> None:
    """Run the analysis. Raises UsageError if the picture cannot be written."""
    from desim_uav.report.figures.style import styled, to_bytes

    figure = styled(analysis)(runs, picture is not None)
    try:
        if picture is not None and figure is not None:
            write_whole(file_place(picture), to_bytes(figure, picture.suffix.lower()))
    except DesimError as error:
        raise UsageError(str(error)) from error
