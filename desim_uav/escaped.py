"""Escaping of other people's text (names in submissions, files and folders) in what is written.

Each format has one function, through which all such text passes: ``errors.printable`` for lines in
a terminal, ``report.markup.html`` for pages, ``report.markup.visible`` for figures, and the
functions of this module for Markdown and CSV.
"""

from __future__ import annotations

import re
from typing import Any

from desim_uav.errors import printable

ACTIVE = re.compile(
    r"[\\`*\[\]<>|~$&]|(?<![^\W_])_|_(?![^\W_])|(?<=http):|(?<=https):|(?<=ftp):|(?<=www)\.",
    re.IGNORECASE,
)
"""What begins code, emphasis, links, images, HTML, formulas or entities in Markdown. An underscore
does so only at the edge of a word, and an address only if more follows its first letters."""

FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""The first characters of a cell that spreadsheet programs take for a formula."""


def markdown(text: str) -> str:
    """Return text escaped for a line or a cell of a table in Markdown."""
    return ACTIVE.sub(r"\\\g<0>", printable(" ".join(text.split())))


def markdown_code(text: str) -> str:
    """Return text as code in Markdown, with a fence that is longer than any in it."""
    plain = printable(text)
    longest = max(map(len, re.findall("`+", plain)), default=0)
    edge = " " if plain.startswith("`") or plain.endswith("`") else ""
    return f"{'`' * (longest + 1)}{edge}{plain}{edge}{'`' * (longest + 1)}"


def csv_cell(value: object) -> Any:
    """Return the value of a cell; a text that would be a formula gets an apostrophe before it."""
    is_formula = isinstance(value, str) and value.startswith(FORMULA)
    return f"'{value}" if is_formula else value
