"""What a check of a whole scenario has found."""

from __future__ import annotations

from typing import NamedTuple

from desim_uav.scenario.yaml12 import KeyPath


class Finding(NamedTuple):
    """What is wrong, where to report it, and the other keys it depends on."""

    path: KeyPath
    message: str
    also: tuple[KeyPath, ...] = ()
