"""Case 1 is a finite decision process of one drone: what is learned, against value iteration."""

import pytest

from desim_uav.scenario.learning import ALGORITHMS
from tests.verification.figure import check
from tests.verification.optimality import LEAST, THOROUGH, figures, share


def test_what_is_learned_is_the_best():
    check(figures(quick=True))


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("seed", range(10))
def test_the_best_way_in_case_1(seed: int, algorithm: str):
    found = share(seed, algorithm, *(THOROUGH if algorithm in ("sarsa", "double_q") else ()))
    assert LEAST[algorithm] - 1e-9 <= found <= 1 + 1e-9
