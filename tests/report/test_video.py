"""Films of an episode: what is on a frame is where it was; the files are what they should be."""

import builtins
import re
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image, ImageSequence

from desim_uav.engine.base import UserState
from desim_uav.errors import MissingExtraError, UsageError
from desim_uav.model.rules import US, Mode
from desim_uav.palette import USERS, drone_colour
from desim_uav.report.playback import Playback
from desim_uav.report.run import Run
from desim_uav.report.video import Film, write_gif, write_mp4

SCALE = 600 / 2400
"""Pixels a metre."""


@pytest.fixture
def playback(flown):
    return Playback(Run(flown), 0)


def on_map(x_m, y_m):
    return round(x_m * SCALE), round((2400 - y_m) * SCALE)


def colour(text):
    return tuple(int(text[k : k + 2], 16) for k in (1, 3, 5))


class TestFrames:
    def test_a_drone_is_drawn_where_the_formula_says(self, playback, flown):
        """Mid-leg: the trapezoid of case 8 by hand, 240 m in 60 s at 4.068986 m/s and 4 m/s²."""
        legs = playback.run.of("legs", 0)
        moves = legs[(legs["mode"] == "flying") & (legs["duration_s"] == 60)]
        moves = moves[moves["z_from_m"] == moves["z_to_m"]]
        film, cruise, ramp = Film(playback), 4.068986030484496, 1.017246508
        checked = 0
        for leg in moves.to_dict("records")[:6]:
            elapsed_s = 20.0
            flown_m = cruise * (elapsed_s - ramp / 2)
            share = flown_m / 240
            x = leg["x_from_m"] + share * (leg["x_to_m"] - leg["x_from_m"])
            y = leg["y_from_m"] + share * (leg["y_to_m"] - leg["y_from_m"])
            t_us = round((leg["t_s"] + elapsed_s) * US)
            moment = playback.at(t_us)
            assert moment.drones_m[leg["drone"]][:2] == pytest.approx((x, y), abs=1e-5)
            others = np.delete(moment.drones_m, leg["drone"], axis=0)[:, :2]
            if np.min(np.hypot(*(others - (x, y)).T)) < 400:
                continue  # drawn over, or beside each other
            frame = np.asarray(film.frame(t_us)).astype(int)
            px, py = on_map(x, y)
            own = np.abs(frame - colour(drone_colour(leg["drone"]))).sum(axis=2) < 30
            ys, xs = np.nonzero(own[max(0, py - 12) : py + 12, max(0, px - 12) : px + 12])
            middle = xs.mean() + max(0, px - 12), ys.mean() + max(0, py - 12)
            assert middle == pytest.approx((px, py), abs=1.5)
            checked += 1
        assert checked > 0

    def test_users_have_the_colour_of_their_state(self, playback):
        t_us = round(777.5 * US)
        moment, frame = playback.at(t_us), np.asarray(Film(playback).frame(t_us))
        found = 0
        for (x, y, _), state in zip(moment.users_m, moment.states, strict=True):
            apart = np.hypot(*(moment.users_m[:, :2] - (x, y)).T)
            drones = np.hypot(*(moment.drones_m[:, :2] - (x, y)).T)
            px, py = on_map(x, y)
            if np.sort(apart)[1] < 60 or drones.min() < 150 or not 5 < px < 594 or not 5 < py < 594:
                continue
            assert tuple(frame[py, px]) == pytest.approx(colour(USERS[state].colour), abs=3)
            found += 1
        assert found > 3

    def test_a_serving_drone_has_a_footprint(self, playback):
        film = Film(playback)
        for t_s in (100.0, 1000.0, 1700.0):
            moment = playback.at(round(t_s * US))
            frame = np.asarray(film.frame(round(t_s * US))).astype(int)
            for drone, ((x, y, _), mode) in enumerate(
                zip(moment.drones_m, moment.modes, strict=True)
            ):
                own = colour(drone_colour(drone))
                around = np.arange(0, 6, 0.1)
                rim = [on_map(x + 600 * np.cos(a), y + 600 * np.sin(a)) for a in around]
                near = [
                    frame[py - 1 : py + 2, px - 1 : px + 2]
                    for px, py in rim
                    if 1 < px < 598 and 1 < py < 598
                ]
                off = [np.min(np.abs(part - own).sum(axis=2)) for part in near]
                drawn = np.mean(np.array(off) < 160)
                assert drawn > 0.9 if mode is Mode.FLYING else drawn < 0.3

    def test_from_beginning_to_end_at_even_times(self, playback):
        film = Film(playback, fps=10, speed=120)
        assert np.diff(film.times_us).tolist() == 150 * [12 * US]
        assert (film.times_us[0], film.times_us[-1]) == (0, 1800 * US)
        uneven = Film(playback, fps=7, speed=130)
        assert uneven.times_us[-1] == 1800 * US
        assert set(np.diff(uneven.times_us)[:-1].tolist()) == {round(130 / 7 * US)}

    @pytest.mark.parametrize(
        ("width", "size"), [(800, (800, 600)), (481, (480, 360)), (330, (330, 248))]
    )
    def test_any_width_gives_an_even_size(self, playback, width, size):
        assert Film(playback, width=width).frame(0).size == size

    def test_too_many(self, playback):
        with pytest.raises(UsageError, match="frames are too many"):
            Film(playback, fps=60, speed=0.1)

    def test_it_shows_the_measures_the_run_ended_with(self, playback):
        end, row = playback.at(1800 * US).measures, playback.run.of("episodes", 0).iloc[0]
        assert end.qoe1_percent == pytest.approx(row["qoe1_percent"])
        assert end.qoe2_iterations == pytest.approx(row["qoe2_iterations"])
        assert end.qoe3_percent == pytest.approx(row["qoe3_percent"])


