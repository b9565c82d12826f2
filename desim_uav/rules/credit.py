"""What each drone adds to the quality of experience in a step, for rewards that pay for it.

A user-time or a part of a request counts as a drone's *alone* if no other sender covers the user
meanwhile: without this drone the user would not have been attached then. Times are integrals of
whole microseconds: a sum of the ends of intervals less their starts, to which those under way add
their number times now. All of this is counted only if ``state.keeps_credit``.
"""

from __future__ import annotations

from desim_uav.model.services import MOVING
from desim_uav.rowcode.kernels import apart, rule
from desim_uav.rules.battery import count_charge
from desim_uav.rules.rows import Drone, State, User
from desim_uav.rules.tasks import own_parts


@rule
def forget_credit(drone: Drone) -> None:
    """Reset what has been counted for a drone, at the start of an episode."""
    credit = drone.credit
    credit.held_us = credit.alone_us = credit.alone = credit.used = 0
    credit.in_time = credit.fallen_us = 0
    credit.served = credit.served_alone = 0.0
    credit.step_held_us = credit.step_alone_us = credit.step_used = 0
    credit.step_in_time = credit.step_fallen_us = 0
    credit.step_served = credit.step_served_alone = 0.0


@apart
def credit_entry(state: State, drone: Drone, user: User) -> None:
    """Count that a user enters a footprint, before ``covered`` counts it."""
    if user.covering[drone.index] < 0 and user.covered <= 1:
        credit_service(state, user)
        if user.covered == 0:
            _begin_alone(state, drone)
        else:
            _end_alone(state, _another(state, drone, user))


@apart
def credit_exit(state: State, drone: Drone, user: User) -> None:
    """Count that a user leaves a footprint, before ``covered`` counts it."""
    if user.covering[drone.index] >= 0 and user.covered <= 2:
        credit_service(state, user)
        if user.covered == 1:
            _end_alone(state, drone)
        else:
            _begin_alone(state, _another(state, drone, user))


@rule
def _another(state: State, drone: Drone, user: User) -> Drone:
    """Return the one sender besides a drone that covers a user."""
    other = 0
    while other == drone.index or user.covering[other] < 0:
        other += 1
    return state.senders[other]


@rule
def _begin_alone(state: State, drone: Drone) -> None:
    """Count from now on a user whom no other sender covers."""
    drone.credit.alone += 1
    drone.credit.alone_us -= state.now_us


@rule
def _end_alone(state: State, drone: Drone) -> None:
    """Count a user no longer whom another sender covers, or none."""
    drone.credit.alone -= 1
    drone.credit.alone_us += state.now_us


@apart
def credit_service(state: State, user: User) -> None:
    """Count what a drone has done for a user's request since this was counted last."""
    request, index = user.request, user.index
    if request.number >= 0 and request.server >= 0 and request.line != MOVING:
        amount = request.done + (state.now_us - request.counted_us) * request.rate
        amount = min(amount, request.required)
        share = float(amount - state.credited[index]) / float(request.required)
        share /= float(request.stages + own_parts(state, user))
        state.credited[index] = amount
        credit = state.senders[request.server].credit
        credit.served += share
        if user.covered == int(user.covering[request.server] >= 0):
            credit.served_alone += share


@apart
def credit_step(state: State) -> None:
    """Write what each drone has added in the step that ends now, and count the next one anew."""
    now_us = state.now_us
    for u in range(len(state.users)):
        credit_service(state, state.users[u])
    for d in range(len(state.senders)):
        drone, credit = state.senders[d], state.senders[d].credit
        credit.step_held_us = credit.held_us + drone.attached_users * now_us
        credit.step_alone_us = credit.alone_us + credit.alone * now_us
        credit.step_served, credit.step_served_alone = credit.served, credit.served_alone
        credit.held_us, credit.alone_us = -drone.attached_users * now_us, -credit.alone * now_us
        credit.served = credit.served_alone = 0.0
        credit.step_in_time, credit.in_time = credit.in_time, 0
        credit.step_fallen_us, credit.fallen_us = credit.fallen_us, 0
    for d in range(len(state.drones)):
        drone, credit = state.drones[d], state.drones[d].credit
        count_charge(drone, state.observations[d].charge)
        credit.step_used, credit.used = drone.used - credit.used, drone.used
