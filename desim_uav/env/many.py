"""Many environments in the compiled engine, which are reset and stepped together."""

from __future__ import annotations

import operator
import os
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import partial
from itertools import pairwise
from typing import Any
from weakref import WeakSet

import numpy as np
from gymnasium import error
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from desim_uav.commands import CellCommands, FreeCommands
from desim_uav.commands.given import out_of_range
from desim_uav.copies import Independent
from desim_uav.engine.compiled import calls
from desim_uav.engine.compiled.paths import blocks_of
from desim_uav.engine.compiled.scratch import scratch
from desim_uav.env.alone import OneThread
from desim_uav.env.compiled import CompiledSession, Outputs
from desim_uav.env.render import Screen
from desim_uav.env.room import require_room
from desim_uav.env.saving_vector import VectorSaving
from desim_uav.env.session import ActionError, as_commands
from desim_uav.env.tasks import Tasks
from desim_uav.errors import SimulationError
from desim_uav.sample_path import draw_all

Flags = NDArray[np.bool_]
"""One truth value for each environment."""

Seed = int | Sequence[int | None] | None
"""The seed of environment 0, to which k is added for environment k; or a list with one for each."""

StepTask = Callable[[], int]
"""Steps some environments, or begins episodes in them; returns how many a fault has stopped."""

FEWEST_DRAWN, FEWEST_STEPPED = 32, 8
"""The smallest number of environments for which a task is worth its calls: to begin and to step."""

MOST_DRAWN = 128
"""The largest number whose sample paths are drawn at once, because of the memory for drawing."""

CACHED = 4 * 2**20
"""The bytes of all states up to which it is not worth fetching them before they are stepped."""


