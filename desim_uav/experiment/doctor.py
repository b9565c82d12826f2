"""The checks of ``desim-uav doctor``: packages, their versions, and folders to write to."""

from __future__ import annotations

import importlib
import math
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, metadata, requires, version
from pathlib import Path
from typing import Any, Literal

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from desim_uav import __version__
from desim_uav.available import available_bytes, processors, quota
from desim_uav.errors import install_command

Verdict = Literal["ok", "note", "problem"]

PACKAGE = "desim-uav"
SHORT_OF_DISK = 2**30
SHORT_OF_MEMORY = 5e8

CONFLICTS = {
    "ray": "RLlib needs gymnasium {wanted}, but {found} is installed; install RLlib in an "
    "environment of its own",
}
"""Packages that require other versions than this one does, each with the message about it."""

ALONE = dict.fromkeys(("benchmarl", "marl-test", "rllib"), " in an environment of its own")
"""Extras that need an environment of their own."""


@dataclass(frozen=True)
class Check:
    """The result of one check; with a ``problem``, something does not work."""

    verdict: Verdict
    what: str
    words: str


def examine() -> list[Check]:
    """Make all checks and return their results in order."""
    looks = (_python, _required, _extras, _conflicts, _kernels, _processors, _memory, _places)
    return [finding for look in looks for finding in look()]


def as_content(findings: list[Check]) -> dict[str, Any]:
    """Return the results as plain data, for JSON."""
    return {
        "healthy": all(finding.verdict != "problem" for finding in findings),
        "findings": [asdict(finding) for finding in findings],
    }


def _python() -> Iterator[Check]:
    yield Check("ok", PACKAGE, __version__)
    specifiers = SpecifierSet(_requires_python())
    release = platform.python_version()
    fits = specifiers.contains(release, prereleases=True)
    words = f"{release}, {platform.platform()}"
    yield Check(
        "ok" if fits else "problem", "Python", words if fits else f"{words}; {specifiers} is needed"
    )


def _requires_python() -> str:
    try:
        return metadata(PACKAGE)["Requires-Python"] or ""
    except (PackageNotFoundError, KeyError):
        return ""


def _requirements() -> list[Requirement]:
    """Return the requirements of this package, including those of its extras."""
    try:
        return [Requirement(text) for text in requires(PACKAGE) or ()]
    except PackageNotFoundError:
        return []


def _of_extra(extra: str) -> list[Requirement]:
    """Return the requirements of an extra; for "", those of the package itself."""
    return [
        one
        for one in _requirements()
        if (one.marker is None) == (not extra)
        and (one.marker is None or one.marker.evaluate({"extra": extra}))
    ]


def _required() -> Iterator[Check]:
    requirements = _of_extra("")
    if not requirements:
        yield Check("note", "packages", "not installed by pip, so versions are not checked")
    wrong = [words for one in requirements if (words := _misfit(one))]
    for words in wrong:
        yield Check("problem", "package", f"{words}; pip install --upgrade {PACKAGE}")
    if requirements and not wrong:
        some = ", ".join(f"{name} {version(name)}" for name in ("simpy", "numpy", "numba"))
        yield Check("ok", "packages", f"all {len(requirements)} have suitable versions ({some}, …)")
    yield from _broken(one.name for one in requirements)


def _misfit(requirement: Requirement) -> str | None:
    """Return why an installed package does not fit, or None if it does."""
    try:
        release = version(requirement.name)
    except PackageNotFoundError:
        return f"{requirement.name} is missing"
    if not requirement.specifier.contains(release, prereleases=True):
        return f"{requirement.name} {release} is installed, but {requirement.specifier} is needed"
    inner = (
        _misfit(one) for extra in requirement.extras for one in _with_extra(requirement.name, extra)
    )
    return next(filter(None, inner), None)


def _with_extra(package: str, extra: str) -> list[Requirement]:
    """Return the requirements of another package's extra."""
    requirements = [Requirement(text) for text in requires(package) or ()]
    return [one for one in requirements if one.marker and one.marker.evaluate({"extra": extra})]


def _broken(names: Iterator[str]) -> Iterator[Check]:
    """Yield the packages that are installed but cannot be imported, as numba with a newer numpy."""
    modules = {"pyyaml": "yaml", "annotated-types": "annotated_types", "pillow": "PIL"}
    for name in names:
        try:
            importlib.import_module(modules.get(name, name))
        except ImportError as error:
            yield Check("problem", name, f"cannot be imported: {error}")


