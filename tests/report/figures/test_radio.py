"""The figure of a radio shows the rings, rates and levels that the simulation has."""

from dataclasses import dataclass
from itertools import combinations
from math import hypot, log10, pi

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.contour import QuadContourSet
from matplotlib.patches import Circle, StepPatch
from scipy.interpolate import RegularGridInterpolator

from desim_uav.errors import UsageError
from desim_uav.model.radio.path_loss import RowPathLoss
from desim_uav.palette import luminance
from desim_uav.report.figures import radio_figure, to_bytes
from desim_uav.report.figures.radio import INK, SHADES
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world

LINKS = {"kind": "link_classes", "power_dbm": 0, "carrier_ghz": 3.5}
OWN = {
    "power_dbm": -15,
    "bandwidth_mhz": 4,
    "path_loss": {"kind": "free_space"},
    "classes": [{"snr_db": 0, "bit_s_hz": 0.5}, {"snr_db": 15, "bit_s_hz": 3}],
}


class Limited(RowPathLoss):
    """Is not defined more than 30 m above a user."""

    def los_db(self, distance_m, height_m, carrier_ghz):
        """Return the loss in dB."""
        if height_m > 30.0:
            raise ValueError("at most 30 m")
        return 40.0 + 0.05 * (distance_m * distance_m + height_m * height_m) ** 0.5


def world_of(radio=(), **sections):
    """A map of 1200 m by 800 m with levels at 20, 40 and 60 m; users stand on the ground."""
    drones = {"radio": LINKS | dict(radio)}
    buildings = {"cells": [[0, 0, 55]]}
    scenario = {
        "name": "town",
        "map": {"size_m": [1200, 800], "cells": [12, 8], "obstacles": buildings},
        "users": {"positions_m": [[600, 400]], "mobility": {"kind": "static"}},
        "drones": {"count": 1, "start_cells": [[5, 5]], "battery": None} | drones,
        "stations": {"count": 0},
    }
    return build_world(from_mapping(scenario | sections), 0)


@dataclass
class Drawn:
    """What is on a figure."""

    figure: object

    def __post_init__(self):
        self.above, self.rate, self.classes, self.side, self.bar = self.figure.axes

    @property
    def rings_m(self):
        return [patch.radius for patch in self.above.patches if isinstance(patch, Circle)]

    @property
    def contours(self):
        """The level and the points of each contour, the lowest first."""
        found = [c for c in self.side.collections if isinstance(c, QuadContourSet)]
        return [(c.levels[0], np.concatenate([p.vertices for p in c.get_paths()])) for c in found]

    def levels_dbm(self, axes):
        """The level as a function of places on a picture."""
        (image,) = axes.images
        x0, x1, y0, y1 = image.get_extent()
        shown = image.get_array().filled(np.nan)
        rows, columns = shown.shape
        half_x, half_y = (x1 - x0) / columns / 2, (y1 - y0) / rows / 2
        xs = np.linspace(x0 + half_x, x1 - half_x, columns)
        ys = np.linspace(y0 + half_y, y1 - half_y, rows)
        return xs, ys, RegularGridInterpolator((xs, ys), shown.T)

    def steps(self, axes):
        (stairs,) = (patch for patch in axes.patches if isinstance(patch, StepPatch))
        return stairs.get_data()


def drawn(world, **options):
    return Drawn(radio_figure(world, **options))


def snr_db(radio, dbm):
    return np.asarray(dbm) - radio.budget.noise_dbm


