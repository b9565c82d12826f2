"""The keys of a scenario file, as its JSON Schema has them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from markdown_table import table

from desim_uav.scenario.load import json_schema, to_plain
from desim_uav.scenario.schema import Scenario

Schema = dict[str, Any]

UNITS = {
    "_dbm_per_hz": "dBm/Hz",
    "bit_s_hz": "bit/s/Hz",
    "_dbm": "dBm",
    "_db": "dB",
    "_ghz": "GHz",
    "_mhz": "MHz",
    "_mbit": "Mbit",
    "_ms": "ms",
    "_per_hour": "1/h",
    "_kbps": "kbit/s",
    "_mps2": "m/s²",
    "_mps": "m/s",
    "_rad_s": "rad/s",
    "_kg_m3": "kg/m³",
    "_m2": "m²",
    "weight_n": "N",
    "_wh": "Wh",
    "_w": "W",
    "sigma_cells": "cells",
    "_min": "min",
    "_m": "m",
    "_s": "s",
}
"""The unit that the end of a key's name says."""

HEADINGS = ("Key", "Meaning", "Unit", "Allowed", "Default")


def markdown() -> str:
    """A table of the keys at the top, and a section for each of them that has keys of its own."""
    schema = json_schema()
    walker = Walker(schema["$defs"])
    defaults = to_plain(Scenario())
    simple, sections = [], []
    for key, found in schema["properties"].items():
        walker.claim(key, found)
    for key, found in schema["properties"].items():
        if walker.is_simple(found):
            simple.append(walker.row(key, found, defaults[key]))
        else:
            sections.append(f"## {key}\n\n" + walker.section(key, found, defaults[key]))
    return table(HEADINGS, simple) + "\n" + "\n".join(sections)


