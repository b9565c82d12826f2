"""Reports: what they say is what the tables say, and what a folder holds stays text."""

import json
import os
import re
import shutil
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pandas as pd
import pytest

from desim_uav import cli, qoe
from desim_uav.api.pictures import write_report as report
from desim_uav.errors import PolicyError
from desim_uav.experiment import report as reporting
from desim_uav.experiment.compare_runs import compare_runs
from desim_uav.experiment.statistics import estimate
from desim_uav.measures.known import ALWAYS, looks
from desim_uav.parquet_file import parquet
from desim_uav.report import page as page_module
from desim_uav.report import run_page
from desim_uav.report.markup import Html
from desim_uav.report.text import MEASURES
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from tests.report.helpers import read_counted
from tests.run_to_folder import run_to_folder
from tests.selection import by_default

SMALL = ("users.count=12", "episode.steps=10")
HOSTILE = "</style><script>alert(1)</script>\u202e$\\frac$ \"'onload=x " + "w" * 300


class Page(HTMLParser):
    """A page taken apart: its elements, the text of each table's cells, and of all."""

    def __init__(self, file):
        super().__init__()
        self.source = file.read_text(encoding="utf-8")
        self.elements, self.tables, self.words = [], [], []
        self.section = None
        self.feed(self.source)
        self.close()

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.elements.append((tag, attributes))
        if tag == "section":
            self.section = attributes["id"]
        elif tag == "table":
            self.tables.append((self.section, []))
        elif tag == "tr":
            self.tables[-1][1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][1][-1].append("")
            self.in_cell = True
        elif tag == "small":
            self.handle_data(" ")

    def handle_endtag(self, tag):
        if tag in ("td", "th"):
            self.in_cell = False

    in_cell = False

    def handle_data(self, data):
        self.words.append(data)
        if self.in_cell:
            self.tables[-1][1][-1][-1] += data

    @property
    def text(self):
        return "".join(self.words)

    def of(self, section):
        """The tables of a section, each a list of rows."""
        return [rows for where, rows in self.tables if where == section]

    def links(self, start):
        found = (attributes.get("href", "") for tag, attributes in self.elements if tag == "a")
        return [link for link in found if start in link]


