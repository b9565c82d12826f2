"""What is recorded about how something was made."""

from __future__ import annotations

import ast
import sys

from desim_uav.experiment.provenance import PACKAGES, command
from tests.command_line import ROOT


def test_a_recorded_command_has_no_places_of_this_machine(tmp_path):
    program = str(ROOT / "policies" / "ppo.py")
    given = [program, str(tmp_path / "mine.yaml"), "--steps", "64", "--out", "some/where/a.npz"]
    assert command(given) == ["policies/ppo.py", "mine.yaml", "--steps", "64", "--out", "a.npz"]
    assert command(["policies/ppo.py", "-S", "world_seed=0"]) == [
        "policies/ppo.py",
        "-S",
        "world_seed=0",
    ]


COMPUTES = ("engine", "model", "rules", "sky", "rowcode", "city", "geodata", "measures")
"""The rooms whose code makes the tables of a run."""
FORMAL = {"annotated_types", "pydantic", "yaml", "gymnasium"}
"""What describes data there, and computes nothing."""


def test_every_package_that_makes_tables_is_recorded_with_its_version():
    files = [file for room in COMPUTES for file in (ROOT / "desim_uav" / room).rglob("*.py")]
    assert len(files) > 100
    imported = {
        name.partition(".")[0]
        for file in files
        for node in ast.walk(ast.parse(file.read_text()))
        for name in (
            [node.module]
            if isinstance(node, ast.ImportFrom) and node.module and not node.level
            else [one.name for one in node.names]
            if isinstance(node, ast.Import)
            else []
        )
    }
    others = imported - set(sys.stdlib_module_names) - {"desim_uav"} - FORMAL
    assert {"numpy", "shapely", "scipy"} <= others <= set(PACKAGES)
