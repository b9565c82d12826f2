"""What drones are commanded: actions, or in free flight the numbers of a displacement.

Everything that depends on which of the two it is stands here. Others ask ``World.commands``.
"""

from __future__ import annotations

from desim_uav.commands.aims import FreeCommands
from desim_uav.commands.base import Commands
from desim_uav.commands.cells import CellCommands
from desim_uav.commands.each import EachCommands
from desim_uav.drone_type import DroneType
from desim_uav.model.motion.motion import cruise_of
from desim_uav.model.rules import Action, actions, free_actions
from desim_uav.scenario.schema import Scenario

__all__ = ["CellCommands", "Commands", "EachCommands", "FreeCommands", "commands_for"]


def commands_for(scenario: Scenario, types: tuple[DroneType, ...]) -> Commands:
    """Return what the drones of a scenario can be commanded, given their types.

    A drone whose battery is unlimited takes none of the actions of charging, which are the last
    ones of a kind. If only some types fly freely, ``FLY`` comes after the actions of the others.
    """
    limited = scenario.limited_battery
    by_cells, shares = next((own for own in types if not own.free), None), types[0].shares
    if by_cells is None:
        return FreeCommands(scenario, types, free_actions(limited, shares))
    actions_ = actions(scenario.three_d, limited, cruise_of(by_cells.drones.motion), shares)
    if not scenario.free:
        return CellCommands(scenario, types, actions_)
    actions_ = (*actions_, Action.FLY)
    return EachCommands(
        CellCommands(scenario, types, actions_), FreeCommands(scenario, types, actions_)
    )
