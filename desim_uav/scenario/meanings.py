"""The meanings of a scenario's keys, from the docstrings below the fields of its classes."""

from __future__ import annotations

import ast
import inspect
import textwrap
from functools import cache
from itertools import pairwise
from typing import Any


def with_meanings(schema: dict[str, Any], class_: type) -> dict[str, Any]:
    """Return a class's JSON Schema with a description of each property that has a docstring."""
    properties = schema.get("properties", {})
    for name, meaning in meanings(class_).items():
        if name in properties:
            properties[name]["description"] = meaning
    return schema


@cache
def meanings(class_: type) -> dict[str, str]:
    """Return the docstring below each annotated field of a class and of its bases, by name.

    If the source of a class cannot be read, its fields are left out.
    """
    collected: dict[str, str] = {}
    for base in reversed(class_.__mro__):
        for field, below in pairwise(_statements(base)):
            match field, below:
                case (
                    ast.AnnAssign(target=ast.Name(id=name)),
                    ast.Expr(value=ast.Constant(value=str(text))),
                ):
                    collected[name] = " ".join(text.split())
    return collected


def _statements(class_: type) -> list[ast.stmt]:
    """Return the statements in the body of a class."""
    try:
        source = textwrap.dedent(inspect.getsource(class_))
        (definition,) = ast.parse(source).body
    except (OSError, TypeError, SyntaxError, ValueError):
        return []
    return definition.body if isinstance(definition, ast.ClassDef) else []
