"""SimPy's event queue under the model's own order: time, phase, drone, user; never insertion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import simpy

from desim_uav.model.rules import Phase

_PHASE, _DRONE = 1 << 48, 1 << 24


class Agenda(simpy.Environment):
    """A SimPy environment whose clock counts whole microseconds.

    SimPy orders events of one instant by priority: ours is the key (phase, drone, user), which is
    above SimPy's own priorities, so a resource hands on its place before the next event of ours.
    """

    def at(self, t_us: int, phase: Phase, drone: int = -1, user: int = -1) -> Due:
        """An event for a process to wait for."""
        return Due(self, t_us, phase * _PHASE + (drone + 1) * _DRONE + user + 1, [], None)

    def call(
        self,
        callback: Callable[[Due], None],
        args: Any,
        t_us: int,
        phase: Phase,
        drone: int = -1,
        user: int = -1,
    ) -> None:
        """Call ``callback`` at an instant with an event that carries ``args``."""
        Due(self, t_us, phase * _PHASE + (drone + 1) * _DRONE + user + 1, [callback], args)


class Due(simpy.Event):
    """An event that is bound to happen at its time."""

    _ok = True
    _value = None

    def __init__(
        self,
        agenda: Agenda,
        t_us: int,
        key: int,
        callbacks: list[Callable[[Any], None]],
        args: Any,
    ) -> None:
        self.env = agenda
        self.callbacks = callbacks
        self.args = args
        agenda.schedule(self, key, t_us - agenda._now)


class Signal(simpy.Event):
    """An event a process waits for until somebody gives it a value."""

    def give(self, value: Any, phase: Phase, drone: int) -> None:
        """Wake the process in this instant, in its place in the order."""
        self._ok = True
        self._value = value
        self.env.schedule(self, phase * _PHASE + (drone + 1) * _DRONE)
