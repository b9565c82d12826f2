"""Sessions in the compiled engine, which writes what environments return into arrays."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property, partial
from typing import Any, NamedTuple
from weakref import ref

import numpy as np
from gymnasium import error
from numpy.typing import NDArray

from desim_uav.commands.given import out_of_range
from desim_uav.engine.base import COUNTS, MEASURES, OWN_COUNTS, RunSettings
from desim_uav.engine.choose import CHOICES, first_of, instead_of, on_disk
from desim_uav.engine.compiled import BatchSimulation, calls
from desim_uav.engine.compiled.scratch import scratch
from desim_uav.engine.constants import term_names
from desim_uav.engine.episode import Engine
from desim_uav.env.session import ActionError, Session, as_commands, info_keys
from desim_uav.env.tasks import Tasks
from desim_uav.model.state import Snapshot
from desim_uav.rowcode.rows import Words
from desim_uav.sample_path import SamplePath, draw
from desim_uav.spaces import features
from desim_uav.world import World

MEASURED, COUNTED, NUMBERS = len(MEASURES), calls.COUNTED, calls.NUMBERS
"""Where the MEASURES, the COUNTS and OF_STEP end in a row of ``Outputs.numbers``."""

OWN_COUNTED = len(OWN_COUNTS)
"""Where the OWN_COUNTS end in the row of a drone in ``Outputs.own``."""

REQUESTS = MEASURED + COUNTS.index("requests")
"""The place of the number of requests in such a row."""

ONE = np.ones(1, np.bool_)


class Outputs(NamedTuple):
    """The outputs of n environments at their present epochs, in arrays with a row for each.

    ``observations`` (n, drones * features); ``masks`` int8 (n, drones * actions); ``rewards``
    (n, 1), means over the drones; ``numbers``, the MEASURES, the COUNTS, OF_STEP and the mean
    terms of the reward; ``over`` bool (n, 3): terminated, truncated, stopped by a fault. ``paid``
    (n, drones) are the rewards of the drones, and ``own`` (n, drones * (OWN_COUNTED + terms)) their
    OWN_COUNTS and terms. ``addresses`` (n, ADDRESSES) tells kernels where the environments and
    these rows are.
    """

    observations: NDArray[np.float64]
    masks: NDArray[np.int8]
    rewards: NDArray[np.float64]
    numbers: NDArray[np.float64]
    over: NDArray[np.bool_]
    paid: NDArray[np.float64]
    own: NDArray[np.float64]
    addresses: NDArray[np.int64]

    @classmethod
    def of(cls, session: Session, count: int) -> Outputs:
        """Return arrays for ``count`` sessions like this one, of which none has begun."""
        world, drones = session.world, session.drones
        terms = len(term_names(world))
        outputs = cls(
            np.zeros((count, drones * len(features(world)))),
            np.zeros((count, drones * len(world.actions)), np.int8),
            np.zeros((count, 1)),
            np.zeros((count, NUMBERS + terms)),
            np.zeros((count, 3), np.bool_),
            np.zeros((count, drones)),
            np.zeros((count, drones * (OWN_COUNTED + terms))),
            np.zeros((count, calls.ADDRESSES), np.int64),
        )
        for k, addresses in enumerate(outputs.addresses):
            addresses[3:] = [array[k:].ctypes.data for array in outputs[: calls.OUTPUTS]]
        return outputs


class CompiledSession(Session):
    """A session in the compiled engine (see ``Session``), whose outputs are a row of arrays.

    Raises ScenarioError if a component of the scenario cannot be compiled.
    """

    engine: BatchSimulation
    compiled = 1

    def __init__(self, tasks: Tasks, world: World | None = None, draws_ahead: bool = True) -> None:
        super().__init__(tasks, world, draws_ahead)
        self.keys = info_keys(term_names(self.world))
        self.write_to(Outputs.of(self, 1), 0)

    def __getstate__(self) -> dict[str, Any]:
        """Return everything except addresses and outputs, which a copy makes again."""
        state = super().__getstate__()
        del state["_outputs"]
        state.pop("_row", None)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the attributes, with outputs of this object's own."""
        vars(self).update(state)
        self.write_to(Outputs.of(self, 1), 0)

    @classmethod
    def instead_of(cls, other: Session, engine: BatchSimulation) -> CompiledSession:
        """Return a session that begins the next episode in the place of one in another engine.

        ``engine`` is new, and of the same world and settings. Drones are carried over.
        """
        own = cls(other.tasks, other.world, other._draws_ahead)
        own.guard, own.chooses = other.guard, other.chooses
        own.seed, own.episode, own.steps = other.seed, other.episode, other.steps
        if other.episode >= 0:
            own.steps += int(other.engine.state.step)
        own._stage, own.scenario, own._paths = other._stage, other.scenario, other._paths
        engine.carry(other.engine.carried())
        own.engine, own._started = engine, True
        own.tell()
        return own

    def write_to(self, outputs: Outputs, k: int) -> None:
        """Make row k of these outputs the one of this session, from now on."""
        self._outputs = outputs, k
        vars(self).pop("_row", None)
        if self._started:
            self.tell()
        if self.episode >= 0:
            self._look()

    @cached_property
    def _row(self) -> Outputs:
        """The row of this session in the outputs, whose arrays are made only if it is used."""
        outputs, k = self._outputs
        rows = (array[k] for array in outputs[: calls.OUTPUTS])
        return Outputs._make([*rows, outputs.addresses[k : k + 1]])

    def tell(self) -> None:
        """Write where constants, sample path and state are, for kernels, now and if they move."""
        outputs, k = self._outputs
        self.engine.session = ref(self)
        outputs.addresses[k, :3] = self.addresses()

    def go_on(self) -> None:
        """Repeat a step that has run out of memory, in more of it.

        Raises SimulationError if the step was stopped by a component of one's own.
        """
        self.engine.drain()
        self._look()

    def begin_on(self, path: Words) -> bool:
        """Prepare the next episode on a path in memory for ``calls.begin_all``.

        Returns whether that has to put the drones at their starts.
        """
        episode = self.episode + 1
        again = partial(draw, self.world, self.seed, episode)
        afresh = self.engine.begin_on(path, again, episode)
        self.episode += 1
        self._over = False
        return afresh

    def addresses(self) -> tuple[int, int, int]:
        """Return the addresses of constants, sample path (0 before the first) and state."""
        return self.engine.addresses()

    def _look(self) -> None:
        """Write the outputs of the present epoch."""
        self.tell()
        calls.look_at_all(self._row.addresses, ONE)

    def _new_engine(self, settings: RunSettings) -> Engine:
        if self._started and self.engine.move_to(self.world, settings):
            return self.engine
        engine = BatchSimulation(self.world, settings)
        engine.session = ref(self)
        engine.refuse_unseen()
        return engine

    def _begin(self, path: SamplePath) -> None:
        self.engine.begin(path)
        self._look()

    def _resume(self) -> None:
        self._look()

    def _step(self, action: object) -> tuple[float, bool, bool]:
        indices, aims = as_commands(self.world.commands.arrays, action)
        if aims is not None:
            calls.aim_all(self._row.addresses, aims, ONE)
        stopped = calls.step_all(self._row.addresses, indices, ONE, scratch(), 0)
        if stopped < 0:
            raise ActionError(str(out_of_range(indices.tolist(), self.world.actions)))
        if stopped > 0:
            self.go_on()
        terminated, truncated, _ = self._row.over.tolist()
        return self._row.rewards.item(), terminated, truncated

    @property
    def snapshot(self) -> Snapshot:
        """The snapshot at the present epoch. Raises ResetNeeded before the first episode."""
        self.require_episode()
        return self.engine.snapshot()

    def observation(self) -> NDArray[Any]:
        """Return the encoded observations of all drones, one after the other."""
        observation: NDArray[Any] = self._row.observations.astype(self.dtype)
        return observation

    def observations(self) -> NDArray[Any]:
        """Return the encoded observation of each drone, in a new array (drones, features)."""
        return self.observation().reshape(self.drones, -1)

    def rewards(self) -> list[float]:
        """Return the reward of each drone in the last step."""
        rewards: list[float] = self._row.paid.tolist()
        return rewards

    def _whole_state(self) -> NDArray[np.float64]:
        states: NDArray[np.float64] = states_of(self._row.addresses, self)
        return states.reshape(-1)

    def mask(self) -> NDArray[np.int8]:
        """Return the masks of all drones, one after the other, in a new array."""
        return self._row.masks.copy()

    def info(self) -> dict[str, Any]:
        """Return the info (see ``Session.info``), from the numbers that a kernel has written."""
        row = self._row.numbers.tolist()
        measures, counts, others = row[:MEASURED], row[MEASURED:COUNTED], row[COUNTED:]
        which, counted = self.which(self.episode), as_counts(COUNTS, counts, self.world)
        values = (*measures, *which, *counted, *others)
        info: dict[str, Any] = dict(zip(self.keys, values, strict=True))
        info["action_mask"] = self.mask()
        return info

    def infos(self) -> list[dict[str, Any]]:
        """Return the info of each drone (see ``Session.infos``)."""
        row, infos = self._row.numbers.tolist(), []
        measures, which, requests = row[:MEASURED], self.which(self.episode), int(row[REQUESTS])
        for own in self._row.own.reshape(self.drones, -1).tolist():
            users, crashes, *times = as_counts(OWN_COUNTS, own[:OWN_COUNTED], self.world)
            counts = users, crashes, requests, *times
            values = (*measures, *which, *counts, *row[COUNTED:NUMBERS], *own[OWN_COUNTED:])
            infos.append(dict(zip(self.keys, values, strict=True)))
        return infos


