"""The interface of observations for learners; the built-in ones are in ``rules.observations``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple, Protocol

from desim_uav.errors import SimulationError
from desim_uav.model.state import Facts, Observation
from desim_uav.rowcode.kernels import rule


class Feature(NamedTuple):
    """One number of an encoded observation, with its name and its inclusive bounds.

    ``whole`` says that it is a whole number. If all features are, a learner can store the values of
    states in a table.
    """

    name: str
    low: float
    high: float
    whole: bool


class Encoding(Protocol):
    """An observation of learners, whose drones have a ceiling: what a drone knows, as numbers."""

    def features(self, facts: Facts) -> tuple[Feature, ...]:
        """Return the names and bounds of the numbers, in their order."""

    def encode(self, observation: Observation, facts: Facts) -> tuple[float, ...]:
        """Return the numbers of an observation, each within the bounds of its feature."""


class RowObservation:
    """An observation over rows, which can be compiled, so that both engines run it.

    A subclass is a frozen dataclass whose fields are numbers, or mappings from services to numbers.
    """

    plain: ClassVar = ("encode",)
    """The methods of which a subclass overrides one if it works on Python objects, not on rows."""
    information: ClassVar[str] = "undeclared"
    """What a drone has to know for it: ``local``, ``team``, ``radar``, or words of one's own."""
    maps_users: ClassVar[bool] = False
    """Whether ``write`` reads ``state.spots`` and ``state.firsts``, the users' places now."""

    def features(self, facts: Facts) -> tuple[Feature, ...]:
        """Return the names and bounds of the numbers, in their order."""
        raise NotImplementedError

    def write(self, world: Any, state: Any, drone: Any) -> None:
        """Write what a drone observes into ``drone.features``, one number per feature.

        ``world``, ``state`` and ``drone`` are rows (see ``rules.rows``: Constants, State, Drone).
        ``state.observations[drone.index]`` is what the drone knows. Compiled code can use
        rows and numbers only.
        """
        raise NotImplementedError

    def encode(self, observation: Observation, facts: Facts) -> tuple[float, ...]:
        """Return the numbers that the engine has written into the observation."""
        return observation.features

    def expected_features(self, drones: int, services: int) -> int:
        """Return a bound on the number of features of a drone, by which memory is foreseen."""
        return 100 + 2 * services


def information_of(observation: Any) -> str:
    """Return what a drone has to know for an observation; ``undeclared`` if it does not say."""
    return str(getattr(observation, "information", RowObservation.information))


def table_sizes(features: Sequence[Feature]) -> tuple[int, ...]:
    """Return the number of values of each feature, all whole and at least 0, for a table."""
    return tuple(int(feature.high) + 1 for feature in features)


def common_features(of_types: Sequence[tuple[Feature, ...]]) -> tuple[Feature, ...]:
    """Return features with bounds that hold for drones of all types, in the order of their numbers.

    There are as many as the type has that has the most; others have zeros behind their own.
    """
    longest = max(of_types, key=len)
    if all(own == longest for own in of_types):
        return longest
    none = Feature("", 0.0, 0.0, True)
    padded = [(*own, *[none] * (len(longest) - len(own))) for own in of_types]
    return tuple(
        Feature(
            feature.name,
            min(own[k].low for own in padded),
            max(own[k].high for own in padded),
            all(own[k].whole for own in padded),
        )
        for k, feature in enumerate(longest)
    )


def table_row(code: Sequence[float], sizes: Sequence[int], features: int | None = None) -> int:
    """Return the index of a state in a table, in which the last feature varies fastest.

    ``sizes`` are those of ``table_sizes``. A drone may have fewer ``features`` than there are
    sizes; the others are 0. Raises SimulationError for a state outside of ``sizes``, or with fewer
    numbers than features.
    """
    expected = len(sizes) if features is None else features
    row = row_or_none(code, sizes) if len(code) >= expected else -1
    if row < 0:
        raise SimulationError(
            f"observation: {tuple(code)} is outside the bounds of its features, which have "
            f"{tuple(sizes)} values from 0"
        )
    return row


@rule
def row_or_none(code: Sequence[float], sizes: Sequence[int]) -> int:
    """Return the row of a state in a table (see ``table_row``), or -1.

    Numbers that are missing at the end of ``code`` are 0.
    """
    row, length = 0, len(code)
    for k in range(len(sizes)):
        row *= sizes[k]
        if k < length:
            if not 0 <= code[k] < sizes[k]:
                return -1
            row += int(code[k])
    return row
