"""The measures of runs, as ``desim_uav.measures.known`` has them."""

from __future__ import annotations

from markdown_table import table

from desim_uav.measures.known import EVERYWHERE, KNOWN, NOWHERE


def markdown() -> str:
    """Return a table of all measures, with the scenarios that have them."""
    return table(
        ("Measure", "Unit", "Better", "Meaning", "From the tables", "Null, or left out, if"),
        (
            [
                *(f"`{name}`", one.unit, one.better or "", one.meaning, one.table),
                one.where.lack,
            ]
            for name, one in KNOWN.items()
        ),
    )


def compared() -> str:
    """Return which measures comparisons and sweeps have."""
    always = [name for name, one in KNOWN.items() if one.compared is EVERYWHERE]
    others = [name for name, one in KNOWN.items() if one.compared not in (EVERYWHERE, NOWHERE)]
    return (
        f"In every scenario: {_listed(always)}.\n\nWhere services have them: {_listed(others)}.\n"
    )


def _listed(names: list[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)