class TestGif:
    @pytest.fixture
    def made(self, playback, tmp_path):
        film = Film(playback, fps=6, speed=600, width=400)
        write_gif(film, tmp_path / "film.gif")
        return film, tmp_path / "film.gif"

    def test_every_frame_is_the_one_of_the_film(self, made):
        film, file = made
        with Image.open(file) as gif:
            frames = [frame.convert("RGB") for frame in ImageSequence.Iterator(gif)]
        assert len(frames) == len(film)
        for frame, t_us in zip(frames, film.times_us, strict=True):
            off = np.abs(np.asarray(frame).astype(int) - np.asarray(film.frame(t_us)))
            assert off.mean() < 3  # of 255: Pillow looks for the nearest colour roughly
            assert (off.max(axis=2) > 60).mean() < 1e-3

    def test_it_loops_and_lasts_as_long_as_it_should(self, made):
        film, file = made
        with Image.open(file) as gif:
            assert gif.info["loop"] == 0
            durations = [frame.info["duration"] for frame in ImageSequence.Iterator(gif)]
        assert sum(durations[:-1]) == pytest.approx(1000 * (len(film) - 1) / 6, abs=10)
        assert durations[-1] == 1500

    def test_there_is_no_noise_where_nothing_moves(self, made):
        _, file = made
        with Image.open(file) as gif:
            frames = [np.asarray(f.convert("RGB")) for f in ImageSequence.Iterator(gif)]
        corner = [frame[-70:-8, 305:] for frame in frames]  # the legend
        assert all((part == corner[0]).all() for part in corner)

    def test_the_same_run_gives_the_same_bytes(self, made, tmp_path):
        film, file = made
        write_gif(film, tmp_path / "again.gif")
        assert (tmp_path / "again.gif").read_bytes() == file.read_bytes()

    def test_too_fast(self, playback, tmp_path):
        with pytest.raises(UsageError, match="a GIF can have at most 50"):
            write_gif(Film(playback, fps=60), tmp_path / "film.gif")


class TestMp4:
    @pytest.mark.thorough
    def test_it_is_h264_of_that_size_and_length(self, playback, tmp_path):
        ffmpeg = pytest.importorskip("imageio_ffmpeg")
        film = Film(playback, fps=6, speed=600, width=330)
        write_mp4(film, tmp_path / "film.mp4")
        program = [ffmpeg.get_ffmpeg_exe(), "-i", str(tmp_path / "film.mp4"), "-f", "rawvideo"]
        read = subprocess.run([*program, "-pix_fmt", "rgb24", "-"], capture_output=True, check=True)
        told = read.stderr.decode()
        assert re.search(r"Video: h264 .* yuv420p.* 330x248.* 6 fps", told), told
        frames = np.frombuffer(read.stdout, np.uint8).reshape(-1, 248, 330, 3).astype(int)
        assert len(frames) == len(film)
        for number in (0, 9, len(film) - 1):
            meant = np.asarray(film.frame(film.times_us[number])).astype(int)
            assert np.abs(frames[number] - meant).mean() < 6
        first = (tmp_path / "film.mp4").read_bytes()
        write_mp4(film, tmp_path / "film.mp4")
        assert (tmp_path / "film.mp4").read_bytes() == first

    def test_without_the_package(self, playback, tmp_path, monkeypatch):
        real = builtins.__import__

        def without(name, *rest, **more):
            if name == "imageio_ffmpeg":
                raise ImportError(name)
            return real(name, *rest, **more)

        monkeypatch.delitem(sys.modules, "imageio_ffmpeg", raising=False)
        monkeypatch.setattr(builtins, "__import__", without)
        with pytest.raises(MissingExtraError, match=r'pip install -e "\.\[video\]"'):
            write_mp4(Film(playback), tmp_path / "film.mp4")
        assert not (tmp_path / "film.mp4").exists()


def test_every_state_of_a_user_is_shown(playback):
    states = {s for t in range(0, 1800, 60) for s in playback.at(t * US).states}
    assert states == set(UserState)


def test_a_film_that_fails_leaves_nothing(playback, tmp_path, monkeypatch):
    film = Film(playback, fps=6, speed=600)
    monkeypatch.setattr(film, "frame", lambda t_us: 1 / 0)
    for write, name in ((write_gif, "film.gif"), (write_mp4, "film.mp4")):
        with pytest.raises(ZeroDivisionError):
            write(film, tmp_path / name)
    assert not any(tmp_path.iterdir())
