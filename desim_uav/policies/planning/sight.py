"""What a planner sees of an engine at a decision epoch: all users and drones, and no future."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.base import UserState
from desim_uav.engine.episode import Engine
from desim_uav.model.rules import DECIDES, IN_QUEUE, US, Mode
from desim_uav.model.services import COMPUTING
from desim_uav.model.state import Observation
from desim_uav.policies.planning.ground import NO_WAY, Ground


class Standing(NamedTuple):
    """From when on a drone can be commanded, in steps from now, and where and how full it is then.

    Until then it is at its station, if ``station`` is not -1, and occupies a pad there in the steps
    from ``begins`` to ``ready`` - 1. ``place`` and ``units`` are those of ``Ground``.
    """

    ready: int
    place: int
    units: int
    station: int = -1
    begins: int = 0


class PlanningSight(NamedTuple):
    """The users' places (users, 2) in metres and what they need (users,), and the drones.

    ``backlog`` is how many things of a user wait for a link: 1 for an open request, or the updates
    in the buffer of a sensor; a task that is at a processor, or that its user computes, waits for
    none. ``only`` is the drone that alone can serve the user now, as it has the result of its task,
    or -1. ``ages`` are the ages of sensors over the mean age of all sensors, 0 for other users.
    ``left`` is the number of steps that are left of the episode. ``future_m`` (left, users, 2) are
    the users' places in the coming steps, which only a clairvoyant has.
    """

    left: int
    users_m: NDArray[np.float64]
    backlog: NDArray[np.float64]
    only: NDArray[np.int64]
    ages: NDArray[np.float64]
    drones: tuple[Standing, ...]
    future_m: NDArray[np.float64] | None = None

    def expected(self, ground: Ground, steps: int) -> tuple[NDArray[np.float64], Any]:
        """Return where users are expected (steps + 1, users, 2), and the error of it (steps + 1,).

        From step ``left`` on the next episode has begun, in which they walk from their homes anew.
        """
        places_m = np.repeat(self.users_m[np.newaxis], steps + 1, axis=0)
        steps_since = np.arange(steps + 1)
        if self.future_m is not None:
            true_m = self.future_m[: steps + 1]
            places_m[: len(true_m)] = true_m
        places_m[self.left :] = ground.world.homes[:, :2]
        steps_since[self.left :] -= self.left
        spread_m = ground.spread_m[np.minimum(steps_since, len(ground.spread_m) - 1)]
        if self.future_m is not None:
            spread_m[: self.left] = 0.0
        return places_m, spread_m


def look(engine: Engine, ground: Ground, observations: Any) -> PlanningSight:
    """Return what a planner sees now."""
    _, users_m = engine.positions_m()
    left = ground.world.scenario.episode.steps - observations[0].step
    places = np.ascontiguousarray(users_m[:, :2])
    drones = _drones(engine, ground, observations)
    return PlanningSight(left, places, *_needs(engine), drones)


def _needs(engine: Engine) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Return what each user needs now (see ``PlanningSight``): backlog, only and ages."""
    state = engine.state
    backlog = np.array([float(one >= UserState.OPEN) for one in engine.user_states()])
    only, ages = np.full(len(backlog), -1), np.zeros(len(backlog))
    for u in np.flatnonzero(backlog).tolist() if state.keeps_tasks else ():
        if state.users[u].request.line >= COMPUTING:
            backlog[u] = 0.0
        else:
            only[u] = state.tasks[u].site
    for u, service in enumerate(engine.world.senses):
        if service >= 0:
            sensor = state.sensors[u]
            backlog[u], ages[u] = float(sensor.count), float(state.now_us - sensor.fresh_us)
    if ages.any():
        ages /= ages[np.array(engine.world.senses) >= 0].mean()
    return backlog, only, ages


def _drones(engine: Engine, ground: Ground, observations: Any) -> tuple[Standing, ...]:
    """Return the standings of all drones; those at stations and on their way there come in turn."""
    rows = engine.entries("drones")
    standings: dict[int, Standing] = {}
    landings: list[tuple[int, int, int, float, int]] = []
    places = {drone: k for each in engine.state.stations for k, drone in enumerate(each.queue)}
    for drone, observation in zip(rows, observations, strict=True):
        if observation.mode in DECIDES:
            standings[drone.index] = _free(ground, drone, observation)
        elif observation.mode is Mode.RETURNING:
            lands_us, (x, y), charge = _lands(engine, ground, drone, observation)
            station = _station(ground, x, y)
            landings.append((lands_us, 0, station, charge, drone.index))
        elif observation.mode in IN_QUEUE:
            charge = observation.battery_s * ground.world.only_type.drain_per_s
            station = ground.world.stations.index((drone.x, drone.y))
            landings.append((-1, places[drone.index], station, charge, drone.index))
        else:
            standings[drone.index] = Standing(NO_WAY, 0, 0)
    standings.update(_charges(ground, sorted(landings)))
    return tuple(standings[k] for k in range(len(rows)))


def _free(ground: Ground, drone: Any, observation: Observation) -> Standing:
    """Return the standing of a drone that decides now."""
    charge = ground.charge_unit
    if observation.battery_s is not None:
        charge = round(observation.battery_s * ground.world.only_type.drain_per_s)
    level = min(drone.level, ground.world.grid.levels(True) - 1)
    units = min(charge // ground.charge_unit, ground.full)
    return Standing(0, ground.number(drone.x, drone.y, level), units)


def _lands(
    engine: Engine, ground: Ground, drone: Any, observation: Observation
) -> tuple[int, tuple[int, int], float]:
    """Return when and where a returning drone will land, and its battery then."""
    world, lands_us = ground.world, 0
    hop = (drone.to_x - drone.x, drone.to_y - drone.y, drone.to_level - drone.level)
    if hop != (0, 0, 0):
        ends_us = drone.since_us + world.only_type.return_transits[hop].duration_us
        lands_us += max(0, ends_us - int(engine.state.now_us))
    x, y = drone.to_x, drone.to_y
    for dx, dy, up in engine.hops(drone.route, drone.route_end):
        lands_us += world.only_type.return_transits[int(dx), int(dy), int(up)].duration_us
        x, y = x + dx, y + dy
    left = ((observation.battery_s or 0.0) * 1e6 - lands_us) * (world.only_type.drain_per_s / US)
    return lands_us, (int(x), int(y)), left


def _station(ground: Ground, x: int, y: int) -> int:
    """Return the station on a cell or, if a drone has lost its way there, the nearest one."""
    away = [abs(x - sx) + abs(y - sy) for sx, sy in ground.world.stations]
    return away.index(min(away))


def _charges(
    ground: Ground, landings: list[tuple[int, int, int, float, int]]
) -> dict[int, Standing]:
    """Return the standings of drones that land, given as (time, place, station, battery, drone)."""
    world, standings = ground.world, {}
    pads = world.scenario.stations.pads
    free_us: list[list[int]] = [[0] * pads for _ in world.stations]
    for lands_us, _, station, charge, drone in landings:
        takes_us = world.only_type.until_full_us(int(max(charge, 0.0)))
        pad = free_us[station].index(min(free_us[station]))
        begins_us = max(lands_us, free_us[station][pad], 0)
        free_us[station][pad] = begins_us + takes_us
        x, y = world.stations[station]
        begins, ready = begins_us // world.step_us, -(-(begins_us + takes_us) // world.step_us)
        standings[drone] = Standing(
            max(ready, 1), ground.number(x, y, 0), ground.full, station, begins
        )
    return standings
