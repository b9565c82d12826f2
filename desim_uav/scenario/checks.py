"""What no single key can tell: checks of a whole scenario, each yielding what it finds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from itertools import islice

import numpy as np

from desim_uav.errors import did_you_mean
from desim_uav.model.energy.battery import LONGEST_MIN, MOST_CHARGE, in_joules
from desim_uav.model.geometry.grid import Cell, reachable
from desim_uav.model.mobility.walks import Area
from desim_uav.model.motion.motion import cruise_of, return_transit, transits_over
from desim_uav.model.motion.wind import motion_in
from desim_uav.model.rules import US
from desim_uav.model.sums import in_order
from desim_uav.registry import FAULTS, what_failed
from desim_uav.rules.rewards import MultiService
from desim_uav.scenario import radio_checks
from desim_uav.scenario.components import place_of_problem
from desim_uav.scenario.drones import Drones, flies_freely
from desim_uav.scenario.epochs import decisions_by_event_fit_the_scenario
from desim_uav.scenario.finding import Finding
from desim_uav.scenario.layout import start_cells, station_cells
from desim_uav.scenario.map import DrawnObstacles, ListedObstacles
from desim_uav.scenario.schema import Scenario
from desim_uav.scenario.sensors import (
    only_sensors_send_updates,
    sensors_find_their_service,
    updates_at_will_take_time,
    what_needs_sensors_has_some,
)
from desim_uav.scenario.separation import drones_can_keep_apart
from desim_uav.scenario.service_checks import (
    backhauls_can_be_shared,
    processors_draw_from_energy,
    stages_can_be_served,
    tasks_are_paid_and_observed,
    tasks_find_processors,
    users_can_compute,
)
from desim_uav.scenario.shield import shields_hold
from desim_uav.scenario.space_checks import buildings_fit_the_map, free_flight_fits_the_scenario
from desim_uav.scenario.wind import drones_can_fly_in_the_wind, problem_in_wind
from desim_uav.scenario.yaml12 import KeyPath

LONGEST_US = 2**53
"""The longest episode in microseconds, whose times are exact as floating-point numbers, too."""

MAX_SQUARES = 1_000_000
MAX_LEVELS = 1000
MAX_PLACES = 5_000_000
MAX_TRACE_PROBLEMS = 20


def findings(scenario: Scenario) -> Iterator[Finding]:
    """Everything that is wrong with a scenario whose keys are right one by one."""
    for check in CHECKS:
        yield from check(scenario)


def a_battery_needs_a_station(scenario: Scenario) -> Iterator[Finding]:
    """A limited battery without a charging station."""
    if scenario.limited_battery and scenario.stations.count == 0:
        yield Finding(
            ("stations", "count"),
            "a limited battery needs a charging station: at least 1, or drones.battery: null",
            tuple((*key, "battery") for key in scenario.fleet_keys),
        )


def stations_have_their_own_cells(scenario: Scenario) -> Iterator[Finding]:
    """Two stations on one cell."""
    station_on: dict[Cell, int] = {}
    for station, cell in enumerate(station_cells(scenario)):
        if cell in station_on:
            yield Finding(
                ("stations", "radius_m"),
                f"stations {station_on[cell]} and {station} stand on one cell {_text_of(cell)}; "
                f"take fewer stations, a larger circle or smaller cells",
                (("stations", "count"), *_GRID),
            )
            return
        station_on[cell] = station


def drones_start_on_the_map(scenario: Scenario) -> Iterator[Finding]:
    """Start cells: one a drone, each on the map."""
    for key, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        cells, path = drones.start_cells, (*key, "start_cells")
        if cells is None:
            continue
        if len(cells) != drones.count:
            yield Finding(
                path,
                f"must be one cell a drone: {drones.count}, not {len(cells)}",
                ((*key, "count"),),
            )
        for index, cell in enumerate(cells):
            if not _on_map(scenario, cell):
                yield Finding((*path, index), _off_map(scenario), (("map", "cells"),))


def users_are_on_the_map(scenario: Scenario) -> Iterator[Finding]:
    """Given positions off the map."""
    width, depth = scenario.map.size_m
    for key, users in zip(scenario.user_keys, scenario.user_groups, strict=True):
        for index, (x, y) in enumerate(users.positions_m or ()):
            if x > width or y > depth:
                yield Finding(
                    (*key, "positions_m", index),
                    f"off the map, which is {width:g} x {depth:g} m",
                    (("map", "size_m"),),
                )


def obstacles_fit_the_map(scenario: Scenario) -> Iterator[Finding]:
    """No obstacles in 2D; drawn ones in reasonable number and height."""
    obstacles, path = scenario.map.obstacles, ("map", "obstacles")
    if obstacles is None:
        return
    if not scenario.three_d:
        yield Finding(
            path,
            "not in 2D, where drones fly above everything; leave it out, or map.dimensions: 3",
            (("map", "dimensions"),),
        )
    if not isinstance(obstacles, DrawnObstacles):
        yield from _listed_obstacles(scenario, obstacles)
    elif obstacles.square_m is not None:
        width, depth = scenario.map.size_m
        squares = math.ceil(width / obstacles.square_m) * math.ceil(depth / obstacles.square_m)
        if squares > MAX_SQUARES:
            yield Finding(
                (*path, "square_m"),
                f"makes {squares} squares of the map; at most {MAX_SQUARES}",
                (("map", "size_m"),),
            )


def levels_fit_the_map(scenario: Scenario) -> Iterator[Finding]:
    """Levels in reasonable number, and none above the lowest one in 2D."""
    levels, tallest_m = scenario.map.levels, scenario.map.tallest_m
    lowest_m, most_m = levels.min_altitude_m, levels.max_altitude_m
    (nx, ny), path = scenario.map.cells, ("map", "levels")
    if most_m is not None and not scenario.three_d:
        yield Finding(
            (*path, "max_altitude_m"),
            "not in 2D, where drones fly at one altitude; leave it out, or map.dimensions: 3",
            (("map", "dimensions"),),
        )
    elif most_m is not None and most_m < lowest_m:
        yield Finding(
            (*path, "max_altitude_m"),
            f"must be at least min_altitude_m, {lowest_m:g}",
            ((*path, "min_altitude_m"),),
        )
    up_to_m = max(tallest_m, most_m or 0.0)
    also = (("map", "obstacles"), (*path, "min_altitude_m"), (*path, "max_altitude_m"))
    if (up_to_m - lowest_m) / levels.step_m > MAX_LEVELS:
        what = f"the tallest building of {tallest_m:g} m"
        if most_m is not None and most_m > tallest_m:
            what = f"max_altitude_m: {most_m:g}"
        yield Finding((*path, "step_m"), f"makes more than {MAX_LEVELS} levels up to {what}", also)
    elif nx * ny * (up_to_m / levels.step_m + 2) > MAX_PLACES:
        yield Finding(
            ("map", "cells"),
            f"makes more than {MAX_PLACES} places (cells times levels) to fly to",
            (*also, (*path, "step_m")),
        )


def transits_fit_a_step(scenario: Scenario) -> Iterator[Finding]:
    """A moving action that its drone cannot carry out within a step."""
    dx, dy = scenario.map.cell_m
    nx, ny = scenario.map.cells
    hops = {"along x": ((1, 0, 0), dx), "along -x": ((-1, 0, 0), dx)} if nx > 1 else {}
    hops |= {"along y": ((0, 1, 0), dy), "along -y": ((0, -1, 0), dy)} if ny > 1 else {}
    if scenario.three_d and (
        scenario.map.obstacles is not None or scenario.map.levels.max_altitude_m is not None
    ):
        hops["between levels"] = (0, 0, 1), scenario.map.levels.step_m
    also = (*_GRID, ("map", "levels", "step_m"), ("map", "dimensions"), ("episode", "step_s"))
    for key, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        if flies_freely(drones):
            continue
        problems = set()
        if problem_in_wind(drones, scenario.wind_mps):
            continue
        for which, (way, distance) in hops.items():
            problem = _transit_problem(scenario, drones, way, distance)
            if problem and problem not in problems:
                problems.add(problem)
                message = f"a hop {which} cannot be flown: {problem}"
                yield Finding((*key, "motion"), message, also)


def cruise_speeds_can_be_flown(scenario: Scenario) -> Iterator[Finding]:
    """Cruise speeds above a drone's highest one, or that only some types of drones choose from.

    Types that fly freely and types that fly from cell to cell are compared among themselves.
    """
    firsts: dict[bool, int] = {}
    for number, (key, drones) in enumerate(zip(scenario.fleet_keys, scenario.fleet, strict=True)):
        path, free = (*key, "motion", "cruise"), flies_freely(drones)
        kind = "that fly freely " * free if scenario.mixed else ""
        kind = kind or "that fly from cell to cell " * scenario.mixed
        of_first = firsts.setdefault(free, number)
        first = scenario.fleet[of_first].motion
        if free and bool(cruise_of(drones.motion)) != bool(cruise_of(first)):
            yield Finding(
                path if cruise_of(drones.motion) else path[:-1],
                f"the commands of all types of drones {kind}have the same numbers, so either all "
                "types have cruise or none has",
                (("drones", of_first, "motion"),),
            )
        if not free and cruise_of(drones.motion) != cruise_of(first):
            speeds = ", ".join(f"{speed:g}" for speed in cruise_of(first))
            yield Finding(
                path if cruise_of(drones.motion) else path[:-1],
                f"all types of drones {kind}have the same actions, so cruise must be that of "
                f"drones.{of_first}, {f'[{speeds}]' if speeds else 'null'}",
                (("drones", of_first, "motion"),),
            )
        too_fast = getattr(drones.motion, "too_fast", None)
        for place, problem in too_fast() if too_fast else ():
            yield Finding((*path, place), problem, ((*key, "motion", "max_speed_mps"),))


def the_mix_names_services(scenario: Scenario) -> Iterator[Finding]:
    """Weights of services there are, of which one at least is above 0."""
    services = list(scenario.services)
    for key, demand, _ in scenario.asking:
        mix = getattr(demand, "mix", None)
        if not isinstance(mix, dict):
            continue
        path = (*key, "mix")
        for name in mix:
            if name not in services:
                yield Finding(
                    (*path, name),
                    f"no such service{did_you_mean(name, services)}; "
                    f"demand.mix can name {', '.join(services)}",
                    (("services",),),
                )
        if not in_order(mix.values()) > 0:
            yield Finding(path, "one weight at least must be above 0")


def the_reward_names_services(scenario: Scenario) -> Iterator[Finding]:
    """Weights of services there are not, unless they are the default."""
    weights = getattr(scenario.reward, "services", None)
    if not isinstance(weights, Mapping) or weights == MultiService().services:
        return
    services = list(scenario.services)
    for name in weights:
        if name not in services:
            yield Finding(
                ("reward", "services", name),
                f"no such service{did_you_mean(name, services)}; "
                f"reward.services can name {', '.join(services)}",
                (("services",),),
            )


def times_are_whole_microseconds(scenario: Scenario) -> Iterator[Finding]:
    """Durations that round to nothing, or that cannot be counted in whole microseconds."""
    episode = scenario.episode
    if episode.steps * round(episode.step_s * US) > LONGEST_US:
        yield Finding(
            ("episode", "steps"),
            f"an episode of {episode.steps:,} steps of {episode.step_s:g} s is too long; at most "
            f"2^53 microseconds (285 years) can be counted",
            (("episode", "step_s"),),
        )
    for key, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        battery, path = drones.battery, (*key, "battery", "autonomy_min")
        if in_joules(battery) > MOST_CHARGE:
            yield Finding((*key, "battery"), f"capacity_uj must be at most {MOST_CHARGE:,}")
        if battery is None or in_joules(battery):
            continue
        if round(battery.autonomy_min * 60e6) < 1:
            yield Finding(path, "is less than a microsecond")
        if battery.autonomy_min > LONGEST_MIN:
            yield Finding(path, f"must be at most {LONGEST_MIN} minutes")


def components_fit_the_scenario(scenario: Scenario) -> Iterator[Finding]:
    """What components say themselves, such as a trace of users that there are not."""
    for key, users in zip(scenario.user_keys, scenario.user_groups, strict=True):
        walks = getattr(users.mobility, "problems", None)
        if walks:
            yield from _own_problems(
                (*key, "mobility"),
                users.mobility,
                walks(users.count, Area(*scenario.map.size_m)),
                ((*key, "count"), (*key, "positions_m"), ("map", "size_m")),
            )
    for key, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        drained = getattr(drones.battery, "problems", None)
        if drained:
            yield from _own_problems(
                (*key, "battery"),
                drones.battery,
                drained(drones.motion, scenario.episode.step_s),
                ((*key, "motion"), ("episode", "step_s")),
            )
        charged = getattr(scenario.stations.charging, "problems", None)
        if charged and drones.battery is not None:
            yield from _own_problems(
                ("stations", "charging"),
                scenario.stations.charging,
                charged(drones.battery),
                ((*key, "battery"),),
            )
    for key, demand, counts in scenario.asking:
        asked = getattr(demand, "problems", None)
        if asked:
            yield from _own_problems(
                key,
                demand,
                asked(min(counts), list(scenario.services)),
                (*_USER_COUNT, ("services",)),
            )


CHECKS: tuple[Callable[[Scenario], Iterator[Finding]], ...] = (
    a_battery_needs_a_station,
    stations_have_their_own_cells,
    drones_start_on_the_map,
    users_are_on_the_map,
    obstacles_fit_the_map,
    buildings_fit_the_map,
    levels_fit_the_map,
    drones_can_fly_in_the_wind,
    drones_can_keep_apart,
    transits_fit_a_step,
    cruise_speeds_can_be_flown,
    the_mix_names_services,
    the_reward_names_services,
    times_are_whole_microseconds,
    stages_can_be_served,
    sensors_find_their_service,
    only_sensors_send_updates,
    what_needs_sensors_has_some,
    updates_at_will_take_time,
    tasks_find_processors,
    backhauls_can_be_shared,
    users_can_compute,
    processors_draw_from_energy,
    tasks_are_paid_and_observed,
    components_fit_the_scenario,
    decisions_by_event_fit_the_scenario,
    free_flight_fits_the_scenario,
    shields_hold,
    *radio_checks.CHECKS,
)

_GRID: tuple[KeyPath, ...] = (("map", "size_m"), ("map", "cells"))
_USER_COUNT: tuple[KeyPath, ...] = (("users", "count"), ("users", "positions_m"), ("users",))


def _listed_obstacles(scenario: Scenario, obstacles: ListedObstacles) -> Iterator[Finding]:
    """Each building once, on the map, on no station or start cell; and none cuts these off."""
    path = ("map", "obstacles", "cells")
    own = ((*key, name) for key in scenario.fleet_keys for name in ("count", "start_cells"))
    layout = (("stations",), *own)
    kept_free = dict.fromkeys(start_cells(scenario), "a start cell")
    kept_free |= dict.fromkeys(station_cells(scenario), "a station's cell")
    index_of: dict[Cell, int] = {}
    sound = True
    for index, (ix, iy, _) in enumerate(obstacles.cells):
        cell, problem, also = (ix, iy), "", (*_GRID, *layout)
        if not _on_map(scenario, cell):
            problem, also = _off_map(scenario), (("map", "cells"),)
        elif cell in index_of:
            problem, also = f"this cell is given twice, first as {path[-1]}.{index_of[cell]}", ()
        elif cell in kept_free:
            problem = f"a building on {kept_free[cell]}"
        if problem:
            sound = False
            yield Finding((*path, index), problem, also)
        index_of.setdefault(cell, index)
    if sound:
        yield from _cut_off(scenario, obstacles, list(kept_free), (*_GRID, *layout))


def _cut_off(
    scenario: Scenario, obstacles: ListedObstacles, cells: list[Cell], also: tuple[KeyPath, ...]
) -> Iterator[Finding]:
    lowest = scenario.map.levels.min_altitude_m
    blocked = np.zeros(scenario.map.cells, np.bool_)
    for ix, iy, height in obstacles.cells:
        blocked[ix, iy] = height >= lowest
    cells = [cell for cell in cells if _on_map(scenario, cell)]
    reached = reachable(blocked, cells[0]) if cells else blocked
    for cell in cells:
        if not reached[cell]:
            yield Finding(
                ("map", "obstacles", "cells"),
                f"the buildings cut {_text_of(cell)} off from {_text_of(cells[0])} "
                f"at the lowest level, {lowest:g} m",
                (*also, ("map", "levels", "min_altitude_m")),
            )
            return


def _transit_problem(
    scenario: Scenario, drones: Drones, way: tuple[int, int, int], distance_m: float
) -> str:
    step_s = scenario.episode.step_s
    try:
        motion = motion_in(drones.motion, scenario.wind_mps, way)
        transits_over(motion, distance_m, step_s)
        if drones.battery is not None:
            return_transit(motion, distance_m, step_s)
    except ValueError as error:
        return str(error)
    except FAULTS as error:
        return what_failed(error)
    return ""


def _own_problems(
    path: KeyPath, component: object, problems: list[str], also: tuple[KeyPath, ...]
) -> Iterator[Finding]:
    where = (*path, *place_of_problem(component))
    for problem in islice(problems, MAX_TRACE_PROBLEMS):
        yield Finding(where, problem, also)
    if len(problems) > MAX_TRACE_PROBLEMS:
        more = len(problems) - MAX_TRACE_PROBLEMS
        yield Finding(where, f"and {more} more problems of this kind", also)


def _on_map(scenario: Scenario, cell: Cell) -> bool:
    return cell[0] < scenario.map.cells[0] and cell[1] < scenario.map.cells[1]


def _off_map(scenario: Scenario) -> str:
    nx, ny = scenario.map.cells
    return f"off the map, which is {nx} x {ny} cells, counted from 0"


def _text_of(cell: Cell) -> str:
    return f"[{cell[0]}, {cell[1]}]"
