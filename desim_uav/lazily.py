"""Imports that are put off until somebody needs what they bring."""

from __future__ import annotations

import ast
import importlib.util
import sys
from collections.abc import Callable
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Any


def names_in_stub(file: str) -> dict[str, str]:
    """Return the names that the stub beside a package's file imports, each with its module."""
    tree = ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    module_of = {name.name: node.module or "" for node in imports for name in node.names}
    return dict(sorted(module_of.items()))


def after_import(package: str, then: Callable[[], Any]) -> None:
    """Do something once a package has been imported, or at once if it is there already."""
    if package in sys.modules:
        then()
    else:
        sys.meta_path.insert(0, _After(package, then))


class _After:
    """A finder that finds a package as others do, and lets its loader do one thing more."""

    def __init__(self, package: str, then: Callable[[], Any]) -> None:
        self._package, self._then = package, then
        self._finding = False

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """Return how the package is loaded, and nothing for any other."""
        if name != self._package or self._finding:
            return None
        self._finding = True
        try:
            spec = importlib.util.find_spec(name)
        finally:
            self._finding = False
        if spec is not None and spec.loader is not None:
            loader: Any = spec.loader
            load = loader.exec_module

            def exec_module(module: object) -> None:
                load(module)
                if self in sys.meta_path:
                    sys.meta_path.remove(self)
                    self._then()

            loader.exec_module = exec_module
        return spec
