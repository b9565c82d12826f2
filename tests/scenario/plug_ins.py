"""Components of a user's own, for the tests."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Gt

from desim_uav.model.mobility.mobility import Static, Walks


@dataclass(frozen=True)
class Wind:
    """A dataclass with a parameter to validate and a field that is none."""

    speed_mps: Annotated[float, Gt(0)]
    heading_deg: float = 0.0
    note: str = field(default="", init=False)

    def walks(self, *args: Any) -> Walks:
        return Static().walks(*args)


class Plain:
    """No dataclass."""

    def __init__(self, speed: float = 1.0) -> None:
        if speed < 0:
            raise ValueError("speed must not be negative")
        self.speed = speed

    def walks(self, *args: Any) -> Walks:
        return Static().walks(*args)


@dataclass(frozen=True)
class Recorded:
    """A component with a file."""

    file: Path

    def walks(self, *args: Any) -> Walks:
        return Static().walks(*args)
