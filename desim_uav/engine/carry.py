"""What drones carry over from one episode of an engine to the next."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

from desim_uav.engine import base
from desim_uav.engine.constants import hop_transit
from desim_uav.engine.courses import carried_course, load_course
from desim_uav.engine.restorable import Restorable
from desim_uav.model.motion.planner import Node
from desim_uav.model.rules import IN_QUEUE, TIMED, Mode
from desim_uav.rowcode.rows import Queue
from desim_uav.rules.words import REST

MODES = tuple(Mode)


class CarryOver(Restorable):
    """The part of an engine that ends an episode and begins the next one.

    ``state`` and ``constants`` are rows (see ``rules.rows``).
    """

    state: Any
    constants: Any

    @abstractmethod
    def start_afresh(self) -> None:
        """Put all drones at their starting cells with full batteries, and empty the stations."""

    @abstractmethod
    def new_log(self, episode: int) -> None:
        """Begin the log of an episode, by its number."""

    @property
    def terminated(self) -> bool:
        """Whether a crash has ended the episode."""
        return self._under_way and bool(self.state.terminated)

    @property
    def truncated(self) -> bool:
        """Whether the episode has lasted for all its steps."""
        return self._under_way and bool(self.state.truncated)

    @property
    def _goes_on(self) -> bool:
        """Whether drones begin the next episode as they are now."""
        return self.truncated and not self.terminated and self.settings.carry_over

    def carried(self) -> base.Carried | None:
        """Return the states in which drones begin the next episode; None if they start afresh."""
        if not self._goes_on:
            return self._carried
        places = [0] * len(self.drones)
        for station in self.state.stations:
            for place, drone in enumerate(list(station.queue)):
                places[drone] = place
        return self.drones_of(int(self.state.now_us), self.drones, places)

    def carry(self, drones: base.Carried | None) -> None:
        """Let drones begin the next episode in these states, or afresh if they are None.

        The states may come from another engine of the same world and settings.
        """
        self.latest = None
        self._under_way = False
        self._carried = drones

    def take_up(self, episode: int) -> None:
        """Put drones in their states at the start of an episode, and begin its log."""
        if not self._goes_on:
            self.load(self._carried)
        self.set_under_way(episode)

    def set_under_way(self, episode: int) -> None:
        """Note that an episode begins, with drones that are where they begin it."""
        self._carried = None
        self._under_way = True
        self.new_log(episode)

    def drones_of(self, now_us: int, drones: Sequence[Any], places: Sequence[int]) -> base.Carried:
        """Return the states of drones at a time, given their rows and places in queues."""
        carried = []
        for drone, place in zip(drones, places, strict=True):
            hop = (drone.to_x - drone.x, drone.to_y - drone.y, drone.to_level - drone.level)
            goes_on = drone.mode in TIMED and drone.until_us > now_us
            moves = goes_on and not drone.off_grid and drone.transit != REST
            carried.append(
                base.CarriedDrone(
                    MODES[drone.mode],
                    (drone.x, drone.y, drone.level),
                    drone.charge,
                    now_us - drone.since_us,
                    hop if drone.hopping or moves else None,
                    tuple(self.hops(drone.route, drone.route_end)),
                    drone.counted_m,
                    place,
                    (drone.fallen_x_m, drone.fallen_y_m) if drone.fallen else None,
                    carried_course(drone.course) if drone.off_grid else None,
                    drone.until_us - now_us if goes_on else 0,
                    drone.taken if goes_on else 0,
                )
            )
        return tuple(carried)

    def load(self, carried: base.Carried | None) -> None:
        """Put drones in these states, or at their starting cells, before an episode."""
        self.start_afresh()
        landed: list[list[tuple[int, int]]] = [[] for _ in self.world.stations]
        for drone, one in zip(self.drones, carried or (), strict=False):
            drone.mode, drone.charge = int(one.mode), one.charge
            drone.since_us, drone.until_us, drone.taken = -one.age_us, one.rest_us, one.taken
            drone.x, drone.y, drone.level = one.node
            drone.to_x, drone.to_y, drone.to_level = one.node
            drone.route, drone.route_end = self.route(one.route) if one.route else (0, 0)
            drone.counted_m = one.counted_m
            if one.free is not None:
                load_course(self.world, drone, one.free)
                drone.hopping = int(one.hop is not None)
            elif one.hop is not None:
                self._load_hop(drone, one, one.hop)
            if one.fallen_m is not None:
                drone.fallen = 1
                drone.fallen_x_m, drone.fallen_y_m = one.fallen_m
            if one.mode in IN_QUEUE:
                station = self.world.stations.index(one.node[:2])
                landed[station].append((one.place, drone.index))
        for station, waiting in zip(self.state.stations, landed, strict=True):
            station.queue = Queue(drone for _, drone in sorted(waiting))

    def _load_hop(self, drone: Any, one: base.CarriedDrone, hop: Node) -> None:
        """Put a drone on its hop of a return or, if it follows a command, on its move."""
        to = [int(at) + by for at, by in zip(one.node, hop, strict=True)]
        drone.to_x, drone.to_y, drone.to_level = to
        if one.mode is Mode.RETURNING:
            drone.transit, drone.hopping = hop_transit(self.world, drone.type, hop), 1
        else:
            first = self.constants.types[drone.type].first_transit
            drone.transit = first + self.constants.moves[one.taken].transit
