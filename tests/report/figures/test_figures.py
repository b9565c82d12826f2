"""What figures show is what the tables say."""

import json

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb
from matplotlib.patches import Circle
from scipy.stats import t as student

from desim_uav.errors import NoEventsError, PolicyError, UsageError
from desim_uav.experiment.compare_runs import compare_runs
from desim_uav.experiment.replay import playable
from desim_uav.model.rules import US, Mode
from desim_uav.qoe import OUTCOMES
from desim_uav.report.figures import (
    battery_figure,
    compare_figure,
    episodes_figure,
    intervals_figure,
    services_figure,
    snapshot_figure,
    to_bytes,
    training_figure,
    visits_figure,
)
from desim_uav.report.figures.battery import SPANS
from desim_uav.report.figures.services import BARS
from desim_uav.report.figures.style import COLOURS, DASHES, MARKERS, STYLE
from desim_uav.report.figures.training import CURVES, smoothed
from desim_uav.report.figures.visits import visit_minutes
from desim_uav.report.playback import Playback
from desim_uav.report.run import Run


def titles(figure):
    return [axes.get_title(loc="left") for axes in figure.axes]


class TestTraining:
    def test_a_curve_is_the_mean_of_its_seeds_and_the_band_their_deviation(self, trained):
        figure = training_figure(trained, window=5)
        tables = [pd.read_parquet(folder / "training.parquet") for folder in trained]
        for axes, name in zip(figure.axes, CURVES, strict=False):
            for number, (line, band) in enumerate(zip(axes.lines, axes.collections, strict=True)):
                of_seeds = [
                    [
                        table.loc[table["episode"].between(first, first + 4), name].mean()
                        for first in range(56)
                    ]
                    for table in tables[2 * number : 2 * number + 2]
                ]
                mean, deviation = np.mean(of_seeds, axis=0), np.std(of_seeds, axis=0, ddof=1)
                assert line.get_xdata() == pytest.approx(np.arange(5, 61))
                assert line.get_ydata() == pytest.approx(mean)
                ends = band.get_paths()[0].vertices
                for x, y, wide in zip(range(5, 61), mean, deviation, strict=True):
                    at = ends[ends[:, 0] == x][:, 1]
                    assert (at.min(), at.max()) == pytest.approx((y - wide, y + wide))

    def test_the_window_and_the_band_are_told(self, trained):
        (legend,) = (axes.get_legend() for axes in training_figure(trained).axes[-1:])
        told = legend.get_title().get_text()
        assert "running means over 1 episode" in told and "standard deviation over seeds" in told
        assert [text.get_text() for text in legend.get_texts()] == [
            "q_learning, 2 seeds",
            "sarsa, 2 seeds",
        ]

    def test_one_seed_has_no_band(self, trained):
        figure = training_figure(trained[:1])
        assert not any(axes.collections for axes in figure.axes)
        told = figure.axes[-1].get_legend().get_title().get_text()
        assert "deviation" not in told and "one seed allows no band" in told

    def test_an_algorithm_with_one_seed_beside_one_with_two(self, trained):
        figure = training_figure(trained[:3])
        assert [len(axes.collections) for axes in figure.axes[:5]] == [1] * 5
        told = figure.axes[-1].get_legend().get_title().get_text()
        assert "standard deviation over seeds" in told and "one seed allows no band" in told
        told = training_figure(trained).axes[-1].get_legend().get_title().get_text()
        assert "no band" not in told

    def test_where_nobody_asked_nothing_is_counted(self):
        curve = pd.Series([1.0, np.nan, 3.0, np.nan, np.nan])
        _, mean, _ = smoothed([curve], 2)
        assert mean == pytest.approx([1.0, 3.0, 3.0, np.nan], nan_ok=True)

    def test_what_cannot_be_drawn_together(self, trained, seeds, tmp_path):
        with pytest.raises(PolicyError, match="not a training folder"):
            training_figure(seeds[:1])
        with pytest.raises(PolicyError, match="q_learning on seed 0 is given twice"):
            training_figure([trained[0], copy(trained[0], tmp_path / "again")])
        other = copy(trained[2], tmp_path / "other")
        text = (other / "scenario.yaml").read_text()
        (other / "scenario.yaml").write_text(text.replace("count: 12", "count: 13"))
        (other / "SHA256SUMS").unlink()
        with pytest.raises(PolicyError, match=r"its scenario is not that of .*: users is"):
            training_figure([trained[0], other])
        with pytest.raises(UsageError, match=r"^window: 61: there are 60 episodes"):
            training_figure(trained, window=61)


