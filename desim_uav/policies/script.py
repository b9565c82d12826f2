"""The policy that takes each drone's actions, step by step, from a CSV file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from desim_uav.commands.aims import NUMBERS
from desim_uav.commands.given import Command, CommandError
from desim_uav.errors import PolicyError, did_you_mean, notice
from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import Action, fastest_of
from desim_uav.model.state import Observation
from desim_uav.model.traces import index, number_of, read_table
from desim_uav.registry import register
from desim_uav.world import World

FlightNumbers = dict[str, float | None]
"""The numbers of a row, by their columns; None where the row has none."""


@register("policy", "script")
class Script:
    """Takes actions from a CSV file with the columns step (from 0), drone and action (a name).

    A drone hovers at steps that the file leaves out. If commands choose a cruise speed, an action
    is written ``right@8.3``; ``right`` is the move at the highest speed. If they choose a share of
    tasks, it is written ``right+0.5``. The action ``fly`` of free
    flight has its numbers in the columns aim_x, aim_y and so on; they are ignored beside any other
    action. Without aim_charge, the drone does not wish to charge.
    """

    ceiling = True
    file_of = Path

    def __init__(self, file: str = "") -> None:
        if not file:
            raise ValueError("a script needs its file: script:FILE.csv")
        self.file = Path(file)
        columns = {"step": index, "drone": index, "action": _action}
        rows = read_table(self.file, columns, dict.fromkeys(NUMBERS, _share))
        self.commands: dict[tuple[int, int], str] = {}
        self._numbers: dict[tuple[int, int], FlightNumbers] = {}
        self._lines: dict[tuple[int, int], int] = {}
        self._noticed = False
        for step, drone, action, *numbers, line in rows:
            at = step, drone
            if at in self.commands:
                raise ValueError(f"{file}:{line}: drone {drone} has two actions at step {step}")
            self.commands[at], self._lines[at] = action, line
            self._numbers[at] = dict(zip(NUMBERS, numbers, strict=True))

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Check the script. Raises PolicyError if it does not fit the scenario.

        The first time, print a notice if there are actions after the last step of an episode.
        """
        self._notice_late_actions(world)
        commands = world.commands
        self._hover = fastest_of(commands.actions)[Action.HOVER]
        self._commands: dict[tuple[int, int], Command] = {}
        drones = world.scenario.drone_count
        for at, action in self.commands.items():
            where, drone = f"{self.file}:{self._lines[at]}", at[1]
            if drone >= drones:
                raise PolicyError(f"{where}: drone: {drone}: must be from 0 to {drones - 1}")
            own = commands.of(drone)
            if action not in own.named:
                raise PolicyError(
                    f"{where}: action: {action!r} is not an action of {commands.whose(drone)}; "
                    f"allowed: {', '.join(own.named)}"
                )
            try:
                self._commands[at] = own.scripted(drone, own.named[action], self._numbers[at])
            except CommandError as problem:
                raise PolicyError(f"{where}: {problem}") from problem

    def _notice_late_actions(self, world: World) -> None:
        steps = world.scenario.episode.steps
        late = [self._lines[at] for at in self.commands if at[0] >= steps]
        if late and not world.by_event and not self._noticed:
            notice(
                f"warning: {self.file}:{min(late)}: {len(late)} of {len(self.commands)} actions "
                f"are never taken: an episode has the steps 0 to {steps - 1}"
            )
        self._noticed = True

    def act(self, observation: Observation, mask: Sequence[bool]) -> Command:
        """Return the command in the file, or "hover" if it has none for this step and drone."""
        return self._commands.get((observation.step, observation.drone), self._hover)


def _action(text: str) -> str:
    actions, name = [action.name.lower() for action in Action], text.lower()
    if re.split("[@+]", name)[0] not in actions:
        hint = did_you_mean(name, actions)
        raise ValueError(f"not an action{hint}; allowed: {', '.join(actions)}")
    return name


def _share(text: str) -> float:
    """Parse a number from -1 to 1."""
    number = number_of(text)
    if not -1.0 <= number <= 1.0:
        raise ValueError("must be from -1 to 1")
    return number
