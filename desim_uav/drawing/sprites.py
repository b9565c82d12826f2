"""Small pictures with smooth edges. They are drawn large and then reduced."""

from __future__ import annotations

import math
from functools import lru_cache

from PIL import Image, ImageDraw, ImageFont
from PIL.ImageFont import FreeTypeFont

from desim_uav.palette import DRONES, USERS

YELLOW, RED = "#F0E442", "#B3261E"
INK, GREY, PALE, WHITE = "#1E1E1E", "#6E6E6E", "#D9D9D6", "#FFFFFF"
NAMED = (*DRONES, *(look.colour for look in USERS.values()), YELLOW, RED, INK, GREY, PALE, WHITE)
"""All colours that have a meaning."""

FINE = 4
"""The factor by which a sprite is drawn larger than it is shown."""


def stick(picture: Image.Image, sprite: Image.Image, x: float, y: float) -> None:
    """Paste a sprite with its centre at (x, y) of a picture, which may clip it."""
    corner = round(x - sprite.width / 2), round(y - sprite.height / 2)
    picture.paste(sprite, corner, sprite)


@lru_cache(maxsize=64)
def dot(colour: str, diameter: int) -> Image.Image:
    """Draw a disc with a white rim."""
    sprite, draw = _canvas(diameter + 2)
    side = sprite.width - 1
    draw.ellipse((0, 0, side, side), fill=WHITE)
    draw.ellipse((FINE, FINE, side - FINE, side - FINE), fill=colour)
    return sprite.reduce(FINE)


@lru_cache(maxsize=16)
def ring(colour: str, radius_px: float) -> Image.Image:
    """Draw a footprint: a translucent disc with an outline."""
    size = 2 * math.ceil(radius_px) + 2
    fine = FINE if size <= 1200 else 1
    sprite, draw = _canvas(size, fine)
    middle, reach = size * fine / 2, radius_px * fine
    box = (middle - reach, middle - reach, middle + reach, middle + reach)
    draw.ellipse(box, fill=f"{colour}1C", outline=f"{colour}B4", width=round(1.5 * fine))
    return sprite.reduce(fine)


@lru_cache(maxsize=2 * len(DRONES))
def drone(colour: str, hollow: bool = False) -> Image.Image:
    """Draw four rotors on crossed arms, with room for a number in the middle.

    A drone that does not serve has a hollow middle.
    """
    size = 34
    sprite, draw = _canvas(size)
    side, reach = size * FINE, 9 * FINE
    middle = side / 2
    for dx, dy in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        x, y = middle + dx * reach, middle + dy * reach
        draw.line((middle, middle, x, y), fill=colour, width=3 * FINE)
        _disc(draw, x, y, 6.5 * FINE, WHITE)
        _disc(draw, x, y, 5.5 * FINE, colour)
        _disc(draw, x, y, 3.5 * FINE, PALE)
    _disc(draw, middle, middle, 8.5 * FINE, WHITE)
    _disc(draw, middle, middle, 7.5 * FINE, colour)
    if hollow:
        _disc(draw, middle, middle, 5.8 * FINE, WHITE)
    return sprite.reduce(FINE)


@lru_cache(maxsize=1)
def mast() -> Image.Image:
    """Draw an access point: a triangle with a white rim."""
    size = 20
    sprite, draw = _canvas(size)
    for rim, colour in ((0, WHITE), (2 * FINE, INK)):
        top, left = (size * FINE / 2, 1.5 * rim), (rim, size * FINE - rim)
        draw.polygon((top, left, (size * FINE - rim, left[1])), fill=colour)
    return sprite.reduce(FINE)


@lru_cache(maxsize=1)
def wreck() -> Image.Image:
    """Draw the cross over a drone that has crashed."""
    size = 30
    sprite, draw = _canvas(size)
    low, high = 3 * FINE, (size - 3) * FINE
    for width, colour in ((6 * FINE, WHITE), (3 * FINE, RED)):
        draw.line((low, low, high, high), fill=colour, width=width)
        draw.line((low, high, high, low), fill=colour, width=width)
    return sprite.reduce(FINE)


@lru_cache(maxsize=1)
def station() -> Image.Image:
    """Draw a charging station: a plate with a flash."""
    sprite, draw = _canvas(24)
    side = sprite.width - 1
    draw.rounded_rectangle(
        (0, 0, side, side), 5 * FINE, fill=YELLOW, outline=INK, width=FINE * 3 // 2
    )
    flash = ((13.5, 3.5), (6.5, 13.5), (11, 13.5), (9.5, 20.5), (17, 10.5), (12.5, 10.5))
    draw.polygon([(x * FINE, y * FINE) for x, y in flash], fill=INK)
    return sprite.reduce(FINE)


@lru_cache(maxsize=8)
def font(size: int) -> FreeTypeFont | ImageFont.ImageFont:
    """Return Pillow's own font in this size."""
    typeface = ImageFont.load_default(size)
    if isinstance(typeface, FreeTypeFont):
        typeface.getmask2 = lru_cache(maxsize=2048)(typeface.getmask2)  # type: ignore[method-assign,assignment]
    return typeface


def _canvas(size: int, fine: int = FINE) -> tuple[Image.Image, ImageDraw.ImageDraw]:
    sprite = Image.new("RGBA", (size * fine, size * fine))
    return sprite, ImageDraw.Draw(sprite)


def _disc(draw: ImageDraw.ImageDraw, x: float, y: float, radius: float, colour: str) -> None:
    draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=colour)
