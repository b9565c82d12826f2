"""The event loop of the compiled engine, which calls the rule of each event in turn."""

from __future__ import annotations

from desim_uav.engine.compiled.fetching import fetch
from desim_uav.engine.compiled.slots import is_before, next_slot
from desim_uav.model.geometry.coverage import LEG, leg_near, walked
from desim_uav.rowcode.kernels import apart, kernel, rare_rule, rule, stands_in_for
from desim_uav.rules.charging import await_full, begin_charging, end_charging, hand_on_pads
from desim_uav.rules.coverage import on_crossing
from desim_uav.rules.crash import crash
from desim_uav.rules.decide import on_arrival
from desim_uav.rules.due import key, separation_slot, undo
from desim_uav.rules.episode import begin, command, end_step, show_first, start_afresh
from desim_uav.rules.points import on_renewal
from desim_uav.rules.requests import (
    on_completion,
    on_deadline,
    on_delivery,
    on_own_completion,
    on_request,
)
from desim_uav.rules.rows import Constants, Path, State
from desim_uav.rules.separation import on_separation
from desim_uav.rules.settle import on_turn, settle
from desim_uav.rules.spots import find_users
from desim_uav.rules.walks import know_walks
from desim_uav.rules.words import (
    ATTACHMENT,
    LOST,
    OUT_OF_MEMORY,
    QUEUED,
    RECORD,
    RESPAWN,
    UNFINISHED,
)

START_AFRESH, RESET, STEP = range(3)
"""The tasks of ``run``: put the drones at their starts, begin an episode, or run a step."""


@kernel
def run(world: Constants, path: Path, state: State, what: int) -> None:
    """Put the drones at their starts, begin an episode, or run a step (``what``).

    It is one kernel, which others call by its address, so that all of it is compiled once.
    """
    if what == START_AFRESH:
        start_afresh(world, state)
        return
    if what == RESET:
        begin(world, path, state)
        state.faults |= UNFINISHED
    elif state.faults & UNFINISHED:
        return  # an error has ended an earlier step of this episode
    else:
        state.faults |= UNFINISHED
        state.events.clear()
        state.closed.clear()
        state.handovers.clear()
        state.updates.clear()
        state.flown.clear()
        command(world, path, state)
    _run_before(world, path, state, key(RESPAWN if what == RESET else RECORD, -1, -1))
    if what == RESET:
        show_first(world, path, state)
    else:
        end_step(world, path, state)
    state.faults &= ~UNFINISHED
    if _overrun(state):
        state.faults |= OUT_OF_MEMORY


@stands_in_for(hand_on_pads)
def _hand_on_pads(world: Constants, state: State, station: int) -> None:
    queue, k = state.stations[station].queue, 0
    while k < min(len(queue), world.pads):
        drone = state.drones[queue[k]]
        k += 1
        if drone.mode == QUEUED:
            phase = begin_charging(world, state, drone, station)
            if not await_full(world, state, drone):
                end_charging(world, state, drone, station, phase)
                k = 0


@stands_in_for(find_users)
def _find_users(world: Constants, path: Path, state: State) -> None:
    look, now_us, count = state.look, state.now_us, len(state.users)
    if look.stand and state.step > 0:
        return  # all users still are where they were
    know_walks(world, path, state, now_us, now_us)
    if path.stepwise:
        if look.walking.lost:
            state.faults |= LOST
            return
        legs, begins = look.walking.legs, look.walking.legs_at
    else:
        legs, begins = path.legs, path.legs_at
    seen = state.sky.seen
    for user in range(count):
        begin, stop = begins[user], begins[user + 1]
        if stop > begin:  # else there was no memory for the user's legs
            guess = stop - 1 if path.stepwise else begin + int(seen[LEG * count + user])
            leg = leg_near(legs, begin, stop, now_us, guess)
            state.spots[user].x_m, state.spots[user].y_m = walked(legs[leg], now_us)


@rule
def _overrun(state: State) -> int:
    """Return whether a queue of the state had no memory left for an entry."""
    walking = state.look.walking
    overrun = int(walking.count > len(walking.legs)) | state.loose.overrun
    overrun |= state.sky.marks_lost
    overrun |= (
        state.unsettled.overrun
        | state.events.overrun
        | state.closed.overrun
        | state.handovers.overrun
        | state.updates.overrun
        | state.flown.overrun
    )
    for d in range(len(state.senders)):
        overrun |= state.senders[d].ahead.overrun | state.senders[d].store.overrun
    return overrun


@rule
def _run_before(world: Constants, path: Path, state: State, end_key: int) -> None:
    """Run all events before ``state.next_us``, and those of that instant with smaller keys."""
    slot = next_slot(state)
    while is_before(state, slot, state.next_us, end_key):
        state.now_us = state.slot_times[slot]
        if state.fetch_at < state.fetch_end:
            fetch(state)
        _happen(world, path, state, slot)
        slot = next_slot(state)
    state.now_us = state.next_us


@rule
def _happen(world: Constants, path: Path, state: State, slot: int) -> None:
    """Let the event of a slot happen."""
    users, drones, senders = len(state.users), len(state.drones), len(state.senders)
    if 2 * users <= slot < 2 * users + senders:
        on_crossing(world, path, state, state.senders[slot - 2 * users])
        return  # its slot already holds the next crossing
    undo(state, slot)
    if slot < users:
        on_completion(world, path, state, state.users[slot])
    elif slot < 2 * users:
        on_request(world, path, state, state.users[slot - users])
    else:
        slot -= 2 * users + senders
        if slot < drones:
            on_arrival(world, path, state, state.drones[slot])
        elif slot < 2 * drones:
            crash(world, path, state, state.drones[slot - drones])
        elif slot == 2 * drones:
            settle(world, path, state, ATTACHMENT, ATTACHMENT)
        else:
            _happen_rarely(world, path, state, slot, separation_slot(state) - 2 * users - senders)


@rare_rule
def _happen_rarely(world: Constants, path: Path, state: State, slot: int, separation: int) -> None:
    """Let the event of a slot happen that few scenarios have, counted from the first arrival."""
    if slot == separation:
        on_separation(world, state)
    elif slot == separation + 1:
        on_renewal(world, path, state)
    elif slot > separation + 1 + 2 * len(state.users):
        on_delivery(world, path, state, state.senders[slot - separation - 2 - 2 * len(state.users)])
    elif slot > separation:
        _happen_to_task(world, path, state, slot - separation - 2)
    else:
        on_turn(world, path, state, state.users[slot - 2 * len(state.drones) - 1])


@apart
def _happen_to_task(world: Constants, path: Path, state: State, slot: int) -> None:
    """Let a task be late, or be done by its user, counted from the first deadline's slot."""
    users = len(state.users)
    if slot < users:
        on_deadline(world, path, state, state.users[slot])
    else:
        on_own_completion(world, path, state, state.users[slot - users])
