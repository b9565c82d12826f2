"""Legs that are flown again and again over users who stand: their changes are remembered."""

from __future__ import annotations

from desim_uav.model.radio.marks import DRAWN
from desim_uav.rowcode.compiled_rows import call, call_for_int
from desim_uav.rowcode.kernels import rule
from desim_uav.rowcode.rows import address
from desim_uav.rules.rows import Constants, Drone, State
from desim_uav.rules.words import OWN


@rule
def recurs(world: Constants, state: State, drone: Drone, end_us: int) -> bool:
    """Return whether the same changes come whenever a drone flies its leg (``sky.leg_memory``).

    They do if all users stand at home, nothing interferes or is drawn, and the marks of the leg, if
    it has any, begin now. A leg of free flight is flown once.
    """
    radio = world.scene.radios[drone.radio]
    is_drawn = radio.sight == DRAWN or radio.los_shadow_db > 0.0 or radio.nlos_shadow_db > 0.0
    return bool(
        state.look.stand
        and drone.transit != OWN
        and world.reuse == 0
        and not is_drawn
        and drone.marked_until_us < end_us
    )


@rule
def recall_leg(world: Constants, state: State, drone: Drone, end_us: int) -> int:
    """Write the changes on a leg until a time, if they are known, and return their number.

    It is -1 if no drone has flown the leg before. The leg and the classes of links are in the sky.
    """
    places = address(world.scene), address(state.sky), *drone.ahead.space(state.sky.changes)
    return call_for_int(world.recall_leg, (*places, drone.index, state.now_us, end_us))


@rule
def remember_leg(world: Constants, state: State, drone: Drone, count: int) -> None:
    """Keep the changes on a leg for the next time, unless there was too little memory for them."""
    out, room = drone.ahead.space(state.sky.changes)
    if count <= room and not state.sky.marks_lost:
        call(world.remember_leg, (address(state.sky), out, count, state.now_us))
