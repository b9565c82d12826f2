"""Google-style sections (Args, Raises, Attributes) of docstrings.

``sphinx.ext.napoleon`` would take what stands before a colon in a property's docstring for its
type; here a property's docstring is left as it is.
"""

from __future__ import annotations

from typing import Any

from sphinx.ext.napoleon import Config, GoogleDocstring


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("autodoc-process-docstring", _process)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _process(app: Any, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    if what not in ("attribute", "property"):
        config = Config(napoleon_use_ivar=True)
        lines[:] = GoogleDocstring(lines, config, app, what, name, found, options).lines()
