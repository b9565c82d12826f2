"""HTML from plain data: whatever is not markup yet is escaped."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

INVISIBLE = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Categories of characters that could reorder, hide or break what stands beside them."""


class Html(str):
    """Markup; any other text is escaped as it becomes part of a page."""

    __slots__ = ()


def visible(text: str, longest: int | None = None) -> str:
    """A text with what cannot be seen of it written out in hexadecimal, cut to ``longest``."""
    if longest is not None and len(text) > longest:
        text = text[: longest - 1] + "…"
    if text.isprintable():
        return text
    return "".join(_visible(character) for character in text)


def _visible(character: str) -> str:
    if unicodedata.category(character) not in INVISIBLE or character in "\n\t":
        return character
    code = ord(character)
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def html(content: Any) -> Html:
    """Some content as markup: a text is escaped, None is nothing."""
    if isinstance(content, Html):
        return content
    return Html("" if content is None else escape(visible(str(content))))


def tag(name: str, *children: Any, **attributes: Any) -> Html:
    """An element; an attribute of None is left out, ``class_`` is ``class``."""
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{html(value)}"'
        for key, value in attributes.items()
        if value is not None
    )
    return Html(f"<{name}{given}>{joined(children)}</{name}>")


def joined(parts: Iterable[Any], between: str = "") -> Html:
    """Parts one after the other."""
    return Html(between.join(html(part) for part in parts))


def table(headings: Sequence[Any], rows: Iterable[Sequence[Any]], words: Sequence[int]) -> Html:
    """A table that scrolls by itself where it is too wide; ``words``: its columns of text."""

    def cells(name: str, row: Sequence[Any], **scope: str) -> Html:
        return joined(
            tag(name, cell, class_=None if k in words else "number", **scope)
            for k, cell in enumerate(row)
        )

    head = tag("thead", tag("tr", cells("th", headings, scope="col")))
    body = tag("tbody", joined((tag("tr", cells("td", row)) for row in rows), "\n"))
    return tag("div", tag("table", head, "\n", body), class_="scroll", tabindex=0)


def facts(pairs: Iterable[tuple[str, Any]]) -> Html:
    """Names and what they stand for; those without are left out."""
    return tag(
        "dl",
        joined(
            tag("div", tag("dt", name), tag("dd", value))
            for name, value in pairs
            if value not in (None, "")
        ),
    )


def folded(summary: str, *content: Any, opened: bool = False) -> Html:
    """What is shown on demand, or hidden."""
    return tag("details", tag("summary", summary), *content, open="" if opened else None)


def paragraph(*content: Any, class_: str | None = None) -> Html:
    """A paragraph."""
    return tag("p", *content, class_=class_)


def code(text: str) -> Html:
    """What is typed."""
    return tag("code", text)
