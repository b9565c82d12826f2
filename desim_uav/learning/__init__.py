"""Learning: independent learners, an algorithm a file. Each file that registers one is found."""

import sys

from desim_uav.registry import discover

discover(sys.modules[__name__])
