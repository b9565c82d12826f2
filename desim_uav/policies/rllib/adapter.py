"""The policy that flies drones by networks trained with RLlib."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from desim_uav.errors import MissingExtraError, PolicyError, in_short
from desim_uav.model.observations import Feature
from desim_uav.model.random.streams import Streams
from desim_uav.model.state import Observation
from desim_uav.policies.network_file import reason
from desim_uav.policies.rllib.file import NAME, NetworkFile, Saved
from desim_uav.registry import register
from desim_uav.run_folder import world_hash
from desim_uav.scenario.load import scenario_hash, seedless
from desim_uav.world import World


class InMemory:
    """What would be in the file of an algorithm's checkpoint; messages name the algorithm."""

    def __init__(self, path: str, file: NetworkFile) -> None:
        self.path, self.about, self.statistics = path, file.about, file.statistics
        self._saved = file.saved()

    def saved(self) -> Saved:
        """Return all that was in the file."""
        return self._saved


@register("policy", "rllib")
class RLlib:
    """Chooses the best allowed actions by networks of RLlib, each for one or several drones.

    A drone's observation reaches its network, and the network's output the drone, through the
    connectors of the training. Filters keep the statistics they had at the end of the training.
    """

    ceiling = True

    def __init__(self, folder: str = "") -> None:
        if not folder:
            raise ValueError("a network needs the folder of its checkpoint: rllib:DIR")
        self._use(folder, NetworkFile(self.file_of(folder).parent))

    @classmethod
    def of_model(cls, algorithm: object, name: str) -> RLlib:
        """Act by an algorithm that is in memory, as by the file that ``save`` would write.

        Raises PolicyError for an algorithm that could not be rebuilt.
        """
        saving = importlib.import_module("desim_uav.policies.rllib.saving")
        policy = cls.__new__(cls)
        with TemporaryDirectory(prefix="desim-uav-") as scratch:
            try:
                (Path(scratch) / NAME).write_bytes(saving.content_of(algorithm))
            except PolicyError as error:
                raise PolicyError(f"policy {name!r}: {error}") from error
            policy._use(name, InMemory(f"policy {name!r}", NetworkFile(Path(scratch))))
        return policy

    def _use(self, folder: str, file: NetworkFile | InMemory) -> None:
        self.folder = folder
        self._file = file
        self.world_seed: int | None = self._file.about["world_seed"]
        self._world: World | None = None
        try:
            self._built = importlib.import_module("desim_uav.policies.rllib.network")
        except ModuleNotFoundError as error:
            raise MissingExtraError(f"policy 'rllib:{folder}'", "rllib") from error
        self._require_version()

    @staticmethod
    def file_of(folder: str) -> Path:
        """Return the file of a checkpoint's folder; the argument may also be the file itself."""
        path = Path(folder)
        return path if path.name == NAME and not path.is_dir() else path / NAME

    def _require_version(self) -> None:
        """Check the version of Ray, because connectors and networks change with minor versions."""
        saved, here = self._file.about["ray"], self._built.ray_version()
        if saved.split(".")[:2] != here.split(".")[:2]:
            raise PolicyError(
                f"{self._file.path}: the file was saved with ray {saved}, but ray {here} is "
                f"installed: pip install 'ray[rllib]=={saved}'"
            )

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Build the network, once per world. Raises PolicyError if it does not fit."""
        if world is not self._world:
            world.require_one_type("a network of RLlib")
            self._fit(world)
            try:
                self._network = self._filled(world)
            except PolicyError:
                raise
            except Exception as error:  # RLlib and torch refuse what does not fit in many ways
                raise PolicyError(
                    f"{self._file.path}: the network does not fit: {reason(error)}"
                ) from error
            self._world = world
        self._network.begin()

    def _filled(self, world: World) -> Any:
        """Build the network. Its weights are unpacked only after their number has been checked."""
        network = self._built.Network(self._file.about, world)
        network.require(self._file.statistics)
        network.fill(self._file.saved())
        return network

    def _fit(self, world: World) -> None:
        """Raise PolicyError if the drones of ``world`` have other observations or actions."""
        about = self._file.about
        encoding, of_all = world.scenario.observation, spaces().widest(world)
        descriptions = [described(encoding.features(facts)) for facts in (world.facts, of_all)]
        self._require("drones", len(about["agents"]), world.scenario.drone_count)
        self._require("actions", about["actions"], [a.name.lower() for a in world.actions])
        self._require("observations", about["features"], *descriptions)

    def _require(self, what: str, trained: object, *here: Any) -> None:
        if trained not in here:
            raise PolicyError(
                f"{self._file.path}: the network was trained with {what} {in_short(trained)}; "
                f"the scenario has {in_short(here[0])}"
            )

    def notice(self, world: World) -> str:
        """Return a warning if the network is of another world, or "". Raises as ``begin`` does."""
        self._fit(world)
        about = self._file.about
        name = in_short(about["scenario"])
        if about["world_hash"] is not None:
            if world_hash(world) == about["world_hash"]:
                return ""
            where = f"world: {name}, world seed {about['world_seed']}"
        elif scenario_hash(seedless(world.scenario)) == about["scenario_hash"]:
            return ""
        else:
            where = f"scenario: {name}"
        return f"{self.folder} was trained in another {where}"

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Raise, because a recurrent network has to be asked for all drones together."""
        raise NotImplementedError("rllib: drones are commanded together")

    def act_jointly(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> list[int]:
        """Return the best allowed action of each drone."""
        assert self._world is not None, "begin comes first"
        encode, facts = self._world.scenario.observation.encode, self._world.facts
        codes = [encode(observation, facts) for observation in observations]
        commands: list[int] = self._network.decide(codes, masks)
        return commands


def described(columns: Iterable[Feature]) -> list[list[Any]]:
    """Return features as a file describes them: [name, lowest, highest, whether it is whole]."""
    return [[one.name, float(one.low), float(one.high), one.whole] for one in columns]


def spaces() -> Any:
    """Return the module ``desim_uav.spaces``, whose import loads Gymnasium."""
    return importlib.import_module("desim_uav.spaces")
