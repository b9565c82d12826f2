"""Published experiments: what papers print, beside what is computed here."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from desim_uav.experiment.papers import (
    ENTRIES,
    a3,
    age_queues,
    al_hourani,
    andrews,
    brunori,
    do_2026,
    fly_hover,
    mozaffari_2015,
    mozaffari_2016,
    wang_2021,
    work,
    wu_2018,
    zeng,
)
from desim_uav.experiment.papers.row import FigureRow, evaluated
from desim_uav.model.radio.path_loss import AlHourani
from tests.command_line import runner
from tests.verification import age_laws
from tests.verification.figure import Estimate

DOCS = Path(__file__).parents[2] / "docs"
MINUTES = {"brunori_2021", "kaul_2012", "costa_2016", "do_2026", "bayerlein_2021"}
"""The papers that take minutes."""


@pytest.fixture
def cli_run(capsys, monkeypatch):
    return runner(capsys, monkeypatch)


def test_every_paper_has_been_measured_and_has_its_section():
    page = (DOCS / "papers.md").read_text(encoding="utf-8")
    assert list(work.measured()) == list(ENTRIES)
    for name, known in work.measured().items():
        assert f"\n## {name}\n" in page and f"_generated/paper_of_{name}.md" in page
        assert known["rows"] and known["seconds"] > 0 and known["peak_mib"] > 0
        assert ENTRIES[name].compared
    assert all((work.HERE / file).is_file() for one in ENTRIES.values() for file in one.scenarios)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name in MINUTES else pytest.mark.thorough)
        for name in ENTRIES
    ],
)
def test_a_paper_holds_and_the_documentation_says_what_is_computed(name):
    computed = work.compute(name)
    for row in computed.rows:
        assert row.holds is not False, row
    apart = work.COLUMNS.index("apart")  # rounding errors, which other computers have others of
    known = [
        FigureRow(**{k: v for k, v in row.items() if k not in {"apart", "holds"}})
        for row in work.measured()[name]["rows"]
    ]
    shown, found = ([row.cells() for row in rows] for rows in (known, computed.rows))
    assert [one[:apart] + one[apart + 1 :] for one in shown] == [
        one[:apart] + one[apart + 1 :] for one in found
    ]


def test_the_open_questions_are_known():
    computed = work.compute("mozaffari_2015")
    assert computed.count() == {"hold": 4, "fail": 0, "open": 5}
    assert computed.summary() == "4 of 4 figures hold, 5 are open"


def test_a_diagram_shows_ours_and_what_it_is_compared_with():
    axes = zeng.draw().axes[0]
    curve, points, _ = axes.lines
    assert dict(points.get_xydata().tolist()) == zeng.POWERS_W
    ours = np.interp(points.get_xdata(), *curve.get_xydata().T)
    assert ours == pytest.approx(list(zeng.POWERS_W.values()), abs=5e-4)
    assert [text.get_text() for text in axes.get_legend().texts] == ["ours", zeng.APART]


class TestRows:
    def test_holds(self):
        row = FigureRow("x", "", 1.0, 1.04, 0.05, 2)
        assert row.holds and row.apart == pytest.approx(0.04)
        assert FigureRow("x", "", 1.0, 1.06, 0.05, 2).holds is False
        assert FigureRow("x", "", 1.0, math.nan, 0.05, 2).holds is False
        assert FigureRow("x", "", 1.0, 9.0, None, 2).holds is None

    def test_more_is_as_good(self):
        more = FigureRow("x", "", 1.0, 9.0, 0.1, 2, at_least=True)
        assert more.holds and more.apart == 0.0
        assert FigureRow("x", "", 1.0, 0.95, 0.1, 2, at_least=True).holds
        assert FigureRow("x", "", 1.0, 0.8, 0.1, 2, at_least=True).holds is False

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

    def test_the_best_scheme_follows_the_throughput(self):
        nodes, cost = fly_hover.drawn_nodes(0), fly_hover.COSTS["energy"]
        one, each = fly_hover.at_centre, fly_hover.above_each
        assert one(nodes, 1e5, cost).cost < each(nodes, 1e5, cost).cost
        assert one(nodes, 1e9, cost).cost > each(nodes, 1e9, cost).cost
        path, both = fly_hover.optimised(nodes, 1e8, cost), fly_hover.continuous(nodes, 1e8, cost)
        assert both.places == pytest.approx(path.places)
        # What the flight sends: no more than all of it at the rate of a node right below.
        saved_s = path.hovers_s.sum() - both.hovers_s.sum()
        assert 0.0 < saved_s < sum(fly_hover.ways_m(path.places)) / cost.speed_mps + 1.0

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


class TestAges:
    def test_a_mean_age_by_hand(self, monkeypatch):
        """From 1 s to 5 s, with deliveries at 1, 3 and 4 s of what was taken at 0, 2 and 1 s."""
        monkeypatch.setattr(age_queues, "WARMING_S", 1.0)
        times = np.array([0.0, 1.0, 2.0]), np.array([1.0, 4.0, 3.0])
        assert age_queues.mean_age_s(*times, 5.0) == pytest.approx((4.0 + 4.0) / 4.0)

    def test_what_was_taken_before_counts_when_counting_begins(self, monkeypatch):
        monkeypatch.setattr(age_queues, "WARMING_S", 2.0)
        times = np.array([0.0, 3.0]), np.array([1.0, 4.0])
        assert age_queues.mean_age_s(*times, 5.0) == pytest.approx((6.0 + 1.5) / 3.0)

    def test_the_laws_are_those_of_the_verification(self):
        for name in ("m_m_1", "m_d_1", "d_m_1", "m_m_1_1", "m_m_1_2", "m_m_1_2_newest"):
            for load in (0.3, 0.6, 0.9):
                ours, other = getattr(age_queues, name)(load), getattr(age_laws, name)(load)
                assert ours == pytest.approx(other, rel=1e-12)

    def test_the_best_load_of_exact_ages(self, monkeypatch):
        exact = {name: queue.law for name, queue in age_queues.FIRST_COME.items()}
        monkeypatch.setattr(age_queues, "ages_s", lambda name, load: np.full(3, exact[name](load)))
        for name, queue in age_queues.FIRST_COME.items():
            load, error = age_queues.best_load(name)
            assert load == pytest.approx(queue.least[1], abs=3e-3) and error < 1e-6


class TestTasks:
    def test_delays_are_those_of_the_formulas(self):
        theory = wang_2021.formulas_s(100)
        known = {"local": 174.7627, "edge only": 97.9016, "best split": 62.7495}
        assert theory == pytest.approx(known, abs=5e-5)
        for line, delay_s in theory.items():
            assert wang_2021.simulated_s(line, 100) == pytest.approx(delay_s, abs=2e-6)


class TestPads:
    def test_the_closed_queue(self):
        """One machine and one repairer never wait; of two, each waits for what is left."""
        wait_s, mean_s = do_2026.closed_queue_s, do_2026.CHARGING_S
        assert wait_s(3, 3, 1000.0) == wait_s(1, 1, 1000.0) == 0
        ratio = mean_s / 1000.0
        shares = np.array([1.0, 2 * ratio, 2 * ratio**2]) / (1 + 2 * ratio + 2 * ratio**2)
        arrivals = (2 * shares[0] + shares[1]) / 1000.0
        assert wait_s(2, 1, 1000.0) == pytest.approx(shares[2] / arrivals, rel=1e-12)

    @pytest.mark.thorough
    def test_the_best_numbers_of_the_closed_queue(self):
        for pads, printed in do_2026.BY_FORMULA.items():
            assert do_2026.best_by_formula(pads) == printed

    @pytest.mark.thorough
    def test_waits_for_one_pad_are_those_of_the_formula(self, monkeypatch):
        """M/D/1//5: exponential times between charges, and charging in a fixed time."""
        monkeypatch.setattr(do_2026, "between_charges_s", lambda drones: 1700.0)
        monkeypatch.setattr(do_2026, "SEEDS", range(12))
        found = do_2026.waits_s.__wrapped__(5, 1, "exponential")
        assert Estimate.of("", found.tolist(), one_pad_s(5, 1700.0)).holds


