"""The fixed-step simulator for drones that fly freely and are asked when they are free.

A leg may be as short as it likes. So a drone that has arrived hovers until its patience is over,
which counts from its command on.
"""

from __future__ import annotations

from collections.abc import Sequence

from tests.reference.by_event import ByEvent
from tests.reference.flight import Drone
from tests.reference.free import Freely, Space
from tests.reference.inputs import US, Inputs, Result


class FreelyByEvent(ByEvent, Freely):
    """One episode, tick by tick; ``commands[drone][which]`` are four or five numbers."""

    def _over_us(self, drone: Drone, since_us: int) -> int:
        patient_us = since_us + self.inputs.patience_us
        return patient_us if drone.hop is None else max(patient_us, drone.until_us)


def simulate(
    inputs: Inputs, space: Space, commands: Sequence[Sequence[Sequence[float]]], dt_s: float
) -> Result:
    """Run one episode in steps of ``dt_s``; ``commands[drone][which]`` are four numbers."""
    return FreelyByEvent(inputs, space, round(dt_s * US)).run(commands)
