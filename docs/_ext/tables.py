"""The tables of a run folder and their columns, as ``desim_uav.records`` has them."""

from __future__ import annotations

from markdown_table import table

from desim_uav import records

TYPES = {
    records.INT: "whole number",
    "Int64": "whole number or null",
    records.FLOAT: "number",
    records.BOOL: "true or false",
    records.TEXT: "text",
    records.LIST: "list of whole numbers",
}


def markdown() -> str:
    """One section for each table."""
    return "\n".join(
        f"### {name}.parquet\n\n{columns.about}\n\n"
        + table(
            ("Column", "Type", "Meaning"),
            ([f"`{c}`", TYPES[dtype], columns.meanings[c]] for c, dtype in columns.items()),
        )
        for name, columns in records.TABLES.items()
    )
