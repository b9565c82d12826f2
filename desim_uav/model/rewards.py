"""Rewards: what a drone is paid at the end of each step. R1 to R3 are in ``rules.rewards``."""

from __future__ import annotations

from typing import Any, ClassVar, Protocol

from desim_uav.errors import SimulationError
from desim_uav.model.state import Facts, Observation


class Reward(Protocol):
    """Computes the reward of a drone for the step that ends now."""

    def terms(
        self, drone: Observation, open_requests: tuple[int, ...], facts: Facts
    ) -> dict[str, float]:
        """Return the terms of the reward by name; the reward is their sum. Names never change.

        ``open_requests`` counts all open requests by service, in the order of ``facts.services``.
        """


class RowReward:
    """A reward over rows, which is compiled: both engines run it, and training at full speed.

    A subclass is a frozen dataclass whose fields are numbers, or mappings from services to numbers.
    ``names`` are the terms; the reward is their sum.
    """

    names: ClassVar[tuple[str, ...]] = ()
    plain: ClassVar = ("terms",)
    """A subclass that overrides one of these works on Python's objects instead of rows."""

    def term_names(self, services: tuple[str, ...]) -> tuple[str, ...]:
        """Return the names of the terms in their order, for a scenario with these services."""
        return self.names

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        """Write what a drone gets for the step that ends now: ``drone.terms``, which are 0.

        ``world``, ``state`` and ``drone`` are rows (see ``rules.rows``: Constants, State, Drone).
        ``state.seen[drone.index]`` is what the drone knows, and ``state.asked`` counts the open
        requests by service. A mapping from services to numbers is a table here, in the order of
        the services. Compiled code knows no objects besides rows and numbers.
        """
        raise NotImplementedError

    def terms(
        self, drone: Observation, open_requests: tuple[int, ...], facts: Facts
    ) -> dict[str, float]:
        """Refuse: this reward is computed from rows, not from an observation."""
        raise SimulationError(
            f"reward {type(self).__name__!r} is computed from rows, and cannot be computed from an "
            "observation alone"
        )
