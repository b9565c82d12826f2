"""The compiled engine as Python calls it, with arrays; inside there are only pointers to them."""

from __future__ import annotations

from desim_uav.engine.batch import airlink, drones, machine
from desim_uav.engine.batch.kernels import inner, kernel
from desim_uav.engine.batch.memory import Fixed, Ints, Path, State
from desim_uav.engine.batch.pointers import moved, pointer


@inner
def world(w: Fixed) -> Fixed:
    """A world by pointers."""
    return Fixed(pointer(w.i), pointer(w.f))


@inner
def path_at(p: Path, at_i: int, at_f: int) -> Path:
    """One of several sample paths, by pointers (see ``paths_of``)."""
    return Path(moved(pointer(p.i), at_i), moved(pointer(p.f), at_f))


@inner
def state(s: State) -> State:
    """An environment by pointers."""
    return State(pointer(s.i), pointer(s.f))


@kernel
def start_afresh(w: Fixed, s: State) -> None:
    """Put the drones at their starts."""
    machine.start_afresh(world(w), state(s))


@kernel
def reset(w: Fixed, p: Path, s: State) -> None:
    """Begin an episode with the drones as they are, and run up to its first decision epoch."""
    machine.reset(world(w), path_at(p, 0, 0), state(s))


@kernel
def step(w: Fixed, p: Path, s: State, commands: Ints) -> None:
    """Give each drone its command (an index of an action) and run to the next decision epoch."""
    machine.step(world(w), path_at(p, 0, 0), state(s), commands)


@kernel
def measures(w: Fixed, s: State) -> tuple[float, float, float]:
    """QoE1-3 so far, open requests by what they have had so far; nan where nothing was asked."""
    return airlink.measures(world(w), state(s))


@kernel
def position(w: Fixed, s: State, d: int) -> tuple[float, float, float]:
    """Where a drone is now: x, y, z."""
    return drones.position(world(w), state(s), d)


@kernel
def queue_up(s: State, d: int, station: int) -> None:
    """The drone is the last at a station; the first ones there have its pads."""
    drones.queue_up(state(s), d, station)


@kernel
def user_state(s: State, user: int) -> int:
    """What a user is doing (see ``UserState``)."""
    return machine.user_state(state(s), user)
