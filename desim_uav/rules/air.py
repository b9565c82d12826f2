"""Where drones fly and how they transmit, as ``model.radio.air`` has to know it."""

from __future__ import annotations

from desim_uav.model.kernels import rule
from desim_uav.model.radio.scene import (
    BAND,
    BEGUN_US,
    PLACE_COLUMNS,
    POWER_DBM,
    SENDER_COLUMNS,
    SERVES,
    TRANSIT,
    X0,
    X1,
    Y0,
    Y1,
    Z0,
    Z1,
)
from desim_uav.rules.rows import Constants, Drone, State


@rule
def place_drones(world: Constants, state: State) -> None:
    """Write the legs of all drones, and whether they serve, into ``state.look.air``."""
    air = state.look.air
    air.losses[0], air.losses[1], air.losses[2] = world.level, world.rates, world.loss_values
    air.radios[0], air.radios[1] = world.carrier_ghz, world.noise_dbm
    for d in range(len(state.drones)):
        drone, at, own = state.drones[d], d * PLACE_COLUMNS, d * SENDER_COLUMNS
        air.ways[at + X0] = (drone.x + 0.5) * world.cell_x_m
        air.ways[at + Y0] = (drone.y + 0.5) * world.cell_y_m
        air.ways[at + Z0] = world.levels_m[drone.level]
        air.ways[at + X1] = (drone.to_x + 0.5) * world.cell_x_m
        air.ways[at + Y1] = (drone.to_y + 0.5) * world.cell_y_m
        air.ways[at + Z1] = world.levels_m[drone.to_level]
        air.ways[at + POWER_DBM] = world.power_dbm
        air.senders[own + BEGUN_US], air.senders[own + TRANSIT] = drone.since_us, drone.transit
        air.senders[own + SERVES] = drone.serving
        air.senders[own + BAND] = d % world.reuse if world.reuse > 0 else d


@rule
def note_classes(state: State, drone: Drone) -> None:
    """Write the classes of all users' links to a drone into ``state.look.air``."""
    held = state.look.air.held
    for u in range(len(state.users)):
        held[u] = state.users[u].classes[drone.index]