class Walker:
    """Walks a schema whose definitions stand in ``defs``."""

    def __init__(self, defs: dict[str, Schema]) -> None:
        self.defs = defs
        self.components: dict[tuple[str, ...], str] = {}
        """Where the kinds of components have been described, by their names."""

    def resolved(self, schema: Schema) -> Schema:
        """The schema that a reference leads to, its own description first."""
        if "$ref" not in schema:
            return schema
        return self.defs[schema["$ref"].rpartition("/")[2]] | {
            key: value for key, value in schema.items() if key != "$ref"
        }

    def forms(self, schema: Schema) -> list[Schema]:
        """All forms that a value may have."""
        return [self.resolved(form) for form in schema.get("anyOf", [schema])]

    def mappings(self, schema: Schema) -> list[Schema]:
        """Those forms that have keys of their own, or are lists of such ones."""
        forms = [*self.forms(schema)]
        forms += [self.resolved(form["items"]) for form in forms if "items" in form]
        return [form for form in forms if form.get("properties")]

    def kinds(self, schema: Schema) -> list[Schema]:
        """The kinds of a component, without plug-ins; nothing if the value is none."""
        return [
            form for form in self.mappings(schema) if "const" in form["properties"].get("kind", {})
        ]

    def is_simple(self, schema: Schema) -> bool:
        """Is the value a number, text or list, or a mapping whose keys are free?"""
        return not self.mappings(schema) and not self.component_of(schema)

    def component_of(self, schema: Schema) -> Schema | None:
        """The component that each free key of a mapping holds, if any."""
        for inner in schema.get("patternProperties", {}).values():
            if self.kinds(inner):
                return inner
        return None

    def section(self, path: str, schema: Schema, default: Any) -> str:
        """What a key means, and tables of the keys within it."""
        inner = self.component_of(schema)
        text = f"{schema.get('description', self.resolved(schema).get('description', ''))}\n\n"
        if inner is not None:
            text += f"Default: {_code(default)}\n\n"
            return text + "\n".join(
                self._kind(f"{path}.NAME", kind, {}, "###") for kind in self.kinds(inner)
            )
        if self.kinds(schema):
            return text + self._component(path, schema, default)
        rows, further, described = [], [], set()
        forms = self.forms(schema)
        for form in self.mappings(schema):
            for key, found in form["properties"].items():
                if key in described:  # which items of a list have as a mapping has them
                    continue
                described.add(key)
                inside = (default or {}).get(key, found.get("default"))
                where = f"{path if form in forms else self._item(path, schema)}.{key}"
                if self.kinds(found):
                    rows.append(self.row(where, found, (inside or {}).get("kind")))
                    further.append(f"### {where}\n\n" + self._component(where, found, inside))
                elif self.mappings(found) and not self._is_schedule(found):
                    rows += self._within(where, found, inside)
                else:
                    rows.append(self.row(where, found, inside, key in form.get("required", [])))
        return text + table(HEADINGS, rows) + "\n" + "\n".join(further)

    def _within(self, path: str, schema: Schema, default: Any) -> Iterator[list[str]]:
        """Rows of a mapping inside a section: itself, if it may be null, and its keys."""
        null = any(form.get("type") == "null" for form in self.forms(schema))
        allowed = ["a mapping"] + ["null"] * null
        yield [f"`{path}`", schema.get("description", ""), "", "; ".join(allowed), ""]
        for form in self.mappings(schema):
            for key, found in form["properties"].items():
                required = key in form.get("required", [])
                inside = (default or {}).get(key, found.get("default"))
                yield self.row(f"{path}.{key}", found, inside, required)

    def _item(self, path: str, schema: Schema) -> str:
        """The path of what has keys of its own: the value, or each item of a list."""
        return f"{path}.N" if any("items" in form for form in self.forms(schema)) else path

    def _is_schedule(self, schema: Schema) -> bool:
        return any(form.get("title") == "Schedule" for form in self.mappings(schema))

    def claim(self, path: str, schema: Schema) -> str:
        """Where the kinds of a component are described: here, if they are nowhere else yet."""
        names = tuple(kind["title"] for kind in self.kinds(schema))
        return self.components.setdefault(names, path) if names else path

    def _component(self, path: str, schema: Schema, default: Any) -> str:
        """The kinds of a component."""
        chosen = (default or {}).get("kind")
        text = f"Default: `kind: {chosen}`.\n\n" if chosen else ""
        described = self.claim(path, schema)
        if described != path:
            return text + f"The kinds are those of `{described}`.\n"
        if any("enum" in form for form in self.forms(schema)):
            key = path.rpartition(".")[2]
            text += f"`{key}: NAME` is short for `{key}: {{kind: NAME}}`.\n\n"
        return text + "\n".join(
            self._kind(path, kind, default if kind["title"] == chosen else {})
            for kind in self.kinds(schema)
        )

    def _kind(self, path: str, kind: Schema, default: dict[str, Any], heading: str = "####") -> str:
        """A kind of a component; its keys that are components have sections with this heading."""
        rows, further = [], []
        for key, found in kind["properties"].items():
            where, inside = f"{path}.{key}", default.get(key, found.get("default"))
            if self.kinds(found):
                required = key in kind.get("required", [])
                rows.append(self.row(where, found, (inside or {}).get("kind"), required))
                further.append(f"{heading} {where}\n\n" + self._component(where, found, inside))
            elif key != "kind":
                rows.append(self.row(where, found, inside, key in kind.get("required", [])))
                for form in self.mappings(found):
                    keys = form["properties"].items()
                    item = self._item(where, found)
                    rows += [self.row(f"{item}.{name}", one, None, True) for name, one in keys]
        about = kind.get("description", "")
        text = f"**`{path}: {{kind: {kind['title']}}}`**\n\n{about}\n\n"
        return text + (table(HEADINGS, rows) + "\n" if rows else "") + "\n".join(further)

    def row(self, path: str, schema: Schema, default: Any, required: bool = False) -> list[str]:
        """A key's row."""
        unit = next((unit for end, unit in UNITS.items() if path.endswith(end)), "")
        allowed = [text for form in self.forms(schema) if (text := self._allowed(form))]
        open_mapping = schema.get("type") == "object" and not default
        told = "" if required or open_mapping else _code(default)
        meaning = schema.get("description", "")
        return [f"`{path}`", meaning, unit, "; ".join(allowed), "required" if required else told]

    def _allowed(self, form: Schema) -> str:  # noqa: PLR0911, PLR0912 (one case per form)
        """What a form allows, in words."""
        match form:
            case {"enum": values}:
                return ", ".join(f"`{value}`" for value in values)
            case {"const": value}:
                return "" if form.get("title") == "plug-in" else f"`{value}`"
            case {"type": "null"}:
                return "null"
            case {"type": "boolean"}:
                return "true, false"
            case {"type": "integer" | "number"}:
                return _range(form)
            case {"type": "string", "format": "path"}:
                return "a file's name"
            case {"type": "string"}:
                return "text"
            case {"type": "array", "prefixItems": items}:
                parts = [self._allowed(self.resolved(item)) for item in items]
                if len(set(parts)) == 1:
                    return f"[{len(parts)} of: {parts[0]}]"
                return "[" + ", ".join(parts) + "]"
            case {"type": "array", "items": item}:
                return f"a list of {self._allowed(self.resolved(item))}"
            case {"title": "Schedule"}:
                return "{start, decay, end}, each from 0 to 1"
            case {"type": "object", "properties": {"kind": {"const": kind}}}:
                return f"`{kind}`"
            case {"type": "object", "title": "plug-in"}:
                return '`"package.module:Class"`'
            case {"type": "object"}:
                return "a mapping"
        return ""


def _range(form: Schema) -> str:
    """A numeric range."""
    kind = "whole number" if form["type"] == "integer" else "number"
    low = f"from {_number(form['minimum'])}" if "minimum" in form else ""
    low = f"above {_number(form['exclusiveMinimum'])}" if "exclusiveMinimum" in form else low
    high = f"to {_number(form['maximum'])}" if "maximum" in form else ""
    high = f"below {_number(form['exclusiveMaximum'])}" if "exclusiveMaximum" in form else high
    if low.startswith("above") and high.startswith("to"):
        high = "up " + high
    return " ".join(filter(None, (kind, low, high)))


def _number(value: float) -> str:
    return "2^63" if value == 2**63 else f"{value:,}" if isinstance(value, int) else f"{value:g}"


def _code(value: Any) -> str:
    return f"`{json.dumps(value).replace(chr(34), '')}`"
