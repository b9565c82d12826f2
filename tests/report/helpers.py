"""Small runs and trainings to draw."""

from pathlib import Path

from desim_uav.experiment.command import read_summary
from desim_uav.experiment.train.folder import train_to_folder
from desim_uav.report.run import Run
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from tests.run_to_folder import run_to_folder


def make_run(folder, scenario, policy, overrides=(), *, episodes=1, warmup=0, events=True):
    """A run folder."""
    done = run_to_folder(
        load(scenario_path(scenario), list(overrides)),
        policy,
        episodes=episodes,
        warmup=warmup,
        keep_events=events,
        out=folder,
        command=[],
    )
    return Path(done.summary["run_dir"])


def make_training(folder, scenario, overrides=()):
    """A training folder."""
    train_to_folder(
        load(scenario_path(scenario), list(overrides)),
        out=folder,
        resume=False,
        checkpoint_every=10**6,
    )
    return folder


def read_counted(folder):
    """The summary and the counted requests of a finished run."""
    summary, _ = read_summary(folder)
    return summary, Run(folder).counted("requests")
