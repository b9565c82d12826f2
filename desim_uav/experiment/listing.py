"""The runs and trainings in a folder, and the keys in which their scenarios differ."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from desim_uav.checksums import verify
from desim_uav.errors import DesimError, PolicyError, notice
from desim_uav.experiment.command import read_summary
from desim_uav.report.json_file import MOST_BYTES, Form, read_json
from desim_uav.report.manifest import Count, ManifestText
from desim_uav.rowcode.regular_file import text_of
from desim_uav.scenario import yaml12

MEASURES = ("qoe1_percent", "qoe2_iterations", "qoe3_percent", "crashes")
TRAINING = "training"
IDENTITY = ("name", "seed", "world_seed")
"""Keys of a scenario that say which run it is, and not how it differs."""

Keys = Mapping[str, Any]
"""The keys of a scenario, as ``users.count``, and their values."""


class Entries(Form):
    """The entries of a manifest that a list shows."""

    scenario: ManifestText
    seed: Count
    episodes: Count
    policy: ManifestText = ""
    algorithm: ManifestText = ""
    kind: ManifestText = "run"
    finished: ManifestText = ""
    interrupted: bool = False
    name: ManifestText = ""


class Listed(NamedTuple):
    """A run or a training: its folder, what its manifest says, its measures, and its scenario."""

    folder: Path
    entries: Entries
    measures: Mapping[str, float | None]
    keys: Keys

    def uses(self, key: str) -> bool:
        """Return whether a key of the scenario matters to it: only trainings learn."""
        return self.entries.kind == TRAINING or not key.startswith("learning.")


def listed(root: Path) -> list[Listed]:
    """Return the runs and trainings below a folder, the latest last.

    A folder that cannot be read is left out, and a notice says why.
    """
    runs = []
    for folder in sorted(file.parent for file in root.rglob("manifest.json")):
        if any(part.startswith(".") for part in folder.relative_to(root).parts):
            continue  # it is being written
        try:
            if _is_run(folder):
                runs.append(_read(folder))
        except DesimError as error:
            notice(f"left out: {error}")
    return sorted(runs, key=lambda one: (one.entries.finished, one.folder))


def _is_run(folder: Path) -> bool:
    """Return whether a folder with a manifest is that of a run, even if its scenario is missing.

    Raises PolicyError if nothing says so, because the manifest cannot be read.
    """
    if (folder / "scenario.yaml").exists():
        return True
    content = read_json(folder / "manifest.json", Form, "the manifest of a run")
    return {name for name, one in Entries.model_fields.items() if one.is_required()} <= {*content}


def _read(folder: Path) -> Listed:
    content = read_json(folder / "manifest.json", Entries, "the manifest of a run")
    entries = Entries.model_validate(content)
    measures: dict[str, float | None] = dict.fromkeys(MEASURES)
    if entries.kind != TRAINING:
        summary, _ = read_summary(folder)
        measures = {name: summary[name] for name in MEASURES}
    return Listed(folder, entries, measures, dict(_flat(_scenario(folder / "scenario.yaml"))))


def _scenario(file: Path) -> Any:
    """Return the keys of a scenario as they stand, without importing its components."""
    verify(file)
    try:
        return yaml12.read(text_of(file, MOST_BYTES)).data
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise PolicyError(f"{file}: cannot be read: {reason}") from error


def _flat(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the keys of a scenario with their values; that of a component is its kind.

    The keys of the entries of a list, such as types of drones, have their numbers: drones.0.count.
    """
    if isinstance(value, list) and value and all(isinstance(one, Mapping) for one in value):
        value = dict(enumerate(value))
    if not isinstance(value, Mapping):
        yield path, value
        return
    for key, inner in value.items():
        yield from _flat(inner, path if key == "kind" else f"{path}.{key}" if path else str(key))


def differences(runs: Sequence[Listed]) -> list[dict[str, Any]]:
    """Return for each run the keys in which it differs from others of its scenario's name.

    A key that not all of them have is None where it is missing, and one that a run does not use is
    no difference of it.
    """
    of_name = defaultdict(list)
    for run in runs:
        of_name[run.entries.scenario].append(run)
    differing = {name: _differing(own) for name, own in of_name.items()}
    return [
        {key: run.keys.get(key) for key in differing[run.entries.scenario] if run.uses(key)}
        for run in runs
    ]


def _differing(runs: Sequence[Listed]) -> list[str]:
    """Return the keys that differ; of components of different kinds, their kinds only."""
    unlike: dict[str, None] = {}
    for name in dict.fromkeys(name for run in runs for name in run.keys if name not in IDENTITY):
        values = [run.keys.get(name) for run in runs if run.uses(name)]
        if any(value != values[0] for value in values):
            unlike[name] = None
    return [name for name in unlike if not any(above in unlike for above in _above(name))]


def _above(name: str) -> Iterator[str]:
    while "." in name:
        name = name.rpartition(".")[0]
        yield name
