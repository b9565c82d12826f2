"""Flies the drones by a network of RLlib."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from desim_uav.errors import MissingExtraError, PolicyError, in_short
from desim_uav.model.observations import Feature
from desim_uav.model.state import Observation
from desim_uav.model.streams import Streams
from desim_uav.policies.network_file import reason
from desim_uav.policies.rllib.file import NAME, NetworkFile
from desim_uav.registry import register
from desim_uav.run_folder import world_hash
from desim_uav.scenario.load import scenario_hash, seedless
from desim_uav.world import World


@register("policy", "rllib")
class RLlib:
    """The best allowed action by networks of RLlib, one for each drone or one for several.

    What a drone is shown goes to its network, and what that says to the drone, through the
    connectors of the training. Filters stay as the training has left them.
    """

    ceiling = True

    def __init__(self, folder: str = "") -> None:
        if not folder:
            raise ValueError("a network needs the folder of its checkpoint: rllib:DIR")
        self.folder = folder
        self._file = NetworkFile(self.file_of(folder).parent)
        self.world_seed: int | None = self._file.about["world_seed"]
        self._world: World | None = None
        try:
            self._built = importlib.import_module("desim_uav.policies.rllib.network")
        except ModuleNotFoundError as error:
            raise MissingExtraError(f"policy 'rllib:{folder}'", "rllib") from error
        self._require_version()

    @staticmethod
    def file_of(folder: str) -> Path:
        """What is read of a checkpoint; the file itself may be named too."""
        path = Path(folder)
        return path if path.name == NAME and not path.is_dir() else path / NAME

    def _require_version(self) -> None:
        """Connectors and networks are Ray's own business, and change with its minor versions."""
        saved, here = self._file.about["ray"], self._built.ray_version()
        if saved.split(".")[:2] != here.split(".")[:2]:
            raise PolicyError(
                f"{self._file.path}: it is of ray {saved}, and {here} is installed: "
                f"pip install 'ray[rllib]=={saved}' reads it"
            )

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Build the network, once for a world. Raises PolicyError where it does not fit."""
        if world is not self._world:
            self._fit(world)
            try:
                self._network = self._filled(world)
            except PolicyError:
                raise
            except Exception as error:  # RLlib and torch refuse what does not fit in many ways
                raise PolicyError(f"{self._file.path}: it does not fit: {reason(error)}") from error
            self._world = world
        self._network.begin()

    def _filled(self, world: World) -> Any:
        """The network. Numbers are unpacked once it is known that they are as many as it has."""
        network = self._built.Network(self._file.about, world)
        network.require(self._file.statistics)
        network.fill(self._file.saved())
        return network

    def _fit(self, world: World) -> None:
        """Raises PolicyError where the drones here see or may do something else."""
        about = self._file.about
        encoding, of_all = world.scenario.observation, spaces().widest(world)
        seen = [described(encoding.features(facts)) for facts in (world.facts, of_all)]
        self._require("drones", len(about["agents"]), world.scenario.drones.count)
        self._require("actions", about["actions"], [a.name.lower() for a in world.actions])
        self._require("observations", about["features"], *seen)

    def _require(self, what: str, trained: Any, *here: Any) -> None:
        if trained not in here:
            raise PolicyError(
                f"{self._file.path}: it has {what} {in_short(trained)}; "
                f"the scenario has {in_short(here[0])}"
            )

    def notice(self, world: World) -> str:
        """What to warn of before it acts in a world, or nothing. Raises as ``begin`` does."""
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
        """Drones are commanded together: a network may remember what it has shown each."""
        raise NotImplementedError("rllib: drones are commanded together")

    def act_jointly(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> list[int]:
        """The best allowed action of each drone."""
        assert self._world is not None, "begin comes first"
        encode, facts = self._world.scenario.observation.encode, self._world.facts
        codes = [encode(observation, facts) for observation in observations]
        commands: list[int] = self._network.decide(codes, masks)
        return commands


def described(shown: Iterable[Feature]) -> list[list[Any]]:
    """What a drone is shown, as a file says it: [name, lowest, highest, is it whole?]."""
    return [[one.name, float(one.low), float(one.high), one.whole] for one in shown]


def spaces() -> Any:
    """The module, which imports Gymnasium."""
    return importlib.import_module("desim_uav.spaces")
