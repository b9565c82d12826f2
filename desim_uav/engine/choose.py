"""The engines by name: ``des``, of SimPy, and ``batch``, the compiled one. Their numbers agree."""

from __future__ import annotations

from typing import TYPE_CHECKING

from desim_uav.errors import ScenarioError, UsageError

if TYPE_CHECKING:
    from desim_uav.engine.base import Engine, RunSettings
    from desim_uav.world import World

ENGINES = ("des", "batch")


def make_engine(name: str, world: World, settings: RunSettings) -> Engine:
    """The engine of this name. Raises the errors of ``check_engine``."""
    check_engine(name, world)
    if name == "batch":
        from desim_uav.engine.batch import BatchSimulation

        return BatchSimulation(world, settings)
    from desim_uav.engine.des import Simulation

    return Simulation(world, settings)


def check_engine(name: str, world: World) -> None:
    """Raises ScenarioError where this engine has no kernel for a component of the scenario.

    UsageError where there is no such engine.
    """
    if name not in ENGINES:
        raise UsageError(f"--engine {name}: allowed: {', '.join(ENGINES)}")
    problems = _refused(world) if name == "batch" else []
    if problems:
        raise ScenarioError(*problems)


def engine_for(world: World) -> str:
    """The compiled engine where every component has a kernel, else the SimPy engine."""
    return "des" if _refused(world) else "batch"


def _refused(world: World) -> list[str]:
    from desim_uav.engine.batch.pack import refused

    return refused(world)
