"""Saved states of environments, which are kept in memory or in a file."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Self

from desim_uav.copies import Unchanging
from desim_uav.engine.saved import SavedState
from desim_uav.env import state_file
from desim_uav.env.session import Session
from desim_uav.errors import StateError
from desim_uav.scenario.load import scenario_hash, seedless
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World

StateLike = "EnvState | str | PathLike[str]"


@dataclass(frozen=True, eq=False)
class EnvState(Unchanging):
    """The state of an environment at a decision epoch, which does not change.

    Every environment of the same scenario can be put into it, with any engine; ``saved`` is the
    state of the engine, and ``seed`` the seed of the run.
    """

    saved: SavedState
    seed: int

    @property
    def episode(self) -> int:
        """The number of the episode."""
        return self.saved.path.episode

    @property
    def step(self) -> int:
        """The number of steps that the episode has had."""
        return int(self.saved.rows.state.step)

    def write(self, path: str | PathLike[str]) -> None:
        """Write a file from which ``restore`` of an environment in any process goes on.

        It holds seeds and commands but no code, and appears as a whole. Raises DesimError if it
        cannot be written.
        """
        state_file.write(Path(fspath(path)), self.saved, self.seed)


class Saving:
    """The methods of an environment with one session that save, restore and fork it."""

    session: Session

    def _shown(self) -> Any:
        """Return what a reset returns, for the present decision epoch."""
        raise NotImplementedError

    def save(self) -> EnvState:
        """Return the state at the present decision epoch, or at the end of the episode.

        Raises ResetNeeded before the first episode.
        """
        return save(self.session)

    def restore(self, state: EnvState | str | PathLike[str]) -> Any:
        """Go on from a saved state, or from the file of one; return what ``reset`` returns.

        The rest of the episode, and the episodes after it, are those of the environment that was
        saved. Raises StateError if the state is of another scenario or world, and for a file that
        cannot be read or that does not lead to the state that was saved.
        """
        resume(self.session, state)
        return self._shown()

    def fork(self, count: int) -> list[Self]:
        """Return this many independent environments in the state of this one."""
        return [deepcopy(self) for _ in range(count)]


def save(session: Session) -> EnvState:
    """Return the state of a session. Raises ResetNeeded before the first episode."""
    session.require_episode()
    return EnvState(session.engine.save(), session.seed)


def resume(session: Session, state: EnvState | str | PathLike[str]) -> None:
    """Let a session go on from a saved state, or from its file. Raises StateError."""
    if not isinstance(state, EnvState):
        _resume_file(session, Path(fspath(state)))
        return
    world = state.saved.world
    if world is not session.world or not session.started:
        if world.scenario is not session.scenario:
            _refuse(session.scenario, scenario_hash(seedless(world.scenario)))
        _enter(session, state.seed, world.seed, world)
    session.engine.take(state.saved)
    session.go_on_from(state.seed, state.episode)


def assign(source: Session, others: Sequence[Session]) -> None:
    """Let compiled sessions go on from the state of another one, on its sample path."""
    for other in others:
        if other.world is not source.world or not other.started:
            other.enter(source.seed, source.world)
    engine: Any = source.engine
    engine.fork_into([other.engine for other in others])
    for other in others:
        other.go_on_from(source.seed, source.episode)


def _resume_file(session: Session, path: Path) -> None:
    """Let a session go on from the state to which the commands of a file lead.

    A copy of the session plays them, so that nothing has changed if they do not lead there.
    """
    kept, twin = state_file.read(path), deepcopy(session)
    _refuse(session.scenario, kept.scenario_hash, f"{path}: ")
    _enter(twin, kept.seed, kept.world_seed, twin.world, f"{path}: ")
    resume(session, EnvState(kept.played(twin.engine, path), kept.seed))


def _refuse(scenario: Scenario, wanted: str, where: str = "") -> None:
    """Raise StateError if a state with this hash is of another scenario."""
    own = scenario_hash(seedless(scenario))
    if own != wanted:
        raise StateError(
            f"{where}the saved state is of another scenario (hash {wanted[:12]}) than this one "
            f"({own[:12]})"
        )


def _enter(session: Session, seed: int, world_seed: int, world: World, where: str = "") -> None:
    """Let a session fly in the world of a state, in a new engine if it is another one."""
    fixed = session.scenario.world_seed
    if (seed if fixed is None else fixed) != world_seed:
        raise StateError(
            f"{where}the saved state is of world {world_seed}, but this environment flies in "
            f"{'the world of its seed' if fixed is None else f'world {fixed}'}; world_seed: "
            f"{world_seed}"
        )
    if not session.started or session.world.seed != world_seed:
        session.enter(seed, world)
