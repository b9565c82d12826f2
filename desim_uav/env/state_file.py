"""Files of saved states, which hold what leads to a state: seeds, carried drones and commands.

A file may come from an untrusted source. Its commands are therefore played again, by the rules that
make every other state, and no index or address of the file reaches compiled code. The digest of the
rows says whether they have led to the state that was saved.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import desim_uav
from desim_uav import array_file
from desim_uav.disk import write_whole
from desim_uav.engine.episode import Engine
from desim_uav.engine.saved import SavedState
from desim_uav.env.carried_drones import checked, plain
from desim_uav.errors import PolicyError, SimulationError, StateError
from desim_uav.rules.words import AIMS
from desim_uav.sample_path import draw
from desim_uav.scenario.load import scenario_hash, seedless
from desim_uav.world import World

FORMAT = 1
LARGEST_SEED, LARGEST_EPISODE = 2**63, 2**31


class Kept(NamedTuple):
    """The content of a file of a saved state.

    ``numbers`` (steps, drones, numbers) are those of commands of free flight (``Commands.kept``);
    None if the file has none.
    """

    version: str
    scenario_hash: str
    world_seed: int
    seed: int
    episode: int
    steps: int
    digest: str
    before: Any
    commands: NDArray[Any]
    numbers: NDArray[Any] | None = None

    def played(self, engine: Engine, path: Path) -> SavedState:
        """Return the state to which the commands lead. Raises StateError, which names the file."""
        world = engine.world
        try:
            steps = self._steps(world)
            before, ceilings = self.before, engine.settings.ceilings
            engine.carry(None if before is None else checked(before, world, ceilings))
            engine.reset(draw(world, self.seed, self.episode))
            for commands in steps:
                engine.step(commands)
        except (SimulationError, ValueError) as error:
            raise StateError(f"{path}: cannot be played: {error}") from error
        saved = engine.save()
        if saved.digest() != self.digest:
            raise StateError(
                f"{path}: its commands lead to another state than the one that was saved, by "
                f"desim-uav {self.version}; this is {desim_uav.__version__}"
            )
        return saved

    def _steps(self, world: World) -> list[Any]:
        """Return the commands of each step. Raises ValueError if they do not fit a world."""
        steps, drones = self.commands.shape
        if drones != world.scenario.drone_count or steps > world.most_epochs:
            raise ValueError(f"commands of the shape {self.commands.shape} do not fit")
        return world.commands.played(self.commands.tolist(), self.numbers)


def write(path: Path, saved: SavedState, seed: int, steps: int) -> None:
    """Write the file of a state in the run of a seed, whose earlier episodes had so many steps.

    Raises DesimError if it cannot be written.
    """
    about = {
        "format": FORMAT,
        "version": desim_uav.__version__,
        "scenario_hash": scenario_hash(seedless(saved.world.scenario)),
        "world_seed": saved.world.seed,
        "seed": seed,
        "episode": saved.path.episode,
        "steps": steps,
        "digest": saved.digest(),
        "before": plain(saved.before),
    }
    drones = saved.world.scenario.drone_count
    arrays: dict[str, NDArray[Any]] = {
        "commands": np.array(saved.commands, np.int64).reshape(-1, drones)
    }
    if (numbers := saved.numbers) is not None:
        arrays["numbers"] = numbers
    write_whole(path, array_file.pack(about, **arrays))


def read(path: Path) -> Kept:
    """Read the file of a state. Raises StateError, which names the file, if it is none."""
    try:
        free = "numbers" in array_file.names_in(path)
        names = ["commands", "numbers"] if free else ["commands"]
        stored = array_file.Stored(path, "saved state", names, FORMAT)
        _check_forms(path, stored.forms)
        arrays = stored.arrays()
    except PolicyError as error:
        raise StateError(str(error)) from error
    about = stored.about
    types: dict[str, type] = {"version": str, "scenario_hash": str, "digest": str}
    types |= dict.fromkeys(("world_seed", "seed", "episode", "steps"), int)
    for key, kind in types.items():
        if type(about.get(key)) is not kind:
            raise StateError(f"{path}: not a readable saved state: {key} is missing or wrong")
    world_seed, seed, episode = about["world_seed"], about["seed"], about["episode"]
    steps = about["steps"]
    if not (0 <= world_seed < LARGEST_SEED and 0 <= seed < LARGEST_SEED):
        raise StateError(f"{path}: not a readable saved state: a seed is out of range")
    if abs(episode) >= LARGEST_EPISODE or not 0 <= steps < LARGEST_SEED:
        raise StateError(f"{path}: not a readable saved state: episode or steps are out of range")
    numbers = arrays.get("numbers")
    if numbers is not None and not np.isfinite(numbers).all():
        raise StateError(f"{path}: not a readable saved state: numbers are not finite")
    texts, counts = (about["version"], about["scenario_hash"]), (world_seed, seed, episode, steps)
    return Kept(*texts, *counts, about["digest"], about.get("before"), arrays["commands"], numbers)


def _check_forms(path: Path, forms: dict[str, Any]) -> None:
    """Raise StateError unless arrays have the types and the dimensions that they must have."""
    shape, dtype = forms["commands"]
    if len(shape) != 2 or dtype != np.int64:
        raise StateError(f"{path}: not a readable saved state: commands are wrong")
    if "numbers" in forms:
        more, dtype = forms["numbers"]
        if more[:2] != shape or len(more) != 3 or more[2] > AIMS or dtype != np.float64:
            raise StateError(f"{path}: not a readable saved state: numbers are wrong")
