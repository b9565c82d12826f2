"""Records of users' links: handovers, ping-pongs, outages, and users whose levels may change.

They are kept only if the drones' radio has classes of links (``state.keeps_links``).
"""

from __future__ import annotations

from desim_uav.rowcode.kernels import apart, rare_rule
from desim_uav.rules.note import note
from desim_uav.rules.rows import Drone, State, User
from desim_uav.rules.words import NEVER, ON_HANDOVER, ON_OUTAGE, ON_OUTAGE_END, ON_PING_PONG

PING_PONG_US = 1_000_000
"""A user who is handed back within this time makes a ping-pong (3GPP TR 36.839: 1 s)."""


@apart
def count_handover(state: State, drone: Drone, user: User, phase: int) -> None:
    """Count a handover if a user who is attached to a drone now has just left another one.

    A handover back to the drone from which the user came in its previous handover is a ping-pong
    if it comes within ``PING_PONG_US``.
    """
    links = state.links[user.index]
    if links.left_us == state.now_us and links.left not in (-1, drone.index):
        state.handed_over += 1
        note(state, phase, ON_HANDOVER, drone.index, user.index, -1, -1)
        if links.came_from == drone.index and state.now_us - links.came_us <= PING_PONG_US:
            state.ping_pongs += 1
            note(state, phase, ON_PING_PONG, drone.index, user.index, -1, -1)
        links.came_from, links.came_us = links.left, state.now_us


@rare_rule
def forget_links(state: State, user: User) -> None:
    """Clear the records of a user's links from the previous episode."""
    links = state.links[user.index]
    links.left = links.left_us = links.came_from = -1
    links.outage_since_us = links.outage_until_us = -1
    links.outage_began_in = links.outage_ended_in = links.unsettled = links.came_us = 0
    links.turns_us, links.rival = NEVER, -1
    for d in range(len(links.better_since)):
        links.better_since[d] = -1


@rare_rule
def unsettle(state: State, user: User) -> None:
    """Mark a user, whose levels are then compared when this instant is settled."""
    if state.by_level and not state.links[user.index].unsettled:
        state.links[user.index].unsettled = 1
        state.unsettled.append(user.index)


@rare_rule
def unsettle_covered(state: State, drone: Drone) -> None:
    """Mark all users in a drone's footprint, whose levels are then compared (see ``unsettle``)."""
    for u in range(len(state.users)):
        if state.users[u].covering[drone.index] >= 0:
            unsettle(state, state.users[u])


@rare_rule
def begin_outage(state: State, user: User, phase: int) -> None:
    """Begin an outage of a user who has an open request, but is in no footprint.

    An outage that ended at this very instant goes on instead.
    """
    if user.covered > 0 or user.request.number < 0:
        return
    links = state.links[user.index]
    if links.outage_since_us >= 0 and links.outage_until_us == state.now_us:
        links.outage_until_us = -1
        return
    count_outage(state, user)
    links.outage_since_us, links.outage_began_in = state.now_us, phase


@rare_rule
def end_outage(state: State, user: User, phase: int) -> None:
    """End the outage of a user, if there is one."""
    links = state.links[user.index]
    if links.outage_since_us >= 0 and links.outage_until_us < 0:
        links.outage_until_us, links.outage_ended_in = state.now_us, phase


@apart
def count_outage(state: State, user: User) -> None:
    """Count and log the outage of a user that has ended, if it has lasted more than 0 µs.

    Both are certain only after the instants at which it begins and ends, so it is logged later.
    """
    links = state.links[user.index]
    since_us, until_us = links.outage_since_us, links.outage_until_us
    if since_us < until_us:
        state.outages += 1
        state.outage_us += until_us - since_us
        _note_outage(state, ON_OUTAGE, since_us, links.outage_began_in, user)
        _note_outage(state, ON_OUTAGE_END, until_us, links.outage_ended_in, user)
    links.outage_since_us = links.outage_until_us = -1


@rare_rule
def _note_outage(state: State, kind: int, t_us: int, phase: int, user: User) -> None:
    """Append the beginning or the end of a user's outage to the event log."""
    if state.keeps_events:
        note(state, phase, kind, -1, user.index, user.request.number, -1)
        state.events[len(state.events) - 1].t_us = t_us
