"""Small pictures with soft edges, drawn large and reduced: Pillow itself draws hard ones."""

from __future__ import annotations

import math
from functools import lru_cache

from PIL import Image, ImageDraw, ImageFont
from PIL.ImageFont import FreeTypeFont

# Okabe and Ito's colours, which the colour-blind tell apart.
ORANGE, SKY, GREEN, YELLOW = "#E69F00", "#56B4E9", "#009E73", "#F0E442"
BLUE, VERMILLION = "#0072B2", "#D55E00"
INK, GREY, PALE, WHITE = "#1E1E1E", "#8C8C8C", "#D9D9D6", "#FFFFFF"
NAMED = (ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILLION, INK, GREY, PALE, WHITE)

FINE = 4
"""How much larger a sprite is drawn than it is shown."""


def stick(picture: Image.Image, sprite: Image.Image, x: float, y: float) -> None:
    """Put the middle of a sprite at (x, y) of a picture, which may cut it off."""
    corner = round(x - sprite.width / 2), round(y - sprite.height / 2)
    picture.paste(sprite, corner, sprite)


@lru_cache(maxsize=64)
def dot(colour: str, diameter: int) -> Image.Image:
    """A disc with a white rim."""
    sprite, draw = _canvas(diameter + 2)
    side = sprite.width - 1
    draw.ellipse((0, 0, side, side), fill=WHITE)
    draw.ellipse((FINE, FINE, side - FINE, side - FINE), fill=colour)
    return sprite.reduce(FINE)


@lru_cache(maxsize=16)
def ring(colour: str, radius_px: float) -> Image.Image:
    """A footprint: a see-through disc with an outline."""
    size = 2 * math.ceil(radius_px) + 2
    fine = FINE if size <= 1200 else 1
    sprite, draw = _canvas(size, fine)
    middle, reach = size * fine / 2, radius_px * fine
    box = (middle - reach, middle - reach, middle + reach, middle + reach)
    draw.ellipse(box, fill=f"{colour}1C", outline=f"{colour}B4", width=round(1.5 * fine))
    return sprite.reduce(fine)


@lru_cache(maxsize=8)
def drone(colour: str) -> Image.Image:
    """Four rotors on crossed arms, with room for a number in the middle."""
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
    return sprite.reduce(FINE)


@lru_cache(maxsize=1)
def station() -> Image.Image:
    """A charging station: a plate with a flash."""
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
    """Pillow's own; what it has written once it remembers."""
    found = ImageFont.load_default(size)
    if isinstance(found, FreeTypeFont):
        found.getmask2 = lru_cache(maxsize=2048)(found.getmask2)  # type: ignore[method-assign,assignment]
    return found


def _canvas(size: int, fine: int = FINE) -> tuple[Image.Image, ImageDraw.ImageDraw]:
    sprite = Image.new("RGBA", (size * fine, size * fine))
    return sprite, ImageDraw.Draw(sprite)


def _disc(draw: ImageDraw.ImageDraw, x: float, y: float, radius: float, colour: str) -> None:
    draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=colour)
