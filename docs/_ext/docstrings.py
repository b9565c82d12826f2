"""Google-style sections (Args, Raises, Attributes) of docstrings.

``sphinx.ext.napoleon`` would take what stands before a colon in a property's docstring for its
type; here a property's docstring is left as it is.
"""

from __future__ import annotations

import inspect
import typing
from typing import Any

from sphinx.ext.napoleon import Config, GoogleDocstring
from sphinx.util.inspect import stringify_signature

from desim_uav.typed import hints_of


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("autodoc-process-docstring", _process)
    app.connect("autodoc-process-signature", _plain)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _process(app: Any, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    if what not in ("attribute", "property"):
        config = Config(napoleon_use_ivar=True)
        lines[:] = GoogleDocstring(lines, config, app, what, name, found, options).lines()


def _plain(
    app: Any, what: str, name: str, found: Any, options: Any, signature: Any, returns: Any
) -> tuple[str, str] | None:
    if not getattr(found, "__names_in__", ""):
        return None
    own = inspect.signature(found)
    kept = [
        each.replace(annotation=_without_bounds(hint))
        for each, hint in zip(own.parameters.values(), hints_of(found).values(), strict=True)
    ]
    shown = stringify_signature(
        own.replace(parameters=kept), show_return_annotation=False, unqualified_typehints=True
    )
    return shown, returns


def _without_bounds(hint: Any) -> Any:
    return typing.get_type_hints(type("", (), {"__annotations__": {"of": hint}}))["of"]
