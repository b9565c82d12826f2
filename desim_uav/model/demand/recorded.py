"""What recorded requests ask for: the values that others draw, from columns of a CSV file."""

from __future__ import annotations

import operator
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_type_hints

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from desim_uav.errors import in_short
from desim_uav.model.catalogue import catalogue
from desim_uav.model.rules import US
from desim_uav.model.services import Service, collecting_of, is_one_time
from desim_uav.model.traces import quantity, read_table

LIMITS: dict[Any, tuple[str, Any, str]] = {
    Ge: ("ge", operator.ge, "at least"),
    Gt: ("gt", operator.gt, "above"),
    Le: ("le", operator.le, "at most"),
    Lt: ("lt", operator.lt, "below"),
}
"""Of each kind of limit its attribute, the comparison, and the words for it."""


class Recorded(NamedTuple):
    """The values of each request by the number of its line, and what is wrong with them."""

    values: dict[int, list[int]]
    problems: list[str]


def recorded_values(file: Path, services: Mapping[str, Service]) -> Recorded:
    """Return what the requests of a file ask for, in the units of ``Service.values``.

    A request for one time has columns ``required_s`` and ``bandwidth_kbps``. Others have a column
    for each list of their service, by its name; where a column or its value is missing, a list of
    one value has this one. Raises ValueError if the file is not such a table.
    """
    recorded = Recorded({}, [])
    most = catalogue(services, dict.fromkeys(services, 1.0)).most
    for number, (name, service) in enumerate(services.items()):
        lists = list(service.values())
        names = ["required_s", "bandwidth_kbps"] if is_one_time(service) else lists
        table = read_table(file, {"service": str}, dict.fromkeys(names, str))
        own = [(line, cells) for kind, *cells, line in table if kind == name]
        lines = [line for line, _ in own]
        columns = []
        for k, column in enumerate(names):
            cells = [each[k] for _, each in own]
            read = _Column(file, name, service, column, lines, cells, int(most[number, k]))
            recorded.problems.extend(read.problems())
            columns.append(read.numbers() if not recorded.problems else [0] * len(lines))
        if collecting_of(service) is not None:
            sent = f"service: {name!r}: only sensors send it, by demand: {{kind: sensing}}"
            recorded.problems.extend(f"{file}:{line}: {sent}" for line in lines)
        recorded.values.update(zip(lines, map(list, zip(*columns, strict=True)), strict=True))
    return recorded


@dataclass(frozen=True)
class _Column:
    """The cells of a column in the lines of one service; None where there is none."""

    file: Path
    name: str
    service: Service
    column: str
    lines: Sequence[int]
    cells: Sequence[str | None]
    most: int

    @property
    def timed(self) -> bool:
        """Whether the service asks for one time, so that all columns must be there."""
        return is_one_time(self.service)

    @property
    def has_list(self) -> bool:
        """Whether the service has a list of values, of which the cells could be some."""
        own: set[str] = (
            {one.name for one in fields(self.service)} if is_dataclass(self.service) else set()
        )
        return self.column in own and getattr(self.service, self.column) is not None

    def problems(self) -> Iterator[str]:
        """Yield what is wrong, with file and line."""
        for line, cell in zip(self.lines, self.cells, strict=True):
            try:
                problem = self._missing() if cell is None else self._wrong(quantity(cell))
            except ValueError as error:
                problem = str(error)
            if problem:
                value = "" if cell is None else f"{in_short(cell)}: "
                yield f"{self.file}:{line}: {self.column}: {value}{problem}"

    def _missing(self) -> str:
        if self.timed:
            return f"missing; {self.name} asks for a time and a rate"
        count = len(self.service.values()[self.column])
        return f"missing; services.{self.name} has {count} values" if count > 1 else ""

    def _wrong(self, cell: float) -> str:
        if self.timed:
            return ""
        if not self.has_list:
            return f"services.{self.name} must have {self.column} to take it from a file"
        for limit in _limits(get_type_hints(type(self.service), include_extras=True)[self.column]):
            attribute, holds, words = LIMITS[type(limit)]
            bound = getattr(limit, attribute)
            if not holds(cell, bound):
                return f"must be {words} {bound:g}"
        if self._converted([cell])[0] > self.most:
            largest = max(getattr(self.service, self.column))
            return f"must be at most {largest:g}, the largest of services.{self.name}"
        return ""

    def numbers(self) -> list[int]:
        """Return the values; call this only if there are no problems."""
        if self.timed:
            scale = US if self.column == "required_s" else 1000
            return [round(float(cell or 0.0) * scale) for cell in self.cells]
        given = [float(cell) for cell in self.cells if cell is not None]
        converted = iter(self._converted(given) if given else [])
        only = int(self.service.values()[self.column][0])
        return [only if cell is None else next(converted) for cell in self.cells]

    def _converted(self, cells: Sequence[float]) -> list[int]:
        """Return cells in the units of the service, as if its list had them."""
        twin: Any = replace(self.service, **{self.column: tuple(cells)})  # type: ignore[type-var]
        return [int(value) for value in np.asarray(twin.values()[self.column])]


def _limits(hint: Any) -> Iterator[Any]:
    """Yield the limits of numbers in an annotation, those of elements too."""
    yield from (one for one in getattr(hint, "__metadata__", ()) if type(one) in LIMITS)
    for part in get_args(hint):
        if not isinstance(part, Ge | Gt | Le | Lt):
            yield from _limits(part)
