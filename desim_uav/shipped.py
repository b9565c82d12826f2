"""Finds what comes with the package, scenarios and trained policies: in the wheel or a checkout."""

from __future__ import annotations

import re
from pathlib import Path

from desim_uav.errors import ScenarioError, did_you_mean

_PACKAGE = Path(__file__).resolve().parent


def scenario_names() -> list[str]:
    """The names of the shipped scenarios, case2 before case10."""
    return sorted((path.stem for path in _folder("scenarios").glob("*.yaml")), key=_natural)


def scenario_path(name: str) -> Path:
    """The file of a shipped scenario. Raises ScenarioError with the nearest name."""
    names = scenario_names()
    if name not in names:
        raise ScenarioError(
            f"{name}: neither a file nor a shipped scenario{did_you_mean(name, names)}; "
            f"shipped: {', '.join(names)}"
        )
    return _folder("scenarios") / f"{name}.yaml"


def find_scenario(argument: str) -> Path:
    """The file an argument means: a path to one, or the name of a shipped scenario."""
    path = Path(argument)
    try:
        if path.exists() and not path.is_dir():
            return path
    except (OSError, ValueError) as error:
        raise ScenarioError(f"{argument}: cannot be read: {error}") from error
    if path.name != argument or path.suffix in (".yaml", ".yml"):
        reason = "a folder, not a scenario file" if path.is_dir() else "no such file"
        raise ScenarioError(f"{argument}: {reason}")
    return scenario_path(argument)


def shipped_extract(name: str) -> Path | None:
    """Return the shipped file of a city with this name, or None if there is none."""
    path = _folder("scenarios") / name
    return path if path.name == name and path.suffix == ".geojson" and path.is_file() else None


def bench_folder() -> Path:
    """Return the folder of the benchmark's tasks: scenarios, their hashes and bounds."""
    return _folder("scenarios") / "bench" / "uav-v1"


def trained_names() -> list[str]:
    """Return the names of the shipped tables and networks."""
    return sorted((path.name for path in _folder("policies").glob("*.npz")), key=_natural)


def find_table(argument: str) -> Path:
    """The trained policy that is meant: a file, or the name of a shipped one (``case8.npz``)."""
    path = Path(argument)
    shipped = _folder("policies") / argument
    return shipped if path.name == argument and not path.exists() and shipped.exists() else path


def tutorials() -> dict[str, Path]:
    """Return the pages of the tutorials by their names, in the order in which they are read."""
    return {path.stem: path for path in sorted(_folder("tutorials", "docs").glob("*.md"))}


def _folder(name: str, beside: str = "") -> Path:
    """Beside the package, or in it: where its own subpackage has the name, under ``shipped_``."""
    inside = _PACKAGE / f"shipped_{name}"
    return inside if inside.is_dir() else _PACKAGE.parent / beside / name


def _natural(name: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]
