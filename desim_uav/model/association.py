"""Association: which of the drones that cover a user serves it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Protocol

from annotated_types import Ge, Le

from desim_uav.registry import register


class Association(Protocol):
    """A way to choose drones, as the scenario's component ``association``.

    If it is ``by_level``, users are handed over to a drone whose level has exceeded that of their
    own by more than ``margin_db`` for ``trigger_us`` microseconds.
    """

    by_level: bool
    margin_db: float
    trigger_us: int


@register("association", "entered_first")
@dataclass(frozen=True)
class EnteredFirst:
    """A user stays with the drone whose footprint it entered first, as in the paper."""

    by_level: ClassVar[bool] = False
    margin_db: ClassVar[float] = 0.0
    trigger_us: ClassVar[int] = 0


@register("association", "strongest")
@dataclass(frozen=True)
class Strongest:
    """A user is always attached to the drone that it receives best (ties: the lowest index)."""

    by_level: ClassVar[bool] = True
    margin_db: ClassVar[float] = 0.0
    trigger_us: ClassVar[int] = 0


@register("association", "a3")
@dataclass(frozen=True)
class A3:
    """A user leaves its drone when another is better for a time (event A3 of 3GPP TS 36.331).

    Better is who exceeds the level of the user's drone by more than the offset and the hysteresis.
    Here the time ends when this no longer holds, whereas the standard subtracts the hysteresis
    then.
    """

    offset_db: Annotated[float, Ge(-30), Le(30)] = 0.0
    """The offset, in dB."""
    hysteresis_db: Annotated[float, Ge(0), Le(30)] = 3.0
    """The hysteresis, in dB."""
    time_to_trigger_ms: Annotated[int, Ge(0), Le(10_000)] = 160
    """How long the other drone must have been better, in milliseconds."""

    by_level: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check the margin. Raises ValueError."""
        if self.margin_db < 0.0:
            raise ValueError(
                f"offset_db + hysteresis_db is {self.margin_db:g} and must not be below 0: users "
                f"would leave the better drone"
            )
        if self.margin_db == 0.0 and self.time_to_trigger_ms == 0:
            raise ValueError(
                "without a margin and without a time to trigger, users always take the strongest "
                "drone; write association: strongest"
            )

    @property
    def margin_db(self) -> float:
        """The offset and the hysteresis together."""
        return self.offset_db + self.hysteresis_db

    @property
    def trigger_us(self) -> int:
        """The time to trigger in microseconds."""
        return 1000 * self.time_to_trigger_ms
