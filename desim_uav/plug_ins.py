"""Notices before components of one's own are imported, which runs their code, and their refusal.

Scenarios and folders of runs name such components, and a user who reads somebody else's file may
not expect code to run. The command line prints a notice, or refuses them (``--no-plugins``).
"""

from __future__ import annotations

import importlib.util
import os
import sys
import sysconfig
from contextlib import suppress
from pathlib import Path

from desim_uav.errors import notice

REFUSED = "--no-plugins refuses components of one's own, whose code would run"

PROJECT = ("pyproject.toml", "setup.py", ".git")
"""Entries by which the folder of a project is recognised."""


class Admission:
    """The setting of the command line. In Python code, everything is imported without a notice."""

    def __init__(self) -> None:
        self._refuses = self._says = False
        self._folders: set[Path] = set()

    def begin(self, refuses: bool) -> None:
        """Begin a command of the command line, which refuses components of one's own or not."""
        self._refuses, self._says = refuses, True
        self._folders.clear()

    def end(self) -> None:
        """End the command: what Python code imports after it is neither refused nor announced."""
        self._refuses = self._says = False

    def ask(self, name: str) -> None:
        """Ask whether a component, ``"package.module:Class"``, may be imported.

        Prints a notice, once per folder, if it is in no folder that the user has chosen: the
        current project, installed packages, and ``PYTHONPATH``. Raises ValueError if it is refused.
        """
        if self._refuses:
            raise ValueError(REFUSED)
        folder = _folder_of(name.rpartition(":")[0]) if self._says else None
        if folder is None or folder in self._folders:
            return
        self._folders.add(folder)
        if not any(folder.is_relative_to(place) for place in _code_folders()):
            notice(f"{name!r} is imported from {folder}, which runs its code (see --no-plugins)")


ADMISSION = Admission()


def _folder_of(module: str) -> Path | None:
    """Return the folder of a module's package, or of its file, without importing it.

    ``module`` is its name or the path of its file. Returns None if there is no file.
    """
    if module.endswith(".py"):
        return Path(module).resolve().parent
    package = module.partition(".")[0]
    with suppress(ImportError, ValueError, AttributeError, OSError):
        spec = importlib.util.find_spec(package)
        places = [spec.origin] if spec and spec.has_location else []
        places = places or list((spec and spec.submodule_search_locations) or ())
        if places and places[0]:
            return Path(places[0]).resolve().parent
    return None


def _code_folders() -> list[Path]:
    """Return the folders whose code the user has chosen to run."""
    folders = [Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib")]
    folders += [
        Path(place) for place in os.environ.get("PYTHONPATH", "").split(os.pathsep) if place
    ]
    folders += [Path(__file__).parents[1], Path(sys.prefix)]
    here = Path.cwd()
    project = (at for at in (here, *here.parents) if any((at / name).exists() for name in PROJECT))
    folders += [at for at in (next(project, None),) if at is not None]
    return [place.resolve() for place in folders]
