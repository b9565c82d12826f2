"""The errors a user can meet, each with the exit code the command line ends with, and notices."""

from __future__ import annotations

import difflib
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any


class DesimError(Exception):
    """An error that the user can mend. The command line prints it without a traceback."""

    exit_code = 1


class DesimWarning(UserWarning):
    """Something a user may have overlooked; the command line prints it as one line on stderr."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C has interrupted a run, a training or a comparison.

    ``result`` holds what was finished before. This class is a KeyboardInterrupt, so that a program
    that does not handle it ends as usual.
    """

    def __init__(self, message: str, result: object) -> None:
        super().__init__(message)
        self.result = result


class SimulationError(DesimError):
    """The simulation failed."""

    exit_code = 1


class UsageError(DesimError):
    """A command or a call asks for something that cannot be done."""

    exit_code = 2


class ScenarioError(DesimError):
    """A scenario is invalid. ``problems`` holds every problem found, one line each."""

    exit_code = 3

    def __init__(self, *problems: str) -> None:
        super().__init__("\n".join(problems))
        self.problems = problems


@contextmanager
def located(path: Path) -> Iterator[None]:
    """Add the scenario's file to problems that are found only when its world is drawn."""
    try:
        yield
    except ScenarioError as error:
        raise ScenarioError(*(f"{path}: {problem}" for problem in error.problems)) from error


class PolicyError(DesimError):
    """A policy or a log file is unreadable, or does not fit the scenario."""

    exit_code = 4


class StateError(PolicyError):
    """A saved state is unreadable, or it is of another scenario or world."""


class NoEventsError(PolicyError):
    """A run was made without events, so it cannot be replayed."""


def install_command(extra: str) -> str:
    """Return the command that installs an extra, to be typed in the folder of the checkout."""
    return f'pip install -e ".[{extra}]"'


class MissingExtraError(DesimError):
    """A command or a component needs packages that are not installed."""

    exit_code = 5

    def __init__(self, what: str, extra: str) -> None:
        super().__init__(
            f"{what} needs packages that are missing: {install_command(extra)} "
            "(in the folder of the checkout)"
        )


def printable(text: str) -> str:
    """Return a text on one line, with control and invisible characters as escape sequences."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def in_short(what: object, longest: int = 200) -> str:
    """Return text from an untrusted file, shortened and printable, for use in a message."""
    text = str(what)
    return printable(text if len(text) <= longest else f"{text[: longest - 1]}…")


def did_you_mean(word: str, words: Iterable[str]) -> str:
    """Return `` (did you mean 'x'?)`` for the nearest known word, or "" if none is near."""
    nearest = difflib.get_close_matches(word, list(words), n=1, cutoff=0.6)
    return f" (did you mean {nearest[0]!r}?)" if nearest else ""


def require_within(options: Mapping[str, Any], bounds: Mapping[str, Sequence[float]]) -> None:
    """Raise UsageError, which names the option, for one that is not within its two bounds."""
    for name, (least, most) in bounds.items():
        if not least <= options[name] <= most:
            raise UsageError(f"--{name} {options[name]}: must be from {least} to {most}")


def has_instead(of: type, name: str) -> str:
    """Return the fields of a row or record that lacks ``name``, for a message, or ""."""
    listings = ("kinds", "__dataclass_fields__", "_fields")
    fields = next((list(vars(of)[each]) for each in listings if each in vars(of)), [])
    return f"{did_you_mean(name, fields)}; it has {', '.join(fields)}" if fields else ""


def notice(words: str) -> None:
    """Print one line on stderr, as the command line prints its errors."""
    try:
        print(f"desim-uav: {printable(words)}", file=sys.stderr, flush=True)
    except BrokenPipeError:
        drop(sys.stderr)


def drop(stream: Any) -> None:
    """Discard what is still to be written to a stream that nobody reads any more.

    Otherwise Python would report an error when it exits.
    """
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
