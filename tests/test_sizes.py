"""No file of the package is long, and no function has many branches."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import desim_uav

FILES = sorted(Path(desim_uav.__file__).parent.rglob("*.py"))
LONGEST, MOST_COMPLEX = 450, 20

BRANCHES = (ast.If, ast.For, ast.While, ast.IfExp, ast.ExceptHandler, ast.comprehension)


def complexity_of(function: ast.AST) -> int:
    """Return the cyclomatic complexity, with an additional branch for each ``and`` and ``or``."""
    nodes = [*ast.walk(function)]
    operands = sum(len(node.values) - 1 for node in nodes if isinstance(node, ast.BoolOp))
    return 1 + operands + sum(isinstance(node, BRANCHES) for node in nodes)


def functions() -> Iterator[tuple[str, ast.AST]]:
    for file in FILES:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield f"{file}:{node.lineno} {node.name}", node


def test_no_file_is_long() -> None:
    lines = {str(file): len(file.read_text(encoding="utf-8").splitlines()) for file in FILES}
    assert not {name: count for name, count in lines.items() if count > LONGEST}


@pytest.mark.thorough
def test_no_function_has_many_branches() -> None:
    complexities = {name: complexity_of(node) for name, node in functions()}
    assert len(complexities) > 1000
    assert not {name: count for name, count in complexities.items() if count > MOST_COMPLEX}
