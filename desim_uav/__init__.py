"""desim-uav: exact discrete-event simulation of UAV-enabled wireless networks."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from desim_uav.api.bench import (
        Leaderboard,
        Submitted,
        bench_board,
        bench_list,
        bench_run,
        bench_verify,
    )
    from desim_uav.api.compare import Comparison, compare, compare_runs
    from desim_uav.api.fork import Counterfactual, counterfactual
    from desim_uav.api.pictures import film, plot, write_replay, write_report
    from desim_uav.api.replay import Replay
    from desim_uav.api.run import RunResult, read_run, run
    from desim_uav.api.study import find_bounds, find_optimum, reproduce, sweep
    from desim_uav.api.tensorboard import TensorBoardCallback
    from desim_uav.api.train import StopTraining, TrainingProgress, TrainingResult, train
    from desim_uav.api.worlds import build_world
    from desim_uav.engine.base import RunSettings
    from desim_uav.engine.des import Simulation
    from desim_uav.env import (
        Curriculum,
        SkipForced,
        SkipForcedParallel,
        UavEnv,
        UavMoEnv,
        UavParallelEnv,
        UavParallelVectorEnv,
        UavVecEnv,
        UavVectorEnv,
    )
    from desim_uav.errors import DesimError, DesimWarning, Interrupted
    from desim_uav.policies import Policy, load_policy
    from desim_uav.registry import register
    from desim_uav.sample_path import draw
    from desim_uav.scenario.load import load
    from desim_uav.scenario.schema import Scenario
    from desim_uav.world import World

_PUBLIC = {
    "Comparison": "desim_uav.api.compare",
    "Counterfactual": "desim_uav.api.fork",
    "Curriculum": "desim_uav.env",
    "DesimError": "desim_uav.errors",
    "DesimWarning": "desim_uav.errors",
    "Interrupted": "desim_uav.errors",
    "Leaderboard": "desim_uav.api.bench",
    "Policy": "desim_uav.policies",
    "Replay": "desim_uav.api.replay",
    "RunResult": "desim_uav.api.run",
    "RunSettings": "desim_uav.engine.base",
    "Scenario": "desim_uav.scenario.schema",
    "Simulation": "desim_uav.engine.des",
    "SkipForced": "desim_uav.env",
    "SkipForcedParallel": "desim_uav.env",
    "StopTraining": "desim_uav.api.train",
    "Submitted": "desim_uav.api.bench",
    "TensorBoardCallback": "desim_uav.api.tensorboard",
    "TrainingProgress": "desim_uav.api.train",
    "TrainingResult": "desim_uav.api.train",
    "UavEnv": "desim_uav.env",
    "UavMoEnv": "desim_uav.env",
    "UavParallelEnv": "desim_uav.env",
    "UavParallelVectorEnv": "desim_uav.env",
    "UavVecEnv": "desim_uav.env",
    "UavVectorEnv": "desim_uav.env",
    "World": "desim_uav.world",
    "bench_board": "desim_uav.api.bench",
    "bench_list": "desim_uav.api.bench",
    "bench_run": "desim_uav.api.bench",
    "bench_verify": "desim_uav.api.bench",
    "build_world": "desim_uav.api.worlds",
    "compare": "desim_uav.api.compare",
    "compare_runs": "desim_uav.api.compare",
    "counterfactual": "desim_uav.api.fork",
    "draw": "desim_uav.sample_path",
    "film": "desim_uav.api.pictures",
    "find_bounds": "desim_uav.api.study",
    "find_optimum": "desim_uav.api.study",
    "load": "desim_uav.scenario.load",
    "load_policy": "desim_uav.policies",
    "plot": "desim_uav.api.pictures",
    "read_run": "desim_uav.api.run",
    "register": "desim_uav.registry",
    "reproduce": "desim_uav.api.study",
    "run": "desim_uav.api.run",
    "sweep": "desim_uav.api.study",
    "train": "desim_uav.api.train",
    "write_replay": "desim_uav.api.pictures",
    "write_report": "desim_uav.api.pictures",
}

__all__ = [
    "Comparison",
    "Counterfactual",
    "Curriculum",
    "DesimError",
    "DesimWarning",
    "Interrupted",
    "Leaderboard",
    "Policy",
    "Replay",
    "RunResult",
    "RunSettings",
    "Scenario",
    "Simulation",
    "SkipForced",
    "SkipForcedParallel",
    "StopTraining",
    "Submitted",
    "TensorBoardCallback",
    "TrainingProgress",
    "TrainingResult",
    "UavEnv",
    "UavMoEnv",
    "UavParallelEnv",
    "UavParallelVectorEnv",
    "UavVecEnv",
    "UavVectorEnv",
    "World",
    "__version__",
    "bench_board",
    "bench_list",
    "bench_run",
    "bench_verify",
    "build_world",
    "compare",
    "compare_runs",
    "counterfactual",
    "draw",
    "film",
    "find_bounds",
    "find_optimum",
    "load",
    "load_policy",
    "plot",
    "read_run",
    "register",
    "reproduce",
    "run",
    "sweep",
    "train",
    "write_replay",
    "write_report",
]


if Path(*sys.argv[:1]).stem != "desim-uav":  # whose commands need no ids, and start faster
    importlib.import_module("desim_uav.env")  # registers the ids with Gymnasium


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for: ``--help`` stays fast."""
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module 'desim_uav' has no attribute {name!r}")
