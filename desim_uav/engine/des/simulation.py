"""The SimPy engine, which runs the rules as plain Python on SimPy's event queue."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from desim_uav.commands.given import Command
from desim_uav.engine.base import Carried, RunSettings
from desim_uav.engine.constants import constants_of, transits_of
from desim_uav.engine.des.clock import AuditedClock, Clock
from desim_uav.engine.des.plans import Plans
from desim_uav.engine.des.plug_ins import own_over_rows, set_components
from desim_uav.engine.des.processes import Processes
from desim_uav.engine.des.skies import Skies
from desim_uav.engine.episode import Engine
from desim_uav.engine.saved import Kept, Rows, SavedState, read, write
from desim_uav.engine.state import Buffers, state_of
from desim_uav.model.demand.requests import DRAWN, DUE_US, SERVICE
from desim_uav.model.geometry.coverage import all_walked
from desim_uav.model.state import Observation, Snapshot
from desim_uav.rowcode.rows import Table, blank, bound
from desim_uav.rowcode.views import Numbers
from desim_uav.rules.due import key, slots
from desim_uav.rules.episode import begin, end_step, hear, show_first, start_afresh
from desim_uav.rules.rows import Constants, Path, State
from desim_uav.rules.walks import look_anew
from desim_uav.rules.words import RESPAWN
from desim_uav.sample_path import SamplePath
from desim_uav.typed import typed
from desim_uav.world import World


class LiveState(State):
    """The state of an episode, with four fields that only the SimPy engine needs.

    ``clock`` is its event queue. ``named_terms`` holds the terms of each drone's reward by name if
    the reward does not work on rows, ``observed`` returns the drones' observations, and
    ``find_users`` writes the users' places (see ``rules.spots``).
    """

    __slots__ = ("clock", "find_users", "named_terms", "observed")
    clock: Clock
    find_users: Callable[[], None]
    named_terms: Sequence[dict[str, float]]
    observed: Callable[[], tuple[Observation, ...]]


class Simulation(Engine):
    """The SimPy engine (see ``Engine``).

    ``audit`` is called with the simulation after every event. The tests have one, which checks the
    invariants of an episode.

    SimPy's processes can be neither copied nor pickled, so a copy, as an engine that goes on from a
    saved state, has new ones, which wait for the same events.
    """

    name = "des"

    @typed
    def __init__(
        self,
        world: World,
        settings: RunSettings,
        audit: Callable[[Simulation], None] | None = None,
    ) -> None:
        super().__init__(world, settings)
        self.audit = audit
        self._before: Carried | None = None
        self.transits = transits_of(world)
        self._bounds, self._skies = own_over_rows(world), Skies(world)
        self.constants = self._constants()
        self.state = self._state()
        self.drones = self.state.drones
        self._asks: tuple[Any, ...] = (None, Table(), Table(), Table())
        self.clock = Clock(0)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return a function that makes a copy, and its arguments: a saved state if there is one."""
        made_of, at_epoch = (self.world, self.settings, self.audit), self.latest is not None
        return _copied, (made_of, self.save() if at_epoch else None, self._carried)

    def _constants(self) -> Constants:
        """Return the constants, with plans and functions."""
        world = self.world
        row: Any = constants_of(world, self.settings)
        row.plans = Plans(world.planners, world.grid)
        row.hops = row.plans.hops
        self._skies.set_functions(row, lambda: self.state)
        set_components(row, world)
        constants: Constants = row
        return constants

    def _state(self) -> LiveState:
        """Return a new state."""
        state = state_of(self.world, self.settings, Buffers(), LiveState)
        state.named_terms, state.observed = (), self.observations
        state.find_users = self._find_users
        state.sky = self._skies.first()
        return state

    # ---- episodes

    @typed
    def reset(self, path: SamplePath) -> Snapshot:
        """Begin an episode and return the snapshot of its first decision epoch."""
        self._before = self.carried()
        self.take_up(path.episode)
        self._follow(path)
        self._start_clock(0)
        world, state, own = self.constants, self.state, self.own_path
        state.named_terms = ()
        begin(world, own, state)
        self._start_processes()
        self.clock.run_to_end()
        show_first(world, own, state)
        self.check_components()
        self.drain_log()
        return self.snapshot()

    def _follow(self, path: SamplePath) -> None:
        """Make a sample path the one of the present episode."""
        self.drawn, self.own_path = path, self._path(path)
        self._skies.begin(self.state, path.walks)

    def _start_clock(self, now_us: int) -> None:
        """Make a new event queue, in which nothing is scheduled yet."""
        if self._bounds:
            bound(self.constants, self.own_path, self.state)
        if self.audit is None:
            self.clock = Clock(slots(self.state), now_us)
        else:
            self.clock = AuditedClock(slots(self.state), self._after_event, now_us)
        self.state.clock = self.clock
        self._processes = Processes(self.clock, self.constants, self.own_path, self.state)

    def _start_processes(self) -> None:
        """Start all processes."""
        self._processes.begin()

    # ---- saved states

    def _keep(self) -> tuple[Carried | None, Kept]:
        """Return the states in which drones began the episode, and the present rows."""
        rows = Rows(read(self.state, State), self.routes(), self.clock.scheduled())
        return self._before, rows

    def _take(self, saved: SavedState) -> None:
        """Write the rows of a saved state, and start processes that wait for its events."""
        self._before, rows = saved.before, saved.rows
        write(self.state, State, rows.state)
        self.set_routes(rows.routes)
        self.state.named_terms = [dict(terms) for terms in saved.named_terms]
        self._follow(saved.path)
        look_anew(self.constants, self.own_path, self.state)
        self._start_clock(self.state.now_us)
        for slot, t_us, place in rows.due:
            self.clock.due(slot, t_us, place)
        self._start_processes()
        self.clock.run_before(int(self.clock.now), key(RESPAWN, -1, -1))  # each until it waits
        self.snapshot()

    def _ready(self) -> bool:
        """Return whether the last step, or the reset, has not failed."""
        return self.latest is not None

    def named_terms(self) -> tuple[tuple[tuple[str, float], ...], ...]:
        """Return the terms of a reward that does not work on rows, by drone and name."""
        return tuple([tuple(terms.items()) for terms in self.state.named_terms])

    def step(self, commands: Sequence[Command]) -> Snapshot:
        """Give the commands and run to the next decision epoch, or to the end of the episode."""
        self.hear(commands)
        world, state = self.constants, self.state
        state.events.clear()
        state.closed.clear()
        state.handovers.clear()
        state.updates.clear()
        state.flown.clear()
        hear(world, self.own_path, state)
        self._processes.tell()
        self.clock.run_to_end()
        state.now_us = int(self.clock.now)
        end_step(world, self.own_path, state)
        self.check_components()
        self.drain_log()
        if state.terminated or state.truncated:
            self._after_event()
        return self.snapshot()

    def _after_event(self) -> None:
        """Call the audit, if there is one."""
        if self.audit is not None:
            self.state.now_us = int(self.clock.now)
            self.audit(self)

    def _find_users(self) -> None:
        """Write the places at which the users are now into the state (see ``rules.spots``)."""
        places = all_walked(*self.drawn.walks, int(self.state.now_us)).tolist()
        for spot, (x_m, y_m) in zip(self.state.spots, places, strict=True):
            spot.x_m, spot.y_m = x_m, y_m

    def _path(self, path: SamplePath) -> Path:
        """Return a sample path as a row."""
        row: Any = blank(Path)
        requests, walks = path.requests, path.walks
        if requests is not self._asks[0]:
            parts = (requests.rows[:, part] for part in (DUE_US, SERVICE, slice(DRAWN, None)))
            self._asks = requests, *(Table(part.reshape(-1).tolist()) for part in parts)
        _, row.due_us, row.services, row.drawn = self._asks
        row.asks_at = Table(requests.offsets.tolist())
        row.legs = walks.legs.view(Numbers)
        row.legs_at = np.ascontiguousarray(walks.offsets, np.int64).view(Numbers)
        row.link_key = np.ascontiguousarray(path.link_key).view(np.int64).view(Numbers)
        row.follows = Table(requests.follows.astype(int).tolist())
        row.respawns = Table(path.respawn.reshape(-1).tolist())
        row.respawns_drawn = path.respawn.shape[1]
        if path.position_error is not None:
            row.errors = Table(np.asarray(path.position_error).reshape(-1).tolist())
        own: Path = row
        return own

    # ---- access to the rows

    def entries(self, name: str) -> Sequence[Any]:
        """Return the numbers or rows in this table or queue of the state."""
        entries: Sequence[Any] = getattr(self.state, name)
        return entries

    def plan(self, number: int) -> Any:
        """Return the planned return with this number."""
        return self.constants.plans[number]

    def hops(self, first: int, end: int) -> list[tuple[int, int, int]]:
        """Return the hops with the numbers ``first`` to ``end`` - 1, as (dx, dy, dlevel)."""
        return [(hop.dx, hop.dy, hop.dlevel) for hop in self.constants.hops[first:end]]

    def route(self, hops: Sequence[tuple[int, int, int]]) -> tuple[int, int]:
        """Add hops; return the number of the first, and the number after that of the last."""
        numbers: tuple[int, int] = self.constants.plans.numbered(hops)
        return numbers

    def start_afresh(self) -> None:
        """Put all drones at their starting cells with full batteries, and empty the stations."""
        start_afresh(self.constants, self.state)

    def terms(self) -> tuple[dict[str, float], ...]:
        """Return the terms of the drones' rewards, by name."""
        return tuple(self.state.named_terms) or super().terms()

    def features(self) -> list[tuple[float, ...]]:
        """Return each drone's features, as far as an observation over rows has written them."""
        self.constants.describe(self.constants, self.state)
        return [tuple(drone.features) for drone in self.drones]


def _copied(
    made_of: tuple[Any, ...], saved: SavedState | None, carried: Carried | None
) -> Simulation:
    """Return an engine that goes on from a saved state or, without one, can only be reset."""
    engine = Simulation(*made_of)
    engine.carry(carried)
    if saved is not None:
        engine.restore(saved)
    return engine
