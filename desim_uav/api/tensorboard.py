"""A training's progress for TensorBoard."""

from __future__ import annotations

from pathlib import Path

from desim_uav.api.training import TrainingProgress
from desim_uav.errors import MissingExtraError
from desim_uav.typed import typed

CURVES = (
    "reward",
    "qoe1_percent",
    "qoe2_iterations",
    "qoe3_percent",
    "crashes",
    "epsilon",
    "alpha",
)


class TensorBoardCallback:
    """Writes the curves of a training where TensorBoard finds them.

    Give it to ``desim_uav.train`` as ``callback``.
    """

    @typed
    def __init__(self, folder: str | Path, *, evaluate: int = 0, seed: int | None = None) -> None:
        """Open a log folder.

        Args:
            folder: What ``tensorboard --logdir`` is given, or a folder in it for this training.
            evaluate: Episodes to fly the greedy policy in at each call, as curves of their own.
            seed: What these episodes are drawn from. Default: the training's.

        Raises:
            MissingExtraError: TensorBoard is not installed.
        """
        try:
            from tensorboard.summary import Writer
        except ImportError as error:
            raise MissingExtraError("TensorBoardCallback", "tensorboard") from error
        self._writer = Writer(str(folder))
        self._evaluate = evaluate
        self._seed = seed

    def __call__(self, progress: TrainingProgress) -> None:
        """Write the means since the last call, and how the greedy policy does."""
        for name in CURVES:
            self._write(f"training/{name}", getattr(progress, name), progress.episode)
        if self._evaluate:
            for name, value in progress.evaluate(self._evaluate, seed=self._seed).items():
                self._write(f"greedy/{name}", value, progress.episode)
        self._writer.flush()

    def _write(self, name: str, value: float | None, episode: int) -> None:
        if value is not None:
            self._writer.add_scalar(name, value, step=episode)
