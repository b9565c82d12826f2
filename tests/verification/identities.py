"""Cases 1-5: QoE1 = QoE3 and QoE2 = 30 (1 - QoE1).

Everybody asks at the start for the whole episode, without bandwidth, so that to be attached is to
be served; the rest follows from the definitions.
"""

from __future__ import annotations

from collections.abc import Iterator

from desim_uav.experiment.run import Results, run
from desim_uav.policies import load_policy
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.verification.figure import Exact, Figure

CASES = ("case1", "case2", "case3", "case4", "case5")
POLICIES = ("baseline", "random", "hover")


def figures(quick: bool = False) -> Iterator[Figure]:
    """The worst episode."""
    found = [
        episode
        for case in CASES
        for policy in POLICIES[: 1 if quick else 3]
        for seed in range(1 if quick else 10)
        for episode in played(case, policy, seed).episodes.itertuples()
    ]
    one = max(abs(e.qoe1_percent - e.qoe3_percent) for e in found)
    two = max(abs(e.qoe2_iterations - 30 * (1 - e.qoe1_percent / 100)) for e in found)
    active = max(abs(e.qoe3_active_percent - e.qoe3_percent) for e in found)
    yield Exact("largest |QoE1 - QoE3|, percent", one, 0.0, 1e-9, cases=len(found))
    yield Exact("largest |QoE2 - 30 (1 - QoE1)|, steps", two, 0.0, 1e-9, cases=len(found))
    yield Exact("largest |active QoE3 - QoE3|, percent", active, 0.0, 1e-9, cases=len(found))


def played(case: str, policy: str, seed: int) -> Results:
    """Three episodes, a warm-up among them."""
    world = build_world(load(scenario_path(case)), seed)
    return run(world, load_policy(policy), policy, seed, episodes=2, warmup=1)
