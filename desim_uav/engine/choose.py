"""The engines by name: ``des``, the SimPy engine, and ``batch``, the compiled engine."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from desim_uav.errors import ScenarioError, UsageError, notice
from desim_uav.scenario.cost import check_cost

if TYPE_CHECKING:
    from desim_uav.engine.base import RunSettings
    from desim_uav.engine.episode import Engine
    from desim_uav.world import World

ENGINES = ("des", "batch")


def make_engine(name: str, world: World, settings: RunSettings) -> Engine:
    """Return a new engine of this name. Raises the errors of ``check_engine``."""
    check_engine(name, world, settings.keep_events)
    if name == "batch":
        from desim_uav.engine.compiled import BatchSimulation

        return BatchSimulation(world, settings)
    from desim_uav.engine.des import Simulation

    return Simulation(world, settings)


def check_engine(name: str, world: World, keep_events: bool = False) -> None:
    """Raise ScenarioError if this engine cannot run an episode of the scenario.

    This is so if the compiled engine cannot compile a component, or if the episode, with its event
    log if ``keep_events``, would be too long or too large. Raises UsageError for an unknown name.
    """
    if name not in ENGINES:
        raise UsageError(f"--engine {name}: allowed: {', '.join(ENGINES)}")
    problems = lacking_of(world) if name == "batch" else []
    if problems:
        raise ScenarioError(*(f"{problem}; --engine des runs it" for problem in problems))
    check_cost(world.scenario, name, keep_events)


def engine_for(world: World, say: Callable[[str], None] = notice) -> str:
    """Return the name of the compiled engine if it has all components, else of the SimPy engine.

    ``say`` is called with the reason for the slower engine; by default it prints it on stderr.
    """
    problems = lacking_of(world)
    if problems:
        say(f"the SimPy engine (des) is used, which is slower: {'; '.join(problems)}")
    return "des" if problems else "batch"


def lacking_of(world: World) -> list[str]:
    """Return why only the SimPy engine can run a world, one reason each; none if both can."""
    from desim_uav.engine.compiled.pack import lacking

    return lacking(world)
