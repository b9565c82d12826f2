"""What a scenario says of a processor: that of a drone or of an access point."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from desim_uav.model.processing import RowProcessing
from desim_uav.rules.processing import FirstComeTasks
from desim_uav.scenario.section import Section
from desim_uav.scenario.slots import PROCESSING

MOST_GHZ = 1000.0
"""The largest clock of a core."""

MOST_W = 1e6
"""The largest power of a processor, whose energy in microjoules then fits in 64 bits."""


class UserProcessor(Section):
    """The processor of each user, which computes what the user does not offload."""

    ghz: Annotated[float, Field(ge=1e-6, le=MOST_GHZ)] = 1.0
    """Its clock, in GHz."""
    kappa: Annotated[float, Field(ge=0, le=1e-15)] = 1e-27
    """Its effective capacitance in J/Hz^2: a cycle takes kappa times the square of the clock."""
    transmit_w: Annotated[float, Field(ge=0, le=1000)] = 0.1
    """The power with which the user sends its input, in W."""

    @property
    def clock(self) -> int:
        """The thousandths of a cycle that it does in a microsecond."""
        return round(self.ghz * 1e6)

    @property
    def busy_w(self) -> float:
        """Its power while it computes, in W."""
        return self.kappa * (self.ghz * 1e9) ** 3


class Processor(Section):
    """A processor, which computes the tasks of services of kind `compute`."""

    cores: Annotated[int, Field(ge=1, le=10_000)] = 1
    """The number of cores; a task is computed by one core at a time."""
    ghz: Annotated[float, Field(ge=1e-6, le=MOST_GHZ)] = 1.0
    """The clock of each core, in GHz."""
    sharing: Annotated[RowProcessing, PROCESSING] = FirstComeTasks()
    """How tasks share the cores: first_come, processor_sharing, or earliest_deadline."""
    on_ground: bool = False
    """Whether it also computes while its drone returns, queues and charges."""
    kappa: Annotated[float, Field(ge=0, le=1e-15)] = 1e-28
    """Its effective capacitance in J/Hz^2: a busy core draws kappa times the cube of the clock."""
    electronics_w: Annotated[float, Field(ge=0, le=10_000)] = 0.0
    """What it draws besides, also if it is idle, in W."""

    @property
    def clock(self) -> int:
        """The thousandths of a cycle that a core does in a microsecond."""
        return round(self.ghz * 1e6)

    @property
    def core_w(self) -> float:
        """The power of a busy core, in W."""
        return self.kappa * (self.ghz * 1e9) ** 3

    @property
    def most_uw(self) -> int:
        """Its power while all cores are busy, in microwatts."""
        return round(self.electronics_w * 1e6) + self.cores * round(self.core_w * 1e6)
