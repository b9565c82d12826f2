"""The sources of figures, pages and films: results, and the paths of folders and files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import Any, Protocol

from desim_uav.errors import UsageError, in_short
from desim_uav.experiment.replay.again import Source


class InFolders(Protocol):
    """A result that is in folders, or can be written to temporary ones."""

    def sources(self) -> AbstractContextManager[Sequence[Source]]:
        """Provide folders with the result in a ``with`` block, for instance one for each seed."""


def each_of(name: str, argument: Any, *single: type) -> list[Any]:
    """Return an argument as a list: one thing, or several in a list or another iterable."""
    if isinstance(argument, (str, Path, *single)) or hasattr(argument, "sources"):
        return [argument]
    if not isinstance(argument, Iterable):
        raise _unknown(name, argument)
    return list(argument)


@contextmanager
def in_folders(name: str, results: Sequence[str | Path | InFolders]) -> Iterator[list[Source]]:
    """Provide folders with the results of an argument in a ``with`` block; paths stay as they are.

    Raises UsageError for anything else.
    """
    with ExitStack() as open_until:
        folders: list[Source] = []
        for one in results:
            if isinstance(one, str | Path):
                folders.append(Source(Path(one)))
            elif hasattr(one, "sources"):
                folders += open_until.enter_context(one.sources())
            else:
                raise _unknown(name, one)
        yield folders


def _unknown(name: str, argument: Any) -> UsageError:
    return UsageError(
        f"{name}: {in_short(repr(argument), 100)}: must be a result of desim_uav, or the path of a "
        "folder or file"
    )
