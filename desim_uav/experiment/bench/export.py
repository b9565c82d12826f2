"""The work of ``desim-uav bench export``: a Minari data set of what a policy saw, did and got.

Each episode of the data set is that of one drone in one episode of a run. The runs are not those of
submissions: they draw their seeds, and in track any their worlds, from those of trainings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from desim_uav.commands.given import Command
from desim_uav.engine.episode import Engine
from desim_uav.env.tasks import WORLDS
from desim_uav.errors import MissingExtraError, UsageError, did_you_mean
from desim_uav.experiment.bench.measure import Recorder
from desim_uav.experiment.bench.run import about, check
from desim_uav.experiment.bench.tasks import ENGINE, EPISODES, WARMUP, BenchTrack, Task
from desim_uav.experiment.provenance import clock, versions
from desim_uav.experiment.run import play
from desim_uav.model.decisions import discount_of
from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import US
from desim_uav.model.state import Observation, Snapshot
from desim_uav.policies import load_policy
from desim_uav.policies.base import as_seen
from desim_uav.registry import names
from desim_uav.run_folder import RunPlace
from desim_uav.scenario.load import from_mapping, to_plain
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World, build_world

if TYPE_CHECKING:
    from minari.data_collector import EpisodeBuffer

SEEDS = WORLDS["train"]
"""The seeds of the runs."""

MANIFEST = "manifest.json"
OF_SUBMISSIONS = ("format", "seal")
"""The entries of the manifest of a submission that a data set has not."""


class Witness(Recorder):
    """Lets a policy decide as in a submission, and keeps the snapshots and commands."""

    def __init__(self, policy: Any, seed: int) -> None:
        super().__init__(policy, seed)
        self.snapshots: list[Snapshot] = []
        self.given: list[Sequence[Command]] = []

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Begin an episode."""
        self.snapshots, self.given = [], []
        super().begin(world, streams, carried)

    def watch(self, engine: Engine) -> None:
        """Note the engine, and show it to the policy if that is a planner."""
        self.engine = engine
        super().watch(engine)

    def act_jointly(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> Sequence[Command]:
        """Return the policy's actions; where a drone has no choice, its only action."""
        commands = super().act_jointly(observations, masks)
        self._note()
        self.given.append([_effective(*pair) for pair in zip(commands, masks, strict=True)])
        return commands

    def whole(self) -> list[Snapshot]:
        """Return the snapshots of the episode that has ended, with the last one."""
        self._note()
        return self.snapshots

    def _note(self) -> None:
        assert self.engine.latest is not None, "the engine is between two steps"
        self.snapshots.append(self.engine.latest)


def storage_class() -> Any:
    """Return the class that writes data sets. Raises MissingExtraError without Minari."""
    try:
        import h5py  # noqa: F401 (Minari asks for it only when it writes)
        from minari.dataset.minari_storage import MinariStorage
    except ModuleNotFoundError as error:
        raise MissingExtraError("bench export", "minari") from error
    return MinariStorage


def scenario_of(task: Task, track: BenchTrack, policy: str, observation: str | None) -> Scenario:
    """Return the scenario of the runs, with the observation of the data set.

    Raises UsageError if there is no such observation, or if the policy needs another one.
    """
    scenario = task.scenario(track)
    own = as_seen(scenario, policy)
    if observation is None:
        return own
    known = names("observation")
    if observation not in known:
        raise UsageError(
            f"--observation {observation}: unknown{did_you_mean(observation, known)}; allowed: "
            f"{', '.join(sorted(known))}"
        )
    if getattr(load_policy(policy), "observation", None) is not None:
        raise UsageError(f"--observation {observation}: {policy} needs an observation of its own")
    component = from_mapping({"observation": {"kind": observation}}).observation
    return scenario.model_copy(update={"observation": component})


def export(
    task: Task,
    track: BenchTrack,
    policy: str,
    place: RunPlace,
    *,
    seeds: int,
    observation: str | None = None,
    command: Sequence[str] = (),
    on_run: Callable[[], None] = lambda: None,
) -> Path:
    """Run a policy on the first seeds of trainings, write the data set, and return its folder.

    Raises MissingExtraError, UsageError and ScenarioError before anything is run.
    """
    storage, now = storage_class(), clock()
    started = now()
    scenario = scenario_of(task, track, policy, observation)
    check(task, track, [policy], SEEDS[:seeds])
    first = build_world(scenario, track.world_of(SEEDS[0]))
    spaces = _spaces(first)
    with place.draft() as draft:
        data = storage.new(draft.path.resolve(), *spaces, data_format="hdf5", jpeg_encoding=False)
        for seed in SEEDS[:seeds]:
            data.update_episodes(episodes(scenario, track, policy, seed))
            on_run()
        content = about(task, track, [policy])
        manifest = {
            **{key: value for key, value in content.items() if key not in OF_SUBMISSIONS},
            "observation": to_plain(scenario)["observation"],
            "seeds": list(SEEDS[:seeds]),
            "command": list(command),
            "started": started,
            "finished": now(),
            "versions": versions() | {"minari": _version()},
        }
        data.update_metadata(
            {
                "dataset_id": f"{task.name}/{place.name.replace('.', '_')}-v0",
                "algorithm_name": policy,
                "description": f"{task.about}; one drone in each episode",
                "minari_version": _version(),
                "desim_uav": manifest,
            }
        )
        draft.write_json(MANIFEST, manifest)
        return place.publish(draft)


def episodes(
    scenario: Scenario, track: BenchTrack, policy: str, seed: int
) -> Iterator[EpisodeBuffer]:
    """Run a policy on a seed, and yield the episodes of each drone."""
    world = build_world(scenario, track.world_of(seed))
    witness = Witness(load_policy(policy), seed)
    for log, _ in play(world, witness, policy, seed, EPISODES, WARMUP, engine=ENGINE):
        snapshots = witness.whole()
        if log.episode >= 0:
            for drone in range(scenario.drone_count):
                yield _of_drone(world, snapshots, witness.given, drone, seed, log.episode)


def _of_drone(
    world: World,
    snapshots: Sequence[Snapshot],
    given: Sequence[Sequence[Command]],
    drone: int,
    seed: int,
    episode: int,
) -> EpisodeBuffer:
    """Return what a drone saw, did and got in an episode."""
    from minari.data_collector import EpisodeBuffer

    from desim_uav.spaces import padded

    seen, acted = _spaces(world)
    encode, drones = world.scenario.observation.encode, range(len(snapshots[0].observations))
    rows = [
        padded(world, [encode(one.observations[d], world.facts_of(d)) for d in drones])[drone]
        for one in snapshots
    ]
    times = np.array([one.t_us for one in snapshots]) / US
    steps = np.diff(times, prepend=times[0]) / world.scenario.episode.step_s
    gamma, after = world.scenario.learning.gamma, snapshots[1:]
    return EpisodeBuffer(
        seed=seed,
        options={"drone": drone, "episode": episode},
        observations=np.array(rows, seen.dtype),
        actions=np.array([commands[drone] for commands in given], acted.dtype),
        rewards=np.array([one.rewards[drone] for one in after]),
        terminations=np.array([one.terminated for one in after]),
        truncations=np.array([one.truncated for one in after]),
        infos={
            "action_mask": np.array([one.masks[drone] for one in snapshots], np.int8),
            "discount": np.array([discount_of(gamma, each) for each in steps]),
        },
    )


def _spaces(world: World) -> tuple[Any, Any]:
    """Return the spaces of a drone's observations and actions. Raises ScenarioError if mixed."""
    from desim_uav.spaces import features, observation_space

    return observation_space(features(world)), world.commands.of_all("a data set").space_of(1)


def _effective(command: Command, mask: Sequence[bool]) -> Command:
    """Return a command, or the only action that a mask allows."""
    return list(mask).index(True) if sum(mask) == 1 and len(mask) > 1 else command


def _version() -> str:
    from importlib.metadata import version

    return version("minari")
