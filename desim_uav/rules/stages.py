"""The stages of requests: how they follow each other, and where a request stands meanwhile.

A request needs an amount in each of its stages, one after the other (see ``model.services.Stage``).
What it has in its present stage (``required``, ``done``, ``rate``, …) begins anew with each one. A
stage stands in a line of the drone to which its user is attached: in ``waiting`` until the rate
that it holds is admitted, or in ``sharing`` until it ends. One that needs a processor stands in
``computing`` (see ``rules.tasks``).
"""

from __future__ import annotations

from desim_uav.model.catalogue import drawn_amount
from desim_uav.model.services import COMPUTING, MOVING, SHARING, WAITING
from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rowcode.rows import Queue, Table
from desim_uav.rules.backhaul import relay_of
from desim_uav.rules.bands import show_band
from desim_uav.rules.rows import Closed, Constants, Drone, Path, Request, State, User


@rule
def draw_values(world: Constants, path: Path, state: State, user: User, number: int) -> bool:
    """Begin the first stage of a request, which has the number ``number`` in the sample path.

    The values for its later stages are kept, for the path of a planner has others.
    """
    first = number * world.draws
    if len(state.drawn) > 0:
        for k in range(world.draws):
            state.drawn[first_drawn(world, user) + k] = path.drawn[first + k]
    user.request.stages = count_stages(world, user.request)
    return _begin_stage(world, state, user, path.drawn, first, 0, 1.0)


@rule
def first_drawn(world: Constants, user: User) -> int:
    """Return the number of the first value of a user's request in ``State.drawn``."""
    return user.index * world.draws


@rule
def count_stages(world: Constants, request: Request) -> int:
    """Return how many stages the service of a request has."""
    return world.first_stages[request.service + 1] - world.first_stages[request.service]


@rule
def begin_anew(world: Constants, state: State, user: User, part: float) -> bool:
    """Let a part of a user's request, of which all is lost, begin its first stage again."""
    user.request.stages = count_stages(world, user.request)
    return _begin_stage(world, state, user, state.drawn, first_drawn(world, user), 0, part)


@rule
def next_stage(world: Constants, state: State, user: User, part: float) -> bool:
    """Pass a part of a user's request on to its next stage; return False if there is none.

    A task that has been moved begins the stage of which nothing was done before.
    """
    following = user.request.stage + int(user.request.line != MOVING)
    if following < user.request.stages:
        return _begin_following(world, state, user, following, part)
    return False


@rare_rule
def _begin_following(
    world: Constants, state: State, user: User, following: int, part: float
) -> bool:
    """Begin stage number ``following`` of a part of a request (see ``_begin_stage``)."""
    return _begin_stage(world, state, user, state.drawn, first_drawn(world, user), following, part)


@rule
def part_of(amount: int, part: float) -> int:
    """Return a part of an amount, rounded down."""
    return amount if part == 1.0 else int(float(amount) * part)


@rule
def _begin_stage(
    world: Constants,
    state: State,
    user: User,
    values: Table[int],
    first: int,
    following: int,
    part: float,
) -> bool:
    """Begin the first stage from number ``following`` on whose amount is above 0, if there is one.

    The amounts are a ``part`` of those that were drawn. If there is no such stage, the one that has
    been done is the request's last one.
    """
    request = user.request
    for k in range(following, request.stages):
        stage = world.stages[world.first_stages[request.service] + k]
        amount = part_of(drawn_amount(stage, values, first), part)
        if amount > 0:
            request.stage, request.line, request.up = k, stage.line, stage.up
            request.required, request.done = amount, 0
            if state.keeps_credit:
                state.credited[user.index] = 0
            request.bandwidth_bps = values[first + stage.rate] if stage.rate >= 0 else 0
            request.rate = 1 if stage.timed else request.bandwidth_bps
            return True
    request.stages = request.stage + 1
    return False


