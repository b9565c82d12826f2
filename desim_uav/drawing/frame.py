"""The frame of an episode at a decision epoch: the map on the left, a panel of text beside it."""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from desim_uav.drawing.sprites import (
    GREY,
    INK,
    PALE,
    RED,
    WHITE,
    dot,
    drone,
    font,
    mast,
    ring,
    station,
    stick,
    wreck,
)
from desim_uav.engine.base import Measures, TaskQueue, UserState
from desim_uav.model.rules import AIRBORNE, US, Mode
from desim_uav.model.state import Observation, Snapshot
from desim_uav.palette import USERS, drone_colour, ink_on
from desim_uav.user_group import streets_of
from desim_uav.world import World

WIDTH, HEIGHT, PANEL = 800, 600, 200
LEFT = WIDTH - PANEL + 14
RIGHT = WIDTH - 14
LISTED = 7
"""The largest number of drones that the panel lists one by one."""

DIAMETERS = {
    UserState.SERVED: 9,
    UserState.OPEN: 9,
    UserState.ATTACHED: 7,
    UserState.IDLE: 6,
}
"""The diameters of users' dots by state, in pixels."""

ABOVE, SQUARE, MOST_SQUARES = 20, 7, 8
"""How far above a drone its tasks are drawn, and the pixels of each; of more, there is a number."""

ACROSS = 100
"""The characters of a line that says whose data the map has."""

LOW = 0.2
"""The share of a battery at and below which it is shown in red."""


