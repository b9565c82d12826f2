"""The tables of a run folder and their columns, as ``desim_uav.records`` has them."""

from __future__ import annotations

from markdown_table import table

from desim_uav import records

TYPES = {
    records.INT: "whole number",
    "Int64": "whole number or null",
    "boolean": "true, false or null",
    records.FLOAT: "number",
    records.BOOL: "true or false",
    records.TEXT: "text",
    records.LIST: "list of whole numbers",
}


def markdown() -> str:
    """One section for each table."""
    return "\n".join(
        f"### {file}.parquet\n\n{columns.about}\n\n"
        + table(
            ("Column", "Type", "Meaning"),
            (
                [f"`{name}`", TYPES[dtype], columns.meanings[name]]
                for name, dtype in (columns | columns.more).items()
            ),
        )
        for file, columns in records.TABLES.items()
    )
