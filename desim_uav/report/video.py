"""An episode of a run as a film: GIF, or MP4 in H.264."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable, Iterator
from itertools import chain, pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.ImageColor import getrgb

from desim_uav.disk import write_at
from desim_uav.drawing import sprites
from desim_uav.drawing.frame import HEIGHT, WIDTH, Painter
from desim_uav.engine.base import Measures, TaskQueue, UserState
from desim_uav.errors import DesimError, MissingExtraError, UsageError
from desim_uav.model.rules import US
from desim_uav.model.state import Observation, Snapshot
from desim_uav.report.playback import Moment, Playback

FPS, SPEED = 12.0, 120.0
"""Frames per second, and simulated seconds per second: half an hour lasts 15 s, in 181 frames."""

MOST_FRAMES = 20_000
COLOURS, SAMPLES = 127, 8
"""The colours of a GIF's palette, and about how many frames it is made from."""

UNCHANGED = np.uint8(COLOURS)
"""The transparent colour of a GIF, for pixels that do not change."""

GIF_FPS = 50
"""The largest frame rate of a GIF; browsers slow down faster ones."""

LAST_MS = 1500
NO_DITHER = Image.Dither.NONE
QUALITY = ("-crf", "20", "-preset", "veryfast")
"""Compared with ffmpeg's default preset, half the time and an eighth more bytes."""

BIT_EXACT = ("-map_metadata", "-1", "-fflags", "+bitexact", "-flags:v", "+bitexact")
"""Leave out dates and versions, so that the same film gives the same file."""

OnFrame = Callable[[], None]


