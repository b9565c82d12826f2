"""The page: one file of HTML that holds its style, its script and its data, and asks for nothing.

The names in a run folder may be anyone's. They are data here: JSON in an element that is no script,
without a "<", shown as text only; and the page's own policy lets no script but its own run.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

MODULES = (
    *("decode", "palette", "episode", "states", "state", "history", "camera", "crowd"),
    *("view2d", "view3d", "users", "drones", "stations", "scene"),
    *("timeline", "details", "player", "panel", "controls", "main"),
)
"""The page's modules, each behind those it imports."""

IMPORT = re.compile(r'^import\s+(\{[^}]*\})\s+from\s+"\./(\w+)\.js";$', re.MULTILINE)
EXPORT = re.compile(r"^export ((?:async )?(?:function|class|const) (\w+))", re.MULTILINE)


def page(common: Mapping[str, Any], blocks: list[bytes]) -> bytes:
    """The page of a run: what its episodes have in common, and their blocks."""
    style, script = asset("style.css"), bundle()
    policy = "; ".join(
        (
            "default-src 'none'",
            f"script-src '{_hash(script)}'",
            f"style-src '{_hash(style)}'",
            "img-src data:",
            "base-uri 'none'",
            "form-action 'none'",
        )
    )
    parts = {
        "policy": policy,
        "style": style,
        "data": "\n".join((_data(common), *map(_block, range(len(blocks)), blocks))),
        "script": script,
    }
    html = re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], asset("page.html"))
    return html.encode()


def bundle() -> str:
    """All modules as one script, as a page on a disk cannot import; each keeps its own names."""
    rooms = "\n".join(_room(name, asset(f"{name}.js")) for name in MODULES)
    return f'(() => {{\n"use strict";\n{rooms}\n}})();'


def _room(name: str, text: str) -> str:
    """A module as the inside of a function, which returns its exports."""
    exports = ", ".join(match[2] for match in EXPORT.finditer(text))
    inside = EXPORT.sub(r"\1", IMPORT.sub(r"const \1 = $\2;", text))
    return f"const ${name} = (() => {{\n{inside}return {{ {exports} }};\n}})();"


def asset(name: str) -> str:
    """A file of the page's own."""
    return (files(__package__) / "assets" / name).read_text(encoding="utf-8")


def _data(common: Mapping[str, Any]) -> str:
    text = json.dumps(common, allow_nan=False, separators=(",", ":"))  # ASCII only
    inert = text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
    return f'<script type="application/json" id="run">{inert}</script>'


def _block(number: int, block: bytes) -> str:
    text = base64.b64encode(block).decode()
    return f'<script type="application/octet-stream" id="episode-{number}">{text}</script>'


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
