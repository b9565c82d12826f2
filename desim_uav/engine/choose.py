"""The engines by name: ``des``, the SimPy engine, ``batch``, the compiled one, and ``auto``.

``auto`` is the compiled engine if its machine code is on disk. If it is not, the SimPy engine
begins, another process compiles, and ``faster`` changes the engine between two episodes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING
from weakref import WeakSet

from desim_uav.engine.ahead import AHEAD, folder
from desim_uav.errors import ScenarioError, UsageError, notice
from desim_uav.model.observations import RowObservation
from desim_uav.rowcode.components import works_on_rows
from desim_uav.rowcode.kernels import NotOnDiskError, compiled_before, only_from_disk
from desim_uav.scenario.cost import check_cost

if TYPE_CHECKING:
    from desim_uav.engine.base import RunSettings
    from desim_uav.engine.compiled import BatchSimulation
    from desim_uav.engine.episode import Engine
    from desim_uav.world import World

ENGINES = ("des", "batch")
CHOICES = ("auto", *ENGINES)

SLOWER = "the SimPy engine (des) is used, which is slower: "
"""The beginning of the notice that only the SimPy engine can run a scenario."""


def make_engine(name: str, world: World, settings: RunSettings) -> Engine:
    """Return a new engine of this name. Raises the errors of ``check_engine``."""
    check_engine(name, world, settings.keep_events)
    kind = name if name != "auto" else first_of(world, settings.keep_events)
    if kind == "auto":
        engine = on_disk([world], settings)
        if engine is not None:
            return engine
    if kind == "batch":
        from desim_uav.engine.compiled import BatchSimulation

        return BatchSimulation(world, settings)
    from desim_uav.engine.des import Simulation

    return Simulation(world, settings)


def check_engine(name: str, world: World, keep_events: bool = False) -> None:
    """Raise ScenarioError if this engine cannot run an episode of the scenario.

    This is so if the compiled engine cannot compile a component, or if the episode, with its event
    log if ``keep_events``, would be too long or too large. Raises UsageError for an unknown name.
    """
    if name not in CHOICES:
        raise UsageError(f"--engine {name}: allowed: {', '.join(CHOICES)}")
    problems = lacking_of(world) if name == "batch" else []
    if problems:
        raise ScenarioError(*(f"{problem}; --engine des runs it" for problem in problems))
    check_cost(world.scenario, None if name == "auto" else name, keep_events)


def engine_for(world: World, say: Callable[[str], None] = notice) -> str:
    """Return the name of the compiled engine if it has all components, else of the SimPy engine.

    ``say`` is called with the reason for the slower engine; by default it prints it on stderr.
    """
    problems = lacking_of(world)
    if problems:
        say(SLOWER + "; ".join(problems))
    return "des" if problems else "batch"


def lacking_of(world: World) -> list[str]:
    """Return why only the SimPy engine can run a world, one reason each; none if both can."""
    from desim_uav.engine.compiled.pack import lacking

    return lacking(world)


# ---- auto


def faster(name: str, engine: Engine) -> Engine:
    """Return the engine for the next episode, which goes on from where ``engine`` is.

    It is another one if ``name`` is auto, ``engine`` is the SimPy engine, and the machine code of
    the compiled engine has come to disk. Drones are carried over as they would be in ``engine``.
    """
    successor = None if name != "auto" else instead_of(engine)
    if successor is None:
        return engine
    successor.carry(engine.carried())
    return successor


def instead_of(
    engine: Engine, later: Callable[[], Sequence[World]] = tuple
) -> BatchSimulation | None:
    """Return a new compiled engine for the world of a SimPy engine, if its code is on disk by now.

    So must be that for the worlds that come ``later``. If it is not, see to it that another process
    compiles it.
    """
    from desim_uav.engine.des import Simulation

    if not isinstance(engine, Simulation) or engine.world in _SIMPY_ONLY:
        return None

    def worlds() -> Sequence[World]:
        return [engine.world, *later()]

    return on_disk(worlds(), engine.settings) if AHEAD.has_news(worlds) else None


def look_ahead(name: str, world: World) -> None:
    """Have the engine compiled for others, if it may become that of ``auto`` in a world.

    A process that is ended together with its work, as those of sweeps, should not begin that.
    """
    from desim_uav.engine.compiled import loop

    if name == "auto" and first_of(world) == "auto" and not compiled_before(loop.run):
        AHEAD.has_news(lambda: [world])


def first_of(world: World, keep_events: bool = False, observed: bool = False) -> str:
    """Return what ``auto`` is in a world: auto, or the one engine that can run it.

    ``observed``: compiled code has to write what learners observe. If the compiled engine lacks
    something, a notice names it.
    """
    able = [name for name in ENGINES if _affords(name, world, keep_events)]
    problems = lacking_of(world)
    if observed and not works_on_rows(world.scenario.observation, RowObservation):
        problems += [f"observation: {type(world.scenario.observation).__name__!r} is not compiled"]
    if problems:
        _say_once(SLOWER + "; ".join(problems))
    elif able == ["batch"]:
        return "batch"
    if problems or "batch" not in able or folder() is None:
        _SIMPY_ONLY.add(world)
        return "des"
    return "auto"


_SIMPY_ONLY: WeakSet[World] = WeakSet()
"""The worlds that the SimPy engine runs to the end if nobody names an engine."""

_SAID: set[str] = set()


def _say_once(words: str) -> None:
    """Print a notice if this process has not printed it yet."""
    if words not in _SAID:
        _SAID.add(words)
        notice(words)


def _affords(name: str, world: World, keep_events: bool) -> bool:
    try:
        check_cost(world.scenario, name, keep_events)
    except ScenarioError:
        return False
    return True


def on_disk(worlds: Sequence[World], settings: RunSettings) -> BatchSimulation | None:
    """Return a compiled engine for the first world if the code for all worlds is on disk."""
    from desim_uav.engine.compiled import BatchSimulation, calls

    try:
        with only_from_disk():
            calls.load(calls.OF_STEPS)
            engines = [BatchSimulation(world, settings) for world in worlds]
    except NotOnDiskError as missing:
        if not missing.keeps:
            _SIMPY_ONLY.update(worlds)
        return None
    AHEAD.note_on_disk()
    return engines[0]
