"""Every key of a scenario says what it means, in the JSON Schema and so in the documentation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from desim_uav.scenario.load import json_schema
from desim_uav.scenario.meanings import meanings


def keys(place: str, schema: dict) -> Iterator[tuple[str, dict]]:
    """Every key in a schema, at any depth; a kind goes without saying."""
    for name, found in schema.get("properties", {}).items():
        if name != "kind":
            yield f"{place}.{name}", found
    inner = schema.get("properties", {}) | schema.get("patternProperties", {})
    for name, found in inner.items():
        of_any_name = {"patternProperties": found.get("patternProperties", {})}
        yield from keys(f"{place}.{name}", of_any_name)
        for form in found.get("anyOf", []):
            yield from keys(f"{place}.{name}.{form.get('title')}", form)
    for name, found in schema.get("$defs", {}).items():
        yield from keys(name, found)


def test_every_key_has_a_meaning() -> None:
    found = dict(keys("scenario", json_schema()))
    assert len(found) > 80
    assert {"Users.mobility.random_walk.speed_mps", "Learning.alpha"} <= set(found)
    assert [key for key, schema in found.items() if not schema.get("description")] == []


@dataclass(frozen=True)
class Base:
    """One key, and one without a docstring."""

    speed: float
    """How fast
    it is."""
    silent: int = 0


@dataclass(frozen=True)
class Derived(Base):
    """One more key."""

    length: float = 1.0
    """How long it is."""


def test_meanings_are_the_docstrings_beneath_the_fields_of_a_class_and_its_bases() -> None:
    assert meanings(Derived) == {"speed": "How fast it is.", "length": "How long it is."}


def test_a_class_without_source_has_no_meanings() -> None:
    names: dict = {}
    exec("class Made:\n    speed: float\n    'How fast.'\n", names)
    assert meanings(names["Made"]) == {}


@pytest.mark.parametrize("key", ["alpha", "epsilon"])
def test_the_schema_takes_a_number_for_a_schedule(key: str) -> None:
    schema = json_schema()["$defs"]["Learning"]["properties"][key]
    assert {"$ref": "#/$defs/Schedule"} in schema["anyOf"]
    assert {"type": "number", "minimum": 0, "maximum": 1} in schema["anyOf"]
