"""The colours and words of drones and users, the same in replays, figures, films and reports.

Drone ``k`` has one colour wherever it is drawn, and so has each state of a user. The colours keep
apart for the colour-blind (protan, deutan and tritan vision), and neighbouring drones differ in
lightness, so that they keep apart in grey too. All of them can be seen on a white and on a dark
ground. The first three and those of the users are from Okabe and Ito, "Color Universal Design"
(2008); the others were chosen to be far from these.
"""

from __future__ import annotations

from typing import NamedTuple

from desim_uav.engine.base import UserState

DRONES = ("#0072B2", "#E69F00", "#CC79A7", "#8C5A32", "#7A4DF0", "#BDB175", "#5F6B78")
"""By the number of the drone; they repeat after the last, and numbers tell the drones apart."""

DARK, LIGHT = "#111418", "#FFFFFF"


class UserLook(NamedTuple):
    """The word for a user's state and its colour."""

    word: str
    colour: str


USERS = {
    UserState.SERVED: UserLook("served", "#009E73"),
    UserState.OPEN: UserLook("waiting", "#D55E00"),
    UserState.ATTACHED: UserLook("not asking, covered", "#56B4E9"),
    UserState.IDLE: UserLook("not asking, outside", "#7C858D"),
}
"""By state, in the order of a legend. A user with an open request is served or waits; one without
is covered by a drone or outside all footprints."""


def drone_colour(drone: int) -> str:
    """The colour of a drone, as #RRGGBB."""
    return DRONES[drone % len(DRONES)]


def ink_on(colour: str) -> str:
    """Dark or light letters, whichever have more contrast on a colour (WCAG 2.1)."""
    lightness = luminance(colour)
    on_dark, on_light = (luminance(DARK) + 0.05), (luminance(LIGHT) + 0.05)
    return DARK if (lightness + 0.05) / on_dark > on_light / (lightness + 0.05) else LIGHT


def luminance(colour: str) -> float:
    """The relative luminance of a colour #RRGGBB, 0 to 1 (WCAG 2.1)."""
    red, green, blue = (_linear(int(colour[at : at + 2], 16) / 255) for at in (1, 3, 5))
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def _linear(channel: float) -> float:
    """A channel of sRGB as an intensity."""
    return channel / 12.92 if channel <= 0.04045 else ((channel + 0.055) / 1.055) ** 2.4
