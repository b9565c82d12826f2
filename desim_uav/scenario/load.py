"""Reads, overrides, validates, writes and hashes scenario files.

All errors of a file are reported together. First each key is checked on its own; then, with
defaults in place of the refused values, the scenario is checked as a whole.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from desim_uav.errors import ScenarioError, UsageError
from desim_uav.model.traces import MAX_BYTES as MAX_TABLE_BYTES
from desim_uav.registry import resolve
from desim_uav.rowcode.regular_file import content_of
from desim_uav.scenario import yaml12
from desim_uav.scenario.buildings import BuildingsOfFile
from desim_uav.scenario.checks import findings
from desim_uav.scenario.components import strictly
from desim_uav.scenario.description import code_of, described, unchanged
from desim_uav.scenario.draft import MAX_PROBLEMS, ScenarioDraft, override_path, plain_copy
from desim_uav.scenario.messages import complaints
from desim_uav.scenario.preset import paper_preset
from desim_uav.scenario.schema import ON_CIRCLE, Scenario
from desim_uav.shipped import find_scenario, shipped_extract
from desim_uav.typed import typed

MAX_BYTES = 2**20


Overrides = str | Mapping[str, Any] | Sequence[str]
"""Values for keys of a scenario: ``{"users.count": 60}``, or as on the command line
``["users.count=60"]``, where the value is in YAML."""


@typed
def load(scenario: str | Path, overrides: Overrides = ()) -> Scenario:
    """Load a scenario file, or a shipped scenario by its name, such as ``case8``.

    ``overrides`` set keys of the scenario, for instance ``{"users.count": 60}``. Raises
    ScenarioError with every problem found, and UsageError for an override that names no key.
    """
    path = find_scenario(str(scenario))
    return loads(
        _text(path), source=str(path), base=path.parent, overrides=override_texts(overrides)
    )


def override_texts(overrides: Overrides) -> list[str]:
    """Return overrides in the command line's form. Raises ScenarioError for unsuitable values."""
    if isinstance(overrides, Mapping):
        return [f"{key}={_as_yaml(key, value)}" for key, value in overrides.items()]
    texts: list[Any] = [overrides] if isinstance(overrides, str) else list(overrides)
    if not all(isinstance(text, str) for text in texts):
        raise UsageError(
            f"overrides: {overrides!r}: must be a mapping such as {{'users.count': 60}}, or a list "
            "of texts such as ['users.count=60']"
        )
    return texts


def _as_yaml(key: str, value: object) -> str:
    """Return a value as JSON, which is also YAML; NumPy's numbers and arrays are accepted."""
    try:
        return json.dumps(
            plain_copy(value), ensure_ascii=False, default=lambda other: other.tolist()
        )
    except (TypeError, ValueError, AttributeError):
        raise ScenarioError(
            f"{key}: a value of type {type(value).__name__} cannot be written in YAML"
        ) from None


def loads(
    text: str, *, source: str = "<string>", base: Path | None = None, overrides: Sequence[str] = ()
) -> Scenario:
    """Return the scenario that a YAML text describes.

    File names in the text are relative to ``base``; ``source`` names the text in error messages.
    Raises ScenarioError with every problem found, and UsageError for an override that names no key.
    """
    for override in overrides:
        override_path(override)
    if len(text) > MAX_BYTES:
        raise ScenarioError(f"{source}: the text is larger than {MAX_BYTES >> 20} MiB")
    document = yaml12.read(text)
    draft = ScenarioDraft(source, document.data, document.keys, document.values)
    draft.doubtful += document.left_out
    for mark, message in document.problems:
        draft.at_mark(mark, message)
    if document.empty and not document.problems:
        draft.of_file("the file is empty: a scenario needs at least one key, as in 'name: mine'")
    elif not isinstance(document.data, dict) and not document.problems:
        draft.at_mark(document.values[()], "must be a mapping of keys to values")
    if document.broken or draft.hopeless or not isinstance(document.data, dict):
        raise ScenarioError(*draft.problems)
    return _resolved(draft, base, overrides)


