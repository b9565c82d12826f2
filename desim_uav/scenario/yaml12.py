"""A YAML 1.2 reader (core schema) over PyYAML's events, which records the place of every value.

It accepts plain data only: no anchors, aliases, tags, merge keys or second documents. ``yes``,
``off`` and ``1:30`` are text, ``010`` is ten, and ``1e3`` is a number. It does not recurse.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, field
from typing import Any

import yaml

KeyPath = tuple[str | int, ...]
"""The path of a value: keys of mappings and indices of lists."""

TextMark = tuple[int, int]
"""Line and column, both counted from 1."""

MAX_DEPTH = 50
MAX_DIGITS = 400
MAX_SHOWN = 60


@dataclass
class Document:
    """The data of a YAML text, the mark of each key and value, and the problems found.

    ``broken``: the text could not be read to its end. ``left_out``: the paths of values that were
    refused. If a key is given twice, its first value counts.
    """

    data: Any = None
    keys: dict[KeyPath, TextMark] = field(default_factory=dict)
    values: dict[KeyPath, TextMark] = field(default_factory=dict)
    problems: list[tuple[TextMark, str]] = field(default_factory=list)
    left_out: list[KeyPath] = field(default_factory=list)
    broken: bool = False
    empty: bool = True


def read(text: str) -> Document:
    """Read one YAML document. Problems of the text are returned in the document, not raised."""
    text = text.removeprefix("\ufeff")
    reader = _Reader()
    unprintable = _UNPRINTABLE.search(text)
    if unprintable:
        reader.fail(_mark_of(text, unprintable.start()), unprintable_in(text))
        return reader.document
    try:
        for event in yaml.parse(text, Loader=_Loader):
            if not reader.take(event):
                break
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        reason = ", ".join(filter(None, (error.problem, error.context)))
        reader.fail(_mark(mark) if mark else reader.latest, f"invalid YAML: {reason}")
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        reader.fail(reader.latest, f"invalid YAML: {error}")
    return reader.document


def plain_scalar(text: str) -> bool | int | float | str | None:
    """Return the value of an unquoted scalar in YAML's core schema."""
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    if _INTEGER.fullmatch(text):
        return int(text)
    if text[:2] in _BASES and _BASES[text[:2]][1].fullmatch(text[2:]):
        return int(text[2:], _BASES[text[:2]][0])
    if _FLOAT.fullmatch(text):
        return float(text)
    if _INFINITY.fullmatch(text):
        return -math.inf if text[0] == "-" else math.inf
    return text


def shortened(text: str) -> str:
    """Return a text shortened to at most 60 characters, for a message."""
    return text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 1] + "…"


def unprintable_in(text: str) -> str:
    """Return a message about the first character that is not allowed in a text, or ""."""
    match = _UNPRINTABLE.search(text)
    return f"character U+{ord(match.group()):04X} is not allowed" if match else ""


_UNPRINTABLE = re.compile(
    "[^\t\n\r\x20-\x7e\xa0-\u2027\u202a-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"
)
"""The characters that are refused: those that YAML refuses, and U+0085, U+2028 and U+2029, which
end a line in YAML 1.1 only."""
_CONSTANTS: dict[str, bool | float | None] = (
    dict.fromkeys(("", "~", "null", "Null", "NULL"))
    | dict.fromkeys(("true", "True", "TRUE"), True)
    | dict.fromkeys(("false", "False", "FALSE"), False)
    | dict.fromkeys((".nan", ".NaN", ".NAN"), math.nan)
)
_INTEGER = re.compile(r"[-+]?[0-9]+")
_BASES = {"0o": (8, re.compile("[0-7]+")), "0x": (16, re.compile("[0-9a-fA-F]+"))}
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INFINITY = re.compile(r"[-+]?(\.inf|\.Inf|\.INF)")

_ABSENT: Any = object()
"""Stands for a value that was left out because of an alias, a tag or a refused key."""


class _Loader(yaml.SafeLoader):
    """PyYAML's loader of YAML 1.1, which also takes tabs between tokens, as YAML 1.2 does."""

    def scan_to_next_token(self) -> None:
        """Skip spaces, tabs that are no indentation, comments and ends of lines."""
        super().scan_to_next_token()
        while self.peek() == "\t" and not self._indents():
            while self.peek() in " \t":
                self.forward()
            super().scan_to_next_token()

    def _indents(self) -> bool:
        """Return whether a tab begins a line of a block, which must be indented by spaces."""
        ahead = 0
        while self.peek(ahead) in " \t":
            ahead += 1
        before = self.buffer[self.pointer - self.column : self.pointer]
        has_content = self.peek(ahead) not in "#\r\n\0"
        return not self.flow_level and not before.strip() and has_content


@dataclass
class _Frame:
    """An open mapping or list; ``key`` is the key whose value comes next."""

    container: dict[str, Any] | list[Any]
    path: KeyPath
    refused: bool
    is_key: bool
    key: Any = None
    awaits_value: bool = False


