"""Files of saved states, which hold what leads to a state: seeds, carried drones and commands.

A file may come from an untrusted source. Its commands are therefore played again, by the rules that
make every other state, and no index or address of the file reaches compiled code. The digest of the
rows says whether they have led to the state that was saved.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import desim_uav
from desim_uav import array_file
from desim_uav.engine.base import Carried, CarriedDrone
from desim_uav.engine.episode import Engine
from desim_uav.engine.saved import SavedState
from desim_uav.errors import PolicyError, SimulationError, StateError
from desim_uav.model.rules import Mode
from desim_uav.run_folder import write_whole
from desim_uav.sample_path import draw
from desim_uav.scenario.load import scenario_hash, seedless
from desim_uav.world import World

FORMAT = 1
LARGEST_SEED, LARGEST_EPISODE = 2**63, 2**31


class Kept(NamedTuple):
    """What a file says of a state."""

    version: str
    scenario_hash: str
    world_seed: int
    seed: int
    episode: int
    digest: str
    before: Any
    commands: NDArray[Any]

    def played(self, engine: Engine, path: Path) -> SavedState:
        """Return the state to which the commands lead. Raises StateError, which names the file."""
        world = engine.world
        try:
            drones = len(engine.drones)
            if self.commands.shape[1] != drones or len(self.commands) > world.scenario.episode.steps:
                raise ValueError(f"commands of the shape {self.commands.shape} do not fit")
            engine.carry(None if self.before is None else _carried(self.before, world))
            engine.reset(draw(world, self.seed, self.episode))
            for commands in self.commands.tolist():
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


def write(path: Path, saved: SavedState, seed: int) -> None:
    """Write the file of a state in the run of a seed. Raises DesimError if it cannot be written."""
    about = {
        "format": FORMAT,
        "version": desim_uav.__version__,
        "scenario_hash": scenario_hash(seedless(saved.world.scenario)),
        "world_seed": saved.world.seed,
        "seed": seed,
        "episode": saved.path.episode,
        "digest": saved.digest(),
        "before": saved.before,
    }
    drones = saved.world.scenario.drones.count
    commands = np.array(saved.commands, np.int64).reshape(-1, drones)
    write_whole(path, array_file.pack(about, commands=commands))


def read(path: Path) -> Kept:
    """Read the file of a state. Raises StateError, which names the file, if it is none."""
    try:
        stored = array_file.Stored(path, "saved state", ["commands"], FORMAT)
        commands = stored.arrays()["commands"]
    except PolicyError as error:
        raise StateError(str(error)) from error
    about = stored.about
    wanted = {"version": str, "scenario_hash": str, "digest": str}
    wanted |= dict.fromkeys(("world_seed", "seed", "episode"), int)
    for key, kind in wanted.items():
        if type(about.get(key)) is not kind:
            raise StateError(f"{path}: not a readable saved state: {key} is missing or wrong")
    world_seed, seed, episode = about["world_seed"], about["seed"], about["episode"]
    if not (0 <= world_seed < LARGEST_SEED and 0 <= seed < LARGEST_SEED):
        raise StateError(f"{path}: not a readable saved state: a seed is out of range")
    if abs(episode) >= LARGEST_EPISODE or commands.ndim != 2 or commands.dtype != np.int64:
        raise StateError(f"{path}: not a readable saved state: episode or commands are wrong")
    texts = (about["version"], about["scenario_hash"])
    return Kept(*texts, world_seed, seed, episode, about["digest"], about.get("before"), commands)


# ---- the states of drones, from an untrusted source


def _carried(value: Any, world: World) -> Carried:
    """Return the states in which drones began an episode. Raises ValueError if they cannot be."""
    if not isinstance(value, list) or len(value) != world.scenario.drones.count:
        raise ValueError("there is not one carried drone per drone")
    return tuple(_drone(one, world) for one in value)


def _drone(value: Any, world: World) -> CarriedDrone:
    mode, node, battery_us, age_us, hop, route, counted_m, place, fallen_m = value
    nx, ny = world.grid.cells
    one = CarriedDrone(
        Mode(_whole(mode, 0, 99)),
        _node(node, (0, 0, 0), (nx - 1, ny - 1, len(world.grid.levels_m) - 1)),
        _whole(battery_us, 0, world.capacity_us),
        _whole(age_us, 0, 2**53),
        None if hop is None else _node(hop, (-1, -1, -1), (1, 1, 1)),
        tuple(_node(each, (-1, -1, -1), (1, 1, 1)) for each in route),
        _number(counted_m),
        _whole(place, 0, world.scenario.drones.count),
        None if fallen_m is None else _place(fallen_m, world),
    )
    _check_way(one, world)
    return one


def _check_way(one: CarriedDrone, world: World) -> None:
    """Raise ValueError if a drone is nowhere on its way, or at no station that it needs."""
    (nx, ny), levels, at = world.grid.cells, len(world.grid.levels_m), one.node
    for hop in (*([one.hop] if one.hop else []), *one.route):
        if sum(map(abs, hop)) != 1:
            raise ValueError(f"{hop} is no hop")
        at = (at[0] + hop[0], at[1] + hop[1], at[2] + hop[2])
        if not (0 <= at[0] < nx and 0 <= at[1] < ny and 0 <= at[2] < levels):
            raise ValueError(f"the hop {hop} leaves the map")
    if one.mode in (Mode.QUEUED, Mode.CHARGING) and one.node[:2] not in world.stations:
        raise ValueError(f"there is no station at {one.node[:2]}")
    if (one.mode is Mode.CRASHED) != (one.fallen_m is not None):
        raise ValueError("only a crashed drone has fallen")


def _whole(value: Any, least: int, most: int) -> int:
    if type(value) is not int or not least <= value <= most:
        raise ValueError(f"{value!r} is not a whole number from {least} to {most}")
    return value


def _number(value: Any) -> float:
    if type(value) not in (int, float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is not a number")
    return float(value)


def _node(value: Any, least: tuple[int, int, int], most: tuple[int, int, int]) -> Any:
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError(f"{value!r} is no cell and level")
    return tuple(_whole(*each) for each in zip(value, least, most, strict=True))


def _place(value: Any, world: World) -> tuple[float, float]:
    x_m, y_m = map(_number, value)
    if not (0.0 <= x_m <= world.area.width_m and 0.0 <= y_m <= world.area.depth_m):
        raise ValueError(f"({x_m}, {y_m}) m is off the map")
    return x_m, y_m
