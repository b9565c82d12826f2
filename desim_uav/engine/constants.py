"""The constants of a run as rows (see ``rules.rows.Constants``)."""

from __future__ import annotations

import math

import numpy as np

from desim_uav.engine.base import RunSettings
from desim_uav.engine.courses import space_row
from desim_uav.links import Links
from desim_uav.model.backhaul import UNLIMITED_BPS, Backhaul
from desim_uav.model.catalogue import StageRow
from desim_uav.model.motion.motion import Transit
from desim_uav.model.motion.planner import DIRECTIONS, HOPS, Node
from desim_uav.model.rewards import RowReward
from desim_uav.model.rules import move_of, share_of
from desim_uav.model.services import Collecting, Terms
from desim_uav.rowcode.components import works_on_rows
from desim_uav.rowcode.rows import Table, blank, fill
from desim_uav.rules.rows import (
    CellRow,
    Constants,
    Move,
    PieceRow,
    Place,
    PointRow,
    ProcessorRow,
    RadioRow,
    SpaceRow,
    TermsRow,
    TransitRow,
    TypeRow,
    UpdatesRow,
)
from desim_uav.rules.words import CRASHES, NEVER
from desim_uav.scenario.cost import expected_requests
from desim_uav.scenario.processor import Processor
from desim_uav.world import World


def constants_of(world: World, settings: RunSettings) -> Constants:
    """Return the constants of a run, except plans, functions and what only compiled code needs."""
    scenario, grid = world.scenario, world.grid
    constants = blank(Constants)
    constants.steps = scenario.episode.steps
    constants.step_us, constants.horizon_us = world.step_us, world.horizon_us
    constants.gamma = scenario.learning.gamma
    constants.by_event, constants.patience_us = int(world.by_event), world.patience_us
    constants.limited = int(scenario.limited_battery)
    constants.types = Table(_type(world, number) for number in range(len(world.types)))
    constants.pads = scenario.stations.pads
    constants.services = len(world.services.names)
    constants.separation_m = scenario.separation_m or 0.0
    constants.gives_way = int(scenario.on_conflict == "hover_higher_index")
    _set_links(constants, world)
    constants.nx, constants.ny = grid.cells
    constants.levels, constants.levels_under_ceiling = len(grid.levels_m), grid.levels_under_ceiling
    constants.three_d = int(scenario.three_d)
    constants.cell_x_m, constants.cell_y_m = grid.cell_m
    constants.lowest_m, constants.level_step_m = grid.levels_m[0], grid.level_step_m
    constants.width_m, constants.depth_m = world.area
    _set_flights(constants, world)
    set_needs(constants, world, settings)
    constants.levels_m = Table(grid.levels_m)
    constants.blocked = Table(np.asarray(grid.blocked).reshape(-1).astype(int).tolist())
    station_at = np.full(grid.cells, -1, np.int64)
    for index, cell in enumerate(world.stations):
        station_at[cell] = index
    constants.station_at = Table(station_at.reshape(-1).tolist())
    constants.stations = Table(fill(CellRow, cell) for cell in world.stations)
    constants.starts = Table(fill(CellRow, cell) for cell in world.starts)
    constants.ceilings = Table(map(int, settings.ceilings))
    constants.homes = Table(fill(Place, home) for home in world.homes[:, :2].tolist())
    constants.expected_requests = expected_requests(scenario)
    constants.features = world.most_features
    constants.in_air = int(world.in_air)
    if world.free:
        constants.spaces = Table(
            space_row(own.space) if own.free else blank(SpaceRow) for own in world.types
        )
    return constants


def _type(world: World, number: int) -> TypeRow:
    """Return a type of drones as a row, without its functions."""
    row, own, places = blank(TypeRow), world.types[number], math.prod(world.grid.blocked.shape)
    row.limited = int(own.limited)
    row.capacity, row.return_charge = own.capacity, own.return_charge
    row.full, row.drain_per_s = own.full, own.drain_per_s
    row.respawn_after_us, row.on_crash = own.respawn_after_us, CRASHES[own.on_crash]
    row.first_transit = _first_transit(world, number)
    row.store_ubit = NEVER if own.store_ubit is None else own.store_ubit
    row.first_plan = 2 * places * world.planner_number(number)
    row.shielded, row.draws_uw = int(own.shielded), own.draws_uw
    return row


def set_needs(
    constants: Constants, world: World, settings: RunSettings, early: bool = True
) -> None:
    """Set what shielded drones need at all places, without the drones' ceiling and below it.

    ``early``: they may return above ``return_below`` if they cannot hover any more.
    """
    shape = 2, *world.grid.blocked.shape
    needs: list[int] = []
    for row, own in zip(constants.types, world.types, strict=True):
        if row.shielded and not own.free:
            row.first_need, every = len(needs), np.full(shape, NEVER, np.int64)
            for ceiling in set(settings.ceilings):
                needed = own.needs(ceiling, early)
                every[int(ceiling), : len(needed)] = needed
            needs += every.ravel().tolist()
    constants.needs = Table(needs)


def _first_transit(world: World, number: int) -> int:
    """Return the number of the transits of the types of drones before one of them."""
    return sum(len(own.epoch_transits) + len(HOPS) for own in world.types[:number])


