"""What published papers print, beside what is computed here."""

import importlib.util
import json
import math
import re
from pathlib import Path

import pytest

from desim_uav.experiment import gallery as work
from desim_uav.experiment.gallery import (
    ENTRIES,
    a3,
    al_hourani,
    andrews,
    mozaffari_2015,
    mozaffari_2016,
    wu_2018,
)
from desim_uav.experiment.gallery.row import GalleryRow, evaluated
from desim_uav.model.radio.path_loss import AlHourani
from tests.command_line import runner

DOCS = Path(__file__).parents[2] / "docs"
OPEN = {"mozaffari_2015": 5, "wu_2018": 5}


@pytest.fixture
def cli_run(capsys, monkeypatch):
    return runner(capsys, monkeypatch)


def table_of(name):
    """The rows of a paper's table in the documentation: their cells."""
    text = figures().gallery().partition(f"## {name}\n")[2].partition("\n## ")[0]
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines[2:]]


def figures():
    """The module that makes the tables of the documentation."""
    folder = DOCS / "_ext"
    spec = importlib.util.spec_from_file_location("figures", folder / "figures.py")
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        spec.loader.exec_module(module)
    return module


def test_the_documentation_says_how_many_hold_and_what_each_paper_is():
    found = json.loads((DOCS / "_data" / "gallery.json").read_text(encoding="utf-8"))
    said = f"{found['hold']} of {found['hold'] + found['fail']} figures hold, {found['open']} are"
    page = (DOCS / "literature.md").read_text(encoding="utf-8")
    assert said in page and found["open"] == sum(OPEN.values())
    assert [paper["name"] for paper in found["papers"]] == list(ENTRIES)
    assert all(f"\n**{name}.** " in page for name in ENTRIES)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ENTRIES)
def test_a_paper_holds_and_the_documentation_says_what_is_computed(name):
    (compared,) = work.gallery([name])
    assert compared.rows
    assert json.loads(json.dumps(compared.content()))["name"] == name
    for row in compared.rows:
        assert row.holds is not False, row
    apart = work.COLUMNS.index("apart")  # rounding errors, which other computers have others of
    shown = [cells[:apart] + cells[apart + 1 :] for cells in table_of(name)]
    found = [list(row.cells()) for row in compared.rows]
    assert shown == [cells[:apart] + cells[apart + 1 :] for cells in found]


def test_the_open_questions_are_known():
    compared = work.gallery(["mozaffari_2015"])
    counted = work.count(compared)
    assert counted == {"hold": 4, "fail": 0, "open": OPEN["mozaffari_2015"]}
    assert work.summary(compared) == "4 of 4 figures hold, 5 are open"


class TestRows:
    def test_holds(self):
        row = GalleryRow("x", "", 1.0, 1.04, 0.05, 2)
        assert row.holds and row.apart == pytest.approx(0.04)
        assert GalleryRow("x", "", 1.0, 1.06, 0.05, 2).holds is False
        assert GalleryRow("x", "", 1.0, math.nan, 0.05, 2).holds is False
        assert GalleryRow("x", "", 1.0, 9.0, None, 2).holds is None

    def test_half_a_unit_of_the_last_digit(self):
        assert evaluated("x", "", 20.34, 20.345, 2).holds
        assert not evaluated("x", "", 20.34, 20.3451, 2).holds


