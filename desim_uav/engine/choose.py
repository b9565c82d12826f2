"""The engines by name: ``des``, of SimPy, and ``batch``, the compiled one. Their numbers agree."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from desim_uav.errors import ScenarioError, UsageError
from desim_uav.notices import notice
from desim_uav.scenario.cost import check_cost

if TYPE_CHECKING:
    from desim_uav.engine.base import Engine, RunSettings
    from desim_uav.world import World

ENGINES = ("des", "batch")


def make_engine(name: str, world: World, settings: RunSettings) -> Engine:
    """The engine of this name. Raises the errors of ``check_engine``."""
    check_engine(name, world, settings.keep_events)
    if name == "batch":
        from desim_uav.engine.compiled import BatchSimulation

        return BatchSimulation(world, settings)
    from desim_uav.engine.des import Simulation

    return Simulation(world, settings)


def check_engine(name: str, world: World, keep_events: bool = False) -> None:
    """Raise ScenarioError if this engine cannot run an episode of the scenario.

    Either it has no kernel for a component, or the episode would be too long or too large;
    ``keep_events``: with its event log. Raises UsageError if there is no such engine.
    """
    if name not in ENGINES:
        raise UsageError(f"--engine {name}: allowed: {', '.join(ENGINES)}")
    problems = _lacking(world) if name == "batch" else []
    if problems:
        raise ScenarioError(*(f"{problem}; --engine des runs it" for problem in problems))
    check_cost(world.scenario, name, keep_events)


def engine_for(world: World, say: Callable[[str], None] = notice) -> str:
    """The compiled engine if every component has a kernel, else the SimPy engine.

    ``say`` is told why the slower one is chosen; by default this is a line on stderr.
    """
    problems = _lacking(world)
    if problems:
        say(f"the SimPy engine (des) is used, which is slower: {'; '.join(problems)}")
    return "des" if problems else "batch"


def _lacking(world: World) -> list[str]:
    from desim_uav.engine.compiled.pack import lacking

    return lacking(world)
