"""``plot sweep`` and ``report`` of a sweep: what they show is what the dataset says."""

import json
from pathlib import Path

import pytest

from desim_uav.experiment.statistics import estimate
from desim_uav.experiment.sweep.folder import SweepFolder
from desim_uav.experiment.sweep.grid import axes
from desim_uav.experiment.sweep.pictures import plot_sweep, sweep_report
from desim_uav.experiment.sweep.results import read_sweep
from desim_uav.measures.known import ALWAYS as MEASURES
from desim_uav.report.figures.style import to_bytes
from tests.command_line import runner

POLICIES = ("baseline", "random")


def value(cells, policy, seed):
    """A measure that tells all rows apart, and varies over seeds."""
    numbers = [v for v in cells.values() if isinstance(v, int)]
    return 10.0 * POLICIES.index(policy) + sum(numbers) / 10 + seed * seed


def make_sweep(out, overrides, *, seeds=2, policies=POLICIES, failed=()):
    """The folder of a sweep without its simulations."""
    from itertools import product

    swept = axes(overrides)
    folder = SweepFolder(out, swept)
    (out / "results").mkdir(parents=True)
    jobs = []
    for *values, policy, seed in product(*(axis.values for axis in swept), policies, range(seeds)):
        cells = {axis.key: axis.cell(v.plain) for axis, v in zip(swept, values, strict=True)}
        jobs.append(f"{len(jobs):020x}")
        if len(jobs) - 1 in failed:
            continue
        row = {"job": jobs[-1]} | cells | {"policy": policy, "algorithm": None, "seed": seed}
        row |= {"world_seed": seed} | dict.fromkeys(MEASURES, value(cells, policy, seed))
        (out / "results" / f"{jobs[-1]}.parquet").write_bytes(folder._parquet(row))
    manifest = {
        "scenario": {"name": "case8", "file": "case8.yaml", "sha256": "f" * 64},
        "columns": folder.columns,
        "episodes": 3,
        "warmup": 1,
        "seeds": list(range(seeds)),
        "policies": list(policies),
        "algorithms": [],
        "jobs": jobs,
        "command": ["desim-uav", "sweep", "case8", "a b"],
        "versions": {"desim-uav": "0.1.0"},
    }
    (out / "manifest.json").write_text(json.dumps(manifest))
    if failed:
        told = {"policy": "random", "seed": 1, "reason": "<b>boom"}
        told = [{"job": jobs[k]} | told for k in failed]
        (out / "failed.json").write_text(json.dumps(told))
    return out


COUNTS = "users.count=4,8,12"
RADII = "drones.footprint_radius_m=200,300,400"