class TestComputed:
    """Each figure is computed, not copied: it follows what it depends on."""

    def test_a_best_altitude_follows_the_environment(self, monkeypatch):
        other = {"suburban": AlHourani(a=4.88, b=0.429, eta_los_db=0.1, eta_nlos_db=21.0)}
        monkeypatch.setattr(
            al_hourani, "AlHourani", lambda name: other.get(name, AlHourani("urban"))
        )
        rows = {row.figure: row.holds for row in al_hourani.rows()}
        assert rows["suburban: best elevation, degrees"] is False  # b = 0.429 is another model
        assert rows["urban: best elevation, degrees"] is True

    def test_the_bound_of_the_least_rate_follows_the_height_and_the_users(self, monkeypatch):
        assert wu_2018.least_rate_bound(3) == 2.0 * wu_2018.least_rate_bound(6)
        monkeypatch.setattr(wu_2018, "HEIGHT_M", 200.0)  # a quarter of the power
        assert wu_2018.least_rate_bound(1) == pytest.approx(math.log2(251.0))

    def test_packed_discs_neither_overlap_nor_reach_out(self):
        for count, optimum in mozaffari_2016.OPTIMA.items():
            radius, centres = mozaffari_2016.packing(count)
            assert len(centres) == count and radius <= optimum + 1e-9
            for k, one in enumerate(centres):
                assert math.hypot(*one) + radius <= 1.0 + 1e-9
                for other in centres[:k]:
                    assert math.dist(one, other) >= 2.0 * radius - 1e-9

    def test_the_simulated_coverage_is_the_closed_form_elsewhere_too(self):
        ratios = andrews.simulated_db()
        for threshold in (-5.0, 5.0, 15.0):
            share = andrews.closed_form(threshold)
            error = math.sqrt(share * (1.0 - share) / len(ratios))
            assert abs((ratios > threshold).mean() - share) < 4.0 * error

    def test_the_closed_form_is_what_was_evaluated_apart(self):
        for threshold, share in andrews.EVALUATED.items():
            assert round(andrews.closed_form(threshold), 6) == share

    def test_a_handover_is_on_the_circle_of_apollonius(self):
        for (margin_db, exponent), ratio in {(3.0, 3.76): 1.201676, (3.0, 2.0): 1.412538}.items():
            place = a3.handover_m(margin_db, exponent)
            assert round(place / (a3.LINE_M - place), 6) == ratio
        assert a3.handover_m(0.0, 3.0) == 250.0

    def test_two_discs_touch_where_the_paper_has_its_best_separation(self):
        covered = mozaffari_2015.covered_share
        touching, apart = (covered(d, 2000.0, interference=False) for d in (900.0, 1000.0))
        assert touching == pytest.approx(apart, abs=2e-4)  # neither reaches out of the rectangle
        assert covered(800.0, 2000.0, interference=False) < touching - 0.01
        assert covered(1300.0, 2000.0, interference=False) < touching - 0.01


class TestCommand:
    def test_table(self, cli_run):
        done = cli_run("gallery", "event_a3")
        said = done.err.splitlines()[-1]  # before it, if nothing is compiled yet, a note on that
        assert (done.code, said) == (0, "desim-uav: 3 of 3 figures hold, 0 are open")
        assert "272.9002" in done.out and "Al-Hourani" not in done.out

    def test_json(self, cli_run):
        done = cli_run("gallery", "event_a3", "tr_36777", "event_a3", "--json")
        assert [paper["name"] for paper in done.json["papers"]] == ["event_a3", "tr_36777"]
        assert (done.json["hold"], done.json["fail"], done.json["open"]) == (15, 0, 0)
        row = done.json["papers"][0]["rows"][0]
        assert row["theirs"] == 272.9002 and row["holds"] is True
        assert row["ours"] == pytest.approx(272.9002, abs=5e-5)

    def test_a_figure_that_does_not_hold(self, cli_run, monkeypatch):
        monkeypatch.setattr(a3, "LINE_M", 501.0)
        done = cli_run("gallery", "event_a3")
        assert done.code == 6 and "0 of 3 figures hold" in done.err and "NO" in done.out

    def test_an_unknown_paper(self, cli_run):
        done = cli_run("gallery", "andrews_2012")
        done.failed(2, "no such paper: 'andrews_2012' (did you mean 'andrews_2011'?)")

    def test_figures_and_markdown(self, cli_run, tmp_path):
        page = tmp_path / "tables.md"
        names = ("event_a3", "al_hourani_2014", "mozaffari_2016")
        done = cli_run("gallery", *names, "--figure", tmp_path / "new", "--markdown", page)
        assert done.code == 0
        drawn = sorted(file.name for file in (tmp_path / "new").iterdir())
        assert drawn == ["al_hourani_2014.png", "mozaffari_2016.png"]
        assert "event_a3 has no figure" in done.err
        text = page.read_text(encoding="utf-8")
        assert len(re.findall("^### ", text, re.MULTILINE)) == 3
        assert "| 20.34 | 20.34 |" in text

    def test_a_place_that_cannot_be_written(self, cli_run, tmp_path):
        done = cli_run("gallery", "event_a3", "--markdown", tmp_path)
        done.failed(2, "exists and is not a file")


@pytest.mark.thorough
@pytest.mark.parametrize("name", [name for name, one in ENTRIES.items() if one.draw is not None])
def test_every_figure_can_be_drawn(name):
    figure = ENTRIES[name].draw()
    assert figure.axes and all(axes.has_data() for axes in figure.axes)