def played(place, policy, seed, *overrides, case="case8", episodes=2):
    done = run_to_folder(
        load(scenario_path(case), [*SMALL, f"seed={seed}", *overrides]),
        policy,
        episodes=episodes,
        warmup=1,
        keep_events=False,
        out=place / f"{policy}-{seed}",
        command=["desim-uav", "run", "a b"],
    )
    return Path(done.summary["run_dir"])


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Three policies, three seeds; not to be written to."""
    place = tmp_path_factory.mktemp("kept")
    return [played(place, p, s) for p in ("baseline", "random", "hover") for s in (0, 1, 2)]


@pytest.fixture
def runs(kept, tmp_path, monkeypatch):
    """Copies in the working folder, named as a user names them."""
    monkeypatch.chdir(tmp_path)
    return copied(kept, tmp_path)


def copied(kept, place):
    for folder in kept:
        shutil.copytree(folder, place / "runs" / folder.name)
    return [Path("runs") / folder.name for folder in kept]


@pytest.fixture(scope="module")
def page(kept, tmp_path_factory):
    """Of all runs, under the names they have in ``runs``."""
    place = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        folders = copied(kept, place)
        return Page(place / report(folders, None, "Three policies", None))


@pytest.fixture(scope="module")
def one_page(kept, tmp_path_factory):
    """The page of the first run alone, under the name that it has in ``runs``."""
    place = tmp_path_factory.mktemp("one")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        return Page(place / report(copied(kept[:1], place), None, None, None))


@pytest.fixture
def undrawn(monkeypatch):
    """Figures are left empty, because a test looks at everything but them."""
    monkeypatch.setattr(page_module, "drawn", lambda draw, label, number: Html("<svg></svg>"))


@pytest.fixture
def command(capsys, monkeypatch):
    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["desim-uav", "report", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, *capsys.readouterr()

    return run


def formatted(rows, by, looks):
    def cell(row, name, form):
        value = row.get(name)
        return "" if value is None else format(value, form)

    return [[str(row[by]), *(cell(row, n, f) for n, (_, f) in looks.items())] for row in rows]


class TestOneRun:
    def test_holds_the_measures(self, one_page, runs):
        summary, requests = read_counted(runs[0])
        by_service, by_episode = one_page.of("quality-of-experience")
        every = [{"service": "all"} | summary, *qoe.grouped(requests, "service")]
        assert by_service[1:] == formatted(every, "service", MEASURES)
        episodes = pd.read_parquet(runs[0] / "episodes.parquet").tail(2)
        for row, said in zip(by_episode[1:], episodes.itertuples(), strict=True):
            told = dict(zip(by_episode[0], row, strict=True))
            assert told["QoE1\u00a0%"] == f"{said.qoe1_percent:.1f}"
            assert told["QoE3\u00a0%"] == f"{said.qoe3_percent:.1f}"
            assert (told["requests"], told["reward"]) == (str(said.requests), f"{said.reward:.2f}")
        assert f"{summary['qoe3_percent']:.1f} %" in one_page.text
        assert f"{summary['completed']} of {summary['requests']}" in one_page.text

    def test_holds_the_worst_requests_with_their_moments(self, one_page, runs):
        _, requests = read_counted(runs[0])
        lowest, longest = one_page.of("worst-requests")
        order = requests.sort_values(["qoe1", "wait_s"], ascending=[True, False], kind="stable")
        waited = requests[requests["outcome"] != "never_served"]
        waited = waited.sort_values("wait_s", ascending=False, kind="stable")
        for shown, said in ((lowest, order.head(8)), (longest, waited.head(8))):
            assert [row[:2] for row in shown[1:]] == [
                [str(r.episode), str(r.request_id)] for r in said.itertuples()
            ]
            assert [row[5] for row in shown[1:]] == [f"{w:.0f}" for w in said["wait_s"]]
        links = one_page.links("replay.html")
        assert len(links) == 16
        first = order.iloc[0]
        told = dict(pair.split("=") for pair in urlsplit(links[0]).fragment.split("&"))
        assert links[0].startswith("replay.html#episode=")
        assert (int(told["episode"]), int(told["request"])) == (first.episode, first.request_id)
        assert float(told["t"]) == pytest.approx(first.t_request_s, abs=1e-6)

    def test_says_how_to_make_a_missing_replay(self, one_page, runs, undrawn):
        assert f"desim-uav replay {runs[0]}" in one_page.text
        (runs[0] / "replay.html").touch()
        assert "desim-uav replay" not in Page(report(runs[:1], None, None, None)).text

    def test_holds_where_it_comes_from(self, one_page, runs):
        text = one_page.text
        manifest = json.loads((runs[0] / "manifest.json").read_text())
        assert "desim-uav run 'a b'" in text
        assert (runs[0] / "scenario.yaml").read_text() in text
        for said in (manifest["scenario_hash"], *manifest["versions"].values()):
            assert said in text
        assert "2400 × 2400 m, 10 × 10 cells, 3D" in text

    def test_draws_its_figures(self, one_page):
        figures = [a["aria-label"] for tag, a in one_page.elements if tag == "svg"]
        assert figures == ["Map", "QoE over episodes", "Services", "Battery"]
        assert "building height, m" in one_page.text and "drone 2" in one_page.text

    @pytest.mark.thorough
    def test_its_figures_are_of_the_first_counted_episode(self, runs, monkeypatch):
        asked = {}
        for name in ("case_picture", "battery_figure"):
            draw = getattr(run_page.figures, name)
            monkeypatch.setattr(
                run_page.figures,
                name,
                lambda run, n, *, draw=draw, **k: draw(run, asked.setdefault(draw, n), **k),
            )
        report(runs[:1], None, None, None)
        assert set(asked.values()) == {0} and len(asked) == 2

    def test_of_a_run_that_cannot_be_played_again_has_no_batteries(self, runs):
        file = runs[0] / "manifest.json"
        file.write_text(json.dumps(json.loads(file.read_text()) | {"policy": "<b>gone.npz"}))
        (runs[0] / "SHA256SUMS").unlink()
        page = Page(report(runs[:1], None, None, None))
        figures = [a["aria-label"] for tag, a in page.elements if tag == "svg"]
        assert figures == ["Map", "QoE over episodes", "Services"]
        assert "The batteries cannot be drawn" in page.text and "<b>gone.npz" in page.text

    @pytest.mark.thorough
    def test_of_nobody_who_asks(self, tmp_path):
        silent = played(tmp_path, "hover", 0, "demand={kind: static, none: 1.0}")
        page = Page(report([silent], None, None, None))
        assert "0 of 0" in page.text and page.of("worst-requests") == []

    @pytest.mark.thorough
    def test_of_a_flat_world(self, tmp_path):
        flat = played(tmp_path, "hover", 0, case="case1", episodes=15)
        page = Page(report([flat], None, None, None))
        assert "15 episodes" in page.text and "2D" in page.text
        assert len(page.of("quality-of-experience")[1]) == 16


class TestSeveral:
    @pytest.mark.thorough
    def test_holds_the_estimates(self, page, runs):
        content = compare_runs(runs).content()
        for section, name in (("policies", "policies"), ("paired-differences", "differences")):
            (shown,) = page.of(section)
            assert [row[0] for row in shown[1:]] == [row["policy"] for row in content[name]]
            for row, said in zip(shown[1:], content[name], strict=True):
                assert row[1] == "3"
                for cell, (measure, (_, form)) in zip(row[2:], looks(ALWAYS).items(), strict=True):
                    found = said["measures"][measure]
                    mean, half, low, high = (
                        format(found[key], form) for key in ("mean", "half_width", "low", "high")
                    )
                    assert cell == f"{mean} ± {half} [{low}, {high}]"

    def test_marks_what_excludes_zero(self, page, runs):
        marked = [
            f"{found['mean']:{form}} ± {found['half_width']:{form}}"
            for row in compare_runs(runs).content()["differences"]
            for found, (_, form) in zip(
                row["measures"].values(), looks(ALWAYS).values(), strict=True
            )
            if found["excludes_zero"]
        ]
        assert marked, "choose other policies: these do not differ"
        bold = re.findall("<strong>([^<]* ± [^<]*)</strong>", page.source)
        assert bold == marked

    def test_holds_the_services(self, page, runs):
        (shown,) = page.of("by-service")
        row = next(row for row in shown if row[:2] == ["throughput", "random"])
        means = [
            next(r for r in qoe.grouped(read_counted(f)[1], "service") if r["service"] == row[0])
            for f in runs[3:6]
        ]
        cells = dict(zip(shown[0], row, strict=True))
        assert cells["QoE1\u00a0%"] == f"{estimate(m['qoe1_percent'] for m in means):.1f}"
        assert cells["requests"] == f"{estimate(m['requests'] for m in means):.1f}"

    def test_links_into_each_run(self, page, runs):
        links = page.links("replay.html")
        assert len(links) == 3 * 16
        folders = {unquote(urlsplit(link).path) for link in links}
        assert folders <= {f"{folder}/replay.html" for folder in runs}

    def test_holds_the_values_of_each_seed(self, page, runs):
        shown, folders = page.of("runs")
        values = compare_runs(runs).content()["replications"]
        assert [row[4] for row in shown[1:]] == [
            f"{v['qoe1_feasible_percent']:.2f}" for v in values
        ]
        assert [row[2] for row in folders[1:]] == [str(folder) for folder in runs]

    def test_has_a_title(self, page):
        assert page.text.count("Three policies") == 2

    def test_against_another(self, runs, undrawn):
        page = Page(report(runs, None, None, "hover"))
        (shown,) = page.of("paired-differences")
        assert [row[0] for row in shown[1:]] == ["baseline", "random"]

    @pytest.mark.thorough
    def test_of_one_seed_has_no_intervals(self, runs):
        page = Page(report([runs[0], runs[3]], None, None, None))
        assert "Values of one seed, which allows no interval." in page.text
        assert "t-interval" not in page.text and "Mean over seeds" not in page.text
        assert "±" not in "".join(cell for row in page.of("policies")[0] for cell in row)

    def test_of_one_policy_has_no_differences(self, runs, undrawn):
        page = Page(report(runs[:3], None, None, None))
        assert page.of("policies") and page.of("paired-differences") == []

    def test_without_a_common_seed_says_so(self, runs, undrawn):
        page = Page(report([runs[0], runs[4]], None, None, None))
        assert "No seed and world in common: random." in page.text


class TestPlace:
    def test_is_in_the_folder_of_one_run(self, runs, command, undrawn):
        assert command(runs[0]) == (0, f"{runs[0]}/report.html\n", "")
        assert (runs[0] / "report.html").is_file()

    def test_is_the_working_folder_for_several(self, runs, command, undrawn):
        assert command(*runs[:4]) == (0, "report.html\n", "")
        assert Path("report.html").is_file()

    def test_is_where_one_says(self, runs, command, undrawn):
        assert command(runs[0], "--out", "pages/one.html")[:2] == (0, "pages/one.html\n")
        links = Page(Path("pages/one.html")).links("replay.html")
        assert links and all(link.startswith(f"../{runs[0]}/replay.html#") for link in links)

    def test_links_to_any_name(self, runs, command, undrawn):
        odd = runs[0].rename("javascript:alert(1)#?%41 é")
        code, _, err = command(odd, "--out", "one.html")
        assert (code, err) == (0, "")
        link = Page(Path("one.html")).links("replay.html")[0]
        assert urlsplit(link).scheme == ""
        assert unquote(urlsplit(link).path) == f"{odd}/replay.html"

    def test_is_written_whole_or_not_at_all(self, runs, command, monkeypatch, undrawn):
        Path("old.html").write_text("old")
        monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "full")))
        code, out, err = command(runs[0], "--out", "old.html")
        assert (code, out) == (1, "") and "cannot write" in err
        assert Path("old.html").read_text() == "old"
        assert sorted(p.name for p in Path().iterdir()) == ["old.html", "runs"]

    @pytest.mark.thorough
    def test_twice_is_the_same(self, runs):
        first = report(runs[:4], Path("a.html"), None, None).read_bytes()
        assert report(runs[:4], Path("b.html"), None, None).read_bytes() == first


class TestWrong:
    def test_folders(self, runs, command, tmp_path):
        for folders, said in (
            (["nope"], "nope: no such run folder"),
            ([tmp_path], "requests.parquet: no such table"),
            ([runs[0], "nope"], "nope: no such run folder"),
            ([runs[0], runs[0]], "is given twice"),
        ):
            code, out, err = command(*folders)
            assert (code, out) == (4, "") and said in err and err.count("\n") == 1
        assert not Path("report.html").exists()

    @pytest.mark.parametrize(
        "name",
        [
            *("requests.parquet", "episodes.parquet", "steps.parquet", "users.parquet"),
            *("manifest.json", "scenario.yaml", "world.json"),
        ],
    )
    def test_files(self, runs, command, name):
        file = runs[0] / name
        for damage in (lambda: file.write_bytes(b"{" + file.read_bytes()[:99]), file.unlink):
            damage()
            code, out, err = command(runs[0])
            assert (code, out) == (4, "") and name in err and err.count("\n") == 1
        assert not (runs[0] / "report.html").exists()

    def test_tables_that_do_not_fit_together(self, runs, command):
        steps = pd.read_parquet(runs[0] / "steps.parquet")
        few = parquet("steps", steps[steps["drone"] > 0])
        (runs[0] / "steps.parquet").write_bytes(few)
        (runs[0] / "SHA256SUMS").unlink()
        code, out, err = command(runs[0])
        assert (
            (code, out) == (4, "")
            and "steps.parquet: not of this run" in err
            and err.count("\n") == 1
        )

    def test_how_it_is_asked(self, runs, command):
        assert command(runs[0], "--out", ".")[0] == 2
        assert command(runs[0], "--against", "baseline")[0] == 2
        code, _, err = command(runs[0], runs[3], "--against", "rando")
        assert code == 2 and "random" in err


class TestHostile:
    """A folder by somebody else may hold any text; none of it acts."""

    @pytest.fixture
    def hostile(self, runs):
        for folder, other in ((runs[0], "A"), (runs[3], "B")):
            manifest = json.loads((folder / "manifest.json").read_text())
            manifest |= {
                "scenario": HOSTILE,
                "policy": other + HOSTILE,
                "command": [HOSTILE, {"a": HOSTILE}, None],
                "versions": {HOSTILE: HOSTILE, "\ud800": ["\u2028"]},
                "engine": HOSTILE,
                "started": [HOSTILE],
            }
            (folder / "manifest.json").write_text(json.dumps(manifest))
            requests = pd.read_parquet(folder / "requests.parquet")
            requests["service"] = requests["service"].replace("throughput", HOSTILE)
            (folder / "requests.parquet").write_bytes(parquet("requests", requests))
            steps = pd.read_parquet(folder / "steps.parquet")
            steps["mode"] = HOSTILE
            (folder / "steps.parquet").write_bytes(parquet("steps", steps))
            (folder / "SHA256SUMS").unlink()
        return [runs[0], runs[3]]

    @pytest.mark.parametrize("several", by_default([False], [False, True]))
    def test_is_text(self, hostile, several):
        out = Path("page.html")
        page = Page(report(hostile if several else hostile[:1], out, HOSTILE, None))
        known = {"html", "head", "meta", "title", "style", "body", "header", "nav", "section"}
        known |= {"h1", "h2", "h3", "p", "a", "dl", "dt", "dd", "div", "table", "thead", "tbody"}
        known |= {"tr", "th", "td", "figure", "figcaption", "strong", "span", "small", "code"}
        known |= {"details", "summary", "pre", "footer", "wbr", "svg", "g", "defs", "path", "use"}
        known |= {"rect", "circle", "clippath", "pattern", "text", "tspan", "image", "img"}
        assert {tag for tag, _ in page.elements} <= known
        for tag, attributes in page.elements:
            assert not [name for name in attributes if name.startswith("on")], tag
            for name in ("href", "src"):
                link = attributes.get(name, "#")
                assert re.match(r"#|(runs/\w+-\d/)?replay\.html#|data:image/png;base64,", link)
        assert page.source.count("<style") == page.source.count("</style") == 1
        assert "\u202e" not in page.source and "\\u202e" in page.text
        assert "alert(1)" in page.text

    def test_policy_of_the_page_allows_no_script(self, one_page):
        (policy,) = [a["content"] for _, a in one_page.elements if "http-equiv" in a]
        assert "default-src 'none'" in policy and "script-src" not in policy
        assert "http://" not in one_page.source and "https://" not in one_page.source


def test_an_own_mistake_is_not_hidden(runs, monkeypatch):
    monkeypatch.setattr(reporting, "run_page", lambda *_: {}["gone"])
    with pytest.raises(PolicyError, match="KeyError: 'gone'"):
        report(runs[:1], None, None, None)
