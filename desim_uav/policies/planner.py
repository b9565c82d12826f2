"""The planner ``greedy`` with numbers that are learned, from a file of ``policies/evolve.py``."""

from __future__ import annotations

from typing import Any

from desim_uav.policies.greedy import OPTIONS, Greedy
from desim_uav.policies.weights_file import weights_in
from desim_uav.registry import register
from desim_uav.shipped import find_table

ARRAY = "planner"
"""The name of the array in a file, by which it is known from other policy files."""

SCALES = {
    "waiting": 1.0,
    "fade": 5.0,
    "discount": 0.05,
    "share": 0.5,
    "charge": 1.0,
    "spread": 1.0,
    "margin": 0.2,
}
"""The options of ``greedy`` that are learned, and by how much a training varies them."""

WEIGHTS = {name: OPTIONS[name].default for name in SCALES}
"""What is learned, with the values from which a training begins: those of ``greedy``."""

SETTINGS = {"horizon": 20, "starts": 2}
"""The options of ``greedy`` that are set, and not learned."""


def options_of(weights: dict[str, float]) -> dict[str, Any]:
    """Return the options of ``greedy`` for some weights, which are cut to what is allowed."""
    allowed = {name: (OPTIONS[name].least, OPTIONS[name].most) for name in weights}
    cut = {name: min(max(one, allowed[name][0]), allowed[name][1]) for name, one in weights.items()}
    return SETTINGS | cut


@register("policy", "planner")
class Planner(Greedy):
    """Plans as ``greedy`` does, by numbers that are learned (see ``WEIGHTS``)."""

    file_of = staticmethod(find_table)

    def __init__(self, file: str = "", weights: dict[str, float] | None = None) -> None:
        """Take the weights, or the file that they are read from.

        Raises PolicyError if the file does not hold them.
        """
        if not file and weights is None:
            raise ValueError("a planner needs its file: planner:policy.npz")
        self.weights = weights_in(ARRAY, WEIGHTS, file) if weights is None else weights
        super().__init__(**options_of(self.weights))
        self.name = file or "planner"

    def use(self, weights: dict[str, float]) -> None:
        """Plan by other weights from the next episode on."""
        self.weights, self.options = weights, self.options | options_of(weights)
