"""A Matplotlib window that shows frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from gymnasium import error
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage


class PygletWindow:
    """A window that opens with its first frame and shows each frame for ``1 / fps`` seconds."""

    def __init__(self, fps: float) -> None:
        """Raise UnsupportedMode if there is no display."""
        self.fps = fps
        self.figure = _figure()
        self.image: AxesImage | None = None

    def show(self, frame: NDArray[np.uint8]) -> None:
        """Show a frame (height, width, 3), unless the window has been closed."""
        import matplotlib.pyplot as plt

        if not plt.fignum_exists(self.figure.number):
            return
        if self.image is None:
            axes = self.figure.add_axes((0, 0, 1, 1))
            axes.set_axis_off()
            self.image = axes.imshow(frame)
            self.figure.show()
        self.image.set_data(frame)
        self.figure.canvas.draw()
        self.figure.canvas.start_event_loop(1 / self.fps)

    def close(self) -> None:
        """Close the window. It may be closed more than once."""
        import matplotlib.pyplot as plt

        plt.close(self.figure)


def _figure() -> Figure:
    """Return a figure with a window. Raises UnsupportedMode if there is no display."""
    import matplotlib.pyplot as plt

    try:
        figure = plt.figure(figsize=(8, 6), dpi=100)
    except ImportError as problem:
        raise _no_display() from problem
    if figure.canvas.required_interactive_framework is None:
        plt.close(figure)
        raise _no_display()
    assert figure.canvas.manager is not None, "pyplot's figures have a manager"
    figure.canvas.manager.set_window_title("desim-uav")
    return figure


def _no_display() -> error.UnsupportedMode:
    return error.UnsupportedMode(
        "render_mode 'human': there is no display to open a window on; use render_mode='rgb_array'"
    )
