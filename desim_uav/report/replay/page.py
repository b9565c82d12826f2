"""The page: one HTML file with its style, script and data, which loads nothing else.

The names in a run folder may come from anyone. They are only data in the page: JSON without "<" in
an element that is not executed, shown as text. The page's security policy allows its own script
only.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from typing import Any

from desim_uav.engine.base import UserState
from desim_uav.palette import DRONES, USERS

FORMAT = 3
"""The version of the format of the page's data."""

MODULES = (
    *(
        "decode",
        "palette",
        "episode",
        "states",
        "tasks",
        "state",
        "history",
        "city",
        "camera",
        "crowd",
        "links",
    ),
    *(
        "view2d",
        "view3d",
        "zones",
        "heat",
        "users",
        "drones",
        "stations",
        "points",
        "scale",
        "foot",
        "scene",
        "rows",
    ),
    *(
        "legend",
        "fork",
        "timeline",
        "details",
        "tip",
        "strip",
        "player",
        "panel",
        "layout",
        "picture",
        "controls",
        "main",
    ),
)
"""The page's modules, each after those that it imports."""

IMPORT = re.compile(r'^import\s+(\{[^}]*\})\s+from\s+"\./(\w+)\.js";$', re.MULTILINE)
EXPORT = re.compile(r"^export ((?:async )?(?:function|class|const) (\w+))", re.MULTILINE)


Recording = tuple[Mapping[str, Any], Sequence[bytes]]
"""A run in a page: the data that its episodes have in common, and a block for each episode."""


def page(*runs: Recording) -> bytes:
    """Make the page of a run, or of two that are played in step."""
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
        "data": "\n".join((_data(runs), *_blocks(runs))),
        "script": script,
    }
    html = re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], asset("page.html"))
    return html.encode()


def bundle() -> str:
    """Return all modules as one script, because a page in a local file cannot import modules."""
    modules = "\n".join(_enclosed(name, asset(f"{name}.js")) for name in MODULES)
    return f'(() => {{\n"use strict";\n{modules}\n}})();'


def _enclosed(name: str, text: str) -> str:
    """Return a module as a function that returns its exports, so that its names stay private."""
    exports = ", ".join(match[2] for match in EXPORT.finditer(text))
    inside = EXPORT.sub(r"\1", IMPORT.sub(r"const \1 = $\2;", text))
    return f"const ${name} = (() => {{\n{inside}return {{ {exports} }};\n}})();"


def asset(name: str) -> str:
    """Return the content of one of the page's files."""
    return (files(__package__) / "assets" / name).read_text(encoding="utf-8")


def _data(runs: Sequence[Recording]) -> str:
    content = {"format": FORMAT, "palette": _palette(), "runs": [common for common, _ in runs]}
    text = json.dumps(content, allow_nan=False, separators=(",", ":"))  # ASCII only
    inert = text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
    return f'<script type="application/json" id="runs">{inert}</script>'


def _palette() -> dict[str, Any]:
    """Return the colours of drones by number, and the look of users by state."""
    users = [USERS[state]._asdict() for state in UserState]
    return {"drones": DRONES, "users": users}


def _blocks(runs: Sequence[Recording]) -> Iterator[str]:
    for k, (_, blocks) in enumerate(runs):
        for number, block in enumerate(blocks):
            text = base64.b64encode(block).decode()
            kind = "application/octet-stream"
            yield f'<script type="{kind}" id="episode-{k}-{number}">{text}</script>'


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
