"""Checks of components, policies and environments of one's own, for their tests.

Each function returns if everything holds, and otherwise raises an AssertionError that says what
does not hold, and where: in which table, row and column, or after which step. They are what the
tests of desim-uav use.
"""

from desim_uav.testing.components import check_component
from desim_uav.testing.engines import compare_engines
from desim_uav.testing.environments import check_environment
from desim_uav.testing.policies import check_policy

__all__ = ["check_component", "check_environment", "check_policy", "compare_engines"]
