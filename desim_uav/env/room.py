"""The memory that many environments take, foreseen before they are made."""

from __future__ import annotations

from gymnasium import error

from desim_uav.available import available_bytes
from desim_uav.env.session import Session
from desim_uav.spaces import features

BYTES_A_FEATURE = 24
"""A feature is a float64 in the engine and in the outputs; a step returns it, in 4 or 8 bytes."""


def require_room(first: Session, count: int) -> None:
    """Raise gymnasium's Error if the observations of so many sessions like one need more memory.

    The error names the number of features, the memory that they would take, and what is available.
    """
    numbers = first.drones * len(features(first.world))
    needs, there = count * numbers * BYTES_A_FEATURE, available_bytes()
    if needs > there:
        raise error.Error(
            f"num_envs {count}: the observations of {numbers:,} numbers each would take about "
            f"{needs / 1e9:.3g} GB, but {there / 1e9:.3g} GB are available; use fewer "
            "environments or an observation of fewer features"
        )