class TestMap:
    @pytest.mark.thorough
    @pytest.mark.parametrize("level", [0, 1, 2])
    def test_rings_are_those_of_the_simulation(self, level):
        world = world_of()
        rings_m = world.links[0].rings_m[level, 0]
        assert len(rings_m) == 15 and rings_m.min() > 0
        shown = drawn(world, level=level)
        assert shown.rings_m == rings_m.tolist()
        assert all(patch.center == (600, 400) for patch in shown.above.patches)
        assert f"at {world.grid.levels_m[level]:g} m" in shown.above.get_title(loc="left")

    def test_the_lowest_level_is_drawn_by_default(self):
        world = world_of()
        assert drawn(world).rings_m == world.links[0].rings_m[0, 0].tolist()

    def test_levels_reach_a_threshold_within_its_ring_only(self):
        world = world_of()
        shown, radio = drawn(world, level=1, at_m=(500, 300)), world.scenario.drones.radio
        xs, ys, dbm = shown.levels_dbm(shown.above)
        assert xs[[0, -1]] == pytest.approx([0, 1200]) and ys[[0, -1]] == pytest.approx([0, 800])
        x, y = np.meshgrid(xs, ys, indexing="ij")
        away_m = np.hypot(x - 500, y - 300)
        ratio = snr_db(radio, dbm((x, y)))
        classes = sum(ratio >= one.snr_db for one in radio.ladder)
        inside = sum(away_m <= radius for radius in shown.rings_m)
        assert (classes == inside).all()
        assert len(np.unique(classes)) > 8

    def test_a_level_is_what_friis_says(self):
        shown = drawn(world_of(OWN), level=2, at_m=(0, 800))
        _, _, dbm = shown.levels_dbm(shown.above)
        slant_m = hypot(900, 600, 60)
        loss_db = 20 * log10(4 * pi * slant_m * 3.5e9 / 299_792_458)
        assert dbm((900, 200)) == pytest.approx(-15 - loss_db, abs=1e-3)

    def test_drone_and_access_points_are_where_they_are(self):
        mast = {"height_m": 35, "radio": LINKS}
        points = [{"at_m": [300, 200], **mast}, {"at_m": [1100, 700], **mast}]
        shown = drawn(world_of(access_points=points), at_m=(10, 790))
        places = [tuple(map(float, line.get_xydata()[0])) for line in shown.above.lines]
        assert places == [(300, 200), (1100, 700), (10, 790)]
        (legend,) = shown.figure.legends
        labels = [text.get_text() for text in legend.get_texts()]
        assert labels[:2] == ["drone", "access point"]
        alone = drawn(world_of()).figure.legends[0].get_texts()
        assert "access point" not in [text.get_text() for text in alone]

    @pytest.mark.thorough
    @pytest.mark.parametrize(("power_dbm", "number"), [(-90, 0), (60, 15)])
    def test_a_map_of_one_class_says_which(self, power_dbm, number):
        title = drawn(world_of({"power_dbm": power_dbm})).above.get_title(loc="left")
        assert title.endswith(f": class {number} everywhere")
        assert "everywhere" not in drawn(world_of()).above.get_title(loc="left")


class TestDistance:
    def test_rates_and_classes_have_the_steps_of_the_ladder(self):
        world = world_of()
        shown, radio = drawn(world, level=2), world.scenario.drones.radio
        rings_m = world.links[0].rings_m[2, 0]
        rates, edges_m, _ = shown.steps(shown.rate)
        assert edges_m[1:-1] == pytest.approx(rings_m[::-1])
        mbit_s = [0.0, *(one.bit_s_hz * radio.bandwidth_mhz for one in radio.ladder)]
        assert rates == pytest.approx(mbit_s[::-1])
        classes, same_edges_m, _ = shown.steps(shown.classes)
        assert classes.tolist() == list(range(15, -1, -1))
        assert same_edges_m.tolist() == edges_m.tolist()
        assert edges_m[0] == 0 and edges_m[-1] > rings_m[0]

    @pytest.mark.thorough
    def test_classes_that_hold_nowhere_have_no_step(self):
        world = world_of({"power_dbm": -15})
        held = (world.links[0].rings_m[2, 0] > 0).sum()
        assert 1 < held < 15
        shown = drawn(world, level=2)
        assert shown.steps(shown.classes).values.tolist() == list(range(held, -1, -1))

    @pytest.mark.thorough
    def test_without_any_class_the_rate_is_zero(self):
        shown = drawn(world_of({"power_dbm": -90}))
        assert shown.steps(shown.rate).values.tolist() == [0]
        assert shown.contours == []
        assert to_bytes(shown.figure, ".png")

    def test_small_rates_can_be_read(self):
        shown = drawn(world_of(OWN | {"bandwidth_mhz": 0.1}))
        highest = shown.steps(shown.rate).values[0]
        assert highest == pytest.approx(0.3)
        assert sum(0 < tick <= highest for tick in shown.rate.get_yticks()) > 1
        assert all(float(tick).is_integer() for tick in shown.classes.get_yticks())

    def test_long_distances_are_in_km(self):
        world = world_of({"power_dbm": 60})
        shown = drawn(world)
        assert shown.side.get_xlabel() == "horizontal distance, km"
        edges = shown.steps(shown.rate).edges
        assert edges[1:-1] * 1000 == pytest.approx(world.links[0].rings_m[0, 0][::-1])
        assert drawn(world_of()).side.get_xlabel() == "horizontal distance, m"


