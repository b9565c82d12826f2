"""The paper's table of results: the last training episode of one scenario per case."""

from __future__ import annotations

POLICIES = ("baseline", "q_learning", "sarsa")

PUBLISHED: dict[int, dict[str, tuple[float, float, float]]] = {
    1: {"baseline": (20, 42, 15), "q_learning": (75, 0, 100), "sarsa": (100, 0, 98)},
    2: {"baseline": (27, 22, 33), "q_learning": (55, 0, 97), "sarsa": (100, 0, 100)},
    3: {"baseline": (27, 21, 34), "q_learning": (60, 30, 80), "sarsa": (98, 30, 55)},
    4: {"baseline": (23, 226, 30), "q_learning": (10, 0, 20), "sarsa": (98, 15, 60)},
    5: {"baseline": (27, 27, 25), "q_learning": (52, 8, 68), "sarsa": (95, 30, 42)},
    6: {"baseline": (28, 228, 25), "q_learning": (100, 0, 65), "sarsa": (45, 30, 10)},
    7: {"baseline": (64, 11215, 13), "q_learning": (100, 20, 65), "sarsa": (98, 100, 50)},
    8: {"baseline": (68, 10708, 13), "q_learning": (100, 50, 55), "sarsa": (98, 30, 30)},
    9: {"baseline": (52, 215184, 9), "q_learning": (97, 25, 45), "sarsa": (97, 35, 25)},
}
"""QoE1 in percent, QoE2 in steps and QoE3 in percent, by case and policy."""


def best_qoe3(case: int) -> float:
    """Return the best QoE3 that the paper printed for a case, in percent."""
    return max(qoe3 for _, _, qoe3 in PUBLISHED[case].values())
