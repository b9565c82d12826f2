"""The interface of rewards, which drones receive at the end of each step.

The rewards of the paper, R1 to R3, are in ``rules.rewards``.
"""

from __future__ import annotations

from typing import Any, ClassVar, Protocol

from desim_uav.errors import SimulationError
from desim_uav.model.state import Facts, Observation


class Reward(Protocol):
    """A reward, which is computed for each drone and the step that ends now."""

    def terms(
        self, drone: Observation, open_requests: tuple[int, ...], facts: Facts
    ) -> dict[str, float]:
        """Return the terms of the reward, by names that never change; the reward is their sum.

        ``open_requests`` counts all open requests by service, in the order of ``facts.services``.
        """


class RowReward:
    """A reward over rows, which can be compiled, so that both engines run it.

    A subclass is a frozen dataclass whose fields are numbers, or mappings from services to numbers.
    ``names`` are those of the terms; the reward is their sum.
    """

    names: ClassVar[tuple[str, ...]] = ()
    plain: ClassVar = ("terms",)
    """The methods of which a subclass overrides one if it works on Python objects, not on rows."""
    keeps_credit: ClassVar[bool] = False
    """Whether ``pay`` reads ``drone.credit``, what the drone has added in the step."""

    def term_names(self, services: tuple[str, ...]) -> tuple[str, ...]:
        """Return the names of the terms in their order, for a scenario with these services."""
        return self.names

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        """Write a drone's terms for the step that ends now into ``drone.terms``, which are all 0.

        ``world``, ``state`` and ``drone`` are rows (see ``rules.rows``: Constants, State, Drone).
        ``state.observations[drone.index]`` is what the drone knows, and ``state.asked`` counts
        the open requests by service. A mapping from services to numbers is a table here, in the
        order of the services. Compiled code can use rows and numbers only.
        """
        raise NotImplementedError

    def terms(
        self, drone: Observation, open_requests: tuple[int, ...], facts: Facts
    ) -> dict[str, float]:
        """Raise SimulationError: this reward is computed from rows, not from an observation."""
        raise SimulationError(
            f"reward {type(self).__name__!r} is computed from rows, and cannot be computed from an "
            "observation alone"
        )