class TestHeight:
    def test_contours_pass_the_rings_at_each_level(self):
        world = world_of()
        shown, radio = drawn(world), world.scenario.drones.radio
        assert len(shown.contours) == 15
        xs, ys, _ = shown.levels_dbm(shown.side)
        assert xs[0] == pytest.approx(0) and ys[-1] == pytest.approx(120, rel=0.01)
        for number, (dbm, points) in enumerate(shown.contours):
            assert snr_db(radio, dbm) == pytest.approx(radio.ladder[number].snr_db)
            distances_m, heights_m = points.T
            for level, height_m in enumerate(world.grid.levels_m):
                near = np.abs(heights_m - height_m) < 2 * (ys[1] - ys[0])
                apart_m = np.abs(distances_m[near] - world.links[0].rings_m[level, 0, number])
                assert apart_m.min() < 2 * (xs[1] - xs[0])

    def test_levels_are_those_of_the_path_loss(self):
        world = world_of()
        shown, radio = drawn(world), world.scenario.drones.radio
        xs, ys, dbm = shown.levels_dbm(shown.side)
        for x, y in [(xs[0], ys[7]), (xs[100], ys[200]), (xs[-1], ys[-1])]:
            expected = radio.power_dbm - radio.path_loss.mean_db(x, y, 3.5)
            assert dbm((x, y)) == pytest.approx(expected)

    def test_the_altitude_of_the_drone_is_marked(self):
        (line,) = drawn(world_of(), level=1).side.lines
        assert line.get_ydata() == [40, 40]

    @pytest.mark.thorough
    def test_white_where_the_path_loss_is_not_defined(self):
        own = {"kind": f"{__name__}:Limited"}
        flat = {"size_m": [1200, 800], "cells": [12, 8], "dimensions": 2}
        shown = drawn(world_of({"path_loss": own}, map=flat))
        heights_m = shown.levels_dbm(shown.side)[1]
        assert heights_m[0] < 30 < heights_m[-1]
        missing = shown.side.images[0].get_array().mask
        assert (missing == (heights_m > 30)[:, None]).all()
        assert to_bytes(shown.figure, ".png")


class TestWords:
    @pytest.mark.thorough
    def test_what_is_left_out_is_said(self):
        assert "left out" not in drawn(world_of()).figure.get_suptitle()
        radio = {"interference": "co_channel", "shadowing": {"los_db": 4, "nlos_db": 6}}
        heading = drawn(world_of(radio | {"line_of_sight": "drawn"})).figure.get_suptitle()
        assert heading.endswith("left out: interference, drawn line of sight, shadowing")
        heading = drawn(world_of({"line_of_sight": "buildings"})).figure.get_suptitle()
        assert heading.endswith("left out: line of sight between buildings")

    def test_the_heading_has_the_numbers_of_the_radio(self):
        heading = drawn(world_of(OWN)).figure.get_suptitle()
        assert heading == "town: -15 dBm, 4 MHz at 3.5 GHz\nmean loss of free_space"

    def test_numbers_stand_on_the_lines_of_their_classes(self):
        world = world_of({"power_dbm": 10})
        shown, radio = drawn(world, at_m=(500, 300)), world.scenario.drones.radio
        for text in shown.above.texts:
            x, y = text.get_position()
            ring_m = shown.rings_m[int(text.get_text()) - 1]
            assert hypot(x - 500, y - 300) == pytest.approx(ring_m)
        _, _, dbm = shown.levels_dbm(shown.side)
        for text in shown.side.texts:
            least_db = radio.ladder[int(text.get_text()) - 1].snr_db
            assert snr_db(radio, dbm(text.get_position())) == pytest.approx(least_db, abs=1e-6)
        assert len(shown.above.texts) > 2 and len(shown.side.texts) > 5

    @pytest.mark.thorough
    @pytest.mark.parametrize("radio", [{}, {"classes": "mcs"}, {"power_dbm": 20}, OWN])
    def test_numbers_of_classes_do_not_hide_each_other(self, radio):
        shown = drawn(world_of(radio), level=1)
        to_bytes(shown.figure, ".svg")
        for axes in (shown.above, shown.side):
            boxes = [text.get_window_extent() for text in axes.texts]
            assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
            window = axes.get_window_extent()
            assert all(window.x0 <= box.x0 and box.x1 <= window.x1 for box in boxes)
        assert shown.side.texts


class TestColours:
    def test_they_darken_as_the_level_rises_and_lines_can_be_seen_on_all(self):
        light = [luminance(to_hex(SHADES(part))) for part in np.linspace(0, 1, 33)]
        assert np.max(np.diff(light)) < 0
        assert (light[-1] + 0.05) / (luminance(INK) + 0.05) > 3


class TestRefused:
    def test_a_disc(self):
        world = world_of({})
        disc = world.scenario.drones.model_copy(update={"radio": from_mapping({}).drones.radio})
        scenario = world.scenario.model_copy(update={"drones": disc})
        with pytest.raises(UsageError, match=r"is disc, .* write drones.radio: {kind: link_cl"):
            radio_figure(build_world(scenario, 0))

    @pytest.mark.parametrize("level", [-1, 3])
    def test_a_level_that_does_not_exist(self, level):
        with pytest.raises(UsageError, match=rf"level: {level}: town has the levels 0 to 2"):
            radio_figure(world_of(), level=level)

    @pytest.mark.parametrize("at_m", [(-1, 0), (0, 801), (float("nan"), 5)])
    def test_a_place_that_is_not_on_the_map(self, at_m):
        with pytest.raises(UsageError, match=r"^at: .*: the map of town goes from 0,0 to 1200,800"):
            radio_figure(world_of(), at_m=at_m)
