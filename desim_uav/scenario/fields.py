"""Types of the numbers, ranges and names in a scenario, with their bounds."""

from __future__ import annotations

from typing import Annotated

from pydantic import (
    AfterValidator,
    Field,
    StringConstraints,
)

from desim_uav.scenario.section import Fraction


def ascending(values: tuple[float, float]) -> tuple[float, float]:
    """Return a range, whose ends may be equal. Raises ValueError if its lower end is above."""
    low, high = values
    if low > high:
        raise ValueError(f"must be [low, high] with low <= high; {low:g} is above {high:g}")
    return values


def rising(values: tuple[float, float]) -> tuple[float, float]:
    """Return a range. Raises ValueError if its lower end is not below its upper end."""
    low, high = values
    if low >= high:
        raise ValueError(f"must be [low, high] with low < high; {low:g} is not below {high:g}")
    return values


Metres = Annotated[float, Field(ge=0.001, le=1e6)]
Length = Annotated[float, Field(ge=0, le=1e6)]
Height = Annotated[float, Field(ge=0.001, le=1e4)]
Point = tuple[Length, Length]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
Index = Annotated[int, Field(ge=0, lt=1000)]
CellCount = Annotated[int, Field(ge=1, le=1000)]
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}$")]

Side = Annotated[float, Field(ge=1, le=1e6)]
Speed = Annotated[float, Field(ge=-1000, le=1000)]
Velocity = tuple[Speed, Speed]

FractionRange = Annotated[tuple[Fraction, Fraction], AfterValidator(ascending)]
HeightRange = Annotated[tuple[Height, Height], AfterValidator(ascending)]
RadiusRange = Annotated[tuple[Metres, Metres], AfterValidator(ascending)]


Altitude = Annotated[float, Field(ge=0, le=1e4)]
