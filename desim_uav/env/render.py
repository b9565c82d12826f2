"""Rendering of environments, as frames in arrays or in a window."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from gymnasium import error, logger
from numpy.typing import NDArray

from desim_uav.drawing.frame import Painter
from desim_uav.env.session import Session
from desim_uav.env.window import PygletWindow

RENDERING: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 4}


class Screen:
    """Shows a session according to ``mode``: None, "rgb_array", or "human" (a window).

    A copy opens a window of its own when it first shows a frame.
    """

    def __init__(self, session: Session, mode: str | None) -> None:
        """Raise UnsupportedMode for an unknown mode, and for "human" without a display."""
        if mode not in (None, *RENDERING["render_modes"]):
            raise error.UnsupportedMode(
                f"render_mode {mode!r}: must be None, 'rgb_array' or 'human'"
            )
        self.session = session
        self.mode = mode
        self.window = self._new_window() if mode == "human" else None

    def __getstate__(self) -> dict[str, Any]:
        """Return the session and the mode, without window and pictures."""
        return {"session": self.session, "mode": self.mode, "window": None}

    def _new_window(self) -> PygletWindow:
        return PygletWindow(RENDERING["render_fps"])

    def render(self) -> NDArray[np.uint8] | None:
        """Return the present frame, or None if the window shows it.

        Raises ResetNeeded before the first episode.
        """
        if self.mode == "rgb_array":
            return self.frame()
        if self.mode is None:
            logger.warn("render() shows nothing without a render_mode, such as 'rgb_array'")
        self.refresh()
        return None

    def refresh(self) -> None:
        """Show the present state in the window, if there is one."""
        if self.mode == "human":
            self.window = self.window or self._new_window()
            self.window.show(self.frame())

    def close(self) -> None:
        """Close the window and release the pictures."""
        if self.window is not None:
            self.window.close()
        self.__dict__.pop("_painter", None)

    def frame(self) -> NDArray[np.uint8]:
        """Return the present frame, uint8 (height, width, 3), whatever the mode.

        Raises ResetNeeded before the first episode.
        """
        session = self.session
        if self._painter.world is not session.world:
            self.__dict__.pop("_painter")
        title = f"episode {session.episode}, seed {session.seed}"
        return self._painter.frame(session.engine, session.snapshot, title)

    @cached_property
    def _painter(self) -> Painter:
        return Painter(self.session.world)
