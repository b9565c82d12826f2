"""Writes the parts of the reference that the code itself knows, each time the site is built.

They stand in ``_generated``: the commands (from typer), the keys of a scenario (from the JSON
Schema), the columns of the tables (from ``desim_uav.records``), the measures (from
``desim_uav.measures.known``), and the table of the paper (from what ``desim-uav reproduce`` has
left in ``analysis/paper``), the figures of the verification (from
``docs/_data``), and those of published papers (from what ``desim-uav paper`` has printed). The
pages include them.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import cases
import commands
import figures
import measures
import paper
import scenario_keys
import tables

from desim_uav.experiment.papers import ENTRIES

PARTS = {
    "commands.md": commands.markdown,
    "scenario_keys.md": scenario_keys.markdown,
    "tables.md": tables.markdown,
    "measures.md": measures.markdown,
    "measures_compared.md": measures.compared,
    "cases.md": cases.markdown,
    "paper_table.md": paper.default_table,
    "paper_preset.md": paper.paper_table,
    "claims.md": paper.claims,
    "verification.md": figures.verification,
    "mutations.md": figures.mutations,
    "papers.md": figures.papers,
    **{f"paper_of_{name}.md": partial(figures.paper, name) for name in ENTRIES},
}


def write(folder: Path) -> None:
    """Write every part into ``folder``; a part that has not changed keeps its file."""
    folder.mkdir(exist_ok=True)
    for name, markdown in PARTS.items():
        text = markdown()
        file = folder / name
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("builder-inited", lambda app: write(Path(app.srcdir) / "_generated"))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
