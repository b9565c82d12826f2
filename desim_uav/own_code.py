"""Digests of the files of a user's own components, and checks that none was edited since."""

from __future__ import annotations

import ast
import hashlib
import sys
import sysconfig
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

INSTALLED = {"site-packages", "dist-packages"}
"""Names of the folders of installed packages."""

OTHERS = (Path(sysconfig.get_path("stdlib")), Path(__file__).parent)
"""The folders of Python's own modules, and of this package."""


class _File(NamedTuple):
    """A file as it was when it was first looked at after the import of its module."""

    path: Path
    spec: ModuleSpec | None
    status: tuple[int, ...]
    sha256: str
    code: str
    imports: tuple[str, ...]


_FILES: dict[str, _File] = {}
"""The files of modules, by the names of the modules."""


def digest_of(name: str) -> str:
    """Return the SHA-256 of the files of a module and of all modules of the project it imports.

    The digest is that of the files as Python has imported them, and "" for a module without a
    file. Files of installed packages do not count, unless the module is of the same package.
    """
    digests = sorted(file.sha256 for file in _files_of(name))
    return hashlib.sha256(" ".join(digests).encode()).hexdigest() if digests else ""


def check_unchanged(module: ModuleType) -> None:
    """Raise ValueError if the code in a file of a module differs from what Python has imported.

    The files of all modules of the project that it imports count as well.
    """
    for file in _files_of(module.__name__):
        if _status(file.path) != file.status:
            text = _read(file.path)
            if text is not None and _code(text) != file.code:
                raise ValueError(
                    f"{file.path} has changed since Python imported it; restart Python (in a "
                    "notebook, its kernel), or import it again with importlib.reload"
                )


def check_place(module: ModuleType) -> None:
    """Raise ValueError if Python would now find another file than the one it has imported.

    This happens if one process uses two projects that have a module of the same name.
    """
    root = sys.modules.get(module.__name__.partition(".")[0], module)
    have = getattr(root, "__file__", None)
    spec = PathFinder.find_spec(root.__name__, sys.path) if root.__name__ != "__main__" else None
    if have and spec and spec.has_location and spec.origin:
        here, there = Path(have).resolve(), Path(spec.origin).resolve()
        if here != there:
            raise ValueError(
                f"there are two modules {root.__name__!r}: Python has imported {here}, and would "
                f"now import {there}; rename one of them, or use two processes"
            )


def _files_of(name: str) -> Iterator[_File]:
    """Yield the files of a module and of all modules of its project that it imports."""
    waiting, root = [name], name.partition(".")[0]
    for one in waiting:  # which grows
        file = _file(one, root)
        if file is not None:
            yield file
            waiting += [other for other in file.imports if other not in waiting]


def _file(name: str, root: str) -> _File | None:
    """Return the file of a module, as it was when it was first looked at since its import."""
    path, module, entry = _path(name, root), sys.modules.get(name), _FILES.get(name)
    if path is None:
        return None
    spec = getattr(module, "__spec__", None)
    if entry is None or entry.spec is not spec or entry.path != path:
        status, text = _status(path), _read(path)
        if text is None:
            return None
        sha256, package = hashlib.sha256(text).hexdigest(), name.rpartition(".")[0]
        names = _imports(text, getattr(module, "__package__", None) or package)
        imports = tuple(other for other in names if _path(other, root) is not None)
        entry = _FILES[name] = _File(path, spec, status, sha256, _code(text), imports)
    return entry


def _path(name: str, root: str) -> Path | None:
    """Return the file of a module that belongs to the user's project, loaded or not."""
    origin = getattr(sys.modules.get(name), "__file__", None)
    if origin is None and name not in sys.modules:
        with suppress(ImportError, ValueError, AttributeError):
            origin = getattr(find_spec(name), "origin", None)
    is_own = origin and origin.endswith(".py") and _is_own(Path(origin), name, root)
    return Path(origin) if origin and is_own else None


def _is_own(path: Path, name: str, root: str) -> bool:
    """Return whether a file belongs to the user's project, or to the same package as the root."""
    if name.partition(".")[0] == root != "desim_uav":
        return True
    return not INSTALLED.intersection(path.parts) and not any(map(path.is_relative_to, OTHERS))


def _status(path: Path) -> tuple[int, ...]:
    try:
        status = path.stat()
    except OSError:
        return ()
    return status.st_mtime_ns, status.st_ctime_ns, status.st_size, status.st_ino


def _read(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None


@cache
def _code(text: bytes) -> str:
    """Return the syntax tree of a text, without comments, or the text if it is not valid Python."""
    try:
        return ast.dump(ast.parse(text))
    except (SyntaxError, ValueError):
        return repr(text)


def _imports(text: bytes, package: str) -> tuple[str, ...]:
    """Return the names of the modules that a text may import."""
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError):
        return ()
    modules = list[str]()
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names):
                modules += [one.name for one in names]
            case ast.ImportFrom(module=module, names=names, level=level):
                parts = package.split(".") if level else []
                base = [*parts[: len(parts) - level + 1], *([module] if module else [])]
                modules += [".".join(base), *(".".join([*base, one.name]) for one in names)]
    whole: dict[str, Any] = {}
    for name in modules:
        parts = name.split(".")
        whole |= dict.fromkeys(".".join(parts[:k]) for k in range(1, len(parts) + 1))
    return tuple(name for name in whole if name and "*" not in name)
