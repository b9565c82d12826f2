"""Independent learners, with one algorithm per file. Every file that registers one is found."""

import sys

from desim_uav.registry import discover

discover(sys.modules[__name__])
