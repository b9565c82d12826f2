"""A snapshot of a map in 3D: no words cover others, and none leaves the figure."""

from itertools import combinations

import pytest

from desim_uav.report.figures import snapshot_figure
from tests.report.helpers import make_run

SHORT = "episode.steps=4"
ROTORS = "large_drones_with_four_rotors"
TWO_TYPES = (
    f"drones=[{{name: {ROTORS}, count: 4, footprint_radius_m: 200}}, {{name: small, count: 5}}]"
)


def words_of(figure):
    """The places of all words of a figure: its title, numbers, labels and legend."""
    figure.draw_without_rendering()
    (axes,) = figure.axes
    scales = (axes.xaxis, axes.yaxis, axes.zaxis)
    texts = [tick.label1 for axis in scales for tick in axis.get_major_ticks() if seen(axis, tick)]
    texts += [*(axis.label for axis in scales), *figure.texts, *figure.legends[0].get_texts()]
    return {text: text.get_window_extent() for text in texts if text.get_text()}


def seen(axis, tick):
    """Whether a tick lies on its axis, which has ticks beyond its ends too."""
    low, high = axis.get_view_interval()
    return low <= tick.get_loc() <= high


def check(figure):
    places = words_of(figure)
    assert len(places) > 15
    for one, other in combinations(places, 2):
        assert not places[one].overlaps(places[other]), (one.get_text(), other.get_text())
    for text, box in places.items():
        assert figure.bbox.x0 <= box.x0 and box.x1 <= figure.bbox.x1, text.get_text()
        assert figure.bbox.y0 <= box.y0 and box.y1 <= figure.bbox.y1, text.get_text()


def test_no_word_covers_another(flown):
    check(snapshot_figure(flown))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("scenario", "overrides"),
    [
        ("old_town", ()),
        ("street_canyon", ()),
        ("case8", ("map.size_m=[600, 600]",)),
        ("case8", (TWO_TYPES,)),
        ("case8", ("map.size_m=[9600, 2400]", "map.cells=[40, 10]")),
        ("case8", ("map.size_m=[2400, 9600]", "map.cells=[10, 40]")),
        ("case8", ("name=" + "name" * 16,)),
    ],
    ids=["old_town", "canyon", "small", "types", "wide", "deep", "named"],
)
def test_no_word_covers_another_on_any_map(tmp_path, scenario, overrides):
    check(snapshot_figure(make_run(tmp_path / "run", scenario, "random", (SHORT, *overrides))))
