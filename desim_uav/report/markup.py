"""Makes HTML from plain data; everything that is not markup is escaped."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

INVISIBLE = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Unicode categories of characters that could reorder, hide or break the text beside them."""

UNUSUAL = re.compile("[^\n\t -~]")
"""The characters that may be of these categories."""


class Html(str):
    """Markup; any other text is escaped when it becomes part of a page."""

    __slots__ = ()


def visible(text: str, longest: int | None = None) -> str:
    """Return a text, cut to ``longest``, with its invisible characters in hexadecimal."""
    if longest is not None and len(text) > longest:
        text = text[: longest - 1] + "…"
    return text if text.isprintable() else UNUSUAL.sub(_visible, text)


def _visible(match: re.Match[str]) -> str:
    character = match[0]
    if unicodedata.category(character) not in INVISIBLE:
        return character
    code = ord(character)
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def html(content: object) -> Html:
    """Return content as markup; text is escaped, and None gives nothing."""
    if isinstance(content, Html):
        return content
    return Html("" if content is None else escape(visible(str(content))))


def tag(name: str, *children: Any, **attributes: Any) -> Html:
    """Return an element; attributes of None are left out, and ``class_`` means ``class``."""
    written = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{html(value)}"'
        for key, value in attributes.items()
        if value is not None
    )
    return Html(f"<{name}{written}>{joined(children)}</{name}>")


def joined(parts: Iterable[Any], between: str = "") -> Html:
    """Return parts one after the other."""
    return Html(between.join(html(part) for part in parts))


def table(headings: Sequence[Any], rows: Iterable[Sequence[Any]], words: Sequence[int]) -> Html:
    """Return a table that scrolls if it is too wide; ``words`` are its columns of text."""

    def cells(name: str, row: Sequence[Any], **scope: str) -> Html:
        return joined(
            tag(name, cell, class_=None if k in words else "number", **scope)
            for k, cell in enumerate(row)
        )

    head = tag("thead", tag("tr", cells("th", headings, scope="col")))
    body = tag("tbody", joined((tag("tr", cells("td", row)) for row in rows), "\n"))
    return tag("div", tag("table", head, "\n", body), class_="scroll", tabindex=0)


def facts(pairs: Iterable[tuple[str, Any]]) -> Html:
    """Return a list of names and values, without those that are empty."""
    return tag(
        "dl",
        joined(
            tag("div", tag("dt", name), tag("dd", value))
            for name, value in pairs
            if value not in (None, "")
        ),
    )


def folded(summary: str, *content: Any, opened: bool = False) -> Html:
    """Return content that can be unfolded, or folded if it is ``opened``."""
    return tag("details", tag("summary", summary), *content, open="" if opened else None)


def paragraph(*content: Any, class_: str | None = None) -> Html:
    """Return a paragraph."""
    return tag("p", *content, class_=class_)


def code(text: str) -> Html:
    """Return text that is typed or printed by a computer."""
    return tag("code", text)