def one_pad_s(drones, between_s):
    """The mean wait in M/D/1//N, of which Takács has the law."""
    rate, product, total = 1 / between_s, 1.0, 0.0
    for n in range(drones):
        total += math.comb(drones - 1, n) * product
        product *= math.exp((n + 1) * rate * do_2026.CHARGING_S) - 1
    idle = 1 / (1 + drones * rate * do_2026.CHARGING_S * total)
    return drones * do_2026.CHARGING_S / (1 - idle) - between_s - do_2026.CHARGING_S


class TestCases:
    def test_rows_of_a_case(self):
        done = [
            {"policy": policy, "qoe3_percent": qoe3}
            for policy, values in {
                "baseline": (20, 30),
                "q_learning": (99, 101),
                "sarsa": (90, 90),
            }.items()
            for qoe3 in values
        ]
        *single, best = brunori.rows_of(1, done)
        assert [(row.theirs, row.ours) for row in single] == [(15, 25), (100, 100), (98, 90)]
        assert all(row.holds is None for row in single)
        assert best.theirs == 100 and best.holds and best.limit == pytest.approx(4.0)

    @pytest.mark.thorough
    def test_trainings_that_have_ended_are_kept(self, monkeypatch, tmp_path):
        monkeypatch.setattr(brunori, "FOLDER", tmp_path)
        monkeypatch.setattr(brunori, "SEEDS", range(100, 102))
        monkeypatch.setattr(brunori, "EPISODES", 5)
        first = brunori.finished(1)
        files = {file: file.stat().st_mtime_ns for file in (tmp_path / "jobs").iterdir()}
        assert len(files) == len(first) == 6
        again = brunori.finished(1)
        assert sorted(again, key=str) == sorted(first, key=str)
        assert files == {file: file.stat().st_mtime_ns for file in files}


