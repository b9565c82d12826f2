"""Free flight in an engine: the spaces of types of drones as rows, and legs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from desim_uav.commands.aims import take_aim
from desim_uav.engine.base import FlownLeg, FreeCarried
from desim_uav.model.motion.flight import no_faster
from desim_uav.model.motion.legs import FreeLeg, leg_between
from desim_uav.model.motion.motion import TRAPEZOID
from desim_uav.model.motion.space import Space, Ways
from desim_uav.model.rules import Mode
from desim_uav.rowcode.rows import Queue, Table, blank, fill
from desim_uav.rules.free_flight import write_flight
from desim_uav.rules.rows import Course, Drone, FlownRow, PieceRow, SpaceRow, WaysRow
from desim_uav.rules.words import AIMS, OWN, REST
from desim_uav.world import World


def space_row(space: Space) -> SpaceRow:
    """Return a space as a row."""
    row: Any = blank(SpaceRow)
    for name, value in space.limits._asdict().items():
        setattr(row, name, value)
    row.wind_x_mps, row.wind_y_mps = space.wind
    row.lowest_mps, row.highest_mps = space.cruise_mps
    row.whole_map = int(space.whole_map)
    prisms = space.prisms
    for name in ("corners_m", "walls", "offsets", "heights_m", "boxes_m", "heads", "members"):
        setattr(row, name, getattr(prisms, name).reshape(-1))
    row.shape_x, row.shape_y = prisms.shape
    row.side_x_m, row.side_y_m = prisms.side_m
    row.levels = Table(map(_ways_row, space.levels))
    return row  # type: ignore[no-any-return]


def _ways_row(ways: Ways) -> WaysRow:
    roads = ways.roads
    arrays = (roads.nodes_m, roads.lengths_m, roads.following, ways.times_us, ways.drains)
    return fill(WaysRow, (roads.altitude_m, *(array.reshape(-1) for array in arrays)))


def set_course(drone: Drone, world: World) -> None:
    """Prepare the course of a new row of a drone that flies freely, or of an access point."""
    if drone.point >= 0:
        point = world.scenario.access_points[drone.point]
        drone.off_grid, drone.course = 1, blank(Course)
        course = drone.course
        x_m, y_m = map(float, point.at_m)
        course.x0_m, course.y0_m, course.x1_m, course.y1_m = x_m, y_m, x_m, y_m
        course.z0_m = course.z1_m = float(point.height_m)
    elif world.types[drone.type].free:
        drone.off_grid, drone.course = 1, blank(Course)
        drone.course.limit_mps = math.inf
        for flight in (drone.course.flight, drone.course.probe):
            flight.pieces = Table(blank(PieceRow) for _ in range(TRAPEZOID))
    if drone.off_grid:
        drone.course.share = 1.0


def set_memory(state: Any, world: World, log: int) -> None:
    """Add what free flight needs to a new state; ``log`` is the buffer for a step's legs."""
    state.flown = Queue(of=FlownRow, buffer=0)
    if world.free:
        state.aims = Table([0.0] * (AIMS * len(state.history)))
        state.away_m = np.zeros(max(own.space.nodes for own in world.types if own.free))
        state.flown = Queue(of=FlownRow, buffer=log)


def flown_leg(row: FlownRow) -> FlownLeg:
    """Return the leg of a row of the log."""
    ends_m = (row.x0_m, row.y0_m, row.z0_m), (row.x1_m, row.y1_m, row.z1_m)
    return FlownLeg(row.t_us, row.drone, row.duration_us, tuple(Mode)[row.mode], *ends_m)


# ---- from one episode to the next


def carried_course(course: Any) -> FreeCarried:
    """Return what an episode takes over of the course of a drone."""
    return FreeCarried(*(getattr(course, name) for name in FreeCarried._fields))


def carried_leg(space: Space, mode: int, carried: FreeCarried) -> FreeLeg:
    """Return the leg of an earlier episode of a drone in a mode."""
    limits, (_, highest) = space.limits, space.cruise_mps
    if mode == Mode.FLYING and highest < math.inf:  # as ``rules.free_flight.steer`` does
        limits = no_faster(limits, highest)
    return leg_between(limits, space.wind, carried.limit_mps, carried[:3], carried[3:6])


def load_course(world: World, drone: Drone, carried: FreeCarried) -> None:
    """Put a drone on the course of an earlier episode."""
    for name, value in carried._asdict().items():
        setattr(drone.course, name, value)
    stop, space = carried[3:6], world.types[drone.type].space
    leg = carried_leg(space, drone.mode, carried)
    drone.transit = REST if leg.distance_m == 0.0 else OWN
    drone.to_x, drone.to_y = world.grid.cell_of(*stop[:2])
    drone.to_level = world.grid.level_of(stop[2])
    write_flight(drone.course.flight, leg, space.wind)


def aims_of(state: Any, step: int, drones: Sequence[Any]) -> None:
    """Give drones the numbers of their commands of an earlier step again."""
    for k, drone in enumerate(drones):
        at = AIMS * (step * len(drones) + k)
        if drone.off_grid:
            take_aim(drone, [float(one) for one in state[at : at + AIMS]])
