"""What a planner sees of an engine at a decision epoch: all users and drones, and no future."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.base import UserState
from desim_uav.engine.episode import Engine
from desim_uav.model.rules import DECIDES, IN_QUEUE, US, Mode
from desim_uav.model.services import COMPUTING
from desim_uav.model.state import Observation
from desim_uav.policies.planning.ground import NO_WAY, Ground
from desim_uav.rules.decide import is_under_way


class Standing(NamedTuple):
    """From when on a drone can be commanded, in ticks from now, and where and how full it is then.

    Until then it is at its station, if ``station`` is not -1, and occupies a pad there in the ticks
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
    ``left`` is the number of ticks that are left of the episode. ``future_m`` (left, users, 2) are
    the users' places in the coming ticks, which only a clairvoyant has.
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


def look(engine: Engine, grounds: Sequence[Ground], observations: Any) -> PlanningSight:
    """Return what a planner sees now, with the maps of all drones."""
    _, users_m = engine.positions_m()
    left_us = engine.world.horizon_us - int(engine.state.now_us)
    left = max(1, round(left_us / grounds[0].tick_us))
    places = np.ascontiguousarray(users_m[:, :2])
    drones = _drones(engine, grounds, observations)
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


def _drones(engine: Engine, grounds: Sequence[Ground], observations: Any) -> tuple[Standing, ...]:
    """Return the standings of all drones; those at stations and on their way there come in turn."""
    rows = engine.drones
    standings: dict[int, Standing] = {}
    landings: list[tuple[int, int, int, float, int]] = []
    places = {drone: k for each in engine.state.stations for k, drone in enumerate(each.queue)}
    for drone, observation in zip(rows, observations, strict=True):
        ground = grounds[drone.index]
        if observation.mode in DECIDES:
            standings[drone.index] = _free(engine, ground, drone, observation)
        elif observation.mode is Mode.RETURNING:
            battery_s = observation.battery_s or 0.0
            lands_us, station, charge = ground.flights.lands_at(engine, drone, battery_s)
            landings.append((lands_us, 0, station, charge, drone.index))
        elif observation.mode in IN_QUEUE:
            charge = observation.battery_s * ground.flights.own.drain_per_s
            station = engine.world.stations.index((drone.x, drone.y))
            landings.append((-1, places[drone.index], station, charge, drone.index))
        else:
            standings[drone.index] = Standing(NO_WAY, 0, 0)
    standings.update(_charges(grounds, sorted(landings)))
    return tuple(standings[k] for k in range(len(rows)))


def _free(engine: Engine, ground: Ground, drone: Any, observation: Observation) -> Standing:
    """Return the standing of a drone that decides now or, if it is under way, when it arrives."""
    under_way = is_under_way(engine.constants, drone)
    left_us = max(0, int(drone.until_us) - int(engine.state.now_us)) if under_way else 0
    ready = max(1, round(left_us / ground.tick_us)) if under_way else 0
    charge = ground.charge_unit
    if observation.battery_s is not None:
        charge = round((observation.battery_s - left_us / US) * ground.flights.own.drain_per_s)
    units = max(0, min(charge // ground.charge_unit, ground.full))
    return Standing(ready, ground.flights.place(drone, bool(under_way)), units)


def _charges(
    grounds: Sequence[Ground], landings: list[tuple[int, int, int, float, int]]
) -> dict[int, Standing]:
    """Return the standings of drones that land, given as (time, place, station, battery, drone)."""
    world, standings = grounds[0].world, {}
    pads = world.scenario.stations.pads
    free_us: list[list[int]] = [[0] * pads for _ in world.stations]
    for lands_us, _, station, charge, drone in landings:
        ground, own = grounds[drone], grounds[drone].flights.own
        takes_us = own.until_full_us(int(max(charge, 0.0)))
        pad = free_us[station].index(min(free_us[station]))
        begins_us = max(lands_us, free_us[station][pad], 0)
        free_us[station][pad] = begins_us + takes_us
        begins, ready = begins_us // ground.tick_us, ground.ticks(begins_us + takes_us)
        place = ground.flights.station_point(station)
        standings[drone] = Standing(max(ready, 1), place, ground.full, station, begins)
    return standings
