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
from desim_uav.env.alone import OneThread, alone
from desim_uav.env.arguments import typed
from desim_uav.env.session import Session
from desim_uav.errors import StateError
from desim_uav.scenario.load import scenario_hash, seedless
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World


@dataclass(frozen=True, eq=False)
class EnvState(Unchanging):
    """The state of an environment at a decision epoch, which does not change.

    Every environment of the same scenario can be put into it, with any engine; ``saved`` is the
    state of the engine, ``seed`` the seed of the run, and ``steps`` the number of steps of its
    earlier episodes.
    """

    saved: SavedState
    seed: int
    steps: int = 0

    @property
    def episode(self) -> int:
        """The number of the episode."""
        return self.saved.path.episode

    @property
    def step(self) -> int:
        """The number of steps that the episode has had."""
        return int(self.saved.rows.state.step)

    @typed
    def write(self, path: str | PathLike[str]) -> None:
        """Write a file from which ``restore`` of an environment in any process goes on.

        It holds seeds and commands but no code, and appears as a whole. Raises DesimError if it
        cannot be written.
        """
        state_file.write(Path(fspath(path)), self.saved, self.seed, self.steps)


class Saving:
    """The methods of an environment with one session that save, restore and fork it."""

    session: Session
    guard: OneThread

    def _present(self) -> Any:
        """Return what a reset returns, for the present decision epoch."""
        raise NotImplementedError

    @alone
    def save(self) -> EnvState:
        """Return the state at the present decision epoch, or at the end of the episode.

        Raises ResetNeeded before the first episode.
        """
        return save(self.session)

    @typed
    @alone
    def restore(self, state: EnvState | str | PathLike[str]) -> Any:
        """Go on from a saved state, or from the file of one; return what ``reset`` returns.

        The rest of the episode, and the episodes after it, are those of the environment that was
        saved. Raises StateError if the state is of another scenario or world, and for a file that
        cannot be read or that does not lead to the state that was saved.
        """
        resume(self.session, state)
        return self._present()

    @typed
    @alone
    def fork(self, count: int) -> list[Self]:
        """Return this many independent environments in the state of this one."""
        return [deepcopy(self) for _ in range(count)]


def save(session: Session) -> EnvState:
    """Return the state of a session. Raises ResetNeeded before the first episode."""
    session.require_episode()
    return EnvState(session.engine.save(), session.seed, session.steps)


def resume(session: Session, state: EnvState | str | PathLike[str]) -> None:
    """Let a session go on from a saved state, or from its file. Raises StateError."""
    if not isinstance(state, EnvState):
        _resume_file(session, Path(fspath(state)))
        return
    world = state.saved.world
    if world is not session.world or not session.started:
        stage = _stage_of(session, world.scenario)
        _enter(session, stage, (state.seed, state.episode, world.seed), world)
    session.engine.take(state.saved)
    session.go_on_from(state.seed, state.episode, state.steps)


def assign(source: Session, others: Sequence[Session]) -> None:
    """Let compiled sessions go on from the state of another one, on its sample path."""
    for other in others:
        if other.world is not source.world or not other.started:
            other.enter(source.stage, source.world)
    engine: Any = source.engine
    engine.fork_into([other.engine for other in others])
    for other in others:
        other.go_on_from(source.seed, source.episode, source.steps)


def _resume_file(session: Session, path: Path) -> None:
    """Let a session go on from the state to which the commands of a file lead.

    A copy of the session plays them, so that nothing has changed if they do not lead there.
    """
    content, twin = state_file.read(path), deepcopy(session)
    stage = _stage_of_hash(session, content.scenario_hash, f"{path}: ")
    _enter(twin, stage, (content.seed, content.episode, content.world_seed), None, f"{path}: ")
    resume(session, EnvState(content.played(twin.engine, path), content.seed, content.steps))


def _stage_of(session: Session, scenario: Scenario) -> int:
    """Return the stage of a session's tasks that has this scenario. Raises StateError."""
    if scenario is session.scenario:
        return session.stage
    return _stage_of_hash(session, scenario_hash(seedless(scenario)))


def _stage_of_hash(session: Session, digest: str, where: str = "") -> int:
    """Return the stage whose scenario has this hash. Raises StateError if none has."""
    own = [scenario_hash(seedless(scenario)) for _, scenario in session.tasks.stages]
    if digest not in own:
        raise StateError(
            f"{where}the saved state is of another scenario (hash {digest[:12]}) than this one "
            f"({own[session.stage][:12]})"
        )
    return session.stage if own[session.stage] == digest else own.index(digest)


def _enter(
    session: Session,
    stage: int,
    numbers: tuple[int, int, int],
    world: World | None,
    where: str = "",
) -> None:
    """Let a session fly in the world of a state, in a new engine if it is another one.

    ``numbers`` are the seed of the run, the number of the episode and the seed of the world;
    ``world`` is None if the world has to be drawn. Raises StateError if it is not the session's.
    """
    seed, episode, world_seed = numbers
    own = session.tasks.world_seed(stage, seed, episode)
    if own != world_seed:
        by_seed = session.tasks.stages[stage][1].world_seed is None
        raise StateError(
            f"{where}the saved state is of world {world_seed}, but this environment flies in "
            f"{'the world of its seed' if by_seed else f'world {own}'}; world_seed: {world_seed}"
        )
    if not session.started or (session.world.seed, session.stage) != (world_seed, stage):
        session.enter(stage, world or session.tasks.world(stage, world_seed))