def copy(folder, to):
    to.mkdir()
    for file in folder.iterdir():
        (to / file.name).write_bytes(file.read_bytes())
    return to


class TestCompare:
    def test_points_and_bars_are_means_and_t_intervals(self, seeds):
        found = compare_runs(seeds)
        figure = compare_figure(found.content())
        top, below = figure.axes[:5], figure.axes[5:]
        by_policy = {
            policy: np.array(
                [r.measures["qoe3_percent"] for r in found.replications if r.policy == policy]
            )
            for policy in ("hover", "baseline")
        }
        for place, values in enumerate(by_policy.values()):
            assert interval(top[2], place) == pytest.approx(t_interval(values))
        difference = by_policy["baseline"] - by_policy["hover"]
        assert interval(below[2], 0) == pytest.approx(t_interval(difference))
        assert titles(figure)[5] == "Difference from hover, paired by seed"

    @pytest.mark.thorough
    def test_policies_are_named_once_a_row(self, seeds):
        figure = compare_figure(compare_runs(seeds).content())
        names = [[label.get_text() for label in axes.get_yticklabels()] for axes in figure.axes]
        assert names[0] == ["hover", "baseline"] and names[5] == ["baseline"]

    def test_a_policy_alone_and_a_seed_alone(self, seeds):
        assert len(compare_figure(compare_runs(seeds[:3]).content()).axes) == 5
        figure = compare_figure(compare_runs(seeds[:1]).content())
        assert interval(figure.axes[0], 0)[0] is None

    def test_one_seed_has_no_interval_and_the_heading_says_so(self, seeds):
        figure = compare_figure(compare_runs([seeds[0], seeds[3]]).content())
        assert "one seed allows no interval" in figure.get_suptitle()
        assert "t-interval" not in figure.get_suptitle()
        assert [titles(figure)[k] for k in (0, 5)] == [
            "Values of one seed",
            "Difference from hover on one seed",
        ]
        for axes in figure.axes:
            for point in axes.containers:
                assert point.lines[1:] == ((), ()), "no caps and no bars"

    def test_where_some_have_one_seed_the_heading_says_so(self, seeds):
        figure = compare_figure(compare_runs(seeds[:4]).content())
        told = "95 % t-intervals over seeds (none from a single seed)"
        assert figure.get_suptitle().endswith(told)
        assert compare_figure(compare_runs(seeds).content()).get_suptitle().endswith("over seeds")

    def test_alone_and_narrow_each_policy_keeps_its_colour(self):
        def row(policy, mean):
            found = {"mean": mean, "half_width": 0.5}
            return {"policy": policy, "measures": {"qoe1_percent": found, "reward_mean": found}}

        names = ["first", "second", "third"]
        measures = {"qoe1_percent": "QoE1 %", "reward_mean": "reward"}
        rows = [row("second", 2.0), row("third", None)]
        figure = intervals_figure(rows, names, measures, True)
        assert titles(figure) == ["QoE1 %", "reward"]
        for axes in figure.axes:
            (bar,) = axes.containers
            assert interval(axes, 0) == (1.5, 2.0, 2.5)
            assert bar.lines[0].get_color() == COLOURS[1]


def interval(axes, place):
    """Low, mean and high of the policy in this place."""
    container = axes.containers[place]
    line, _, bars = container.lines
    mean = line.get_xdata()[0]
    if not bars:
        return None, mean, None
    ((low, _), (high, _)) = bars[0].get_segments()[0]
    return low, mean, high


def t_interval(values):
    half = student.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return values.mean() - half, values.mean(), values.mean() + half


