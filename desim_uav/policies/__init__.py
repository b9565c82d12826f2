"""Policies, which choose the drones' actions. Every file here that registers one is found."""

import sys

from desim_uav.policies.base import JointPolicy, Policy, load_policy
from desim_uav.registry import discover

discover(sys.modules[__name__])

__all__ = ["JointPolicy", "Policy", "load_policy"]
