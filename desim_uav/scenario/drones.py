"""What a scenario says of the drones, or of each type of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, cast

from pydantic import (
    Field,
    ValidationInfo,
    model_validator,
)

from desim_uav.model.admission import Admission
from desim_uav.model.backhaul import Backhaul
from desim_uav.model.energy.battery import Endurance, Energy
from desim_uav.model.motion.motion import BangCoastBang, Motion
from desim_uav.model.radio.radio import Disc, Radio
from desim_uav.rules.admission import FirstCome
from desim_uav.scenario.components import errors, strictly
from desim_uav.scenario.fields import Index, Metres, Name
from desim_uav.scenario.named import named_items
from desim_uav.scenario.processor import Processor
from desim_uav.scenario.section import Section
from desim_uav.scenario.slots import ADMISSION, BACKHAUL, BATTERY, MOTION, RADIO
from desim_uav.scenario.yaml12 import KeyPath

MOST_DRONES, MOST_TYPES = 10_000, 100
"""The largest number of drones, and of their types."""


class Drones(Section):
    """The drones: how many, what they cover and carry, how they fly."""

    later: ClassVar = ("processor", "backhaul", "store_mbit", "shielded")

    count: Annotated[int, Field(ge=1, le=MOST_DRONES)] = 3
    """The number of drones."""
    start_cells: tuple[tuple[Index, Index], ...] | None = None
    """The cell [x, y] in which each drone starts; null means on the charging stations in turn,
    or on a circle if there are none.
    """
    footprint_radius_m: Metres = 600.0
    """The radius of the disc on the ground that a drone covers, in metres."""
    bandwidth_kbps: Annotated[float, Field(ge=0.001, le=1e9)] | None = 5000.0
    """The bandwidth of each drone, in kbit/s; null means unlimited."""
    radio: Annotated[Radio, RADIO] = cast(Radio, Disc())
    """How drones reach users: the paper's disc, or links whose classes follow from path loss."""
    motion: Annotated[Motion, MOTION] = BangCoastBang()
    """How drones fly from one cell to the next."""
    battery: Annotated[Energy, BATTERY] | None = cast(Energy, Endurance())
    """The battery and its energy model; null means an unlimited battery."""
    admission: Annotated[Admission, ADMISSION] = FirstCome()
    """Which of the waiting requests a drone serves."""
    processor: Processor | None = None
    """What computes tasks on board; null means nothing does."""
    backhaul: Annotated[Backhaul, BACKHAUL] | None = None
    """What connects each drone to the ground; null means that it limits no rate."""
    store_mbit: Annotated[float, Field(ge=1e-6, le=1e6)] | None = None
    """How much data a drone can carry to the ground, in Mbit; null means any amount, up to
    4.6 million Mbit.
    """
    shielded: bool = False
    """Whether actions are masked after which a drone might not reach a station any more, so that no
    policy lets its battery run empty. It may then return above `return_below` if it has to.
    """

    @model_validator(mode="after")
    def _radio_decides(self) -> Drones:
        if self.radio.graded:
            replaced = {
                "footprint_radius_m": "its path loss says how far links reach",
                "bandwidth_kbps": "give radio.bandwidth_mhz",
            }
            problems: list[tuple[KeyPath, str, object]] = [
                ((key,), f"not beside radio: {{kind: link_classes}}; {instead}", getattr(self, key))
                for key, instead in replaced.items()
                if key in self.model_fields_set
            ]
            if problems:
                raise errors(problems)
        return self


class NamedDrones(Drones):
    """A type of drones, if there are several of them: its name, and the keys of `drones`."""

    name: Name
    """The name of the type, which no other type has."""


def flies_freely(drones: Drones) -> bool:
    """Return whether drones fly freely, and not from cell to cell."""
    motion = drones.motion
    return isinstance(motion, BangCoastBang) and motion.space == "free"


Types = Annotated[tuple[NamedDrones, ...], Field(min_length=1, max_length=MOST_TYPES)]


def as_fleet(value: object, info: ValidationInfo) -> Any:
    """Return the drones, or the types of them, that a mapping or a list of mappings says."""
    if isinstance(value, Drones | tuple):
        return value
    if isinstance(value, Mapping):
        return strictly(Drones, dict(value), info.context)
    if not isinstance(value, list):
        raise ValueError("must be a mapping, or a list of mappings, one for each type of drones")
    types: tuple[NamedDrones, ...] = strictly(Types, value, info.context)
    return named_items(types, "drones", MOST_DRONES)