class TestVisits:
    def test_they_add_up_to_the_serving_time(self, flown):
        run = Run(flown)
        minutes = visit_minutes(run, [0, 1])
        serving = np.zeros(3)
        for episode in (0, 1):
            for drone in range(3):
                spans = Playback(run, episode).spans(drone)
                serving[drone] += sum(b - a for a, b, mode in spans if mode is Mode.FLYING)
        assert minutes.sum(axis=(1, 2)) == pytest.approx(serving / US / 60 / 2)

    def test_a_cell_has_the_time_that_a_sampler_finds_there(self, flown):
        run, every_s = Run(flown), 0.5
        minutes = visit_minutes(run, [1])
        sampled = np.zeros_like(minutes)
        playback = Playback(run, 1)
        for t_s in np.arange(every_s / 2, 1800, every_s):
            moment = playback.at(round(t_s * US))
            for drone, (x, y, _) in enumerate(moment.drones_m):
                if moment.modes[drone] is Mode.FLYING:
                    sampled[drone, int(x // 240), int(y // 240)] += every_s / 60
        assert sampled == pytest.approx(minutes, abs=0.05)

    def test_the_map_shows_them(self, flown):
        figure = visits_figure(flown, episode=1, drone=2)
        minutes = visit_minutes(Run(flown), [1])
        (image,) = figure.axes[0].images
        assert pytest.approx(minutes[2]) == image.get_array().filled(0).T
        assert titles(figure)[0] == f"drone 2: {minutes[2].sum():.1f} min"

    def test_a_run_without_events_is_played_again(self, bare, flown):
        figures = [visits_figure(run) for run in (playable(bare), flown)]
        again, kept = ([axes.images[0].get_array() for axes in f.axes[:3]] for f in figures)
        for one, other in zip(again, kept, strict=True):
            assert np.array_equal(one.filled(-1), other.filled(-1))

    def test_a_folder_alone_has_no_events(self, bare):
        with pytest.raises(NoEventsError, match="kept no events"):
            visits_figure(bare)

    def test_no_such_drone_or_episode(self, flown):
        with pytest.raises(UsageError, match=r"^drone: 3: .* has the drones 0 to 2"):
            visits_figure(flown, drone=3)
        with pytest.raises(UsageError, match=r"^episode: 2: .* has the episodes -1 to 1"):
            visits_figure(flown, episode=2)


class TestBattery:
    def test_the_curve_goes_through_the_steps(self, flown):
        steps = pd.read_parquet(flown / "steps.parquet")
        figure = battery_figure(flown, episode=1)
        for drone, axes in enumerate(figure.axes):
            t_min, left_min = axes.lines[0].get_data()
            mine = steps[(steps["episode"] == 1) & (steps["drone"] == drone)]
            for t_s, battery_s in zip(mine["t_s"], mine["battery_s"], strict=True):
                at = np.flatnonzero(np.isclose(t_min, t_s / 60))
                assert any(left_min[k] == pytest.approx(battery_s / 60) for k in at)
            assert axes.get_ylabel() == "left, min"

    def test_modes_are_shaded_and_crashes_marked(self, flown):
        events = pd.read_parquet(flown / "events.parquet")
        seen = set()
        for episode in (0, 1):
            figure = battery_figure(flown, episode=episode)
            for drone, axes in enumerate(figure.axes):
                mine = events[(events["episode"] == episode) & (events["drone"] == drone)]
                crashes = mine.loc[mine["kind"] == "crash", "t_us"].to_numpy() / US / 60
                marks = [line for line in axes.lines if line.get_marker() == "X"]
                marked = [x for line in marks for x in line.get_xdata()]
                assert marked == pytest.approx(crashes)
                seen |= {"crash"} if len(crashes) else set()
                spans = [*Playback(Run(flown), episode).spans(drone)]
                shaded = sorted((p.get_x(), p.get_x() + p.get_width()) for p in axes.patches)
                assert np.ravel(shaded) == pytest.approx(
                    np.ravel([(a / US / 60, b / US / 60) for a, b, m in spans if m in SPANS])
                )
                seen |= {mode.name for *_, mode in spans}
        assert {"crash", "RETURNING", "QUEUED", "CHARGING", "CHARGED"} <= seen

    def test_a_crash_at_the_very_end(self, tmp_path):
        from tests.report.helpers import make_run

        small = ("users.count=4", "episode.steps=3", "drones.battery.autonomy_min=3")
        folder = make_run(tmp_path / "r", "case8", "hover", small)
        marks = [line for line in battery_figure(folder).axes[0].lines if line.get_marker() == "X"]
        assert [*marks[0].get_xdata()] == [3.0]

    @pytest.mark.thorough
    def test_a_run_without_events_is_played_again(self, bare, flown):
        again, kept = (to_bytes(battery_figure(run, 1), ".svg") for run in (playable(bare), flown))
        assert again == kept

    def test_an_unlimited_one(self, flat):
        with pytest.raises(PolicyError, match="unlimited batteries"):
            battery_figure(flat)


class TestEpisodes:
    def test_the_curves_are_the_counted_episodes(self, flown):
        episodes = pd.read_parquet(flown / "episodes.parquet")
        episodes = episodes[episodes["episode"] >= 0]
        figure = episodes_figure(flown)
        columns = ("qoe1_percent", "qoe2_iterations", "qoe3_percent")
        for axes, name in zip(figure.axes, columns, strict=True):
            assert axes.lines[0].get_xdata().tolist() == [0, 1]
            assert axes.lines[0].get_ydata().tolist() == episodes[name].tolist()
            crashed = episodes[episodes["crashes"] > 0]
            assert axes.lines[1].get_xdata().tolist() == crashed["episode"].tolist()
        assert episodes["crashes"].any()


class TestServices:
    def test_where_there_is_little_room_panels_are_below_each_other(self, flown):
        wide, narrow = services_figure(flown), services_figure(flown, width=5.0)
        for one, other in zip(wide.axes, narrow.axes, strict=True):
            assert one.get_title(loc="left") == other.get_title(loc="left")
            assert [bar.get_width() for bar in one.patches] == [
                bar.get_width() for bar in other.patches
            ]
        assert len({axes.get_subplotspec().rowspan.start for axes in narrow.axes}) == 3

    def test_bars_are_shares_of_outcomes(self, flown):
        requests = pd.read_parquet(flown / "requests.parquet")
        requests = requests[requests["episode"] >= 0]
        outcomes, waits, qoe1s = services_figure(flown).axes
        services = sorted(requests["service"].unique())
        for container, outcome in zip(outcomes.containers, OUTCOMES, strict=True):
            for bar, service in zip(container, services, strict=True):
                of = requests[requests["service"] == service]["outcome"]
                assert bar.get_width() == pytest.approx(100 * (of == outcome).mean())
        for line, service in zip(waits.lines, services, strict=True):
            held = requests[requests["service"] == service]["wait_s"] / 60
            x, y = line.get_data()
            for asked in held.quantile([0.2, 0.5, 0.9]):
                assert y[x <= asked].max() == pytest.approx(100 * (held <= asked).mean())
        for line, service in zip(qoe1s.lines, services, strict=True):
            held = 100 * requests[requests["service"] == service]["qoe1"]
            x, y = line.get_data()
            assert y[x < 100].max(initial=0) == pytest.approx(100 * (held < 100).mean())

    def test_nobody_asked(self, tmp_path):
        from tests.report.helpers import make_run

        silent = ("episode.steps=2", "demand={kind: static, none: 1.0}")
        with pytest.raises(PolicyError, match="no requests"):
            services_figure(make_run(tmp_path / "r", "case8", "hover", silent))


class TestSnapshot:
    def test_drones_are_where_the_playback_has_them(self, flown):
        figure = snapshot_figure(flown, episode=0, minute=7.35)
        moment = Playback(Run(flown), 0).at(round(7.35 * 60 * US))
        crosses = [line for line in figure.axes[0].lines if line.get_marker() == "X"]
        found = np.array([np.ravel(line.get_data_3d()) for line in crosses])
        assert found == pytest.approx(moment.drones_m)
        paths = [line for line in figure.axes[0].lines if line.get_linewidth() == 1.5]
        assert [np.array(p.get_data_3d())[:, -1] for p in paths] == pytest.approx(moment.drones_m)

    def test_a_building_is_as_tall_as_it_is(self, flown):
        world = json.loads((flown / "world.json").read_text())
        heights = sorted(h for row in world["cell_height_m"] for h in row if h)
        boxes = [c for c in snapshot_figure(flown).axes[0].collections if len(get_faces(c)) == 5]
        assert sorted(np.max(get_faces(box)[..., 2]) for box in boxes) == pytest.approx(heights)

    def test_a_flat_map_is_drawn_flat(self, flat):
        figure = snapshot_figure(flat)
        assert figure.axes[0].name != "3d"
        assert any(isinstance(patch, Circle) for patch in figure.axes[0].patches)


def get_faces(collection):
    if hasattr(collection, "_segslices"):  # Matplotlib below 3.10
        return np.array([collection._vec[:3, face].T for face in collection._segslices])
    faces = getattr(collection, "_faces", None)
    return np.zeros((0, 4, 3)) if faces is None else np.asarray(faces)


class TestFiles:
    @pytest.mark.thorough
    @pytest.mark.parametrize("ending", [".png", ".pdf", ".svg"])
    def test_the_same_run_gives_the_same_bytes(self, flown, ending):
        one, other = (to_bytes(battery_figure(flown), ending) for _ in range(2))
        assert one == other
        assert one[:4] in (b"\x89PNG", b"%PDF", b"<?xm")

    @pytest.mark.thorough
    def test_whatever_the_users_own_style_is(self, flown):
        usual = to_bytes(services_figure(flown), ".svg")
        before = dict(mpl.rcParams)
        with mpl.rc_context({"font.size": 20, "axes.facecolor": "red", "lines.linewidth": 9}):
            assert to_bytes(services_figure(flown), ".svg") == usual
            assert mpl.rcParams["font.size"] == 20
        assert dict(mpl.rcParams) == before

    def test_fonts_are_embedded_as_truetype(self, flown):
        assert b"/FontFile2" in to_bytes(battery_figure(flown), ".pdf")

    def test_nothing_is_left_in_pyplot(self, flown):
        import matplotlib.pyplot as plt

        services_figure(flown)
        assert plt.get_fignums() == []

    def test_names_are_not_read_as_mathematics(self, flown, tmp_path):
        folder = copy(flown, tmp_path / "r")
        manifest = json.loads((folder / "manifest.json").read_text())
        manifest["policy"] = r"$\frac$ </svg><script>"
        (folder / "manifest.json").write_text(json.dumps(manifest))
        (folder / "SHA256SUMS").unlink()
        svg = to_bytes(services_figure(folder), ".svg")
        assert b"<script" not in svg


class TestGrey:
    """Without colour a figure can still be read."""

    def grey(self, colour):
        return float(np.dot(to_rgb(colour), (0.299, 0.587, 0.114)))

    def test_neighbouring_series_differ_in_lightness_and_in_dashes(self):
        first = [self.grey(colour) for colour in COLOURS[:4]]
        assert np.min(np.abs(np.subtract.outer(first, first)) + 9 * np.eye(4)) > 0.1
        assert len({str(dash) for dash in DASHES}) == len(set(MARKERS)) == len(COLOURS)

    def test_figures_that_matplotlib_colours_have_the_same_sequence(self):
        file = mpl.rc_params_from_file(STYLE, use_default_template=False)
        found = [entry["color"].removeprefix("#") for entry in file["axes.prop_cycle"]]
        assert found == [colour.removeprefix("#") for colour in COLOURS]

    def test_outcomes_differ_in_lightness_or_hatch(self):
        assert len({bar["hatch"] for bar in BARS.values()}) == len(BARS) == 5

    def test_modes_differ_in_hatch(self):
        assert len({span.get("hatch") for span in SPANS.values()}) == len(SPANS)
