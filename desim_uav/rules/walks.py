"""The users' walks: drawn span by span if they are over rows."""

from __future__ import annotations

from desim_uav.rowcode.compiled_rows import call
from desim_uav.rowcode.kernels import rule
from desim_uav.rowcode.rows import address
from desim_uav.rules.rows import Constants, Path, State
from desim_uav.rules.standing import at_home


@rule
def look_anew(world: Constants, path: Path, state: State) -> None:
    """Forget what is known of the users' walks and of marks, at the start of an episode."""
    look, sky = state.look, state.sky
    sky.from_us = sky.to_us = look.walked_us = -1
    look.still = _still(path)
    look.stand = int(look.still and at_home(world, path))
    look.walking.begun = look.walking.lost = sky.marks_lost = 0
    for k in range(len(sky.air.marks_at)):
        sky.air.marks_at[k] = 0


@rule
def _still(path: Path) -> int:
    """Return whether each user stays at one place in the whole episode."""
    if path.stepwise or len(path.legs) + 1 != len(path.legs_at):
        return 0
    for k in range(len(path.legs)):
        if path.legs[k].vx_mps != 0.0 or path.legs[k].vy_mps != 0.0:
            return 0
    return 1


@rule
def know_walks(world: Constants, path: Path, state: State, start_us: int, end_us: int) -> None:
    """Draw the users' walks in a span, if they walk step by step and it is not known yet."""
    look, walking = state.look, state.look.walking
    if path.stepwise and not walking.lost and look.walked_us != end_us:
        look.walked_us = end_us
        homes, streams = address(world.homes), address(path.streams)
        model = world.mobility_values
        call(world.walk, (model, address(walking), homes, streams, start_us, end_us))


@rule
def walks_of(path: Path, state: State) -> tuple[int, int, int]:
    """Return where the users' walks are in memory, how many legs, and where the offsets are."""
    legs, begins = path.legs, path.legs_at
    if path.stepwise:
        legs, begins = state.look.walking.legs, state.look.walking.legs_at
    return address(legs), len(legs), address(begins)