@pytest.fixture
def ask(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    return runner(capsys, monkeypatch)


def titles(figure):
    return [panel.get_title(loc="left") for panel in figure.axes]


def legend(figure):
    (found,) = figure.legends
    return found.get_title().get_text(), [text.get_text() for text in found.get_texts()]


class TestOneKey:
    def test_a_line_per_policy_has_means_and_intervals(self, tmp_path):
        figure = plot_sweep(make_sweep(tmp_path / "s", [COUNTS]))
        assert titles(figure) == ["QoE1, %", "QoE2, steps", "QoE3, %"]
        assert legend(figure) == ("policy", list(POLICIES))
        assert figure.get_suptitle().endswith(
            "2 seed(s) of 3 episode(s): 95 % t-intervals over seeds"
        )
        for panel in figure.axes:
            assert panel.get_xlabel() == "users.count"
            lines = [line for line in panel.lines if line.get_label() in POLICIES]
            for line, bars, policy in zip(lines, panel.containers, POLICIES, strict=True):
                expected = [
                    estimate(value({"n": n}, policy, seed) for seed in (0, 1)) for n in (4, 8, 12)
                ]
                assert line.get_ydata() == pytest.approx([e.mean for e in expected])
                assert line.get_xdata() == pytest.approx([4, 8, 12], abs=0.2)
                ends = [segment[:, 1] for segment in bars.lines[2][0].get_segments()]
                for (low, high), e in zip(ends, expected, strict=True):
                    assert (low, high) == pytest.approx((e.low, e.high))

    def test_one_seed_has_no_interval_and_the_heading_says_so(self, tmp_path):
        figure = plot_sweep(make_sweep(tmp_path / "s", [COUNTS], seeds=1))
        assert figure.get_suptitle().endswith("one seed allows no interval")
        assert not any(panel.containers for panel in figure.axes)

    def test_words_are_points_without_a_line(self, tmp_path):
        figure = plot_sweep(make_sweep(tmp_path / "s", ["drones.admission.kind=first_come,fair"]))
        panel = figure.axes[0]
        assert [t.get_text() for t in panel.get_xticklabels()] == ["first_come", "fair"]
        lines = [line for line in panel.lines if line.get_label() in POLICIES]
        assert {line.get_linestyle() for line in lines} == {"None"}

    def test_without_a_key_policies_stand_one_below_the_other(self, tmp_path):
        figure = plot_sweep(make_sweep(tmp_path / "s", ["users.count=4"]), ["qoe3_percent"])
        assert [t.get_text() for t in figure.axes[0].get_yticklabels()] == list(POLICIES)


class TestTwoKeys:
    def test_numbers_are_a_heat_map_per_policy(self, tmp_path):
        figure = plot_sweep(make_sweep(tmp_path / "s", [COUNTS, RADII]), ["qoe3_percent"])
        maps = [panel for panel in figure.axes if panel.images]
        assert [panel.get_title(loc="left") for panel in maps] == [
            "baseline: QoE3, %",
            "random: QoE3, %",
        ]
        for panel, policy in zip(maps, POLICIES, strict=True):
            shown = panel.images[0].get_array()
            for y, radius in enumerate((200, 300, 400)):
                for x, count in enumerate((4, 8, 12)):
                    cells = {"users.count": count, "radius": radius}
                    found = estimate(value(cells, policy, seed) for seed in (0, 1))
                    assert shown[y, x] == pytest.approx(found.mean)
                    text = f"{found.mean:.1f}\n±{found.half_width:.1f}"
                    assert panel.texts[3 * x + y].get_text() == text
            assert (panel.get_xlabel(), panel.get_ylabel()) == (
                "users.count",
                "drones.footprint_radius_m",
            )

    def test_few_values_are_a_line_each(self, tmp_path):
        swept = make_sweep(tmp_path / "s", [COUNTS, "stations.pads=1,2"])
        figure = plot_sweep(swept, ["qoe3_percent"])
        assert titles(figure) == ["baseline: QoE3, %", "random: QoE3, %"]
        assert legend(figure) == ("stations.pads", ["1", "2"])

    def test_the_first_key_named_lies_along_the_axis(self, tmp_path):
        swept = make_sweep(tmp_path / "s", [COUNTS, "stations.pads=1,2"])
        figure = plot_sweep(swept, key=["stations.pads"])
        assert figure.axes[0].get_xlabel() == "stations.pads"
        assert legend(figure) == ("users.count", ["4", "8", "12"])

    def test_a_key_is_held_at_a_value(self, tmp_path):
        swept = make_sweep(tmp_path / "s", [COUNTS, RADII, "stations.pads=1,2"])
        figure = plot_sweep(swept, key=["users.count", RADII.partition("=")[0] + "=300"])
        assert "drones.footprint_radius_m = 300" in figure.get_suptitle()
        assert legend(figure)[0] == "stations.pads"


@pytest.mark.parametrize("ending", [".png", ".svg"])
def test_the_same_sweep_gives_the_same_bytes(tmp_path, ending):
    swept = make_sweep(tmp_path / "s", [COUNTS])
    one, other = (to_bytes(plot_sweep(swept, ["qoe3_percent"]), ending) for _ in range(2))
    assert one == other


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("--measure", "qoe3"), 2, "measure: qoe3"),
        (("--key", "users.cnt"), 2, "does not vary in this sweep (did you mean 'users.count'?)"),
        (("--key", "users.count=5"), 2, "key: users.count=5: its values are 4, 8, 12"),
        (("--key", "users.count", "--key", "users.count=4"), 2, "given twice"),
        ((), 2, "3 keys vary (users.count, drones.footprint_radius_m, stations.pads)"),
        (("--window", "3"), 2, "window is an option of training, not of sweep"),
    ],
)
def test_what_is_refused(ask, words, code, message):
    make_sweep(Path("s"), [COUNTS, RADII, "stations.pads=1,2"], seeds=1)
    ask("plot", "sweep", "s", *words).failed(code, message)
    assert not Path("s/sweep.png").exists()


