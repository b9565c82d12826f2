"""A scenario as a task of BenchMARL, and trained networks as policy files (extra ``benchmarl``)."""

import importlib

from desim_uav.errors import MissingExtraError

try:
    importlib.import_module("benchmarl")
except ImportError as missing:
    raise MissingExtraError("UavTask", "benchmarl") from missing

from desim_uav.env.benchmarl.saving import SavePolicy, network_of, save
from desim_uav.env.benchmarl.task import UavTask

__all__ = ["SavePolicy", "UavTask", "network_of", "save"]
