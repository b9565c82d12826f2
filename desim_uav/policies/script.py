"""The policy that takes each drone's actions, step by step, from a CSV file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from desim_uav.errors import PolicyError
from desim_uav.model.rules import Action
from desim_uav.model.state import Observation
from desim_uav.model.streams import Streams
from desim_uav.model.traces import index, read_table
from desim_uav.registry import did_you_mean, register
from desim_uav.world import World


@register("policy", "script")
class Script:
    """Takes actions from a CSV file with the columns step (from 0), drone and action (a name).

    A drone hovers at steps that the file leaves out.
    """

    ceiling = True
    file_of = Path

    def __init__(self, file: str = "") -> None:
        if not file:
            raise ValueError("a script needs its file: script:FILE.csv")
        self.file = Path(file)
        columns = {"step": index, "drone": index, "action": _action}
        rows = read_table(self.file, columns)
        self.commands: dict[tuple[int, int], Action] = {}
        for step, drone, action, line in rows:
            if (step, drone) in self.commands:
                raise ValueError(f"{file}:{line}: drone {drone} has two actions at step {step}")
            self.commands[step, drone] = action
        self._lines = {(step, drone): line for step, drone, _, line in rows}

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Check the script. Raises PolicyError if it does not fit the scenario."""
        world.scenario.require_cells("a script of actions")
        self._index = {action: k for k, action in enumerate(world.actions)}
        drones = world.scenario.drone_count
        for (step, drone), action in self.commands.items():
            where = f"{self.file}:{self._lines[step, drone]}"
            if drone >= drones:
                raise PolicyError(f"{where}: drone: {drone}: must be from 0 to {drones - 1}")
            if action not in self._index:
                allowed = ", ".join(a.name.lower() for a in world.actions)
                raise PolicyError(
                    f"{where}: action: {action.name.lower()!r} does not exist in this scenario; "
                    f"allowed: {allowed}"
                )

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Return the action in the file, or "hover" if it has none for this step and drone."""
        action = self.commands.get((observation.step, observation.drone), Action.HOVER)
        return self._index[action]


def _action(text: str) -> Action:
    known = [action.name.lower() for action in Action]
    if text.lower() not in known:
        hint = did_you_mean(text.lower(), known)
        raise ValueError(f"not an action{hint}; allowed: {', '.join(known)}")
    return Action[text.upper()]