def from_mapping(
    mapping: Mapping[str, Any],
    *,
    source: str = "<mapping>",
    base: Path | None = None,
    overrides: Sequence[str] = (),
) -> Scenario:
    """Return the scenario that a mapping of plain data describes.

    The mapping is nested as a scenario file is, and file names in it are relative to ``base``.
    Raises ScenarioError with every problem found, and UsageError for an override that names no key.
    """
    for override in overrides:
        override_path(override)
    try:
        data = plain_copy(mapping)
    except ScenarioError as error:
        raise ScenarioError(f"{source}: {error}") from error
    if not isinstance(data, dict):
        raise ScenarioError(f"{source}: must be a mapping of keys to values")
    return _resolved(ScenarioDraft(source, data), base, overrides)


def component_alone(key: str, plain: Mapping[str, Any], source: str) -> Any:
    """Return the component that plain data describe, whatever scenario it is used in.

    ``key`` is its key in a scenario file. What depends on other keys is not checked. Raises
    ScenarioError for wrong settings.
    """
    draft = ScenarioDraft(source, {key: plain_copy(plain)})
    scenario = _valid(draft, None)
    if scenario is None or draft.problems:
        raise ScenarioError(*draft.problems)
    return getattr(scenario, key)


def dump(scenario: Scenario) -> str:
    """Return a scenario as YAML text with every key. Loading the text gives the same scenario."""
    return yaml.dump(
        to_plain(scenario),
        Dumper=_Dumper,
        default_flow_style=None,
        sort_keys=False,
        allow_unicode=True,
        width=100,
    )


def files_of(scenario: Scenario) -> dict[str, bytes]:
    """Return what a folder holds of a scenario: its YAML text, and the extract of its map if any.

    The text names this copy of the extract, so the folder can be read when the file has changed.
    Raises ScenarioError if the file cannot be read any more.
    """
    buildings, copies = scenario.map.buildings, dict[str, bytes]()
    if isinstance(buildings, BuildingsOfFile):
        name = f"buildings{buildings.file.suffix}"
        try:
            copies[name] = content_of(buildings.file, MAX_TABLE_BYTES)
        except (OSError, ValueError) as error:
            raise ScenarioError(f"map.buildings.file: {buildings.file}: {error}") from error
        own = scenario.map._with(buildings=buildings._with(file=Path(name)))
        scenario = scenario._with(map=own)
    return {"scenario.yaml": dump(scenario).encode(), **copies}


