"""The debug mode: what must hold after every event, whatever the scenario.

``Simulation(world, settings, audit=audit)`` checks it all; a broken invariant is an AssertionError
that says which. It makes a run many times slower.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from desim_uav.model.coverage import all_walked
from desim_uav.model.rules import Mode

if TYPE_CHECKING:
    from desim_uav.engine.des.drone import Drone
    from desim_uav.engine.des.request import Request
    from desim_uav.engine.des.simulation import Simulation

TOLERANCE_M = 1e-4


def audit(simulation: Simulation) -> None:
    """Check every invariant now."""
    for drone in simulation.drones:
        _battery(drone)
        _bandwidth(simulation, drone)
    _demand(simulation)
    if simulation.log.duration_us == 0:
        for request in simulation.airlink.open:
            if request is not None:
                _one_state(simulation, request)
        _geometry(simulation)


def _battery(drone: Drone) -> None:
    """0 <= battery <= full; empty only when crashed or at this very instant."""
    if drone.energy is not None:
        assert 0 <= drone.battery_now_us() <= drone.world.capacity_us, f"battery of {drone.index}"
        if drone.mode is Mode.CRASHED:
            assert drone.battery_now_us() == 0, f"battery of crashed drone {drone.index}"


def _bandwidth(simulation: Simulation, drone: Drone) -> None:
    """What a drone's requests occupy adds up and fits; none is served unless it flies."""
    served = [r for r in simulation.airlink.open if r is not None and r.serving == drone.index]
    radio = drone.radio
    used_bps = sum(request.bandwidth_bps for request in served)
    assert used_bps == radio.used_bps <= drone.world.bandwidth_bps, f"bandwidth of {drone.index}"
    if math.isfinite(drone.world.bandwidth_bps):
        assert radio.free_bps == drone.world.bandwidth_bps - used_bps
    assert [sum(r.service == s for r in served) for s in range(len(radio.served))] == radio.served
    if drone.mode is not Mode.FLYING:
        assert not served, f"drone {drone.index} serves while {drone.mode.name}"
        assert radio.attached_users == 0, f"drone {drone.index} holds users while {drone.mode.name}"
        assert not radio.waiting


def _demand(simulation: Simulation) -> None:
    """Open requests are counted, all of them and those in each footprint."""
    airlink = simulation.airlink
    services = range(len(airlink.open_requests))
    opened = [request for request in airlink.open if request is not None]
    assert airlink.open_requests == [sum(r.service == s for r in opened) for s in services]
    for radio in airlink.radios:
        covered = [r.service for r in opened if radio.index in airlink.covering[r.user]]
        counted = [covered.count(service) for service in services]
        assert radio.asking == counted, f"requests in the footprint of {radio.index}"


def _one_state(simulation: Simulation, request: Request) -> None:
    """An open request is served by its user's drone, waits there, or its user is loose."""
    airlink = simulation.airlink
    now_us = simulation.agenda.now
    running_us = 0 if request.serving < 0 else now_us - request.started_us
    assert 0 <= request.served_us + running_us <= request.required_us, "served more than requested"
    holder = airlink.attached[request.user]
    queues = [radio.index for radio in airlink.radios if request in radio.waiting]
    if holder is None:
        assert request.serving < 0 and not queues, "served or queued without a drone"
    elif request.serving < 0:
        assert queues == [holder.index], "a request waits where its user is not attached"
    else:
        assert request.serving == holder.index and not queues, "served by another drone"


def _geometry(simulation: Simulation) -> None:
    """Coverage is what the distances say; an attached user is inside its one drone's footprint."""
    airlink = simulation.airlink
    now_us = simulation.agenda.now
    radius_m = simulation.world.scenario.drones.footprint_radius_m
    users = all_walked(*simulation.path.walks, now_us)
    held = [0] * len(simulation.drones)
    for user, radio in enumerate(airlink.attached):
        if radio is not None:
            held[radio.index] += 1
            assert radio.index in airlink.covering[user], f"user {user} attached but not covered"
    for drone in simulation.drones:
        assert held[drone.index] == drone.radio.attached_users
        covered = np.array([drone.index in covering for covering in airlink.covering])
        if not drone.radio.on:
            assert not covered.any(), f"drone {drone.index} covers while {drone.mode.name}"
            continue
        x, y, _ = drone.position_m()
        distance_m = np.hypot(users[:, 0] - x, users[:, 1] - y)
        far = np.abs(distance_m - radius_m) > TOLERANCE_M
        wrong = far & (covered != (distance_m < radius_m))
        assert not wrong.any(), f"coverage by {drone.index} of users {np.flatnonzero(wrong)}"
