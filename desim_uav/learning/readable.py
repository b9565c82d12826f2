"""Training in Python: any engine, observation and algorithm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from desim_uav.engine.episode import Engine
from desim_uav.learning.rows import EpisodeRow
from desim_uav.model.observations import table_row
from desim_uav.model.rules import Mode
from desim_uav.model.state import Snapshot
from desim_uav.sample_path import SamplePath


@dataclass(frozen=True)
class Readable:
    """An engine whose decision epochs are written into the rows of an episode's learners.

    ``draws`` (epochs, drones, 3) are the random numbers of the episode.
    """

    engine: Engine
    path: SamplePath
    draws: Sequence[Sequence[Sequence[float]]]

    def begin(self, episode: EpisodeRow) -> None:
        """Begin the episode."""
        self._show(episode, self.engine.reset(self.path))

    def step(self, episode: EpisodeRow) -> None:
        """Give the drones their commands, and run to the next decision epoch."""
        snapshot = self.engine.step([learner.command for learner in episode.learners])
        for learner, reward in zip(episode.learners, snapshot.rewards, strict=True):
            learner.reward, learner.share = reward, self.engine.state.share
        self._show(episode, snapshot)

    def _show(self, episode: EpisodeRow, snapshot: Snapshot) -> None:
        """Write a decision epoch into the rows of the learners."""
        world, draws = self.engine.world, self.draws[snapshot.step]
        encode = world.scenario.observation.encode
        episode.terminated, episode.truncated = snapshot.terminated, snapshot.truncated
        for learner, observation, mask, uniforms in zip(
            episode.learners, snapshot.observations, snapshot.masks, draws, strict=True
        ):
            lesson: Any = learner.lesson
            lesson.allowed = mask
            learner.explore, learner.which, lesson.coin = uniforms
            removes = world.type_of(observation.drone).on_crash == "remove"
            learner.lost = removes and observation.mode is Mode.CRASHED
            learner.decides = sum(mask) > 1
            if learner.decides:
                code = encode(observation, world.facts_of(observation.drone))
                features = len(world.features_of(observation.drone))
                lesson.next_state = table_row(code, episode.sizes, features)
