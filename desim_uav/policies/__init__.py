"""Policies: what tells a drone where to go."""

from desim_uav.policies import baseline, hover, random, script  # noqa: F401  (they register)
from desim_uav.policies.base import Policy, load_policy

__all__ = ["Policy", "load_policy"]
