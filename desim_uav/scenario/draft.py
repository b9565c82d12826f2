"""A scenario before it is validated: plain data, and where each value was given."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any, NamedTuple

from desim_uav.errors import ScenarioError, UsageError, printable
from desim_uav.scenario import yaml12
from desim_uav.scenario.yaml12 import KeyPath, TextMark, shortened, unprintable_in

MAX_PROBLEMS = 100


class Origin(NamedTuple):
    """An override that set a value: its number among the overrides and its text."""

    number: int
    text: str
    path: KeyPath


@dataclass
class ScenarioDraft:
    """The plain data of a scenario before validation, and the problems found in it.

    ``dropped``: the paths of values that were removed; their defaults take their place.
    ``doubtful``: the paths of values that may not be what the file means, so that no further
    problem is reported because of them.
    """

    source: str
    data: Any
    keys: dict[KeyPath, TextMark] = field(default_factory=dict)
    values: dict[KeyPath, TextMark] = field(default_factory=dict)
    origins: dict[KeyPath, Origin] = field(default_factory=dict)
    dropped: list[KeyPath] = field(default_factory=list)
    doubtful: list[KeyPath] = field(default_factory=list)
    _problems: dict[str, tuple[int, TextMark]] = field(default_factory=dict)

    @property
    def problems(self) -> list[str]:
        """The problems in the order of file and overrides, at most ``MAX_PROBLEMS``."""
        lines = sorted(self._problems, key=lambda line: self._problems[line])
        more = len(lines) - MAX_PROBLEMS
        return lines if more <= 0 else [*lines[:MAX_PROBLEMS], f"{self.source}: and {more} more"]

    @property
    def hopeless(self) -> bool:
        """Whether there are so many problems that the search for more ends."""
        return len(self._problems) >= MAX_PROBLEMS

    def at_mark(self, mark: TextMark, message: str) -> None:
        """Note a problem at a line and column of the file."""
        self._note(f"{self.source}:{mark[0]}:{mark[1]}: {message}", (0, mark))

    def of_file(self, message: str) -> None:
        """Note a problem of the file as a whole."""
        self._note(f"{self.source}: {message}", (0, (0, 0)))

    def at(
        self, path: KeyPath, message: str, also: Sequence[KeyPath] = (), *, key: bool = False
    ) -> None:
        """Note a problem of the value at ``path``, or of its key.

        If no value was given at ``path``, the problem is reported at the first path of ``also``
        that has one. A problem of several values is that of the override which set one of them.
        """
        present = [p for p in (path, *also) if self.has(p)]
        where = next((p for p in present if self._origin(p)), present[0] if present else path)
        subject = ".".join(shortened(str(part)) for part in path)
        if self.has(path) and not key:
            subject += f": {shown(self.get(path))}"
        origin = self._origin(where)
        if origin:
            aside = subject if path != origin.path else ""
            parts = [named_override(origin.text), aside, message]
            self._note(": ".join(filter(None, parts)), (1, (origin.number, 0)))
            return
        mark = self._mark(where, key)
        place = f"{self.source}:{mark[0]}:{mark[1]}" if mark else self.source
        self._note(f"{place}: {subject}: {message}", (0, mark or (0, 0)))

    def has(self, path: KeyPath) -> bool:
        """Return whether a value was given at ``path``."""
        return self._find(path)[1]

    def get(self, path: KeyPath) -> Any:
        """Return the value at ``path``, or None."""
        return self._find(path)[0]

    def drop(self, path: KeyPath) -> bool:
        """Remove the value at ``path`` and the list that holds it; return whether it was there."""
        if any(path[: len(gone)] == gone for gone in self.dropped):
            return False
        while path and (isinstance(path[-1], int) or not self.has(path)):
            path = path[:-1]
        if not path:
            return False
        self.dropped.append(path)
        del self.get(path[:-1])[path[-1]]
        return True

    def depends_on_refused(self, paths: Sequence[KeyPath]) -> bool:
        """Return whether one of ``paths`` holds, or is part of, a removed or doubtful value."""
        refused = (*self.dropped, *self.doubtful)
        return any(_related(path, other) for path in paths for other in refused)

    def clean(self) -> None:
        """Turn whole floats into ints, and refuse values that no key accepts."""
        refused: list[KeyPath] = []
        self.data = self._cleaned((), self.data, refused)
        for path in refused:
            self.drop(path)

    def override(self, number: int, text: str, defaults: Mapping[str, Any]) -> None:
        """Apply ``key.path=value``; lists not given are first filled in from ``defaults``."""
        path = override_path(text)
        document = yaml12.read(text.partition("=")[2])
        for _, message in document.problems:
            self._note(f"{named_override(text)}: {message}", (1, (number, 0)))
        if document.problems:
            self.doubtful.append(path)
            return
        try:
            container, path = self._reach(path, defaults)
        except LookupError as error:
            self._note(f"{named_override(text)}: {error.args[0]}", (1, (number, 0)))
            return
        container[path[-1]] = document.data
        beneath = [p for p in self.origins if p[: len(path)] == path]
        for key in beneath:
            del self.origins[key]
        self.origins[path] = Origin(number, text, path)
        self.doubtful = [p for p in self.doubtful if not _related(p, path)]

    def _reach(self, path: KeyPath, defaults: Mapping[str, Any]) -> tuple[Any, KeyPath]:
        """Return the item's container, made if missing, and ``path`` with indices."""
        container: Any = self.data
        default: Any = defaults
        reached: KeyPath = ()
        for position, part in enumerate(path):
            key = _index(str(part), container) if isinstance(container, list) else part
            reached = (*reached, key)
            if position == len(path) - 1:
                break
            default = default.get(part) if isinstance(default, Mapping) else None
            below: Any = container[key] if part != key else container.get(key)
            if not isinstance(below, dict | list):
                below = copy.deepcopy(default) if isinstance(default, list) else {}
                container[key] = below
            container = below
        return container, reached

    def _note(self, line: str, order: tuple[int, TextMark]) -> None:
        self._problems.setdefault(printable(line), order)

    def _find(self, path: KeyPath) -> tuple[Any, bool]:
        value = self.data
        for part in path:
            has_part = part in value if isinstance(value, dict) else False
            if isinstance(value, list) and isinstance(part, int):
                has_part = part < len(value)
            if not has_part:
                return None, False
            value = value[part]
        return value, True

    def _origin(self, path: KeyPath) -> Origin | None:
        """Return the override that set the value at ``path``, or else a part of it."""
        above = (self.origins[p] for p in _upwards(path) if p in self.origins)
        beneath = (one for p, one in self.origins.items() if path and p[: len(path)] == path)
        return next(above, None) or next(beneath, None)

    def _mark(self, path: KeyPath, key: bool) -> TextMark | None:
        if key and path in self.keys:
            return self.keys[path]
        return next((self.values[p] for p in _upwards(path) if p in self.values), None)

    def _cleaned(self, path: KeyPath, value: object, refused: list[KeyPath]) -> Any:
        if isinstance(value, dict):
            return {key: self._cleaned((*path, key), item, refused) for key, item in value.items()}
        if isinstance(value, list):
            return [self._cleaned((*path, i), item, refused) for i, item in enumerate(value)]
        if isinstance(value, float) and value.is_integer():
            return int(value)
        problem = _problem_of(value)
        if problem:
            self.at(path, problem)
            refused.append(path)
        return value


