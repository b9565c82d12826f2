"""Turns Pydantic's validation errors into this project's error messages."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from desim_uav.errors import did_you_mean
from desim_uav.registry import ComponentField, NameOr, names
from desim_uav.scenario.components import Slot, as_field
from desim_uav.scenario.draft import MAX_PROBLEMS, ScenarioDraft
from desim_uav.scenario.schema import Scenario
from desim_uav.scenario.section import Forms, Section
from desim_uav.scenario.yaml12 import KeyPath


class Complaint(NamedTuple):
    """One error at the value of ``path``, or at its key.

    The value at ``drop`` is removed so that the rest can be checked. ``mistaken_for`` is the known
    key that an unknown one probably stands for. ``missing``: it is a key that has to be given.
    """

    path: KeyPath
    message: str
    drop: KeyPath
    at_key: bool = False
    mistaken_for: KeyPath | None = None
    missing: bool = False

    @property
    def depends_on(self) -> KeyPath:
        """The path whose value, with all of its parts, decides whether there is a problem."""
        return self.path[:-1] if self.missing else self.path


AS_YAML = {"False": "false", "True": "true"}
"""The words for false and true in a scenario file, by those of Python."""


def complaints(error: ValidationError, draft: ScenarioDraft) -> list[Complaint]:
    """Return the errors of a validation, without those that follow from others."""
    details = error.errors(include_url=False)[:MAX_PROBLEMS]
    listing = [_complaint(detail, draft, details) for detail in details]
    wrong = [c.path for c in listing]
    by_path: dict[tuple[KeyPath, str], Complaint] = {}
    for complaint, detail in zip(listing, details, strict=True):
        size = len(complaint.path)
        beneath = any(len(p) > size and p[:size] == complaint.path for p in wrong)
        if not (beneath and detail["type"] in ("too_short", "too_long")):
            by_path.setdefault((complaint.path, complaint.message), complaint)
    return list(by_path.values())


def _complaint(
    detail: ErrorDetails, draft: ScenarioDraft, details: list[ErrorDetails]
) -> Complaint:
    kind, path = detail["type"], tuple(detail["loc"])
    if path and path[-1] == "[key]":
        return Complaint(path[:-1], _NAME, path[:-1], at_key=True)
    if kind in ("extra_forbidden", "unexpected_keyword_argument"):
        return _unknown_key(path, draft)
    if kind in ("missing", "missing_argument", "missing_keyword_only_argument"):
        return _missing(path, details)
    part = _known_part(path, draft)
    return Complaint(part, message_of(detail), part)


def _unknown_key(path: KeyPath, draft: ScenarioDraft) -> Complaint:
    allowed = known_keys(path[:-1], draft)
    hint = did_you_mean(str(path[-1]), allowed)
    nearest = (*path[:-1], hint.split("'")[1]) if hint else None
    others = _kinds_with(path, draft)
    elsewhere = f" (kind {' or '.join(others)} has it)" if others else ""
    message = f"unknown key{hint}{elsewhere}; allowed: {', '.join(allowed)}"
    return Complaint(path, message, path, at_key=True, mistaken_for=nearest)


def _missing(path: KeyPath, details: list[ErrorDetails]) -> Complaint:
    parent = path[:-1]
    if isinstance(path[-1], int):
        size = 1 + max(
            d["loc"][-1]
            for d in details
            if d["type"] == "missing" and d["loc"][:-1] == parent and isinstance(d["loc"][-1], int)
        )
        return Complaint(parent, f"must be a list of {size}", parent)
    return Complaint(path, "missing; it has no default", parent, missing=True)


def _known_part(path: KeyPath, draft: ScenarioDraft) -> KeyPath:
    """Return ``path`` without the parts that Pydantic adds for the alternatives of a union."""
    while path and not draft.has(path):
        path = path[:-1]
    return path


def _kinds_with(path: KeyPath, draft: ScenarioDraft) -> list[str]:
    """Return the kinds of a component that have the key at ``path``, unlike the one chosen."""
    owner = _owner_at(path[:-1], draft)
    if not isinstance(owner, Slot):
        return []
    return [kind for kind in names(owner.name) if path[-1] in owner.parameter_names(kind)]


def known_keys(path: KeyPath, draft: ScenarioDraft) -> list[str]:
    """Return the keys that the mapping at ``path`` may have."""
    owner = _owner_at(path, draft)
    if isinstance(owner, Slot):
        return owner.parameter_names(_kind(draft.get(path)))
    if _is_named_tuple(owner):
        return list(owner._fields)
    return list(owner.model_fields) if _is_section(owner) else []


def _owner_at(path: KeyPath, draft: ScenarioDraft) -> Any:
    """Return what determines the keys at ``path``: a section, a slot or a named tuple, or None."""
    owner: Any = Scenario
    for depth, part in enumerate(path):
        if not isinstance(part, int):  # the items of a list all have the keys of one
            owner = _below(owner, part, draft.get(path[:depth]), draft.get(path[: depth + 1]))
    return owner[""] if isinstance(owner, dict) else owner


def _below(owner: Any, key: str, holder: Any, value: Any) -> Any:
    """Return what determines the keys below a key of an owner, or None if it has none."""
    if isinstance(owner, dict):
        return owner[""]
    if isinstance(owner, Slot):
        return _owner(list(_parts(owner.annotation(_kind(holder), key))), value)
    if not _is_section(owner) or key not in owner.model_fields:
        return None
    field = owner.model_fields[key]
    return _owner(list(_parts(field.annotation)) + list(field.metadata), value)


def _owner(parts: list[Any], value: object) -> Any:
    """Return what determines the keys below a field: a section, a slot, or {"": slot} for many."""
    slots = [part for part in parts if isinstance(part, Slot)]
    if slots:
        return {"": slots[0]} if dict in parts else slots[0]
    sections = [part for part in parts if _is_section(part)]
    forms = [part for part in parts if isinstance(part, Forms)]
    if forms:
        return forms[0].of(value if isinstance(value, Mapping) else {})
    if isinstance(value, list):  # whose items have further keys, of a section of their own
        sections.sort(key=lambda section: -len(section.model_fields))
    return next(
        (part for part in (*sections, *parts) if _is_section(part) or _is_named_tuple(part)), None
    )


def _parts(annotation: object) -> Iterator[Any]:
    yield annotation
    yield getattr(annotation, "__origin__", None)
    if isinstance(annotation, ComponentField):
        yield as_field(annotation)
    if isinstance(annotation, NameOr):
        yield from _parts(annotation.form)
    for part in (*getattr(annotation, "__args__", ()), *getattr(annotation, "__metadata__", ())):
        yield from _parts(part)


def _kind(value: object) -> Any:
    """Return the kind that a component is given, or None."""
    return value.get("kind") if isinstance(value, Mapping) else None


def _is_named_tuple(owner: object) -> bool:
    return isinstance(owner, type) and hasattr(owner, "_fields")


def _is_section(owner: object) -> bool:
    return isinstance(owner, type) and issubclass(owner, Section)


_NAME = (
    "must be a name: 1 to 64 letters, digits, '_', '-' and '.', beginning with neither '-' nor '.'"
)

Words = Callable[[Mapping[str, Any], Any], str]
_WORDS: dict[str, Words] = {
    "bool_type": lambda ctx, _: "must be true or false",
    "int_type": lambda ctx, value: _number("a whole number", value),
    "int_from_float": lambda ctx, _: "must be a whole number",
    "float_type": lambda ctx, value: _number("a number", value),
    "finite_number": lambda ctx, value: _number("a finite number", value),
    "string_type": lambda ctx, value: _text(value),
    "path_type": lambda ctx, _: "must be the name of a file",
    "string_pattern_mismatch": lambda ctx, _: _NAME,
    "tuple_type": lambda ctx, _: "must be a list",
    "list_type": lambda ctx, _: "must be a list",
    "dict_type": lambda ctx, _: "must be a mapping",
    "model_type": lambda ctx, _: "must be a mapping; leave the key out for its defaults",
    "dataclass_type": lambda ctx, _: "must be a mapping",
    "greater_than": lambda ctx, _: f"must be above {_plain(ctx['gt'])}",
    "greater_than_equal": lambda ctx, _: f"must be at least {_plain(ctx['ge'])}",
    "less_than": lambda ctx, _: f"must be below {_plain(ctx['lt'])}",
    "less_than_equal": lambda ctx, _: f"must be at most {_plain(ctx['le'])}",
    "too_short": lambda ctx, _: _items("at least", ctx["min_length"]),
    "too_long": lambda ctx, _: _items("at most", ctx["max_length"]),
    "value_error": lambda ctx, _: str(ctx["error"]),
    "literal_error": lambda ctx, value: _literal(ctx["expected"], value),
}


def message_of(detail: ErrorDetails) -> str:
    """Return in this project's words what is wrong with a value."""
    words = _WORDS.get(detail["type"])
    return words(detail.get("ctx", {}), detail["input"]) if words else detail["msg"]


def _number(what: str, value: object) -> str:
    if isinstance(value, int) and not isinstance(value, bool):
        return "is too large"
    return f"must be {what}"


def _text(value: object) -> str:
    return "must be text" + ("" if isinstance(value, list | dict) else "; put it in quotes")


def _literal(expected: str, value: object) -> str:
    options = [
        AS_YAML.get(one, one.strip("'")) for one in expected.replace(" or ", ", ").split(", ")
    ]
    hint = did_you_mean(value, options) if isinstance(value, str) else ""
    return f"must be {' or '.join(options)}{hint}"


def _items(bound: str, count: int) -> str:
    return f"must have {bound} {count} item{'s' if count != 1 else ''}"


def _plain(bound: float) -> str:
    if isinstance(bound, int):
        return str(bound)
    return f"{bound:,.0f}" if bound.is_integer() and abs(bound) >= 1e4 else f"{bound:g}"