class _Reader:
    """Builds a ``Document`` from PyYAML's events, one at a time."""

    def __init__(self) -> None:
        self.document = Document()
        self.latest: TextMark = (1, 1)
        self._frames: list[_Frame] = []
        self._documents = 0

    def fail(self, mark: TextMark, message: str) -> bool:
        """Note a problem that ends the reading."""
        self._note(mark, message)
        self.document.broken = True
        return False

    def take(self, event: yaml.Event) -> bool:
        """Take the next event; False ends the reading."""
        self.latest = _mark(event.start_mark)
        if isinstance(event, yaml.DocumentStartEvent):
            self._documents += 1
            if self._documents > 1:
                return self.fail(
                    self.latest, "a second document begins here; a scenario file holds only one"
                )
        elif isinstance(event, yaml.AliasEvent):
            self._note(
                self.latest, f"alias *{shortened(str(event.anchor))}: aliases are not allowed"
            )
            self._scalar_or_alias(_ABSENT, self.latest)
        elif isinstance(event, yaml.ScalarEvent):
            self._check_properties(event)
            self._scalar_or_alias(self._scalar(event), self.latest)
        elif isinstance(event, yaml.CollectionStartEvent):
            self._check_properties(event)
            return self._open(event)
        elif isinstance(event, yaml.CollectionEndEvent):
            self._close()
        return True

    def _note(self, mark: TextMark, message: str) -> None:
        self.document.problems.append((mark, message))

    def _check_properties(self, event: yaml.NodeEvent) -> None:
        if event.anchor is not None:
            self._note(self.latest, f"anchor &{shortened(event.anchor)}: anchors are not allowed")
        tag = getattr(event, "tag", None)
        if tag is not None:
            self._note(self.latest, f"tag {shortened(tag)}: tags are not allowed")

    def _scalar(self, event: yaml.ScalarEvent) -> Any:
        text: str = event.value
        refused = unprintable_in(text)
        if refused:
            self._note(self.latest, refused)
            return _ABSENT
        if event.style is not None:
            return text
        if len(text) > MAX_DIGITS and text.lstrip("+-0ox")[:MAX_DIGITS].isalnum():
            digits = text.lstrip("+-")
            if _INTEGER.fullmatch(digits) or text[:2] in _BASES:
                self._note(
                    self.latest,
                    f"a number of {len(digits)} digits; at most {MAX_DIGITS} are allowed",
                )
                return _ABSENT
        return plain_scalar(text)

    def _scalar_or_alias(self, value: object, mark: TextMark) -> None:
        frame = self._frames[-1] if self._frames else None
        if frame and isinstance(frame.container, dict) and not frame.awaits_value:
            self._take_key(frame, value, mark)
        else:
            self._place(value, mark)

    def _take_key(self, frame: _Frame, value: object, mark: TextMark) -> None:
        frame.awaits_value = True
        frame.key = value
        if value is _ABSENT or frame.refused:
            return
        if not isinstance(value, str):
            self._note(mark, f"key {json.dumps(value)}: keys must be text; put it in quotes")
            frame.key = _ABSENT
        elif value == "<<":
            self._note(mark, "<<: merge keys are not allowed")
            frame.key = _ABSENT
        elif (*frame.path, value) in self.document.keys:
            path = (*frame.path, value)
            first = self.document.keys[path]
            self._note(mark, f"key {shortened(value)!r} is given twice, first at line {first[0]}")
            frame.key = _ABSENT
        else:
            self.document.keys[(*frame.path, value)] = mark

    def _place(self, value: object, mark: TextMark) -> tuple[KeyPath, bool]:
        """Put a value in its container; return its path and whether it was refused."""
        if not self._frames:
            self.document.data = None if value is _ABSENT else value
            self.document.values[()] = mark
            self.document.empty = value is None
            return (), value is _ABSENT
        frame = self._frames[-1]
        container = frame.container
        key: Any = len(container) if isinstance(container, list) else frame.key
        frame.awaits_value = False
        if frame.refused or key is _ABSENT:
            return (), True
        path = (*frame.path, key)
        if value is _ABSENT:
            self.document.left_out.append(path)
        if isinstance(container, list):
            container.append(None if value is _ABSENT else value)
        elif value is not _ABSENT:
            container[key] = value
        self.document.values[path] = mark
        return path, False

    def _open(self, event: yaml.CollectionStartEvent) -> bool:
        if len(self._frames) >= MAX_DEPTH:
            return self.fail(self.latest, f"nested more than {MAX_DEPTH} levels deep")
        new: dict[str, Any] | list[Any] = {} if isinstance(event, yaml.MappingStartEvent) else []
        frame = self._frames[-1] if self._frames else None
        if frame and isinstance(frame.container, dict) and not frame.awaits_value:
            if not frame.refused:
                self._note(self.latest, "a mapping or list is used as a key: keys must be text")
            self._frames.append(_Frame(new, (), refused=True, is_key=True))
        else:
            path, refused = self._place(new, self.latest)
            self._frames.append(_Frame(new, path, refused, is_key=False))
        return True

    def _close(self) -> None:
        if self._frames.pop().is_key:
            parent = self._frames[-1]
            parent.key = _ABSENT
            parent.awaits_value = True


def _mark(mark: Any) -> TextMark:
    return mark.line + 1, mark.column + 1


def _mark_of(text: str, index: int) -> TextMark:
    before = text[:index]
    return before.count("\n") + 1, index - (before.rfind("\n") + 1) + 1
