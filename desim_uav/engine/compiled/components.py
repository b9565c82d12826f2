"""The components of a scenario that are compiled: functions that rows know by their addresses.

So nothing else has to be compiled anew if a component is another one.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from desim_uav.model.admission import RowAdmission
from desim_uav.model.battery import RowEnergy
from desim_uav.model.compiled_rows import address_of, pointer_to
from desim_uav.model.components import (
    NOT_COMPILED,
    cause_of,
    over_rows,
    own_kernel,
    ruled,
    values_of,
    works_on_rows,
)
from desim_uav.model.observations import RowObservation
from desim_uav.model.rewards import RowReward
from desim_uav.model.rows import View, Words, packed
from desim_uav.rules.rewards import add_up, clear_terms
from desim_uav.rules.rows import Constants, Drone, Path, State, TransitRow
from desim_uav.world import World


def _pay(method: Any, values_at: Any) -> Any:
    def pay(world: Any, state: Any) -> None:
        own = values_at(world.reward_values)
        for d in range(len(state.drones)):
            clear_terms(state.drones[d])
            method(own, world, state, state.drones[d])
            add_up(state, state.drones[d])

    return pay


def _scan(method: Any, values_at: Any) -> Any:
    def scan(world: Any, path: Any, state: Any, drone: Any, phase: int) -> None:
        method(values_at(world.admission_values), world, path, state, drone, phase)

    return scan


def _describe(method: Any, values_at: Any) -> Any:
    def describe(world: Any, state: Any) -> None:
        own = values_at(world.observation_values)
        for d in range(len(state.drones)):
            method(own, world, state, state.drones[d])

    return describe


def _drained_us(method: Any, values_at: Any) -> Any:
    def drained_us(world: Any, flight: Any, elapsed_us: int) -> int:
        return int(method(values_at(world.battery_values), flight, elapsed_us))

    return drained_us


def _lasts_us(method: Any, values_at: Any) -> Any:
    def lasts_us(world: Any, flight: Any, battery_us: int) -> int:
        return int(method(values_at(world.battery_values), flight, battery_us))

    return lasts_us


class Function(NamedTuple):
    """A function of a component that constants hold.

    ``method`` names the component's method, ``field`` the field of Constants. ``around`` makes the
    function that calls the method, and ``arguments`` are the types with which it is compiled.
    """

    method: str
    field: str
    around: Callable[[Any, Any], Any]
    arguments: tuple[Any, ...]


class Slot(NamedTuple):
    """A place for a component: its key, the base of what is compiled, and its functions.

    ``required``: the compiled engine cannot run without it.
    """

    key: str
    base: type
    chosen: Callable[[World], Any]
    values: str
    functions: tuple[Function, ...]
    required: bool = True


SLOTS = (
    Slot(
        "drones.admission",
        RowAdmission,
        lambda world: world.scenario.drones.admission,
        "admission_values",
        (Function("scan_rows", "scan", _scan, (Constants, Path, State, Drone, int)),),
    ),
    Slot(
        "drones.battery",
        RowEnergy,
        lambda world: world.scenario.drones.battery,
        "battery_values",
        (
            Function("drains", "drained_us", _drained_us, (Constants, TransitRow, int)),
            Function("lasts", "lasts_us", _lasts_us, (Constants, TransitRow, int)),
        ),
    ),
    Slot(
        "reward",
        RowReward,
        lambda world: world.scenario.reward,
        "reward_values",
        (Function("pay", "pay", _pay, (Constants, State)),),
    ),
    Slot(
        "observation",
        RowObservation,
        lambda world: world.scenario.observation,
        "observation_values",
        (Function("write", "describe", _describe, (Constants, State)),),
        required=False,
    ),
)


class Compiled(NamedTuple):
    """A compiled component: the addresses of its functions by field, and its values in memory.

    Addresses are valid in this process.
    """

    functions: dict[str, int]
    place: str
    values: Words


def compiled(slot: Slot, component: Any, services: tuple[str, ...]) -> Compiled:
    """Compile a component, which stays loaded. Raises Numba's errors."""
    values = values_of(over_rows(component, services))
    kinds: tuple[Any, Any] = type(component), type(values)
    functions = {one.field: _address(one, *kinds) for one in slot.functions}
    return Compiled(functions, slot.values, packed(values))


@cache
def _address(one: Function, cls: Any, values: Any) -> int:
    """Compile a function of a class of components, which has a file of its own on disk."""
    made = one.around(ruled(getattr(cls, one.method)), pointer_to(values))
    return address_of(own_kernel(made, cls), *one.arguments)


def why_not_compiled(slot: Slot, component: Any, services: tuple[str, ...]) -> str:
    """Return why a component is not compiled; nothing if it is."""
    if not works_on_rows(component, slot.base):
        return "it does not work on rows" if slot.required and component is not None else ""
    try:
        compiled(slot, component, services)
    except NOT_COMPILED as error:
        return cause_of(error, over_rows(component, services))
    return ""


def components_of(world: World) -> dict[str, Any]:
    """Return the components of a world that are over rows, by the keys of their slots."""
    chosen = {slot.key: slot.chosen(world) for slot in SLOTS}
    return {
        slot.key: chosen[slot.key] for slot in SLOTS if works_on_rows(chosen[slot.key], slot.base)
    }


def point_at(constants: View, component: Compiled) -> None:
    """Write where a component's functions and values are into the constants."""
    for field, address in component.functions.items():
        setattr(constants, field, address)
    setattr(constants, component.place, component.values.ctypes.data)
