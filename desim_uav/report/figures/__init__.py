"""Figures of runs, trainings, policies, sweeps and radios, each from a folder or file alone."""

from desim_uav.report.figures.age import age_figure
from desim_uav.report.figures.battery import battery_figure
from desim_uav.report.figures.case import case_picture
from desim_uav.report.figures.compare import compare_figure, intervals_figure
from desim_uav.report.figures.delay import delay_figure
from desim_uav.report.figures.energy import energy_figure
from desim_uav.report.figures.episodes import episodes_figure
from desim_uav.report.figures.policy import policy_figure
from desim_uav.report.figures.radio import radio_figure
from desim_uav.report.figures.radio_map import map_figure
from desim_uav.report.figures.services import services_figure
from desim_uav.report.figures.snapshot import snapshot_figure
from desim_uav.report.figures.style import to_bytes
from desim_uav.report.figures.sweep import sweep_figure
from desim_uav.report.figures.training import training_figure
from desim_uav.report.figures.visits import visits_figure

__all__ = [
    "age_figure",
    "battery_figure",
    "case_picture",
    "compare_figure",
    "delay_figure",
    "energy_figure",
    "episodes_figure",
    "intervals_figure",
    "map_figure",
    "policy_figure",
    "radio_figure",
    "services_figure",
    "snapshot_figure",
    "sweep_figure",
    "to_bytes",
    "training_figure",
    "visits_figure",
]