def to_plain(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as plain data with every key that something is simulated by."""
    plain: dict[str, Any] = _plain(scenario)
    if not scenario.has_common_demand and "demand" not in scenario.model_fields_set:
        del plain["demand"]
    if isinstance(plain["users"], list):
        plain["users"] = [{"name": one["name"], **one} for one in plain["users"]]
    for users, (_, *group) in zip(scenario.user_groups, scenario.user_keys, strict=True):
        if users.positions_m is not None:
            own = plain["users"][group[0]] if group else plain["users"]
            del own["count"], own["clusters"]
    if isinstance(plain["drones"], list):
        plain["drones"] = [{"name": one["name"], **one} for one in plain["drones"]]
    for drones, (_, *number) in zip(scenario.fleet, scenario.fleet_keys, strict=True):
        if drones.radio.graded:
            own = plain["drones"][number[0]] if number else plain["drones"]
            del own["footprint_radius_m"], own["bandwidth_kbps"]
    for name in ("cells",) if scenario.stations.cells is None else ON_CIRCLE:
        del plain["stations"][name]
    del plain["stations"]["charging" if scenario.stations.charging is None else "full_charge_min"]
    return plain


def scenario_hash(scenario: Scenario) -> str:
    """Return the SHA-256 digest of a scenario, in hexadecimal.

    The digest covers every key except the name, the contents of the files that the scenario uses,
    but not their paths, and those of the modules of one's own components. Keys that came later
    (``Section.later``) are left out if they have their defaults, so that a scenario that was
    written before them keeps its digest.
    """
    content = _plain(scenario, hashed=True)
    del content["name"]
    if ":" in scenario.learning.algorithm:
        with suppress(ValueError):  # of which ``load_algorithm`` says more
            algorithm = resolve("algorithm", scenario.learning.algorithm)
            content["learning"]["code"] = code_of(algorithm)
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def seedless(scenario: Scenario) -> Scenario:
    """Return a scenario with its seeds set to their defaults, for comparison with others."""
    return scenario.model_copy(update={"seed": 0, "world_seed": None})


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of scenario files, for use in editors."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return schema | Scenario.model_json_schema()


def _text(path: Path) -> str:
    """Return the text of a file. Raises ScenarioError if it cannot be read."""
    try:
        content = content_of(path, MAX_BYTES)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ScenarioError(f"{path}: cannot be read: {reason}") from error
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path}: byte {error.start} is not valid UTF-8") from error


def _resolved(draft: ScenarioDraft, base: Path | None, overrides: Sequence[str]) -> Scenario:
    """Validate a draft. Refused values are removed, and the rest is validated again."""
    defaults = to_plain(Scenario()) if overrides else {}
    for number, override in enumerate(overrides):
        draft.override(number, override, defaults)
    scenario = _valid(draft, base)
    if scenario is not None:
        for finding in islice(findings(scenario), MAX_PROBLEMS):
            if not draft.depends_on_refused((finding.path, *finding.also)):
                draft.at(finding.path, finding.message, finding.also)
    if scenario is None or draft.problems:
        raise ScenarioError(*draft.problems)
    return scenario


def _valid(draft: ScenarioDraft, base: Path | None) -> Scenario | None:
    """Return the scenario of a draft, without checks of keys against each other, or None."""
    draft.clean()
    for path in draft.doubtful:
        if draft.has(path):
            draft.drop(path)
    scenario = None
    while scenario is None and not draft.hopeless:
        scenario = _validated(draft, base)
    return scenario


def _validated(draft: ScenarioDraft, base: Path | None) -> Scenario | None:
    """Return the scenario, or None after its problems were noted and the wrong values removed."""
    data = paper_preset(draft.data) if draft.data.get("preset") == "paper" else draft.data
    try:
        scenario: Scenario = strictly(Scenario, data, {"base": base})
    except ValidationError as error:
        mistakes = complaints(error, draft)
    else:
        return scenario
    for complaint in mistakes:
        if not draft.depends_on_refused([complaint.depends_on]):
            draft.at(complaint.path, complaint.message, key=complaint.at_key)
    dropped = [draft.drop(complaint.drop) for complaint in mistakes]
    draft.doubtful += [c.mistaken_for for c in mistakes if c.mistaken_for]
    if not any(dropped):
        draft.data = {}
    return None


def _plain(value: object, hashed: bool = False) -> Any:
    """Models, components and their values as plain data, whole floats as ints.

    To be ``hashed``, files are given by digests of their contents, and later keys are left out.
    """
    left_out = unchanged(value) if hashed else ()
    if isinstance(value, BaseModel):
        value = {name: getattr(value, name) for name in type(value).model_fields}
    elif hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {key: _plain(item, hashed) for key, item in value.items() if key not in left_out}
    if isinstance(value, list | tuple):
        return [_plain(item, hashed) for item in value]
    if isinstance(value, Path):
        return _digest(value) if hashed else _file_name(value)
    if value is None or isinstance(value, bool | int | float | str):
        if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
            value = int(value)
        return value
    return _plain(described(value, hashed), hashed)


def _file_name(path: Path) -> str:
    """Return a file's path, or its name alone if it comes with the package."""
    return path.name if shipped_extract(path.name) == path else str(path)


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(content_of(path, MAX_TABLE_BYTES)).hexdigest()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ScenarioError(f"{path}: cannot be read: {reason}") from error


class _Dumper(yaml.SafeDumper):
    """Writes what the YAML 1.2 reader reads back: no aliases, and quotes where it needs them."""

    def ignore_aliases(self, data: object) -> bool:
        """Never refer back to a value."""
        return True


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = None if isinstance(yaml12.plain_scalar(text), str) else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _represent_text)