def as_counts(names: Sequence[str], values: Iterable[Any], world: World) -> list[Any]:
    """Return the named counts, numbers or arrays of them, as whole numbers.

    If drones are asked by event, the elapsed steps are none.
    """
    exact = "elapsed_steps" if world.by_event else ""
    return [
        value + 0.0 if name == exact else _whole(value)
        for name, value in zip(names, values, strict=True)
    ]


def _whole(value: Any) -> Any:
    return value.astype(np.int64) if isinstance(value, np.ndarray) else int(value)


def states_of(addresses: NDArray[np.int64], session: Session) -> NDArray[np.float64]:
    """Return the whole states of environments like that of a session (n, numbers)."""
    states = np.empty((len(addresses), len(session.state_names)))
    calls.state_all(addresses, np.empty((len(session.world.homes), 2)), states, scratch())
    return states


def session_of(engine: str, tasks: Tasks) -> Session:
    """Return a session in an engine, by its name. Raises gymnasium's Error."""
    if engine not in CHOICES:
        raise error.Error(f"engine {engine!r}: must be 'auto', 'des' or 'batch'")
    if engine == "batch":
        return CompiledSession(tasks)
    session = Session(tasks)
    return session if engine == "des" else _automatic(session)


def _automatic(session: Session) -> Session:
    """Return the session of ``engine="auto"``, given a new one in the SimPy engine."""
    worlds = [session.world, *later(session)]
    allowed = {first_of(world, observed=True) for world in worlds}
    session.chooses = "des" not in allowed
    engine = on_disk(worlds, session.engine.settings) if session.chooses else None
    return session if engine is None else CompiledSession.instead_of(session, engine)


def later(session: Session) -> list[World]:
    """Return worlds of the stages of a curriculum that are not the present one."""
    tasks, seed = session.tasks, session.world.seed
    others = [stage for stage in range(len(tasks.stages)) if stage != session.stage]
    return [tasks.world(stage, seed) for stage in others]


def faster(session: Session) -> Session:
    """Return the session for the next episode, which goes on from where this one is.

    It is another one if this one ``chooses``, and the machine code of the compiled engine has come
    to disk (see ``engine.choose``).
    """
    if not session.chooses or isinstance(session, CompiledSession):
        return session
    engine = instead_of(session.engine, partial(later, session))
    return session if engine is None else CompiledSession.instead_of(session, engine)
