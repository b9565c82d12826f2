"""The table of clients names commands that exist, in a form that can be made again."""

from __future__ import annotations

from pathlib import Path

from tests.clients.rows import DISTRIBUTIONS, PAGE, rows

ROOT = Path(__file__).parents[2]
TABLE = rows(PAGE.read_text(encoding="utf-8"))


def test_each_row_can_be_made_again():
    text = PAGE.read_text(encoding="utf-8")
    assert {row.distribution for row in TABLE} == set(DISTRIBUTIONS.values())
    for row in TABLE:
        assert str(row) in text
        assert row.works == "yes"
        files = [word.partition("::")[0] for word in row.arguments if word.startswith("tests/")]
        assert files and all((ROOT / file).exists() for file in files)


def test_each_client_has_a_row():
    named = {word for row in TABLE for word in row.arguments}
    here = (f"tests/clients/{file.name}" for file in Path(__file__).parent.glob("test_*.py"))
    for file in here:
        if not file.endswith(("rows.py", "missing.py", "one_discount.py")):
            assert file in named