@rule
def progress(request: Request, amount: int) -> float:
    """Return the progress of a request: the stages done, and the share of this one, over all.

    ``amount`` is what has been done in the present stage. Numbers with a point are divided, because
    Python and compiled code divide whole numbers of more than 53 bits differently.
    """
    share = float(amount) / float(request.required)
    return (float(request.stage) + share) / float(request.stages)


@rule
def count_amounts(world: Constants, state: State, user: User, closed: Closed) -> None:
    """Write what a user's request needed in all stages, and what volume it got, into the log.

    They are sums over the stages that are measured in time, and over the ``part`` that is offloaded
    of those in bits.
    """
    request, first = user.request, first_drawn(world, user)
    closed.asked_us = closed.asked_ubit = closed.sent_ubit = 0
    for k in range(request.stages):
        stage = world.stages[world.first_stages[request.service] + k]
        amount = request.required
        if k != request.stage:
            amount = part_of(drawn_amount(stage, state.drawn, first), closed.part)
        if stage.timed:
            closed.asked_us += amount
        elif stage.line <= SHARING:
            closed.asked_ubit += amount
            if k < request.stage:
                closed.sent_ubit += amount
            elif k == request.stage:
                closed.sent_ubit += request.done


@rule
def scan_later(state: State, drone: Drone) -> None:
    """Let a drone divide its bandwidth and its processor anew when this instant is settled."""
    if not drone.scan:
        drone.scan = 1
        state.to_scan += 1


@rule
def join(state: State, drone: Drone, user: User) -> None:
    """Let a user's request stand in the line of a drone's link that its stage needs."""
    user.request.queued = 1
    show_band(drone, user.request.up)
    if user.request.line == SHARING:
        _insert(state, drone.sharing, user)
        if state.relays:
            _count_relayed(state, drone, user, 1)
        drone.shared_hz = 0
    else:
        _insert(state, drone.waiting, user)


@rule
def leave(state: State, drone: Drone, user: User) -> None:
    """Remove a user's request from the line of a drone if it stands there."""
    if user.request.queued:
        user.request.queued = 0
        show_band(drone, user.request.up)
        if user.request.line == SHARING:
            drone.sharing.remove(user.index)
            if state.relays:
                _count_relayed(state, drone, user, -1)
            drone.shared_hz = 0
        elif user.request.line == WAITING:
            drone.waiting.remove(user.index)
        else:
            _leave_processor(state, drone, user)


@rare_rule
def _leave_processor(state: State, drone: Drone, user: User) -> None:
    """Remove a user's task from those at a drone's processor, or on their way to it."""
    if user.request.line == COMPUTING:
        drone.computing.remove(user.index)
    else:
        drone.moving.remove(user.index)
        count_moving(state, user, -1)


@rare_rule
def _count_relayed(state: State, drone: Drone, user: User, by: int) -> None:
    """Count a user's result at its site if it comes to a drone from there, or no longer."""
    site = relay_of(state, drone, user)
    if site >= 0:
        state.senders[site].relayed += by
        scan_later(state, state.senders[site])


@rare_rule
def hold_at_site(state: State, drone: Drone, user: User, bps: int) -> None:
    """Let a user's result hold so much more of the backhaul of its site, if it comes from one."""
    site = relay_of(state, drone, user)
    if site >= 0:
        state.senders[site].free_bps -= bps
        scan_later(state, state.senders[site])


@rare_rule
def count_moving(state: State, user: User, by: int) -> None:
    """Count a user's task at both ends of its way between two processors, or no longer."""
    task = state.tasks[user.index]
    for end in (state.senders[task.site], state.senders[task.target]):
        end.relayed += by
        scan_later(state, end)


@rule
def _insert(state: State, queue: Queue[int], user: User) -> None:
    """Insert a user into a queue that is ordered by the time of requests, then by user."""
    asked_us, place = user.request.t_request_us, len(queue)
    while place > 0:
        before = state.users[queue[place - 1]].request
        if before.t_request_us < asked_us:
            break
        if before.t_request_us == asked_us and queue[place - 1] < user.index:
            break
        place -= 1
    queue.insert(place, user.index)
