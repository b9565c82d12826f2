"""Let the drones of a scenario learn."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from desim_uav.api.parameters import EngineName, RunName, Seed, TrainingEpisodes, verb
from desim_uav.errors import Interrupted, UsageError

if TYPE_CHECKING:
    from desim_uav.api.kinds import Overrides, ScenarioLike
    from desim_uav.api.training import Callback, TrainingResult


@verb
def train(
    scenario: ScenarioLike,
    overrides: Overrides | None = None,
    *,
    algorithm: str | None = None,
    episodes: TrainingEpisodes | None = None,
    seed: Seed = None,
    world_seed: Seed = None,
    out: str | Path | bool | None = None,
    name: RunName = None,
    resume: bool = False,
    checkpoint_every: TrainingEpisodes = 500,
    engine: EngineName = "auto",
    callback: Callback | Sequence[Callback] = (),
    callback_every: TrainingEpisodes = 100,
    progress: bool = True,
) -> TrainingResult:
    """Train the drones of a scenario; `run --policy` takes the policy.npz that this writes.

    In Python, this does what ``desim-uav train`` does. The result holds the policy and the learning
    curve. Without ``out`` everything stays in memory and no file is written.

    Args:
        scenario: The name of a shipped scenario, such as case8, or a scenario file (YAML). In
            Python, it may also be the content of one, or a loaded scenario.
        overrides: Set a key of the scenario, as in users.count=60. In a terminal, -S may be
            repeated. In Python, it may also be a mapping, such as ``{"learning.gamma": 0.95}``.
        algorithm: The algorithm: q_learning, sarsa, expected_sarsa, double_q, or a class of your
            own ("package.module:Class"). By default it is the scenario's.
        episodes: The number of episodes to learn from. By default it is the scenario's.
        seed: The seed of all random draws. By default it is the scenario's.
        world_seed: The seed of the world alone: buildings, homes of users, clusters. By default it
            is the scenario's world_seed, or else the seed.
        out: The folder of the training. By default it is runs/<scenario>-<algorithm>-s<seed>, and
            the keys that were set. In Python, the training is written as it goes, with checkpoints,
            if this is a folder, or True for the one that the command line would choose.
        name: A label of the training, which its manifest and ls show.
        resume: Continue from the checkpoint of the folder, if it has one.
        checkpoint_every: The number of episodes between two checkpoints.
        engine: The engine: des (SimPy, easy to read) or batch (compiled, fast). Their numbers are
            the same. With auto, it is batch, if that can run the scenario.
        callback: Called with a ``TrainingProgress`` after each ``callback_every`` episodes and
            after the last; or several such functions. It ends the training by returning False or
            raising ``StopTraining``, and what has been learned is kept. Any other exception ends
            the training and is raised here. It changes no number.
        callback_every: Episodes between two calls. The compiled engine learns from many episodes at
            once and a call comes between two such batches, so calls after every few episodes make
            the training slower.
        progress: Show the progress, on a terminal or in a notebook.

    Raises:
        DesimError: one of its subclasses says what is wrong with the scenario or an option.
        Interrupted: Ctrl-C. Its ``result`` holds what had been learned before.
    """
    parameters = locals()
    from desim_uav.api.arguments import command_of, opened
    from desim_uav.api.sources import each_of
    from desim_uav.api.training import TrainingResult, pause_of
    from desim_uav.experiment.progress import training_progress
    from desim_uav.experiment.train.course import Asked, train_in_memory
    from desim_uav.experiment.train.folder import train_to_folder

    if resume and not out:
        raise UsageError("resume: only a training in a folder can be resumed; say which by out")
    further = {"learning.algorithm": algorithm, "learning.episodes": episodes}
    source = opened(scenario, overrides, seed, world_seed, further)
    asked = Asked(command_of(train, parameters), source.settings, name)
    callbacks = (callback,) if callable(callback) else tuple(each_of("callback", callback))
    if not all(map(callable, callbacks)):
        raise UsageError(f"callback: {callback!r}: must be a function, or several")
    pauses = [pause_of(callbacks, callback_every)] if callbacks else []
    with training_progress(progress, source.scenario.learning.episodes) as bar, source.located():
        if not out:
            course = train_in_memory(
                source.scenario,
                asked=asked,
                engine=engine,
                pauses=pauses,
                on_episode=bar.advance,
            )
        else:
            course = train_to_folder(
                source.scenario,
                out=None if out is True else Path(out),
                resume=resume,
                checkpoint_every=checkpoint_every,
                asked=asked,
                engine=engine,
                pauses=pauses,
                on_start=bar.start,
                on_episode=bar.advance,
            )
    result = TrainingResult(course)
    if course.interrupted:
        raise Interrupted(
            f"interrupted after {result.episodes} episodes; what was learned is in the result of "
            "this error",
            result,
        )
    return result
