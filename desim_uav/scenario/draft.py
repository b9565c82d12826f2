"""A scenario before it is validated: plain data, and where each value was given."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any, NamedTuple

from desim_uav.errors import UsageError
from desim_uav.scenario import yaml12
from desim_uav.scenario.yaml12 import KeyPath, Mark

MAX_SHOWN = 60


class Origin(NamedTuple):
    """An override that gave a value: where it stands on the command line, and what it says."""

    number: int
    text: str
    path: KeyPath


@dataclass
class Draft:
    """Plain data under construction, and the problems found in it.

    ``dropped``: the paths whose values were refused, so that defaults stand in for them.
    """

    source: str
    data: Any
    keys: dict[KeyPath, Mark] = field(default_factory=dict)
    values: dict[KeyPath, Mark] = field(default_factory=dict)
    origins: dict[KeyPath, Origin] = field(default_factory=dict)
    dropped: list[KeyPath] = field(default_factory=list)
    _problems: dict[str, tuple[int, Mark]] = field(default_factory=dict)

    @property
    def problems(self) -> list[str]:
        """What is wrong, in the order of the file, then of the overrides."""
        return sorted(self._problems, key=lambda line: self._problems[line])

    def at_mark(self, mark: Mark, message: str) -> None:
        """Note a problem at a place of the file."""
        self._note(f"{self.source}:{mark[0]}:{mark[1]}: {message}", (0, mark))

    def of_file(self, message: str) -> None:
        """Note a problem of the file as a whole."""
        self._note(f"{self.source}: {message}", (0, (0, 0)))

    def at(
        self, path: KeyPath, message: str, also: Sequence[KeyPath] = (), *, key: bool = False
    ) -> None:
        """Note a problem of the value at ``path``, or of its key; where neither was given, of the
        first of ``also`` that was.
        """
        given = [p for p in (path, *also) if self.has(p)]
        where = given[0] if given else path
        subject = ".".join(map(str, path))
        if self.has(path) and not key:
            subject += f": {shown(self.get(path))}"
        origin = self._origin(where)
        if origin:
            aside = subject if path != origin.path else ""
            parts = [f"-S {shortened(origin.text)}", aside, message]
            self._note(": ".join(filter(None, parts)), (1, (origin.number, 0)))
            return
        mark = self._mark(where, key)
        place = f"{self.source}:{mark[0]}:{mark[1]}" if mark else self.source
        self._note(f"{place}: {subject}: {message}", (0, mark or (0, 0)))

    def has(self, path: KeyPath) -> bool:
        """Was a value given at ``path``?"""
        return self._find(path)[1]

    def get(self, path: KeyPath) -> Any:
        """The value at ``path``, or None."""
        return self._find(path)[0]

    def drop(self, path: KeyPath) -> bool:
        """Take the value at ``path`` away, with the list it stands in; False if there is none."""
        while path and (isinstance(path[-1], int) or not self.has(path)):
            path = path[:-1]
        if not path:
            return False
        self.dropped.append(path)
        del self.get(path[:-1])[path[-1]]
        return True

    def depends_on_dropped(self, paths: Sequence[KeyPath]) -> bool:
        """Does one of ``paths`` lie over or under a value that was refused?"""
        return any(_related(path, gone) for path in paths for gone in self.dropped)

    def clean(self) -> None:
        """Refuse what no key takes; whole floats become ints, tuples lists and paths text."""
        self.data = self._cleaned((), self.data)

    def override(self, number: int, text: str, defaults: Mapping[str, Any]) -> None:
        """Apply ``key.path=value``; lists not given are first filled in from ``defaults``."""
        path = override_path(text)
        document = yaml12.read(text.partition("=")[2])
        for _, message in document.problems:
            self._note(f"-S {shortened(text)}: {message}", (1, (number, 0)))
        if document.problems:
            self.dropped.append(path)
            return
        message = self._assign(path, document.data, defaults)
        if message:
            self._note(f"-S {shortened(text)}: {message}", (1, (number, 0)))
            return
        for known in [p for p in self.origins if p[: len(path)] == path]:
            del self.origins[known]
        self.origins[path] = Origin(number, text, path)

    def _assign(self, path: KeyPath, value: Any, defaults: Mapping[str, Any]) -> str:
        container, default = self.data, defaults
        for position, part in enumerate(path):
            last = position == len(path) - 1
            key: Any = part
            if isinstance(container, list):
                if not (str(part).isdecimal() and int(part) < len(container)):
                    return f"{part!r} is no item of a list of {len(container)}, counted from 0"
                key = int(part)
            default = default.get(part) if isinstance(default, Mapping) else None
            if last:
                container[key] = value
                return ""
            below = container[key] if isinstance(container, list) else container.get(key)
            if not isinstance(below, dict | list):
                below = copy.deepcopy(default) if isinstance(default, list) else {}
                container[key] = below
            container = below
        return ""

    def _note(self, line: str, order: tuple[int, Mark]) -> None:
        self._problems.setdefault(_one_line(line), order)

    def _find(self, path: KeyPath) -> tuple[Any, bool]:
        value = self.data
        for part in path:
            if isinstance(value, dict) and part in value:
                value = value[part]
            elif isinstance(value, list) and isinstance(part, int) and part < len(value):
                value = value[part]
            else:
                return None, False
        return value, True

    def _origin(self, path: KeyPath) -> Origin | None:
        return next((self.origins[p] for p in _upwards(path) if p in self.origins), None)

    def _mark(self, path: KeyPath, key: bool) -> Mark | None:
        if key and path in self.keys:
            return self.keys[path]
        return next((self.values[p] for p in _upwards(path) if p in self.values), None)

    def _cleaned(self, path: KeyPath, value: Any) -> Any:
        if len(path) > yaml12.MAX_DEPTH:
            self.at(path[:4], f"nested more than {yaml12.MAX_DEPTH} deep")
            return None
        if isinstance(value, Mapping):
            return self._cleaned_mapping(path, value)
        if isinstance(value, list | tuple):
            return [self._cleaned((*path, index), item) for index, item in enumerate(value)]
        if isinstance(value, PurePath):
            return str(value)
        if isinstance(value, float) and not math.isfinite(value):
            self.at(path, "must be a finite number")
            self.dropped.append(path)
            return value
        if isinstance(value, float) and value.is_integer():
            return int(value)
        if not isinstance(value, None | bool | int | float | str):
            self.at(path, f"a {type(value).__name__} is not plain data")
            self.dropped.append(path)
        return value

    def _cleaned_mapping(self, path: KeyPath, value: Mapping[Any, Any]) -> dict[str, Any]:
        for key in value:
            if not isinstance(key, str):
                self.at(path, f"key {key!r}: keys must be text")
        items = value.items()
        return {k: self._cleaned((*path, k), v) for k, v in items if isinstance(k, str)}


def override_path(text: str) -> KeyPath:
    """The key path of ``key.path=value``. Raises UsageError where that is not its form."""
    left, equals, _ = text.partition("=")
    path = tuple(part.strip() for part in left.split("."))
    if not equals or not all(path):
        raise UsageError(f"-S {shortened(text)}: must be key.path=value, as in users.count=20")
    return path


def shown(value: Any) -> str:
    """A value as YAML would write it on one line, shortened."""
    try:
        return shortened(json.dumps(value, ensure_ascii=False))
    except (TypeError, ValueError, RecursionError):
        return shortened(repr(value))


def shortened(text: str) -> str:
    """At most 60 characters."""
    return text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 1] + "…"


def _upwards(path: KeyPath) -> Iterator[KeyPath]:
    for length in range(len(path), -1, -1):
        yield path[:length]


def _related(one: KeyPath, other: KeyPath) -> bool:
    shorter = min(len(one), len(other))
    return one[:shorter] == other[:shorter]


def _one_line(text: str) -> str:
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