class FrameScene(Protocol):
    """What a frame shows besides observations; engines and replays of logged episodes have it."""

    def positions_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the positions of drones (drones, 3) and users (users, 3), in metres."""

    def user_states(self) -> list[UserState]:
        """Return the state of each user."""

    def queues(self) -> list[TaskQueue]:
        """Return the queue at the processor of each drone and access point; [] without tasks."""

    def measures(self) -> Measures:
        """Return the quality of experience so far."""


FARTHEST = 1.5
"""The largest footprint that is drawn, in diagonals of the map; larger ones look the same."""


class Painter:
    """Draws the frames of one world. The parts that never change are drawn once."""

    def __init__(self, world: World) -> None:
        self.world = world
        grid = world.grid
        self.scale = min((WIDTH - PANEL) / grid.width_m, HEIGHT / grid.depth_m)
        size = (round(grid.width_m * self.scale), round(grid.depth_m * self.scale))
        self.corner = ((WIDTH - PANEL - size[0]) // 2, (HEIGHT - size[1]) // 2)
        reaches_m = [links.reach_m for links in world.links[: len(world.types)]]
        farthest_px = FARTHEST * math.hypot(*size)
        self.radii_px = [min(reach_m * self.scale, farthest_px) for reach_m in reaches_m]
        self.map = self._drawn_map(size)
        self.background = self._drawn_background()

    def frame(self, scene: FrameScene, snapshot: Snapshot, title: str) -> NDArray[np.uint8]:
        """Return the frame, uint8 (600, 800, 3). ``title`` appears below the scenario's name."""
        return np.array(self.picture(scene, snapshot, title))

    def picture(self, scene: FrameScene, snapshot: Snapshot, title: str) -> Image.Image:
        """Return the frame as an image of Pillow's."""
        drones_m, users_m = scene.positions_m()
        states = scene.user_states()
        picture = self.map.copy()
        where = [self._pixel(x, y) for x, y, _ in drones_m.tolist()]
        for observation, (x, y) in zip(snapshot.observations, where, strict=True):
            if observation.mode is Mode.FLYING:
                radius_px = self.radii_px[self.world.type_numbers[observation.drone]]
                stick(picture, ring(drone_colour(observation.drone), radius_px), x, y)
        for state, (x, y, _) in sorted(zip(states, users_m.tolist(), strict=True)):
            stick(picture, _user(state), *self._pixel(x, y))
        self._draw_drones(picture, snapshot.observations, where, scene.queues())
        frame = self.background.copy()
        frame.paste(picture, self.corner)
        draw = ImageDraw.Draw(frame)
        self._write_attribution(draw)
        self._write_time(draw, snapshot, title)
        self._write_measures(draw, scene)
        self._write_users(draw, Counter(states))
        self._write_drones(frame, snapshot.observations, drones_m[:, 2].tolist())
        return frame

    def _pixel(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return the pixel of a point of the map."""
        return x_m * self.scale, (self.world.grid.depth_m - y_m) * self.scale

    # ---- what does not change

    def _drawn_map(self, size: tuple[int, int]) -> Image.Image:
        """Draw the cells, the buildings by height, the stations and the access points."""
        grid = self.world.grid
        picture = Image.new("RGB", size, "#FBFBF8")
        draw = ImageDraw.Draw(picture)
        (nx, ny), (dx, dy) = grid.cells, grid.cell_m
        for ix in range(nx):
            for iy in range(ny):
                left, top = self._pixel(ix * dx, (iy + 1) * dy)
                right, bottom = self._pixel((ix + 1) * dx, iy * dy)
                height_m = float(grid.height_m[ix, iy])
                built = height_m > 0.0 and not len(grid.city)
                fill = self._shade(height_m) if built else None
                draw.rectangle((left, top, right, bottom), fill=fill, outline="#E6E6E2")
        for line in streets_of(self.world.scenario):
            draw.line([self._pixel(*place) for place in line], fill="#DEDEDA", width=3)
        for corners, roof_m in zip(grid.city.pieces_m, grid.city.roofs_m.tolist(), strict=True):
            fill = self._shade(roof_m)
            draw.polygon([self._pixel(*corner) for corner in corners.tolist()], fill=fill)
        for zone in self.world.scenario.map.no_fly:
            draw.polygon([self._pixel(*corner) for corner in zone.polygon_m], outline=RED, width=2)
        for cell in self.world.stations:
            stick(picture, station(), *self._pixel(*grid.centre(*cell)))
        for point in self.world.scenario.access_points:
            stick(picture, mast(), *self._pixel(*point.at_m))
        return picture

    def _shade(self, height_m: float) -> str:
        """Return the shade of a building: the taller it is, the darker."""
        light = round(222 - 110 * height_m / self.world.grid.tallest_m)
        return f"#{light:02X}{light:02X}{light:02X}"

    def _drawn_background(self) -> Image.Image:
        """Draw the parts of the panel that never change, and its legend."""
        picture = Image.new("RGB", (WIDTH, HEIGHT), WHITE)
        draw = ImageDraw.Draw(picture)
        draw.rectangle((0, 0, WIDTH - PANEL, HEIGHT), fill="#F0F0EC")
        draw.line((WIDTH - PANEL, 0, WIDTH - PANEL, HEIGHT), fill=PALE)
        draw.text((LEFT, 14), _clipped(self.world.scenario.name, 17), INK, font(20))
        for row, name in enumerate(("QoE1", "QoE2", "QoE3")):
            draw.text((LEFT, 122 + 20 * row), name, GREY, font(14))
        draw.text((LEFT, 194), "users", GREY, font(13))
        for row, (state, look) in enumerate(USERS.items()):
            stick(picture, _user(state), LEFT + 6, 221 + 19 * row)
            draw.text((LEFT + 20, 213 + 19 * row), look.word, INK, font(13))
        draw.text((LEFT, 300), "drones", GREY, font(13))
        self._draw_legend(picture, draw)
        return picture

    def _draw_legend(self, picture: Image.Image, draw: ImageDraw.ImageDraw) -> None:
        y = HEIGHT - 22
        if self.world.stations:
            stick(picture, station().reduce(2), LEFT + 6, y)
            draw.text((LEFT + 20, y), "charging station", INK, font(12), anchor="lm")
            y -= 20
        if self.world.scenario.access_points:
            stick(picture, mast().reduce(2), LEFT + 6, y)
            draw.text((LEFT + 20, y), "access point", INK, font(12), anchor="lm")
            y -= 20
        grid = self.world.grid
        heights_m = grid.city.roofs_m if len(grid.city) else grid.height_m
        if heights_m.any():
            low_m, high_m = float(heights_m[heights_m > 0.0].min()), float(heights_m.max())
            draw.rectangle((LEFT, y - 6, LEFT + 12, y + 6), fill=self._shade((low_m + high_m) / 2))
            text = f"buildings, {low_m:.0f}-{high_m:.0f} m"
            draw.text((LEFT + 20, y), text, INK, font(12), anchor="lm")
            y -= 20
        if self.world.scenario.map.no_fly:
            draw.rectangle((LEFT, y - 6, LEFT + 12, y + 6), outline=RED, width=2)
            draw.text((LEFT + 20, y), "no flight", INK, font(12), anchor="lm")

    # ---- what does

    def _draw_drones(
        self,
        picture: Image.Image,
        observations: tuple[Observation, ...],
        where: list[tuple[float, float]],
        queues: list[TaskQueue],
    ) -> None:
        """Draw each drone with its number, battery and tasks, and its mode if there is room."""
        draw = ImageDraw.Draw(picture)
        alone, beside = Counter(where), Counter[tuple[float, float]]()
        for observation, place in zip(observations, where, strict=True):
            x, y = place[0] + 36 * beside[place], place[1]
            beside[place] += 1
            _draw_drone(picture, draw, observation, x, y)
            if observation.mode is not Mode.FLYING and alone[place] == 1:
                _label(draw, x, y + 30, observation.mode.name.lower())
            _draw_battery(draw, x - 14, y + 19, 28, observation)
            if queues:
                _draw_queue(draw, x, y, queues[observation.drone], drone_colour(observation.drone))
        points = self.world.scenario.access_points if queues else ()
        for queue, point in zip(queues[len(where) :], points, strict=True):
            _draw_queue(draw, *self._pixel(*point.at_m), queue, INK)

    def _write_attribution(self, draw: ImageDraw.ImageDraw) -> None:
        """Write whose data the map has in the corner of the map."""
        if text := textwrap.fill(self.world.attribution, ACROSS):
            look: dict[str, Any] = {"anchor": "rd", "align": "right", "stroke_fill": WHITE}
            corner = WIDTH - PANEL - 4, HEIGHT - 3
            draw.text(corner, text, GREY, font(10), stroke_width=2, **look)

    def _write_time(self, draw: ImageDraw.ImageDraw, snapshot: Snapshot, title: str) -> None:
        """Write the clock and the progress of the episode."""
        draw.text((LEFT, 40), title, GREY, font(12))
        now_s, end_s = snapshot.t_us // US, self.world.horizon_us // US
        draw.text((LEFT, 64), _clock(now_s), INK, font(26))
        draw.text((RIGHT, 74), f"of {_clock(end_s)}", GREY, font(14), anchor="ra")
        draw.rectangle((LEFT, 101, RIGHT, 104), fill=PALE)
        right = LEFT + (RIGHT - LEFT) * snapshot.t_us / self.world.horizon_us
        draw.rectangle((LEFT, 101, right, 104), fill=INK)

    def _write_measures(self, draw: ImageDraw.ImageDraw, scene: FrameScene) -> None:
        """Write the quality of experience so far."""
        qoe1, qoe2, qoe3 = scene.measures()
        rows = ((qoe1, "{:.1f} %"), (qoe2, "{:.2f} steps"), (qoe3, "{:.1f} %"))
        for row, (value, form) in enumerate(rows):
            text = "-" if value is None else form.format(value)
            draw.text((RIGHT, 122 + 20 * row), text, INK, font(14), anchor="ra")

    def _write_users(self, draw: ImageDraw.ImageDraw, count: Counter[UserState]) -> None:
        for row, state in enumerate(USERS):
            draw.text((RIGHT, 213 + 19 * row), str(count[state]), INK, font(13), anchor="ra")

    def _write_drones(
        self, frame: Image.Image, observations: tuple[Observation, ...], altitudes_m: list[float]
    ) -> None:
        """Write two lines per drone: its number, mode, altitude and users, and its battery."""
        draw = ImageDraw.Draw(frame)
        for row, observation in enumerate(observations[:LISTED]):
            y = 319 + 30 * row
            words = observation.mode.name.lower()
            if self.world.scenario.three_d and observation.mode in AIRBORNE:
                words += f", {altitudes_m[row]:.0f} m"
            colour = drone_colour(observation.drone)
            stick(frame, dot(colour, 18), LEFT + 8, y + 13)
            number = (LEFT + 8, y + 13)
            draw.text(number, str(observation.drone), ink_on(colour), font(11), anchor="mm")
            draw.text((LEFT + 26, y), words, INK, font(13))
            if observation.attached_users:
                text = f"{observation.attached_users} users"
                draw.text((RIGHT, y), text, INK, font(13), anchor="ra")
            _draw_battery(draw, LEFT + 26, y + 18, RIGHT - LEFT - 26, observation)
        if len(observations) > LISTED:
            text = f"and {len(observations) - LISTED} more"
            draw.text((LEFT + 26, 319 + 30 * LISTED), text, GREY, font(13))


def _user(state: UserState) -> Image.Image:
    """Return the dot of a user in this state."""
    return dot(USERS[state].colour, DIAMETERS[state])


def _draw_drone(
    picture: Image.Image, draw: ImageDraw.ImageDraw, observation: Observation, x: float, y: float
) -> None:
    """Draw a drone in its colour with its number: filled while it serves, else hollow."""
    colour, serves = drone_colour(observation.drone), observation.mode is Mode.FLYING
    stick(picture, drone(colour, hollow=not serves), x, y)
    ink = ink_on(colour) if serves else INK
    draw.text((x, y), str(observation.drone), ink, font(12), anchor="mm")
    if observation.mode is Mode.CRASHED:
        stick(picture, wreck(), x, y)


def _draw_battery(
    draw: ImageDraw.ImageDraw, left: float, top: float, width: float, observation: Observation
) -> None:
    """A bar of what the battery holds, where it is limited."""
    if observation.battery_s is None or observation.capacity_s is None:
        return
    share = max(0.0, min(1.0, observation.battery_s / observation.capacity_s))
    colour = INK if share > LOW else RED
    draw.rectangle((left, top, left + width, top + 4), fill=PALE)
    if share > 0.0:
        draw.rectangle((left, top, left + width * share, top + 4), fill=colour)


def _draw_queue(
    draw: ImageDraw.ImageDraw, x: float, y: float, queue: TaskQueue, colour: str
) -> None:
    """A square for each task at a processor, filled while it is computed, above what is at (x, y).

    If there are too many, a number says how many are left out.
    """
    shown = min(sum(queue), MOST_SQUARES)
    left, bottom = round(x - shown * SQUARE / 2), round(y - ABOVE)
    for k in range(shown):
        box = (left + k * SQUARE, bottom - SQUARE + 2, left + (k + 1) * SQUARE - 2, bottom)
        draw.rectangle(box, fill=colour if k < queue.computed else WHITE, outline=colour)
    if sum(queue) > shown:
        _label(draw, left + shown * SQUARE + 12, bottom - 3, f"+{sum(queue) - shown}")


def _label(draw: ImageDraw.ImageDraw, x: float, y: float, text: str) -> None:
    """Dark letters on light ground, wherever they stand."""
    draw.text((x, y), text, INK, font(12), anchor="mm", stroke_width=2, stroke_fill=WHITE)


def _clock(seconds: int) -> str:
    """Return a time as hours, minutes and seconds."""
    return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"


def _clipped(text: str, length: int) -> str:
    return text if len(text) <= length else text[: length - 1] + "…"
