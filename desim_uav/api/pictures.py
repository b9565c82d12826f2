"""Pages, figures and films of run folders, as the command line writes them."""

from __future__ import annotations

from desim_uav.experiment.plot import film, plot
from desim_uav.experiment.replay.page import write_replay
from desim_uav.experiment.report import report as write_report

__all__ = ["film", "plot", "write_replay", "write_report"]
