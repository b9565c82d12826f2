"""A dispatcher of drones that fly to any place of the map, by a few numbers that are learned.

The numbers come from a file of ``policies/evolve.py``, which holds arrays and text but no code.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from desim_uav.commands.given import Command
from desim_uav.errors import PolicyError
from desim_uav.model.motion.legs import leg_between
from desim_uav.model.motion.space import ANY_SPEED, flight_of
from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import DECIDES, US, Action
from desim_uav.model.state import Observation
from desim_uav.policies.weights_file import weights_in
from desim_uav.registry import register
from desim_uav.shipped import find_table
from desim_uav.world import World

if TYPE_CHECKING:
    from desim_uav.engine.episode import Engine

Floats = NDArray[np.float64]
ARRAY = "dispatch"
"""The name of the array in a file, by which it is known from other policy files."""

WEIGHTS = {
    "wait": 1.0,  # added to the worth 1 of a user whose request waits
    "age": 0.5,  # added for each ten minutes for which it has waited, at most three times
    "own": 1.0,  # added for a user whom the drone serves
    "other": 0.3,  # added for a user whom another drone serves
    "attached": 0.2,  # added for a user who is attached to the drone
    "margin": -0.1,  # how far beyond the footprint a user half counts, in its radii
    "width": 0.15,  # over how many radii the worth of a user falls from all to nothing
    "share": 1.0,  # how much of the worth of a user another drone's place takes
    "slow": 0.3,  # by how much a flight of a minute divides the worth of a place
    "cost": 0.2,  # what a minute of the flight costs
    "stay": 0.3,  # added to the worth of where the drone is
}
"""What is learned, with the values from which a training begins."""

SCALES = dict.fromkeys(WEIGHTS, 1.0)
"""The scale in which a training varies each weight."""

LATTICE_M, FINER_M = 100.0, 30.0
RESERVE = 0.005
"""The share of the battery that is left at a station at least."""

NEAR_M = 10.0
"""How far apart the lengths are for which flights are computed; longer ones count as the next."""


def problem_of(world: World) -> str:
    """Return why a dispatcher cannot command the drones of a world; "" if it can."""
    if not world.free or not world.by_event or len(world.types) > 1:
        return "all drones must be of one type, fly freely and decide by event"
    own = world.types[0]
    if not own.space.whole_map or not own.limited or world.dimensions != 2 or own.chooses_cruise:
        return "drones must reach the whole map, in two dimensions, with limited batteries"
    if not world.stations or any(world.scenario.wind_mps) or len(own.space.prisms.boxes_m):
        return "stations must exist, and there must be neither wind nor obstacles"
    return ""


@register("policy", "dispatcher")
class Dispatcher:
    """Sends each free drone to the place that is worth most, or to a station before it is empty.

    Candidates are the place of the drone, those of all users and a lattice, and a finer lattice
    around the best of them. A place is worth the sum over users of a weight (see ``WEIGHTS``) and
    of how surely the footprint covers them there, less what the flight costs. A drone flies to a
    place only if its battery suffices for the way from there to a station.
    """

    ceiling = True
    information = "all users and drones now: places, open requests, batteries; no future"
    file_of = staticmethod(find_table)

    def __init__(self, file: str = "", weights: dict[str, float] | None = None) -> None:
        """Take the weights, or the file that they are read from.

        Raises PolicyError if the file does not hold them.
        """
        if not file and weights is None:
            raise ValueError("a dispatcher needs its file: dispatcher:policy.npz")
        self.name = file or "dispatcher"
        self.weights = weights_in(ARRAY, WEIGHTS, file) if weights is None else weights
        self._world: World | None = None
        self._engine: Engine | None = None

    def use(self, weights: dict[str, float]) -> None:
        """Value places by other weights from now on."""
        self.weights = weights

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Prepare for a world. Raises PolicyError if its drones cannot be commanded."""
        if self._world is world:
            return
        problem = problem_of(world)
        if problem:
            raise PolicyError(f"{self.name}: {problem}")
        self._world, grid = world, world.grid
        self._size_m = np.array([grid.width_m, grid.depth_m])
        sides = [np.arange(0.0, size + 1.0, LATTICE_M) for size in self._size_m]
        self._lattice = np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 2)
        self._stations = np.array([grid.centre(*cell) for cell in world.stations])
        self._radius_m = world.links[0].reach_m
        self._measure_flights(world)

    def _measure_flights(self, world: World) -> None:
        """Compute the durations of flights by length, and what they take of a full battery."""
        own, z_m = world.types[0], world.grid.levels_m[0]
        self._patience_s, self._full = world.patience_us / US, own.full / own.drain_per_s
        self._lengths_m = np.arange(0.0, float(self._size_m.sum()) + 2.0 * NEAR_M, NEAR_M)
        lasts, takes = [], []
        for length_m in self._lengths_m.tolist():
            start, stop = (0.0, 0.0, z_m), (length_m, 0.0, z_m)
            leg = leg_between(own.space.commanded, own.space.wind, ANY_SPEED, start, stop)
            flown = flight_of(leg, own.space.wind)
            lasts_us = max(leg.duration_us, world.patience_us)  # after which it is asked again
            lasts.append(leg.duration_us / US)
            takes.append(own.taken_by(flown, lasts_us) / own.full)
        self._lasts_s, self._takes = np.array(lasts), np.maximum.accumulate(takes)

    def watch(self, engine: Engine) -> None:
        """Take the engine of the episode; its sample path is not looked at."""
        self._engine = engine

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Raise TypeError: all drones are commanded at once (see ``act_jointly``)."""
        raise TypeError("a dispatcher commands all drones at once; call act_jointly")

    def act_jointly(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> list[Command]:
        """Return the command of each drone in turn, or the action that is forced."""
        engine = self._engine
        if engine is None or self._world is None:
            raise RuntimeError("a dispatcher needs the engine; call begin and watch first")
        users_m = np.ascontiguousarray(engine.positions_m()[1][:, :2])
        courses = [drone.course for drone in engine.drones]
        stands_m = np.array([(float(one.x1_m), float(one.y1_m)) for one in courses])
        covers = self._covers(stands_m, users_m)
        covers[[one.mode not in DECIDES for one in observations]] = 0.0
        worths, commands = self._worths(engine), list[Command]()
        for d, (observation, mask) in enumerate(zip(observations, masks, strict=True)):
            if sum(mask) == 1:
                commands.append(list(mask).index(True))
                continue
            taken = np.prod(1.0 - self.weights["share"] * np.delete(covers, d, axis=0), axis=0)
            charge = (observation.battery_s or 0.0) / self._full
            to_m = self._place(stands_m[d], users_m, worths[d] * taken, charge)
            commands.append(self._command(stands_m[d], to_m, mask))
            covers[d] = self._covers(to_m[np.newaxis], users_m)[0]
        return commands

    def _worths(self, engine: Engine) -> Floats:
        """Return the worth of each user to each drone (drones, users), wherever they are."""
        weights, now_us = self.weights, int(engine.state.now_us)
        worths = np.ones((len(engine.drones), len(engine.state.users)))
        for u, user in enumerate(engine.state.users):
            request, holder = user.request, int(user.holder)
            if 0 <= holder < len(worths):
                worths[holder, u] += weights["attached"]
            if request.number < 0:
                continue
            server = int(request.server)
            if server < 0:
                waited_us = now_us - request.t_request_us - request.served_us
                worths[:, u] += weights["wait"] + weights["age"] * min(waited_us / 600 / US, 3.0)
                continue
            worths[:, u] += weights["other"]
            if server < len(worths):
                worths[server, u] += weights["own"] - weights["other"]
        return worths

    def _covers(self, places_m: Floats, users_m: Floats) -> Floats:
        """Return how surely footprints at places cover users (places, users), from 0 to 1."""
        away_m = np.sqrt(((places_m[:, np.newaxis] - users_m) ** 2).sum(-1))
        beyond = 1.0 + self.weights["margin"] - away_m / self._radius_m
        covers: Floats = np.clip(beyond / max(self.weights["width"], 0.02) + 0.5, 0.0, 1.0)
        return covers

    def _place(self, here_m: Floats, users_m: Floats, worths: Floats, charge: float) -> Floats:
        """Return the best place that leaves enough battery; a station if there is none."""
        near_m = users_m.min(0) - self._radius_m, users_m.max(0) + self._radius_m
        inside = ((self._lattice >= near_m[0]) & (self._lattice <= near_m[1])).all(-1)
        places_m = np.concatenate([here_m[np.newaxis], users_m, self._lattice[inside]])
        values = self._values(here_m, places_m, users_m, worths, charge)
        values[0] += self.weights["stay"]
        best = int(values.argmax())
        if values[best] == -np.inf:
            return self._nearest_station(here_m)
        if best == 0:
            return here_m
        steps = np.arange(-2, 3) * FINER_M
        finer = np.stack(np.meshgrid(steps, steps, indexing="ij"), -1).reshape(-1, 2)
        finer = np.clip(places_m[best] + finer, 0.0, self._size_m)
        nearer = self._values(here_m, finer, users_m, worths, charge)
        place_m: Floats = finer[int(nearer.argmax())]
        return place_m if nearer.max() > values[best] else places_m[best]

    def _values(
        self, here_m: Floats, places_m: Floats, users_m: Floats, worths: Floats, charge: float
    ) -> Floats:
        """Return the value of each place; -inf where the battery would not suffice."""
        away_m = np.sqrt(((places_m - here_m) ** 2).sum(-1))
        back_m = np.sqrt(((places_m[:, np.newaxis] - self._stations) ** 2).sum(-1)).min(-1)
        minutes = np.maximum(np.interp(away_m, self._lengths_m, self._lasts_s), self._patience_s)
        values = (self._covers(places_m, users_m) * worths).sum(-1)
        values /= 1.0 + max(self.weights["slow"], 0.0) * minutes / 60.0
        values -= self.weights["cost"] * minutes / 60.0
        takes = [self._takes[np.ceil(m / NEAR_M).astype(np.int64)] for m in (away_m, back_m)]
        values[charge <= takes[0] + takes[1] + RESERVE] = -np.inf
        return np.asarray(values)

    def _nearest_station(self, here_m: Floats) -> Floats:
        """Return the place of the station that is nearest."""
        away_m = ((self._stations - here_m) ** 2).sum(-1)
        station_m: Floats = self._stations[int(away_m.argmin())]
        return station_m

    def _command(self, here_m: Floats, to_m: Floats, mask: Sequence[bool]) -> Command:
        """Return the command that leads to a place, or charges at a station that is reached."""
        assert self._world is not None
        actions = self._world.actions
        if (to_m == self._nearest_station(here_m)).all() and abs(to_m - here_m).max() < 1.0:
            for action in (Action.CHARGE, Action.GOTO_CHARGING_STATION):
                if mask[actions.index(action)]:
                    return actions.index(action)
        if (to_m == here_m).all():
            return actions.index(Action.HOVER)
        numbers: list[float] = (2.0 * to_m / self._size_m - 1.0).tolist()
        return [*numbers, -1.0]
