"""The public names, each once: ``desim_uav/__init__.py`` reads at run time where they are from."""

from desim_uav.api.bench import (
    bench_board as bench_board,
)
from desim_uav.api.bench import (
    bench_export as bench_export,
)
from desim_uav.api.bench import (
    bench_list as bench_list,
)
from desim_uav.api.bench import (
    bench_reveal as bench_reveal,
)
from desim_uav.api.bench import (
    bench_run as bench_run,
)
from desim_uav.api.bench import (
    bench_seal as bench_seal,
)
from desim_uav.api.bench import (
    bench_verify as bench_verify,
)
from desim_uav.api.branches import Counterfactual as Counterfactual
from desim_uav.api.compare import compare as compare
from desim_uav.api.compare import compare_runs as compare_runs
from desim_uav.api.fork import counterfactual as counterfactual
from desim_uav.api.levels import write_levels as write_levels
from desim_uav.api.listing import list_runs as list_runs
from desim_uav.api.pictures import (
    film as film,
)
from desim_uav.api.pictures import (
    plot as plot,
)
from desim_uav.api.pictures import (
    write_replay as write_replay,
)
from desim_uav.api.pictures import (
    write_report as write_report,
)
from desim_uav.api.replay import Replay as Replay
from desim_uav.api.run import read_run as read_run
from desim_uav.api.run import run as run
from desim_uav.api.run_result import RunResult as RunResult
from desim_uav.api.study import (
    find_bounds as find_bounds,
)
from desim_uav.api.study import (
    find_optimum as find_optimum,
)
from desim_uav.api.study import (
    reproduce as reproduce,
)
from desim_uav.api.study import (
    sweep as sweep,
)
from desim_uav.api.tensorboard import TensorBoardCallback as TensorBoardCallback
from desim_uav.api.train import train as train
from desim_uav.api.training import (
    StopTraining as StopTraining,
)
from desim_uav.api.training import (
    TrainingProgress as TrainingProgress,
)
from desim_uav.api.training import (
    TrainingResult as TrainingResult,
)
from desim_uav.api.worlds import build_world as build_world
from desim_uav.engine.base import RunSettings as RunSettings
from desim_uav.engine.des import Simulation as Simulation
from desim_uav.env import (
    Curriculum as Curriculum,
)
from desim_uav.env import (
    InTurn as InTurn,
)
from desim_uav.env import (
    JointActions as JointActions,
)
from desim_uav.env import (
    SkipForced as SkipForced,
)
from desim_uav.env import (
    SkipForcedParallel as SkipForcedParallel,
)
from desim_uav.env import (
    UavEnv as UavEnv,
)
from desim_uav.env import (
    UavMoEnv as UavMoEnv,
)
from desim_uav.env import (
    UavParallelEnv as UavParallelEnv,
)
from desim_uav.env import (
    UavParallelVectorEnv as UavParallelVectorEnv,
)
from desim_uav.env import (
    UavVecEnv as UavVecEnv,
)
from desim_uav.env import (
    UavVectorEnv as UavVectorEnv,
)
from desim_uav.errors import (
    DesimError as DesimError,
)
from desim_uav.errors import (
    DesimWarning as DesimWarning,
)
from desim_uav.errors import (
    Interrupted as Interrupted,
)
from desim_uav.experiment.bench.leaderboard import Leaderboard as Leaderboard
from desim_uav.experiment.bench.run import Submitted as Submitted
from desim_uav.experiment.compare import Comparison as Comparison
from desim_uav.policies import Policy as Policy
from desim_uav.policies import load_policy as load_policy
from desim_uav.registry import register as register
from desim_uav.sample_path import draw as draw
from desim_uav.scenario.load import load as load
from desim_uav.scenario.schema import Scenario as Scenario
from desim_uav.world import World as World

__version__: str
