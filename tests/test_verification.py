"""The table of all checks is drawn, and a wrong figure or a test that sees nothing is noticed."""

import csv
import importlib
import json
import re
import runpy
import sys
from pathlib import Path

import pytest

from tests import mutation
from tests.mutation import MUTATIONS, Mutation
from tests.verification import placement, planning, transit
from tests.verification.figure import Estimate, Exact

ROOT = Path(__file__).parents[1]
SCRIPT = str(ROOT / "analysis" / "verification.py")
PARTS = runpy.run_path(SCRIPT)["PARTS"]
PAGE = ROOT / "docs" / "verification.md"
DATA = ROOT / "docs" / "_data"


@pytest.fixture
def ask(capsys, monkeypatch):
    """Run the script; (exit code, output, errors)."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", [SCRIPT, *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            runpy.run_path(SCRIPT, run_name="__main__")
        return end.value.code, *capsys.readouterr()

    return run


def rows(text):
    """The rows of all its tables: their cells."""
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]
    return [row for row in cells if row[0] and not set(row[0]) <= {"-"}]


def data_of(file):
    """Return the content of a JSON file."""
    return json.loads(file.read_text(encoding="utf-8"))


def last(text):
    """The last line of what was said: on a slow machine, lines before it say how far it is."""
    return text.splitlines()[-1]


def test_a_table_a_part(ask, tmp_path):
    code, out, err = ask("--quick", "--data", tmp_path / "new", "transit", "streams")
    assert (code, last(err)) == (0, f"{len(rows(out))} of {len(rows(out))} figures hold")
    assert re.findall("^### .*", out, re.MULTILINE) == [
        "### Transits against their closed forms",
        "### Random streams against NumPy's own generators, and their independence of each other",
    ]
    first = rows(out)[0]
    assert first[0] == "240 m in minimum time, s" and float(first[1]) == 30.990662650602406
    assert all(len(row) == 7 and row[-1] == "yes" for row in rows(out))
    parts = [data_of(tmp_path / "new" / f"{part}.json") for part in ("transit", "streams")]
    assert [tuple(row) for part in parts for row in part["rows"]] == [*map(tuple, rows(out))]
    assert parts[0]["about"] == "Transits against their closed forms"
    for part in parts:
        assert part["command"] == "python analysis/verification.py --quick transit streams"
        assert part["versions"].startswith("Python 3.") and part["processor"] and part["date"]


@pytest.mark.slow
def test_everything_holds_quickly(ask):
    code, out, _ = ask("--quick")
    found = rows(out)
    assert code == 0 and len(found) > 60
    assert {row[-1] for row in found} == {"yes"}
    assert len(re.findall("^### ", out, re.MULTILINE)) == 18


def test_a_wrong_figure_is_noticed(ask, monkeypatch):
    slow = transit.BangCoastBang(8.3, 3.999, "minimum_time")
    monkeypatch.setattr(transit, "FAST", slow)
    code, out, err = ask("transit")
    wrong = [row[0] for row in rows(out) if row[-1] == "NO"]
    assert code == 6
    assert "240 m in minimum time, s" in wrong and "240 m in 60 s: cruise, m/s" not in wrong
    assert last(err) == f"{len(rows(out)) - len(wrong)} of {len(rows(out))} figures hold"


def test_a_wrong_estimate_is_noticed(ask, monkeypatch):
    offsets = placement.offsets
    monkeypatch.setattr(placement, "offsets", lambda users: offsets(users) + 10.0)
    code, out, _ = ask("placement")
    wrong = {row[0] for row in rows(out) if row[-1] == "NO"}
    assert code == 6
    assert {"cut by disc: mean of x, m", "cut by disc: mean of y, m"} <= wrong


def test_a_part_that_fails_does_not_hold(ask, monkeypatch):
    def broken(_):
        yield Exact("one", 1.0, 1.0)
        raise AssertionError("two\nand more")

    monkeypatch.setattr(planning, "figures", broken)
    code, out, _ = ask("planning")
    assert code == 6
    assert [(row[0], row[-1]) for row in rows(out)] == [
        ("one", "yes"),
        ("AssertionError: two", "NO"),
    ]


def test_usage(ask, tmp_path):
    code, out, err = ask("transits")
    assert (code, out) == (2, "") and "no such part: transits" in err
    (tmp_path / "no").touch()
    code, _, err = ask("--data", tmp_path / "no", "transit")
    assert code == 2 and "verification.py: cannot write" in err


class TestFigures:
    def test_exact(self):
        assert Exact("", 1.0, 1.0).holds and not Exact("", 1.0, 1.0 + 1e-15).holds
        assert Exact("", 1.05, 1.0, 0.06).holds and not Exact("", 1.05, 1.0, 0.04).holds
        assert Exact("", 105.0, 100.0, 0.06, True).holds
        assert not Exact("", float("nan"), 1.0, 9.0).holds

    def test_estimates(self):
        values = [1.0, 2.0, 3.0, 4.0]
        found = Estimate.of("", values, 2.0)
        assert (found.ours, found.replications) == (2.5, 4)
        assert found.error == pytest.approx((5 / 3) ** 0.5 / 2)
        assert found.holds and not Estimate.of("", values, 5.2).holds
        assert not Estimate.of("", [2.0, 2.0], 2.5).holds


class TestMutations:
    @pytest.mark.parametrize("mutated", MUTATIONS, ids=lambda m: m.what)
    def test_the_source_is_as_it_says(self, mutated: Mutation):
        source = (ROOT / "desim_uav" / mutated.file).read_text(encoding="utf-8")
        assert mutated.applied(source) != source
        assert all((ROOT / "tests" / test).is_file() for test in mutated.tests)

    def test_no_error_is_noticed_by_a_comparison_of_the_engines_alone(self):
        both = "desim_uav.engine.compiled"
        for mutated in MUTATIONS:
            for test in mutated.tests:
                assert both not in (ROOT / "tests" / test).read_text(encoding="utf-8"), test

    def test_what_is_not_noticed_is_said(self, monkeypatch, capsys):
        first = MUTATIONS[0]
        failures = iter(["", "", "test_x.py::test_y"])
        monkeypatch.setattr(mutation, "MUTATIONS", (first, MUTATIONS[1]))
        monkeypatch.setattr(mutation, "_copy", lambda tree: copied(tree, MUTATIONS[:2]))
        monkeypatch.setattr(mutation, "_first_failure", lambda *_: next(failures))
        monkeypatch.setattr(sys, "argv", ["mutation.py"])
        assert mutation.main() == 6
        out, err = capsys.readouterr()
        assert [row[2] for row in rows(out)[1:]] == ["NOT NOTICED", "`test_x.py::test_y`"]
        assert "1 of 2 noticed" in err


def copied(tree, mutations):
    for mutated in mutations:
        file = tree / "desim_uav" / mutated.file
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes((ROOT / "desim_uav" / mutated.file).read_bytes())


class TestDocument:
    """The documentation has a table of every part that was run, and every mutation."""

    def test_every_mutation_is_noticed(self):
        with (DATA / "mutations.csv").open(encoding="utf-8", newline="") as file:
            headings, *found = csv.reader(file)
        assert tuple(headings) == mutation.COLUMNS
        assert {(m.what, f"`{m.file}`") for m in MUTATIONS} == {(row[0], row[1]) for row in found}
        assert all(re.fullmatch(r"`\S+\.py::.+`", row[2]) for row in found)
        assert f"All {len(MUTATIONS)} errors" in PAGE.read_text(encoding="utf-8")

    def test_every_figure_holds(self):
        files = {file.stem: data_of(file) for file in (DATA / "verification").iterdir()}
        assert files.keys() <= set(PARTS) and set(PARTS) - files.keys() <= {"links"}
        assert {row[-1] for part in files.values() for row in part["rows"]} == {"yes"}
        there = {row[0] for row in files["transit"]["rows"]}
        assert {figure.what for figure in transit.figures()} <= there
        page = PAGE.read_text(encoding="utf-8")
        total = sum(len(part["rows"]) for part in files.values())
        assert f"All {total} figures hold" in page
        counted = {name: len(part["rows"]) for name, part in files.items()}
        listed = re.findall(r"^\| `(\w+)` \| .* \| (\d+|-) \|$", page, re.MULTILINE)
        assert dict(listed) == {part: str(counted.get(part, "-")) for part in PARTS}

    def test_the_page_of_figures_has_the_data(self, monkeypatch):
        monkeypatch.syspath_prepend(ROOT / "docs" / "_ext")
        figures = importlib.import_module("figures")
        shown = rows(figures.verification())
        for file in (DATA / "verification").iterdir():
            part = data_of(file)
            assert f"## {part['about']}\n\n`{part['command']}`" in figures.verification()
            assert all([cell.replace("|", "\\|") for cell in row] in shown for row in part["rows"])
        assert len(rows(figures.mutations())) == len(MUTATIONS) + 1