class TestCommand:
    @pytest.fixture(autouse=True)
    def somewhere(self, monkeypatch, tmp_path):
        monkeypatch.chdir(tmp_path)

    def test_table_and_folder(self, cli_run, tmp_path):
        done = cli_run("paper", "event_a3")
        assert done.code == 0 and "3 of 3 figures hold, 0 are open" in done.err
        assert "272.9002" in done.out
        folder = tmp_path / "runs" / "paper_event_a3"
        assert {file.name for file in folder.iterdir()} == {"SHA256SUMS", "paper.json", "table.md"}
        text = (folder / "table.md").read_text(encoding="utf-8")
        assert "| 272.9002 | 272.9002 |" in text and "`desim-uav paper event_a3` took" in text

    def test_json(self, cli_run):
        done = cli_run("paper", "event_a3", "--json", "--out", "here")
        assert (done.json["hold"], done.json["fail"], done.json["open"]) == (3, 0, 0)
        row = done.json["rows"][0]
        assert row["theirs"] == 272.9002 and row["holds"] is True
        assert row["ours"] == pytest.approx(272.9002, abs=5e-5)
        kept = json.loads(Path("here/paper.json").read_text(encoding="utf-8"))
        assert kept == done.json

    def test_the_scenario_and_the_figure_are_kept(self, cli_run, monkeypatch):
        monkeypatch.setitem(
            ENTRIES,
            "event_a3",
            work.Entry("x", a3.rows, al_hourani.draw, scenarios=("do_2026.yaml",)),
        )
        assert cli_run("paper", "event_a3", "--out", "here").code == 0
        assert Path("here/figure.png").read_bytes().startswith(b"\x89PNG")
        assert Path("here/do_2026.yaml").read_bytes() == (work.HERE / "do_2026.yaml").read_bytes()

    def test_a_figure_that_does_not_hold(self, cli_run, monkeypatch):
        monkeypatch.setattr(a3, "LINE_M", 501.0)
        done = cli_run("paper", "event_a3")
        assert done.code == 6 and "0 of 3 figures hold" in done.err and "NO" in done.out

    def test_an_unknown_paper(self, cli_run):
        done = cli_run("paper", "andrews_2012")
        done.failed(2, "no such paper: 'andrews_2012' (did you mean 'andrews_2011'?)")

    def test_all_in_a_table(self, cli_run):
        assert all(name in cli_run("paper").out for name in ENTRIES)
        listed = cli_run("paper", "--json").json
        assert [one["name"] for one in listed] == list(ENTRIES)
        for one in listed:
            rows = work.measured()[one["name"]]["rows"]
            assert one["hold"] + one["fail"] + one["open"] == len(rows)

    def test_a_folder_that_is_there(self, cli_run, tmp_path):
        (tmp_path / "there").mkdir()
        (tmp_path / "there" / "mine").touch()
        done = cli_run("paper", "event_a3", "--out", "there")
        assert done.code == 2 and "there" in done.err

    def test_nothing_is_left_if_the_figure_fails(self, cli_run, monkeypatch, tmp_path):
        def fails():
            raise RuntimeError("no ink")

        monkeypatch.setitem(ENTRIES, "event_a3", work.Entry("x", a3.rows, fails))
        assert cli_run("paper", "event_a3", "--out", "here").code == 1
        assert not any(tmp_path.iterdir())


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name", [name for name, one in ENTRIES.items() if one.draw is not None and name not in MINUTES]
)
def test_every_figure_can_be_drawn(name):
    figure = ENTRIES[name].draw()
    assert figure.axes and all(axes.has_data() for axes in figure.axes)
