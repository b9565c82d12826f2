"""Columns of tables: their types, what they hold, and tables with them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

TEXT, LIST = "str", "object"
INT, FLOAT, BOOL, MAYBE = "int64", "float64", "bool", "boolean"
NULLABLE = ("Int64", MAYBE)
"""The types of columns that have pandas' own null value."""


class Columns(dict[str, str]):
    """The columns of a table: the dtype of each by name, in order.

    ``about`` says what a row of the table is, and ``meanings`` what each column holds. ``more`` are
    the columns that only tables of some scenarios have, after the others.
    """

    def __init__(self, about: str, *more: Columns, **columns: tuple[str, str]) -> None:
        super().__init__((name, dtype) for name, (dtype, _) in columns.items())
        self.about = about
        self.meanings = {name: meaning for name, (_, meaning) in columns.items()}
        self.more: dict[str, str] = {}
        for others in more:
            self.more |= others
            self.meanings |= others.meanings

    def among(self, names: Iterable[str]) -> dict[str, str]:
        """Return the columns of a table that has these names: all but those that it lacks."""
        there = set(names)
        return {**self, **{name: dtype for name, dtype in self.more.items() if name in there}}


def arrow_schema(columns: dict[str, str]) -> pa.Schema:
    """Return the types of a table in its Parquet file, which do not depend on its rows."""
    import pyarrow as pa

    types = {
        TEXT: pa.string(),
        LIST: pa.list_(pa.int64()),
        INT: pa.int64(),
        "Int64": pa.int64(),
        FLOAT: pa.float64(),
        BOOL: pa.bool_(),
        MAYBE: pa.bool_(),
    }
    return pa.schema([(name, types[dtype]) for name, dtype in columns.items()])


def misfit(columns: dict[str, str], table: pa.Table) -> str | None:
    """Return why a table does not have these ``columns`` and types, or None if it has."""
    import pyarrow.compute as pc
    from pyarrow import types

    fits = {
        TEXT: (types.is_string, types.is_large_string),
        LIST: (types.is_list, types.is_large_list),
        INT: (types.is_integer,),
        "Int64": (types.is_integer,),
        FLOAT: (types.is_floating,),
        BOOL: (types.is_boolean,),
        MAYBE: (types.is_boolean,),
    }
    if isinstance(columns, Columns):
        columns = columns.among(table.column_names)
    expected = arrow_schema(columns)
    for name, dtype in columns.items():
        if table.column_names.count(name) != 1:
            return f"no column {name!r}"
        column = table[name]
        if not any(is_one(column.type) for is_one in (types.is_null, *fits[dtype])):
            return f"column {name!r} holds {column.type}, not {expected.field(name).type}"
        if dtype in (INT, BOOL) and column.null_count:
            return f"column {name!r} has empty values"
        if types.is_floating(column.type) and pc.any(pc.is_inf(column)).as_py():
            return f"column {name!r} has infinite values"
    return None


def to_frame(columns: dict[str, str], rows: Iterable[tuple[Any, ...]]) -> pd.DataFrame:
    """Return a table made of rows, whose values are in the order of ``columns``; None is null."""
    import pandas as pd

    by_column = list(zip(*rows, strict=True)) or [()] * len(columns)
    return pd.DataFrame(
        {
            name: pd.Series(values, dtype=dtype)
            for (name, dtype), values in zip(columns.items(), by_column, strict=True)
        }
    )