def transits_of(world: World) -> list[Transit]:
    """Return the transits in the order of their numbers: the hover, and those of each type.

    These are the moves, and the hops in the order of ``HOPS``.
    """
    transits = [world.types[0].rest]
    for each in world.types:
        transits += [*each.epoch_transits.values(), *(each.return_transits[hop] for hop in HOPS)]
    return transits


def hop_transit(world: World, number: int, hop: Node) -> int:
    """Return the number of the transit of a hop (dx, dy, dlevel) of a type of drones."""
    return _first_transit(world, number) + _first_hop(world) + DIRECTIONS[hop]


def _first_hop(world: World) -> int:
    """Return the number of the first hop of a type that flies from cell to cell, from its first."""
    return 1 + len(world.epoch_moves)


def _set_links(constants: Constants, world: World) -> None:
    """Set the links of drones and access points, and what requests ask for, of the constants."""
    scenario, association = world.scenario, world.scenario.association
    constants.reuse = world.links[0].radio.reuse
    constants.trigger_us, constants.margin_db = association.trigger_us, association.margin_db
    points = scenario.access_points
    constants.sharers = scenario.drone_count + sum(point.counts_in_reward for point in points)
    constants.points = Table(fill(PointRow, (*point.at_m, point.height_m)) for point in points)
    constants.radios = Table(map(_radio, world.links, world.backhauls))
    if world.services.has_tasks:
        in_joules = [own.in_joules for own in world.types] + [False] * len(points)
        constants.processors = Table(map(_processor, world.processors, in_joules))
        constants.terms = Table(map(_terms, world.services.terms))
        own = [users.processor for users in scenario.user_groups for _ in range(users.count)]
        constants.clocks = Table(0 if each is None else each.clock for each in own)
    if world.senses:
        constants.senses = Table(world.senses)
        constants.updates = Table(map(_updates, world.services.collecting))
    constants.draws = world.services.draws
    constants.first_stages = Table(world.services.first_stages)
    constants.stages = Table(fill(StageRow, one) for own in world.services.stages for one in own)


def _radio(links: Links, backhaul: Backhaul | None) -> RadioRow:
    """Return a radio, and the backhaul behind it, as a row, without its functions."""
    row, radio = blank(RadioRow), links.radio
    row.bandwidth_hz = whole_hz(links.bandwidth_hz)
    row.uplink_hz = -1 if links.uplink_hz is None else links.uplink_hz
    row.backhaul_bps = UNLIMITED_BPS if backhaul is None else backhaul.capacity_bps
    row.classes = len(links.efficiencies) - 1
    row.flat = int(radio.flat)
    row.efficiencies = Table(links.efficiencies)
    if radio.graded:
        row.marked = int(radio.marked)
    return row


def _processor(processor: Processor | None, holds_energy: bool) -> ProcessorRow:
    """Return the processor of a drone or access point as a row, without its functions.

    ``holds_energy`` says that it is supplied by a battery that is measured in microjoules.
    """
    row = blank(ProcessorRow)
    if processor is not None:
        row.cores, row.clock = processor.cores, processor.clock
        row.by_deadline = int(processor.sharing.by_deadline)
        row.on_ground = int(processor.on_ground)
        if holds_energy:
            row.core_uw = round(processor.core_w * 1e6)
            row.idle_uw = round(processor.electronics_w * 1e6)
    return row


def _terms(terms: Terms) -> TermsRow:
    """Return the terms of a service as a row."""
    deadline_us = NEVER if terms.deadline_us is None else terms.deadline_us
    return fill(TermsRow, (deadline_us, *map(int, terms[1:])))


def _updates(keeps: Collecting | None) -> UpdatesRow:
    """Return what holds for the updates of a service as a row."""
    if keeps is None:
        return blank(UpdatesRow)
    limit_us = NEVER if keeps.limit_us is None else keeps.limit_us
    order = (keeps.keeps, keeps.preempts, int(keeps.sends_last))
    return fill(UpdatesRow, (*order, limit_us, int(keeps.ground), keeps.wait_us))


def whole_hz(bandwidth_hz: float) -> int:
    """Return a bandwidth as the rows have it: -1 if it is unlimited."""
    return -1 if math.isinf(bandwidth_hz) else int(bandwidth_hz)


def _set_flights(constants: Constants, world: World) -> None:
    """Set the actions and the transits of the constants."""
    shares = world.types[0].shares or (1.0,)
    constants.least_share, most = shares[0], shares[-1]
    constants.most_share = most
    by_action = {action: 1 + k for k, action in enumerate(world.epoch_moves)}
    constants.moves = Table(
        fill(
            Move, (int(action), *move_of(action), by_action.get(action, 0), share_of(action, most))
        )
        for action in world.actions
    )
    constants.first_hop = _first_hop(world)
    constants.transits = Table(map(transit_row, transits_of(world)))


def transit_row(transit: Transit) -> TransitRow:
    """Return a transit as a row."""
    pieces = Table(fill(PieceRow, piece) for piece in transit.profile.tolist())
    _, *values = transit
    return fill(TransitRow, (*values, pieces))


def term_names(world: World) -> tuple[str, ...]:
    """Return the names of the reward's terms in their order; none if it does not work on rows."""
    reward = world.scenario.reward
    if works_on_rows(reward, RowReward):
        assert isinstance(reward, RowReward)
        return reward.term_names(world.services.names)
    return ()
