"""The paper's table and claims, as ``desim-uav reproduce`` has left them in ``analysis/paper``."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "analysis" / "paper"


def default_table() -> str:
    """The nine cases with the default training, beside what the paper printed."""
    made: str = _script().markdown(RESULTS / "table.csv")
    return made


def paper_table() -> str:
    """The nine cases trained as the paper trained."""
    made: str = _script().markdown(RESULTS / "table.csv", "paper", printed=False)
    return made


def claims() -> str:
    """The table of claims that ``table.md`` ends with."""
    text = (RESULTS / "table.md").read_text(encoding="utf-8")
    return text[text.index("| claim |") :]


def _script() -> ModuleType:
    """``analysis/short_paper_table.py`` as a module."""
    spec = importlib.util.spec_from_file_location(
        "short_paper_table", ROOT / "analysis" / "short_paper_table.py"
    )
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