class Many(VectorSaving, Independent):
    """``num_envs`` environments of a scenario, whose outputs are rows of arrays (``outputs``).

    ``sessions`` are the environments. Each step and each reset is a list of tasks, which
    ``threads`` threads, of which the caller's is one, take from it until none is left.
    """

    num_envs: int
    render_mode: str | None

    def make_sessions(
        self,
        tasks: Tasks,
        num_envs: int,
        autoreset_mode: AutoresetMode | str,
        threads: int,
        render_mode: str | None,
    ) -> None:
        """Make the environments. For the errors see ``UavVectorEnv``."""
        for name, number in (("num_envs", num_envs), ("threads", threads)):
            if not hasattr(number, "__index__") or isinstance(number, bool) or number < 1:
                raise error.Error(f"{name} {number!r}: must be a whole number, 1 or more")
        num_envs, threads = operator.index(num_envs), operator.index(threads)
        if render_mode not in (None, "rgb_array"):
            raise error.UnsupportedMode(
                f"render_mode {render_mode!r}: must be None or 'rgb_array'; only a single "
                "environment opens a window"
            )
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.autoreset_mode = _mode(autoreset_mode)
        tasks.stages[0][1].require_one_space("an environment whose actions are one array")
        first = CompiledSession(tasks, draws_ahead=False)
        require_room(first, num_envs)
        others = [CompiledSession(tasks, first.world, False) for _ in range(num_envs - 1)]
        self.sessions = [first, *others]
        self.threads = min(threads, num_envs)
        self.screens = [Screen(session, render_mode) for session in self.sessions if render_mode]
        self._all = np.ones(num_envs, np.bool_)
        self._set_up()
        self._set_spaces()

    def _set_up(self) -> None:
        """Make the arrays and threads, which are this object's own."""
        self.outputs = Outputs.of(self.sessions[0], self.num_envs)
        for k, session in enumerate(self.sessions):
            session.write_to(self.outputs, k)
        self._which = np.array([session.which(session.episode) for session in self.sessions])
        self._shares = shares_of(self.num_envs, self.threads)
        self.guard = OneThread()
        self.start_threads()
        _with_threads.add(self)

    def start_threads(self) -> None:
        """Make threads, which a child process that was forked from this one lacks."""
        self._pool = ThreadPoolExecutor(max(1, self.threads - 1))

    def __getstate__(self) -> dict[str, Any]:
        """Return everything except arrays and threads, which a copy makes again."""
        own = ("outputs", "_which", "_shares", "_pool", "guard")
        return {key: part for key, part in vars(self).items() if key not in own}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the attributes, with arrays and threads of this object's own."""
        vars(self).update(state)
        self._set_up()

    def stop_threads(self) -> None:
        """Stop the threads, if there are any. It may be called more than once."""
        pool = getattr(self, "_pool", None)
        if pool is not None:
            pool.shutdown()

    # ---- resets

    def begin_chosen(self, seed: Seed, options: dict[str, Any] | None) -> Flags:
        """Begin the next episodes that a reset asks for; return in which environments."""
        which = self._reset_mask(options)
        if seed is None or isinstance(seed, int | np.integer):
            seeds = [None if seed is None else int(seed) + k for k in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise error.Error(f"there are {len(seeds)} seeds for {self.num_envs} environments")
        self.begin(which, seeds)
        return which

    def begin(self, which: Flags, seeds: Sequence[int | None] | None = None) -> None:
        """Begin the next episode of the environments ``which``; with seeds, new runs."""
        self._do(self._begins(which, seeds), which)

    def _begins(self, which: Flags, seeds: Sequence[int | None] | None = None) -> list[StepTask]:
        """Prepare the next episode of the environments ``which``; return tasks that begin them."""
        numbers = np.flatnonzero(which).tolist()
        for k in numbers:
            session = self.sessions[k]
            if session.start(None if seeds is None else seeds[k]):
                self.outputs.addresses[k, :3] = session.addresses()
        return [partial(self._begin_drawn, group) for group in self._drawn_together(numbers)]

    def _drawn_together(self, numbers: Sequence[int]) -> Iterable[list[int]]:
        """Yield groups of environments whose sample paths can be drawn at once.

        Walks step by step are the same draws in all worlds of a scenario.
        """
        most = max(FEWEST_DRAWN, min(-(-len(numbers) // self.threads), MOST_DRAWN))
        groups: dict[int, list[int]] = {}
        for k in numbers:
            world = self.sessions[k].world
            key = id(world.scenario if world.row_mobility else world)
            groups.setdefault(key, []).append(k)
        for group in groups.values():
            for first in range(0, len(group), most):
                yield group[first : first + most]

    def _begin_drawn(self, group: Sequence[int]) -> int:
        """Draw the next sample paths of some environments, and begin episodes on them."""
        sessions = [self.sessions[k] for k in group]
        seeds, episodes = zip(*[(own.seed, own.episode + 1) for own in sessions], strict=True)
        blocks, places = blocks_of(draw_all(sessions[0].world, seeds, episodes))
        afresh = [own.begin_on(block) for own, block in zip(sessions, blocks, strict=True)]
        self.outputs.addresses[group, 1] = places
        self._which[group] = [own.which(own.episode) for own in sessions]
        return calls.begin_all(self.outputs.addresses[group], np.array(afresh), scratch())

    def _reset_mask(self, options: dict[str, Any] | None) -> Flags:
        """Return the mask of the environments that a reset concerns."""
        if not options or "reset_mask" not in options:
            return self._all
        mask = np.asarray(options["reset_mask"])
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,) or not mask.any():
            raise error.Error(
                f"reset_mask {mask.tolist()}: must be an array of {self.num_envs} bool, "
                "at least one of them True"
            )
        return mask

    # ---- steps

    def over(self) -> Flags:
        """Return a mask of the environments whose episodes are over."""
        over: Flags = self.outputs.over[:, 0] | self.outputs.over[:, 1]
        return over

    def require_episodes(self, over: Flags) -> None:
        """Raise ResetNeeded if there is an environment that cannot be stepped."""
        self.require_begun()
        if self.autoreset_mode is AutoresetMode.DISABLED and over.any():
            which = np.flatnonzero(over).tolist()
            raise error.ResetNeeded(f"call reset first: the episode is over in {which}")

    def require_begun(self) -> None:
        """Raise ResetNeeded if there is an environment in which no episode has begun."""
        waiting = self._which[:, 2] < 0
        if waiting.any():
            which = np.flatnonzero(waiting).tolist()
            raise error.ResetNeeded(f"call reset first: no episode has begun in {which}")

    @property
    def commands(self) -> CellCommands | FreeCommands:
        """What the drones of an environment can be commanded."""
        return self.sessions[0].world.commands.of_all("an environment whose actions are one array")

    def advance(self, actions: object, over: Flags, by_drone: bool) -> None:
        """Give the environments their actions, and run each to its next epoch.

        Those whose episodes are ``over`` begin their next ones instead, whatever their actions.
        Raises ActionError, before any environment is stepped, if there is an invalid action.
        ``by_drone``: whether the actions have an axis for drones.
        """
        of_worlds = self.commands
        indices, aims = as_commands(of_worlds.arrays_of, self.num_envs, actions, by_drone)
        if aims is not None:
            self._do(self._in_shares(calls.aim_all, aims, ~over), self._all)
        elif indices.min() < 0 or indices.max() >= len(of_worlds.actions):
            raise ActionError(str(out_of_range(indices.tolist(), of_worlds.actions)))
        begins = self._begins(over) if over.any() else []
        state = int(self.sessions[0].engine.memory.nbytes)
        step = partial(_step, state if state * self.num_envs > CACHED else 0)
        self._do([*begins, *self._in_shares(step, indices, ~over)], self._all)

    def _in_shares(
        self, kernel: Callable[..., int], argument: NDArray[Any], which: Flags
    ) -> list[StepTask]:
        """Return tasks that call a kernel on the environments ``which``.

        ``argument`` has a row for each environment.
        """
        rows = self.outputs.addresses
        return [partial(kernel, rows[one], argument[one], which[one]) for one in self._shares]

    def _do(self, tasks: Iterable[StepTask], which: Flags) -> None:
        """Do tasks of the environments ``which`` in all threads; repeat what ran out of room.

        Raises SimulationError if a component of one's own has failed in an environment.
        """
        left = deque(tasks)
        others = [self._pool.submit(work_off, left) for _ in range(self.threads - 1)]
        try:
            stopped = work_off(left)
        except SimulationError as fault:
            left.clear()
            raise self._named(fault, which) from fault
        finally:
            if others:
                wait(others)
        try:
            stopped += sum([other.result() for other in others])
        except SimulationError as fault:
            raise self._named(fault, which) from fault
        for k in np.flatnonzero(self.outputs.over[:, 2] & which).tolist() if stopped else ():
            try:
                self.sessions[k].go_on()
            except SimulationError as fault:
                raise _of_one(k, fault) from fault

    def _named(self, fault: SimulationError, which: Flags) -> SimulationError:
        """Return a fault that has ended a task with the environment in which it was met."""
        stopped = np.flatnonzero(self.outputs.over[:, 2] & which).tolist()
        return _of_one(stopped[0], fault) if stopped else fault

    # ---- pictures

    def frames(self) -> tuple[NDArray[np.uint8], ...]:
        """Return the frame of each environment, (height, width, 3)."""
        return tuple(screen.frame() for screen in self.screens)


_with_threads: WeakSet[Many] = WeakSet()
"""All vector environments of this process."""


def _start_threads() -> None:
    for environments in list(_with_threads):
        environments.start_threads()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_start_threads)


def shares_of(count: int, threads: int) -> list[slice]:
    """Return slices of ``count`` environments, the larger ones first.

    Threads that take one after the other end at about the same time, also if some begin later.
    """
    bounds = [0]
    least = max(min(FEWEST_STEPPED, -(-count // threads)), -(-count // (32 * threads)))
    while bounds[-1] < count:
        left = count - bounds[-1]
        size = left if threads == 1 else max(left // (2 * threads), least)
        bounds.append(min(bounds[-1] + size, count))
    return [slice(*pair) for pair in pairwise(bounds)]


def _step(fetched: int, rows: NDArray[np.int64], indices: NDArray[np.int64], which: Flags) -> int:
    """Step environments in this thread (see ``calls.step_all``)."""
    return calls.step_all(rows, indices, which, scratch(), fetched)


def work_off(left: deque[StepTask]) -> int:
    """Do what is left until nothing is; return how many environments a fault has stopped."""
    stopped = 0
    while left:
        try:
            task = left.popleft()
        except IndexError:  # another thread has taken the last one
            break
        stopped += task()
    return stopped


def _of_one(k: int, fault: SimulationError) -> SimulationError:
    """Return a fault of environment k with its number."""
    return SimulationError(f"environment {k}: {fault}")


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Return the autoreset mode of this name or value. Raises gymnasium's Error."""
    try:
        return AutoresetMode(mode)
    except ValueError as problem:
        modes = ", ".join(repr(one.value) for one in AutoresetMode)
        raise error.Error(f"autoreset_mode {mode!r}: must be one of {modes}") from problem