class TestFolder:
    def test_the_default_place(self, ask):
        make_sweep(Path("s"), [COUNTS])
        assert ask("plot", "sweep", "s").out == f"{Path('s/sweep.png')}\n"
        assert ask("report", "s").out == f"{Path('s/report.html')}\n"

    def test_one_that_cannot_be_read(self, ask):
        ask("plot", "sweep", "nope").failed(4, "nope: no such sweep folder")
        Path("empty").mkdir()
        ask("plot", "sweep", "empty").failed(4, "empty: not a sweep folder")
        swept = make_sweep(Path("s"), [COUNTS])
        file = next((swept / "results").iterdir())
        file.write_bytes(file.read_bytes()[:-9])
        ask("plot", "sweep", "s").failed(4, f"{file}: damaged")
        ask("report", "s").failed(4, f"{file}: damaged")
        for file in (swept / "results").iterdir():
            file.unlink()
        ask("report", "s").failed(4, "s: no job of this sweep has ended")
        (swept / "manifest.json").write_text("{")
        ask("report", "s").failed(4, "not a readable manifest")

    def test_reads_what_a_sweep_writes(self, ask):
        flags = ("--policies", "hover", "--seeds", 2, "--episodes", 1, "--warmup", 0)
        assert ask("sweep", "tiny", *flags, "-S", "episode.steps=3,4", "--out", "o").code == 0
        results = read_sweep(Path("o"))
        assert results.keys == {"episode.steps": [3, 4]} and len(results.rows) == 4
        assert ask("plot", "sweep", "o", "-o", "a.png").code == 0

    def test_the_printed_table_of_one_seed_tells_no_interval(self, ask):
        flags = ("--policies", "hover", "--episodes", 1, "--warmup", 0, "-S", "episode.steps=3,4")
        assert ask("sweep", "tiny", *flags, "--seeds", 1, "--out", "o").code == 0
        told = Path("o/table.md").read_text()
        assert "Values of one seed, which allows no interval" in told and "±" not in told
        assert ask("sweep", "tiny", *flags, "--seeds", 2, "--out", "two").code == 0
        assert "Mean over seeds and 95 % t-interval" in Path("two/table.md").read_text()


class TestReport:
    def test_the_table_has_means_and_half_widths(self, tmp_path):
        page = sweep_report(make_sweep(tmp_path / "s", [COUNTS]), None)
        found = estimate(value({"n": 8}, "random", seed) for seed in (0, 1))
        assert f"{found.mean:.2f}<small>± {found.half_width:.2f}</small>" in page
        assert "The number after ± is half the width of the interval." in page
        assert "users.<wbr>count</th>" in page
        assert "12 of 12 jobs ended" in page and "Failures" not in page
        assert page.count("<svg") == 3 and "Against users.count." in page
        assert "desim-uav sweep case8 &#x27;a b&#x27;" in page and "f" * 64 in page

    def test_one_seed_has_no_interval(self, tmp_path):
        page = sweep_report(make_sweep(tmp_path / "s", [COUNTS], seeds=1), None)
        assert "Values of one seed, which allows no interval." in page
        assert "±" not in page and "t-interval" not in page

    def test_failures_are_listed_and_stay_text(self, tmp_path):
        page = sweep_report(make_sweep(tmp_path / "s", [COUNTS], failed=[3]), None)
        assert "1 job of 12 have no row, and 1 of them failed" in page
        assert "&lt;b&gt;boom" in page and "<b>boom" not in page

    @pytest.mark.thorough
    def test_of_three_keys_the_last_is_held(self, tmp_path):
        page = sweep_report(make_sweep(tmp_path / "s", [COUNTS, RADII, "stations.pads=1,2"]), None)
        assert "with stations.pads = 1." in page and "--key KEY=VALUE" in page
