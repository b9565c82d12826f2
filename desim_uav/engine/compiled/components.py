"""The compiled components of a scenario, whose functions are called by their addresses.

Therefore no other code has to be compiled again if a component is replaced by another one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from desim_uav.drone_type import DroneType
from desim_uav.links import Links
from desim_uav.model.admission import RowAdmission
from desim_uav.model.energy.battery import RowEnergy
from desim_uav.model.energy.charging import RowCharging
from desim_uav.model.mobility.walking import WALK, RowMobility
from desim_uav.model.observations import RowObservation
from desim_uav.model.offloading import RowOffloading
from desim_uav.model.processing import RowProcessing
from desim_uav.model.radio.chances import P_LOS
from desim_uav.model.radio.levels import BOUNDS, LEVEL
from desim_uav.model.radio.path_loss import RowPathLoss
from desim_uav.model.rewards import RowReward
from desim_uav.model.sharing import RowSharing
from desim_uav.rowcode.bounds import owner_of
from desim_uav.rowcode.components import (
    NOT_COMPILED,
    Compiled,
    Function,
    ValuesAt,
    cause_of,
    compiled,
    over_rows,
    ruled,
    works_on_rows,
)
from desim_uav.rowcode.views import View
from desim_uav.rules.rewards import add_up, clear_terms
from desim_uav.rules.rows import Constants, Drone, Path, State, TransitRow, TypeRow, User
from desim_uav.scenario.processor import Processor
from desim_uav.world import World


def _pay(cls: type[RowReward], values_at: ValuesAt) -> Any:
    """Return the function ``pay`` of a class of rewards (see ``Function.around``)."""
    method = ruled(cls.pay)

    def pay(world: Constants, state: State) -> None:
        own = values_at(world.reward_values)
        for d in range(len(state.drones)):
            clear_terms(state.drones[d])
            method(own, world, state, state.drones[d])
            add_up(state, state.drones[d])

    return pay


def _scan(cls: type[RowAdmission], values_at: ValuesAt) -> Any:
    """Return the function ``scan`` of a class of admission rules."""
    method = ruled(cls.scan_rows)

    def scan(world: Constants, path: Path, state: State, drone: Drone, phase: int) -> None:
        own = values_at(world.types[drone.type].admission_values)
        method(own, world, path, state, drone, phase)

    return scan


def _describe(cls: type[RowObservation], values_at: ValuesAt) -> Any:
    """Return the function ``describe`` of a class of observations."""
    method = ruled(cls.write)

    def describe(world: Constants, state: State) -> None:
        own = values_at(world.observation_values)
        for d in range(len(state.drones)):
            method(own, world, state, state.drones[d])

    return describe


def _drain_of(cls: type[RowEnergy], values_at: ValuesAt) -> Any:
    """Return the function ``drain_of`` of a class of energy models."""
    method = ruled(cls.drains)

    def drain_of(own: TypeRow, flight: TransitRow, elapsed_us: int) -> int:
        return int(method(values_at(own.battery_values), flight, elapsed_us))

    return drain_of


def _lasts_us(cls: type[RowEnergy], values_at: ValuesAt) -> Any:
    """Return the function ``lasts_us`` of a class of energy models."""
    method = ruled(cls.lasts)

    def lasts_us(own: TypeRow, flight: TransitRow, charge: int) -> int:
        return int(method(values_at(own.battery_values), flight, charge))

    return lasts_us


def _charged(cls: type[RowCharging], values_at: ValuesAt) -> Any:
    """Return the function ``charged`` of a class of charging."""
    method = ruled(cls.charged)

    def charged(world: Constants, battery: int, elapsed_us: int, capacity: int) -> int:
        return int(method(values_at(world.charging_values), battery, elapsed_us, capacity))

    return charged


def _until_full_us(cls: type[RowCharging], values_at: ValuesAt) -> Any:
    """Return the function ``until_full_us`` of a class of charging."""
    method = ruled(cls.until_full_us)

    def until_full_us(world: Constants, battery: int, capacity: int) -> int:
        return int(method(values_at(world.charging_values), battery, capacity))

    return until_full_us


def _divide(cls: type[RowSharing], values_at: ValuesAt) -> Any:
    """Return the function ``divide`` of a class of sharing."""
    method = ruled(cls.divide)

    def divide(world: Constants, state: State, drone: Drone, phase: int) -> None:
        own = values_at(world.radios[drone.radio].sharing_values)
        method(own, world, state, drone, phase)

    return divide


def _process(cls: type[RowProcessing], values_at: ValuesAt) -> Any:
    """Return the function ``process`` of a class of processing."""
    method = ruled(cls.process)

    def process(world: Constants, state: State, drone: Drone, phase: int) -> None:
        own = values_at(world.processors[drone.radio].processing_values)
        method(own, world, state, drone, phase)

    return process


def _share(cls: type[RowOffloading], values_at: ValuesAt) -> Any:
    """Return the function ``share`` of a class of offloading."""
    method = ruled(cls.share)

    def share(world: Constants, state: State, user: User) -> float:
        return float(method(values_at(world.offloading_values), world, state, user))

    return share


class FunctionSlot(NamedTuple):
    """A kind of component: its key in a scenario, the base of its classes, and its functions.

    ``chosen`` returns the component of a world, of a type of drones, of the links of a radio, or of
    a processor.
    The addresses of its functions are stored in the fields of the row that have their names, and
    the address of its values in the field ``values``. If ``required``, the compiled engine cannot
    run a component that is not compiled.
    """

    key: str
    base: type
    chosen: Callable[[Any], Any]
    values: str
    functions: tuple[Function, ...]
    required: bool = True


SLOTS = (
    FunctionSlot(
        "stations.charging",
        RowCharging,
        lambda world: world.charging,
        "charging_values",
        (
            Function("charged", _charged, (Constants, int, int, int)),
            Function("until_full_us", _until_full_us, (Constants, int, int)),
        ),
    ),
    FunctionSlot(
        "reward",
        RowReward,
        lambda world: world.scenario.reward,
        "reward_values",
        (Function("pay", _pay, (Constants, State)),),
    ),
    FunctionSlot(
        "observation",
        RowObservation,
        lambda world: world.scenario.observation,
        "observation_values",
        (Function("describe", _describe, (Constants, State)),),
        required=False,
    ),
    FunctionSlot(
        "offloading",
        RowOffloading,
        lambda world: world.scenario.offloading if world.services.computes else None,
        "offloading_values",
        (Function("share", _share, (Constants, State, User)),),
    ),
    FunctionSlot(
        "users.mobility",
        RowMobility,
        lambda world: world.row_mobility,
        "mobility_values",
        (WALK,),
        required=False,
    ),
)

"""The components of a world, whose functions are in the row of the constants."""

TYPE_SLOTS = (
    FunctionSlot(
        "admission",
        RowAdmission,
        lambda own: own.drones.admission,
        "admission_values",
        (Function("scan", _scan, (Constants, Path, State, Drone, int)),),
    ),
    FunctionSlot(
        "battery",
        RowEnergy,
        lambda own: own.drones.battery,
        "battery_values",
        (
            Function("drain_of", _drain_of, (TypeRow, TransitRow, int)),
            Function("lasts_us", _lasts_us, (TypeRow, TransitRow, int)),
        ),
    ),
)
"""The components of a type of drones; the key of each follows that of the drones."""

RADIO_SLOTS = (
    FunctionSlot(
        "sharing",
        RowSharing,
        lambda links: links.radio.sharing if links.radio.sharing.divides else None,
        "sharing_values",
        (Function("divide", _divide, (Constants, State, Drone, int)),),
    ),
)
"""The components of a radio; the key of each follows that of the radio."""

PROCESSOR_SLOTS = (
    FunctionSlot(
        "processor.sharing",
        RowProcessing,
        lambda processor: processor and processor.sharing,
        "processing_values",
        (Function("process", _process, (Constants, State, Drone, int)),),
    ),
)
"""The components of a processor; the key of each follows that of its drones or access point."""

LOSS_SLOTS = (
    FunctionSlot(
        "path_loss",
        RowPathLoss,
        lambda links: links.radio.loss if links.in_air else None,
        "loss_values",
        (LEVEL, BOUNDS, P_LOS),
    ),
)
"""Those of a radio whose functions are in the scene, and not in the row of the radio."""


def why_not_compiled(slot: FunctionSlot, component: Any, services: tuple[str, ...]) -> str:
    """Return why a component is not compiled, or an empty text if it is, or need not be.

    Built-in components that work on rows are compiled when an engine needs them.
    """
    if not works_on_rows(component, slot.base):
        return "it does not work on rows" if slot.required and component is not None else ""
    if not owner_of(type(component)):
        return ""
    try:
        compiled(slot.functions, component, services)
    except NOT_COMPILED as error:
        return cause_of(error, over_rows(component, services))
    return ""


def components_of(
    slots: tuple[FunctionSlot, ...], chooser: World | DroneType | Links | Processor | None
) -> dict[str, Any]:
    """Return the components over rows of a world, a type or links, by their slots' keys."""
    component_of = {slot.key: slot.chosen(chooser) for slot in slots}
    return {
        slot.key: component_of[slot.key]
        for slot in slots
        if works_on_rows(component_of[slot.key], slot.base)
    }


def point_at(row: View, slot: FunctionSlot, component: Compiled) -> None:
    """Write the addresses of a component's functions and values into a row."""
    for name, address in component.functions.items():
        setattr(row, name, address)
    setattr(row, slot.values, component.values.ctypes.data)
