"""The interface of learning algorithms, and how one is loaded by its name."""

from __future__ import annotations

import inspect
from typing import Any, Protocol, cast

from desim_uav.errors import ScenarioError
from desim_uav.learning.rows import Lesson, QValues
from desim_uav.registry import resolve

MOST_TABLES = 16


class Algorithm(Protocol):
    """A learning algorithm: the number of a drone's ``tables``, and how they are updated."""

    tables: int

    @staticmethod
    def update(q: QValues, lesson: Lesson) -> None:
        """Change the values ``q[table, state, action]`` of a drone after a lesson.

        It is compiled if it uses only numbers and the fields of ``lesson``; else Python runs it.
        """


def load_algorithm(name: str) -> Algorithm:
    """Return a built-in algorithm, or one of a class ``"package.module:Class"``.

    Raises ScenarioError if there is no such algorithm, or if its ``update`` is unsuitable.
    """
    try:
        algorithm: Any = resolve("algorithm", name)
    except ValueError as error:
        raise ScenarioError(f"learning.algorithm: {error}") from error
    tables, update = getattr(algorithm, "tables", 0), getattr(algorithm, "update", None)
    if type(tables) is not int or not 1 <= tables <= MOST_TABLES or not callable(update):
        raise ScenarioError(
            f"learning.algorithm: {name!r} is not an algorithm: it needs 'tables', their number "
            f"(at most {MOST_TABLES}), and 'update', a function"
        )
    try:
        inspect.signature(update).bind("q", "lesson")
    except TypeError as error:
        raise ScenarioError(
            f"learning.algorithm: {name!r}: its 'update' must take q, lesson ({error})"
        ) from error
    return cast(Algorithm, algorithm)