class Film:
    """The frames of an episode at equal intervals, from its beginning to its end."""

    def __init__(
        self, playback: Playback, fps: float = FPS, speed: float = SPEED, width: int = WIDTH
    ) -> None:
        """Take ``speed`` simulated seconds per second. Raises UsageError for too many frames."""
        self.playback = playback
        self.fps = fps
        self.size = (2 * (width // 2), 2 * round(width * HEIGHT / WIDTH / 2))  # H.264: even
        step_us = max(1, round(US * speed / fps))
        end_us = playback.duration_us
        self.times_us = [*range(0, end_us, step_us), end_us]
        if len(self.times_us) > MOST_FRAMES:
            raise UsageError(
                f"{len(self.times_us)} frames are too many (at most {MOST_FRAMES}); raise --speed "
                "or lower --fps"
            )
        self._painter = Painter(playback.run.world)
        self._title = f"episode {playback.episode}, seed {playback.run.manifest['seed']}"

    def frame(self, t_us: int) -> Image.Image:
        """Return the frame at a time."""
        moment = self.playback.at(t_us)
        picture = self._painter.picture(MomentView(moment), self._snapshot(moment), self._title)
        if picture.size != self.size:
            picture = picture.resize(self.size, Image.Resampling.LANCZOS)
        return picture

    def __iter__(self) -> Iterator[Image.Image]:
        return map(self.frame, self.times_us)

    def __len__(self) -> int:
        return len(self.times_us)

    def _snapshot(self, moment: Moment) -> Snapshot:
        world = self.playback.run.world
        step, steps = moment.t_us // world.step_us, world.scenario.episode.steps
        grid = world.grid
        served = np.bincount(moment.serving[moment.serving >= 0], minlength=len(moment.modes))
        counts = np.bincount(moment.holders[moment.holders >= 0], minlength=len(moment.modes))
        observations = tuple(
            Observation(
                drone,
                step,
                steps,
                grid.cell_of(x, y),
                grid.level_of(z),
                moment.modes[drone],
                moment.batteries_s[drone],
                world.facts_of(drone).capacity_s,
                None,
                int(counts[drone]),
                int(served[drone]),
                0.0,
            )
            for drone, (x, y, z) in enumerate(moment.drones_m.tolist())
        )
        return Snapshot(step, moment.t_us, False, False, observations, (), (), (), ())


class MomentView:
    """A moment with the methods that the painter calls."""

    def __init__(self, moment: Moment) -> None:
        self.moment = moment

    def positions_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the positions of drones and of users."""
        return self.moment.drones_m, self.moment.users_m

    def user_states(self) -> list[UserState]:
        """Return the state of each user."""
        return self.moment.states

    def queues(self) -> list[TaskQueue]:
        """Return the queue at the processor of each drone and access point."""
        return self.moment.queues

    def measures(self) -> Measures:
        """Return the quality of experience so far."""
        return self.moment.measures


def write_gif(film: Film, out: Path, on_frame: OnFrame = lambda: None) -> None:
    """Write an endless GIF, with one palette for all frames and without dithering.

    Raises UsageError for more frames per second than a GIF can have.
    """
    if film.fps > GIF_FPS:
        raise UsageError(f"fps: {film.fps:g}: a GIF can have at most {GIF_FPS}")
    palette = _palette(film)

    def changes() -> Iterator[Image.Image]:
        before = None
        for frame in film:
            reduced = frame.quantize(palette=palette, dither=NO_DITHER)
            now = np.asarray(reduced)
            changed = now if before is None else np.where(now == before, UNCHANGED, now)
            picture = Image.fromarray(changed, "P")
            picture.putpalette(reduced.getpalette() or [])
            yield picture
            before = now
            on_frame()

    frames = changes()
    file = io.BytesIO()
    about: dict[str, Any] = {"duration": _durations_ms(film), "loop": 0, "disposal": 1}
    about["transparency"] = int(UNCHANGED)
    next(frames).save(file, "GIF", save_all=True, append_images=frames, optimize=False, **about)
    write_at(out, file.getvalue())


def _palette(film: Film) -> Image.Image:
    """Return the palette of a film: the colours with a meaning, and those of some frames."""
    frames = [film.frame(t_us) for t_us in film.times_us[:: max(1, len(film) // SAMPLES)]]
    sheet = Image.new("RGB", (film.size[0], film.size[1] * len(frames)))
    for number, frame in enumerate(frames):
        sheet.paste(frame, (0, number * film.size[1]))
    meant = [getrgb(colour) for colour in sprites.NAMED]
    colours = sheet.quantize(COLOURS - len(meant), Image.Quantize.MEDIANCUT, dither=NO_DITHER)
    palette = Image.new("P", (1, 1))
    palette.putpalette([*chain.from_iterable(meant), *(colours.getpalette() or [])])
    return palette


def _durations_ms(film: Film) -> list[int]:
    """Return the duration of each frame in multiples of 10 ms; the last one is longer."""
    ends = [10 * round(100 * (k + 1) / film.fps) for k in range(len(film))]
    return [*(b - a for a, b in pairwise([0, *ends[:-1]])), LAST_MS]


def need_ffmpeg() -> ModuleType:
    """Return the package that contains ffmpeg. Raises MissingExtraError if it is missing."""
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise MissingExtraError("--mp4", "video") from error
    module: ModuleType = imageio_ffmpeg
    return module


def write_mp4(film: Film, out: Path, on_frame: OnFrame = lambda: None) -> None:
    """Write an MP4 in H.264 and yuv420p, which browsers and presentation programs show.

    Raises MissingExtraError without imageio-ffmpeg, and DesimError if it cannot be written.
    """
    imageio_ffmpeg = need_ffmpeg()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "film.mp4"
        writer = imageio_ffmpeg.write_frames(
            str(place),
            film.size,
            fps=film.fps,
            codec="libx264",
            pix_fmt_out="yuv420p",
            quality=None,
            macro_block_size=2,
            output_params=[*QUALITY, "-movflags", "+faststart", *BIT_EXACT],
        )
        try:
            writer.send(None)
            for frame in film:
                writer.send(frame.tobytes())
                on_frame()
            writer.close()
            content = place.read_bytes()
        except OSError as error:
            raise DesimError(f"cannot write {out}: {error}") from error
    write_at(out, content)