def plain_copy(value: object, depth: int = 0) -> Any:
    """Return a value as plain data that a scenario file could hold.

    Mappings become dicts, tuples become lists, and paths become text. Raises ScenarioError for a
    key that is not text, and for data that is nested too deeply.
    """
    if depth > yaml12.MAX_DEPTH:
        raise ScenarioError(f"nested more than {yaml12.MAX_DEPTH} levels deep")
    if isinstance(value, Mapping):
        for key in value:
            problem = "keys must be text" if not isinstance(key, str) else unprintable_in(key)
            if problem:
                raise ScenarioError(f"key {key!r}: {problem}")
        return {key: plain_copy(item, depth + 1) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_copy(item, depth + 1) for item in value]
    return str(value) if isinstance(value, PurePath) else value


def override_path(text: str) -> KeyPath:
    """Return the key path of ``key.path=value``. Raises UsageError for text of another form."""
    left, equals, _ = text.partition("=")
    path = tuple(part.strip() for part in left.split("."))
    if not equals or not all(path) or unprintable_in(left):
        override = printable(named_override(text))
        raise UsageError(f"{override}: must be key.path=value, as in users.count=20")
    return path


def named_override(text: str) -> str:
    """Return what a message calls an override, whether the command line or Python gave it."""
    return f"override {shortened(text)}"


def blamed(problem: str, overrides: Sequence[str]) -> str | None:
    """Return the override that a problem is of, if it is of a key that an override set.

    ``problem`` begins with the key, such as ``users.clusters.radius_m: …``.
    """
    key = tuple(problem.partition(":")[0].split("."))
    return next((text for text in overrides if _related(override_path(text), key)), None)


@contextmanager
def blaming(path: PurePath | None, overrides: Sequence[str] = ()) -> Iterator[None]:
    """Name the override or the file in problems that are found only in drawing a world."""
    try:
        yield
    except ScenarioError as error:
        problems = []
        for problem in error.problems:
            text = blamed(problem, overrides)
            source = path if text is None else named_override(text)
            problems.append(problem if source is None else f"{source}: {problem}")
        raise ScenarioError(*problems) from error


def _problem_of(value: object) -> str:
    if isinstance(value, str):
        return unprintable_in(value)
    if isinstance(value, float) and not math.isfinite(value):
        return "must be a finite number"
    if not isinstance(value, None | bool | int | float):
        return f"a {type(value).__name__} is not plain data"
    return ""


def _index(part: str, items: list[Any]) -> int:
    if not (part.isdecimal() and part.isascii() and int(part) < len(items)):
        raise LookupError(
            f"{part!r} is not an index of this list, which has {len(items)} items, counted from 0"
        )
    return int(part)


def shown(value: object) -> str:
    """Return a value as one line of YAML, shortened."""
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    try:
        return shortened(json.dumps(value, ensure_ascii=False))
    except (TypeError, ValueError):
        return shortened(repr(value))


def _upwards(path: KeyPath) -> Iterator[KeyPath]:
    for length in range(len(path), -1, -1):
        yield path[:length]


def _related(one: KeyPath, other: KeyPath) -> bool:
    shorter = min(len(one), len(other))
    return one[:shorter] == other[:shorter]
