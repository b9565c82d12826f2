"""Where drones fly: cells, moves, transits and planned returns, ways in free flight."""

from __future__ import annotations

from desim_uav.rowcode.rows import Row, Table, row


@row
class CellRow(Row):
    """A cell of the map, by its indices from the west (x) and the south (y)."""

    x: int
    y: int


@row
class Place(Row):
    """A position on the map, in metres."""

    x_m: float
    y_m: float


@row
class Move(Row):
    """An action: the cells and levels by which it moves a drone, and the number of its transit.

    ``share`` is that of tasks which it offloads, the highest one for an action that chooses none.
    """

    action: int
    dx: int
    dy: int
    dlevel: int
    transit: int
    share: float


@row
class PlanRow(Row):
    """The planned return from a place; its hops are ``Constants.hops[first:end]``."""

    station: int
    duration_us: int
    drain: int
    first: int
    end: int


@row
class WaysRow(Row):
    """The ways home at one altitude in free flight (see ``model.motion.space.Ways``)."""

    altitude_m: float
    nodes_m: Table[float]
    lengths_m: Table[float]
    following: Table[int]
    times_us: Table[int]
    drains: Table[int]


@row
class SpaceRow(Row):
    """What a type of drones needs for free flight (see ``model.motion.space.Space``).

    The fields from ``corners_m`` to ``members`` are its obstacles
    (``model.geometry.prisms.Prisms``). Commands choose a cruise speed from ``lowest_mps`` to
    ``highest_mps`` (infinity: none), and name places if ``whole_map``.
    """

    level_mps: float
    level_mps2: float
    climb_mps: float
    descent_mps: float
    vertical_mps2: float
    wind_x_mps: float
    wind_y_mps: float
    lowest_mps: float
    highest_mps: float
    whole_map: int
    corners_m: Table[float]
    walls: Table[float]
    offsets: Table[int]
    heights_m: Table[float]
    boxes_m: Table[float]
    shape_x: int
    shape_y: int
    side_x_m: float
    side_y_m: float
    heads: Table[int]
    members: Table[int]
    levels: Table[WaysRow]


@row
class Hop(Row):
    """A hop of a return, which leads to a neighbouring cell or level."""

    dx: int
    dy: int
    dlevel: int
