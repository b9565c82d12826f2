"""The colours of drones and users keep apart, and every picture has the same ones."""

from itertools import combinations, pairwise, product

import numpy as np
import pytest

from desim_uav.drawing.sprites import dot, drone
from desim_uav.engine.base import UserState
from desim_uav.palette import DRONES, USERS, drone_colour, ink_on, luminance
from desim_uav.report.figures.style import COLOURS, drone_look

VISIONS = {
    "full": np.eye(3),
    "protan": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deutan": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "tritan": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}
"""Machado, Oliveira and Fernandes (2009), severity 1, on linear RGB."""

TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
ALIKE = 14
"""Colours nearer than this in CIELAB are taken for each other at a glance."""


def rgb(colour):
    return tuple(int(colour[at : at + 2], 16) for at in (1, 3, 5))


def lab(colour, vision):
    """CIELAB (D65) of a colour as somebody sees it."""
    channel = np.array(rgb(colour)) / 255
    linear = np.where(channel <= 0.04045, channel / 12.92, ((channel + 0.055) / 1.055) ** 2.4)
    seen = np.clip(VISIONS[vision] @ linear, 0, 1)
    xyz = TO_XYZ @ seen / TO_XYZ.sum(axis=1)
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


class TestTellableApart:
    @pytest.mark.parametrize("vision", VISIONS)
    def test_drones(self, vision):
        for one, other in combinations(DRONES, 2):
            assert np.linalg.norm(lab(one, vision) - lab(other, vision)) > ALIKE, (one, other)

    @pytest.mark.parametrize("vision", VISIONS)
    def test_users_by_state(self, vision):
        for one, other in combinations([look.colour for look in USERS.values()], 2):
            assert np.linalg.norm(lab(one, vision) - lab(other, vision)) > ALIKE, (one, other)

    @pytest.mark.parametrize("vision", VISIONS)
    def test_series_from_each_other_and_from_drones(self, vision):
        pairs = [*combinations(COLOURS, 2), *product(COLOURS, DRONES)]
        for one, other in pairs:
            assert np.linalg.norm(lab(one, vision) - lab(other, vision)) > ALIKE, (one, other)

    def test_neighbouring_drones_in_grey(self):
        grey = [lab(colour, "full")[0] for colour in DRONES]
        assert min(abs(a - b) for a, b in combinations(grey[:3], 2)) > 9
        assert min(abs(a - b) for a, b in pairwise(grey[2:])) > 3

    @pytest.mark.parametrize("ground", ["#FFFFFF", "#1B1F23"])
    def test_on_a_white_and_on_a_dark_ground(self, ground):
        for colour in (*DRONES, *(look.colour for look in USERS.values())):
            assert contrast(colour, ground) > 2, colour

    def test_a_number_on_each_drone_can_be_read(self):
        for colour in DRONES:
            assert contrast(colour, ink_on(colour)) >= 4.5, colour

    def test_a_user_state_is_no_drone(self):
        users = {look.colour for look in USERS.values()}
        assert len(users) == len(UserState) == len(USERS)
        assert not users & set(DRONES)


class TestEverywhere:
    def test_figures(self):
        assert [drone_look(k)["color"] for k in range(9)] == [*DRONES, *DRONES[:2]]
        assert len({tuple(map(str, drone_look(k).values())) for k in range(49)}) == 49

    def test_films_and_frames(self):
        for k in range(len(DRONES)):
            sprite = drone(drone_colour(k))
            assert sprite.getpixel((17, 12))[:3] == pytest.approx(rgb(DRONES[k]), abs=2)
        for look in USERS.values():
            sprite = dot(look.colour, 9)
            assert sprite.getpixel((5, 5))[:3] == pytest.approx(rgb(look.colour), abs=2)
