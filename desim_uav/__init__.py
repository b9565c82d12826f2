"""desim-uav: exact discrete-event simulation of UAV-enabled wireless networks.

The public names stand in ``__init__.pyi``, once for type checkers and for what follows.
"""

from __future__ import annotations

import importlib
from typing import Any

from desim_uav.lazily import after_import, names_in_stub

__version__ = "0.1.0"

_PUBLIC = names_in_stub(__file__)
__all__ = ["__version__", *_PUBLIC]  # noqa: PLE0604

after_import("gymnasium", lambda: importlib.import_module("desim_uav.env"))  # registers the ids


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for: ``--help`` stays fast."""
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module 'desim_uav' has no attribute {name!r}")