def _extras() -> Iterator[Check]:
    try:
        extras = sorted(set(metadata(PACKAGE).get_all("Provides-Extra") or ()))
    except PackageNotFoundError:
        return
    for extra in extras:
        missing = [words for one in _of_extra(extra) if (words := _misfit(one))]
        install = install_command(extra) + ALONE.get(extra, "")
        if not missing:
            yield Check("ok", f"extra {extra}", "installed")
        else:
            yield Check("note", f"extra {extra}", f"{'; '.join(missing)}; {install}")


def _conflicts() -> Iterator[Check]:
    for name, words in CONFLICTS.items():
        try:
            requirements = [Requirement(text) for text in requires(name) or ()]
            release = version("gymnasium")
        except PackageNotFoundError:
            continue
        for one in requirements:
            if one.name == "gymnasium" and not one.specifier.contains(release, prereleases=True):
                message = words.format(wanted=one.specifier, found=release)
                yield Check("note", f"{name} {version(name)}", message)
                break


def _kernels() -> Iterator[Check]:
    if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        yield Check("problem", "kernels", "NUMBA_DISABLE_JIT is set, so everything is very slow")
        return
    from desim_uav.engine.ahead import at_work
    from desim_uav.engine.compiled import loop
    from desim_uav.engine.des.skies import LISTS
    from desim_uav.learning import fused
    from desim_uav.rowcode.kernels import NOWHERE, cache_folder, compiled_before

    cache_dir = os.environ.get("NUMBA_CACHE_DIR")
    if cache_dir and (problem := _unwritable(Path(cache_dir))):
        yield Check("problem", "NUMBA_CACHE_DIR", f"{problem}; it is not used")
    folder = cache_folder(LISTS[0])
    if folder is None:
        words = NOWHERE.format(folder=Path(__file__).parents[1])
        yield Check("problem", "compiled code", words)
        return
    if problem := _unwritable(folder):
        words = f"{problem}; it is compiled anew in each process, or set NUMBA_CACHE_DIR"
        yield Check("problem", "compiled code", words)
    kinds = {"run": LISTS, "the compiled engine": (loop.run,), "training": (fused.play,)}
    waiting = [name for name, own in kinds.items() if not any(map(compiled_before, own))]
    missing = f"{', '.join(waiting)}: compiled on first use, which takes up to a minute"
    words = f"{missing if waiting else 'ready'}; kept in {folder}"
    words += "" if problem else ", which is writable"
    yield Check("note" if waiting else "ok", "compiled code", words)
    if who := at_work():
        yield Check("note", "compiling", f"{who}; until it ends, --engine auto begins with SimPy")


def _processors() -> Iterator[Check]:
    usable, allowed = processors(), quota()
    limits = [f"a control group allows the time of {allowed:g}"] if allowed < math.inf else []
    limits += [
        f"{name}={os.environ[name]}"
        for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS")
        if name in os.environ
    ]
    words = f"{usable} usable (-j {usable})" + (f"; {', '.join(limits)}" if limits else "")
    yield Check("ok", "processors", words)


def _memory() -> Iterator[Check]:
    left = available_bytes()
    if left < math.inf:
        words = f"{left / 1e9:.1f} GB available to this process (machine, control groups, ulimit)"
        yield Check("note" if left < SHORT_OF_MEMORY else "ok", "memory", words)


def _places() -> Iterator[Check]:
    runs = Path("runs") if Path("runs").exists() else Path()
    for name, folder in (("runs", runs), ("temporary files", Path(tempfile.gettempdir()))):
        problem = _unwritable(folder)
        free = shutil.disk_usage(folder).free if not problem else 0
        words = f"{folder.resolve()}: {problem or f'{free / 2**30:.1f} GiB free'}"
        few = not problem and free < SHORT_OF_DISK
        verdict: Verdict = "problem" if problem else "note" if few else "ok"
        yield Check(verdict, name, words)
    if not sys.stderr.isatty():
        words = "stderr is not a terminal, so progress is a line every 10 s instead of a bar"
        yield Check("note", "terminal", words)


def _unwritable(folder: Path) -> str | None:
    """Return why no file can be written in a folder, or None if one can."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        with tempfile.TemporaryFile(dir=folder):
            return None
    except OSError as error:
        return f"cannot write to {folder}: {error.strerror or error}"
