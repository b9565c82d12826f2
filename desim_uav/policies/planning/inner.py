"""The simulations in a planner's mind, which the compiled engine runs whatever the outer one is."""

from __future__ import annotations

from typing import Any

from desim_uav.drone_type import DroneType
from desim_uav.engine.base import RunSettings
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.compiled.pack import lacking
from desim_uav.engine.episode import Engine
from desim_uav.engine.saved import SavedState, copied
from desim_uav.errors import PolicyError
from desim_uav.model.rules import AIRBORNE, GROUNDED, US
from desim_uav.sample_path import SamplePath
from desim_uav.world import World

CRASH = 100.0
"""What a crash costs, in percent: as much as the whole of a measure."""


class InnerEngine(BatchSimulation):
    """An engine that goes back to the state that it has taken if a step runs out of memory.

    It must not run an imagined episode again from its start: the past of this is the true one, and
    that of what is imagined is not (``planning.future``).
    """

    _taken: SavedState | None = None

    def begin(self, path: SamplePath) -> None:
        """Begin an episode without a snapshot."""
        self._taken = None
        super().begin(path)

    def _take(self, saved: SavedState) -> None:
        """Take a saved state, to which this engine goes back."""
        self._taken = saved
        super()._take(saved)

    def go_back(self) -> int:
        """Go back to the state that has been taken, and return the number of its steps."""
        if self._taken is None:
            return super().go_back()
        rows = self._taken.rows
        self._resume(rows)
        self.log = copied(self._taken.log, self.settings)
        self._served_by = {number: list(drones) for number, drones in self._taken.served_by}
        return int(rows.state.step)


def inner_engine(planner: str, world: World, carry_over: bool) -> InnerEngine:
    """Return an engine for a planner's simulations, whose drones fly below the ceiling.

    Raises PolicyError if the compiled engine cannot run the world's components.
    """
    problems = lacking(world)
    if problems:
        raise PolicyError(f"{planner} needs the compiled engine; {'; '.join(problems)}")
    ceilings = (True,) * world.scenario.drone_count
    return InnerEngine(world, RunSettings(ceilings, carry_over, False, False))


def score(engine: Engine, qoe1: float, charged: bool = True) -> float:
    """Return what a simulation has reached so far, in percent of QoE1 and QoE3.

    ``qoe1`` is the weight of QoE1, and 1 - ``qoe1`` that of QoE3. If drones are ``charged``, which
    they need not be at the end of the last episode, the charge of their batteries counts with the
    part of QoE3 that it will be worth. Each crash is a loss.
    """
    measured = engine.measures()
    first, third = measured.qoe1_percent or 0.0, measured.qoe3_percent or 0.0
    counts = charged and (engine.settings.carry_over or not _is_over(engine))
    left = _charge(engine) if counts else 0.0
    value = qoe1 * first + (1.0 - qoe1) * third * (1.0 + left)
    return value - CRASH * float(engine.state.crashes)


def _is_over(engine: Engine) -> bool:
    return engine.terminated or engine.truncated


def _charge(engine: Engine) -> float:
    """Return the worth of all batteries, as a share of the QoE3 of an episode until now."""
    world, share = engine.world, 0.0
    passed_us = int(engine.state.now_us)
    if not world.scenario.limited_battery or not world.stations or passed_us == 0:
        return 0.0
    for number, own in enumerate(world.types):
        if own.limited:
            lasts_us = own.capacity * (US / own.drain_per_s)
            cycle = own.full_charge_us / (lasts_us + own.full_charge_us)
            rows = [row for row in engine.drones if world.type_numbers[row.index] == number]
            charge_us = sum(_charge_of(engine, row, own) for row in rows)
            share += cycle * charge_us / (len(engine.drones) * passed_us)
    return share


def _charge_of(engine: Engine, drone: Any, own: DroneType) -> int:
    """Return the time that a drone's battery lasts, less that since its last record in the air."""
    per_us = own.drain_per_s / US
    if drone.mode in GROUNDED:
        return int(own.capacity / per_us)
    flown_us = int(engine.state.now_us) - drone.since_us if drone.mode in AIRBORNE else 0
    return max(0, int(drone.charge / per_us) - flown_us)
