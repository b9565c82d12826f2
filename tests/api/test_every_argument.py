"""Every public function takes every kind of argument that its annotations allow, and no other.

The kinds are read from the annotations: a new one fails ``test_no_kind_is_left_out`` until it has
an example here. Numbers are also given as NumPy's, and sequences as tuples, iterators and arrays.
"""

from __future__ import annotations

import collections.abc
import inspect
import itertools
import re
import types
import typing
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import desim_uav as du
from desim_uav.errors import MissingExtraError
from desim_uav.experiment.sweep.table import Done
from desim_uav.policies.hover import Hover
from desim_uav.policies.mlp import Mlp, description_of, scaling_of
from desim_uav.shipped import scenario_path
from desim_uav.typed import hints_of

SHORT = {"episode.steps": 2}
NOT_HERE = {"register", "draw"}
"""A decorator, and a function of worlds and numbers alone, which are only called wrongly."""

METHODS: dict[type, tuple[str, ...]] = {
    du.RunResult: ("qoe", "groups", "save", "replay", "plot", "film", "report", "levels", "map"),
    du.TrainingResult: ("plot", "save"),
    du.Comparison: ("plot", "save"),
    du.Counterfactual: ("replay",),
    du.Replay: ("save",),
    Done: ("plot",),
}


def public() -> dict[str, Any]:
    """Return the public functions; what needs an extra that is missing is none."""
    found = {}
    for name in sorted(set(du.__all__) - NOT_HERE):
        with suppress(MissingExtraError):
            if inspect.isfunction(getattr(du, name)):
                found[name] = getattr(du, name)
    return found


FUNCTIONS = public() | {
    f"{of.__name__}.{name}": getattr(of, name) for of, names in METHODS.items() for name in names
}


def kinds(hint: Any) -> list[str]:
    """Return the kinds of values that an annotation allows."""
    if typing.get_origin(hint) is typing.Annotated:
        return kinds(typing.get_args(hint)[0])
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return [kind for one in typing.get_args(hint) for kind in kinds(one)]
    origin = typing.get_origin(hint)
    if origin is collections.abc.Sequence:
        return [f"Sequence of {kind}" for kind in kinds(typing.get_args(hint)[0])]
    if origin is not None:
        return [origin.__name__]
    return [hint.__name__ if isinstance(hint, type) else str(hint)]


def asked(function: Any) -> list[tuple[str, str]]:
    """Return the parameters of a function with each of the kinds that they take."""
    hints = hints_of(function)
    return [
        (parameter.name, kind)
        for parameter in inspect.signature(function).parameters.values()
        if parameter.name != "self" and parameter.kind is not parameter.VAR_KEYWORD
        for kind in kinds(hints[parameter.name])
    ]


@dataclass
class Here:
    """Results and folders that arguments are made of."""

    folder: Path
    numbers: Any = field(default_factory=itertools.count)
    graded: Any = None

    def place(self, ending: str = "") -> Path:
        """Return a place where nothing is yet."""
        return self.folder / f"new{next(self.numbers)}{ending}"

    def run(self, **how: Any) -> du.RunResult:
        return du.run("tiny", SHORT, **{"policy": "hover", **how})


def steps(here: Here) -> Done:
    how = {"out": here.place(), "policies": ["hover"], "seeds": 1, "episodes": 1, "warmup": 0}
    return du.sweep("tiny", {"episode.steps": [2, 3]}, **how)


def submitted(here: Here) -> Path:
    how = {"task": "uav-v1/coverage/small", "policy": "hover", "seeds": 1, "out": here.place()}
    return du.bench_run(**how).folder


def key(here: Here) -> Path:
    file = here.place(".key")
    du.bench_seal(file)
    return file


def opened(here: Here) -> Path:
    return du.bench_reveal(key(here), out=here.place())


def graded(here: Here) -> du.RunResult:
    if here.graded is None:
        how = {"policy": "hover", "episodes": 1, "warmup": 0, "events": True}
        here.graded = du.run("urban_downlink", SHORT | {"users.count": 3}, **how)
    return here.graded


def receipts(here: Here) -> Path:
    file = here.place(".json")
    file.write_text('{"verified": {}}', encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    found = Here(tmp_path_factory.mktemp("made"))
    found.one = found.run(events=True)
    found.two = found.run(seeds=2)
    found.other = found.run(policy="random")
    found.saved, found.saved_other = found.folder / "run", found.folder / "other"
    found.one.save(found.saved)
    found.other.save(found.saved_other)
    found.training = du.train("tiny", SHORT, episodes=2)
    found.comparison = du.compare(
        "tiny", SHORT, policies=["hover", "random"], seeds=2, episodes=1, warmup=0
    )
    found.fork = du.counterfactual("tiny", SHORT, to="hover", fork=(0, 1))
    found.swept = du.sweep("tiny", SHORT, out=found.folder / "sweep", seeds=1, episodes=1, warmup=0)
    found.page = du.write_replay(found.one, found.place(".html"))
    return found


def model() -> Any:
    if find_spec("stable_baselines3") is None:
        return "hover"
    from stable_baselines3 import A2C

    return A2C("MlpPolicy", du.UavEnv("tiny", SHORT))


def module() -> Any:
    if find_spec("torch") is None:
        return "hover"
    from torch.nn import Linear

    world = du.build_world("tiny")
    return Linear(len(world.features_of_types[0]), len(world.actions))


def network() -> Mlp:
    world = du.build_world("tiny")
    seen, actions = len(world.features_of_types[0]), len(world.actions)
    layer = np.zeros((seen, actions), np.float32), np.zeros(actions, np.float32)
    return Mlp(*scaling_of(world), (layer,), description_of(world) | {"training": {}})


def east(observation: Any, mask: Any) -> str:
    return "right"


POLICIES = {
    "str": "hover",
    "Path": lambda here: here.training.save(here.place()) / "policy.npz",
    "Policy": Hover(),
    "type": Hover,
    "Callable": lambda here: east,
    "Learned": lambda here: here.training,
    "Trained": lambda here: model(),
    "Module": lambda here: module(),
    "Network": lambda here: network(),
}
SCENARIOS = {
    "str": "tiny",
    "Path": scenario_path("tiny"),
    "Mapping": {"name": "own", "users": {"count": 3}, "episode": {"steps": 2}},
    "Scenario": du.load("tiny"),
}
OVERRIDES = {
    "str": "episode.steps=2",
    "Mapping": {"episode.steps": np.int64(2)},
    "Sequence of str": ["episode.steps=2"],
    "NoneType": None,
}
EPISODES = {"str": "0", "int": 0, "Sequence of int": [0], "NoneType": None}
WHOLE = {"int": 1, "NoneType": None}
SEVERAL = {"int": 0, "Sequence of int": [0, 1], "NoneType": None}
FOLDERS = {"str": lambda here: str(here.saved), "Path": lambda here: here.saved}
RUNS = FOLDERS | {"InFolders": lambda here: here.one}


def files(ending: str) -> dict[str, Any]:
    return {
        "str": lambda here: str(here.place(ending)),
        "Path": lambda here: here.place(ending),
        "NoneType": None,
    }


def several(examples: dict[str, Any]) -> dict[str, Any]:
    """Return the examples as sequences of one."""
    return {
        f"Sequence of {kind}": (
            (lambda here, one=one: [one(here)]) if isinstance(one, types.LambdaType) else [one]
        )
        for kind, one in examples.items()
    }


FLAG = {"bool": False}
SOURCES = RUNS | {
    "Comparison": lambda here: here.comparison,
    "Scenario": du.load("urban_downlink"),
    "World": lambda here: du.build_world("urban_downlink"),
}
EXAMPLES: dict[str, dict[str, Any]] = {
    "scenario": SCENARIOS,
    "overrides": OVERRIDES,
    "values": {"Mapping": {"episode.steps": np.array([2, 3])}, "Sequence of str": ["seed=0:1"]},
    "policy": POLICIES,
    "to": POLICIES,
    "sweep.values": {
        "Mapping": {"episode.steps": np.array([2, 3])},
        "Sequence of str": ["episode.steps=2:3"],
        "str": "episode.steps=2,3",
    },
    "policies": several(POLICIES) | {"Mapping": {"mine": east}},
    "sweep.policies": {"str": "hover", "Path": Path("hover")}
    | {"Sequence of str": ["hover"], "NoneType": None}
    | {"Sequence of Path": lambda here: [here.training.save(here.place()) / "policy.npz"]},
    "seed": WHOLE,
    "world_seed": WHOLE,
    "seeds": {"int": 2, "Sequence of int": [3, 5], "NoneType": None},
    "first_seed": {"int": 4},
    "episodes": WHOLE,
    "warmup": {"int": 1},
    "jobs": WHOLE,
    "events": FLAG,
    "progress": FLAG,
    "train": FLAG,
    "resume": FLAG,
    "schedule": FLAG,
    "decide": FLAG,
    "engine": {"str": "batch", "NoneType": None},
    "run.name": {"str": "a label", "NoneType": None},
    "train.name": {"str": "a label", "NoneType": None},
    "counterfactual.name": {"str": "a label", "NoneType": None},
    "out": files(""),
    "run.out": files("") | {"bool": False},
    "train.out": files("") | {"bool": False},
    "counterfactual.out": files("") | {"bool": False},
    "fork": {"str": "0:1", "tuple": (0, np.int64(1))},
    "algorithm": {"str": "sarsa", "NoneType": None},
    "algorithms": {"str": "sarsa", "Sequence of str": ["sarsa"], "NoneType": None},
    "checkpoint_every": {"int": 1},
    "callback": {"Callable": lambda here: lambda told: None}
    | {"Sequence of Callable": [lambda told: None]},
    "callback_every": {"int": 1},
    "backend": {"str": "local"},
    "address": {"str": "auto", "NoneType": None},
    "against": {"str": "random", "NoneType": None},
    "folder": FOLDERS,
    "root": FOLDERS,
    "folders": several(RUNS),
    "bench_verify.folder": {"str": lambda here: str(submitted(here)), "Path": submitted},
    "bench_board.folders": {
        "Sequence of str": lambda here: [str(submitted(here))],
        "Sequence of Path": lambda here: [submitted(here)],
    },
    "file": files(".gif"),
    "RunResult.save.folder": files(""),
    "TrainingResult.save.folder": files(""),
    "Comparison.save.file": files(".csv"),
    "Replay.save.file": files(".html"),
    "RunResult.replay.file": files(".html"),
    "RunResult.report.file": files(".html"),
    "Counterfactual.replay.file": files(".html"),
    "by": {"str": "service", "NoneType": None},
    "beside": {
        "RunResult": lambda here: here.other,
        "InFolders": lambda here: here.other,
        "str": lambda here: str(here.saved_other),
        "Path": lambda here: here.saved_other,
        "NoneType": None,
    },
    "RunResult.replay.episodes": EPISODES,
    "write_replay.episodes": EPISODES,
    "html": files(".html"),
    "run_dir": RUNS,
    "write_levels.run_dir": {
        "str": lambda here: str(graded(here).save(here.place())[0]),
        "Path": lambda here: graded(here).save(here.place())[0],
    },
    "most_bytes": {"int": 10**6, "NoneType": None},
    "write_report.runs": RUNS | several(RUNS),
    "write_report.out": files(".html"),
    "title": {"str": "A title", "NoneType": None},
    "RunResult.plot.kind": {"str": "visits"},
    "TrainingResult.plot.kind": {"str": "policy"},
    "film.run": RUNS,
    "episode": {"int": 0, "NoneType": None},
    "fps": {"float": 1.5},
    "speed": {"float": 3600.0},
    "width": {"int": 160},
    "plot.kind": {"str": "services"},
    "plot.runs": SOURCES | several(SOURCES),
    "plot.out": files(".svg") | {"bool": True},
    "RunResult.plot.out": files(".svg"),
    "TrainingResult.plot.out": files(".svg"),
    "Comparison.plot.out": files(".svg"),
    "Done.plot.out": files(".svg"),
    "compare.out": files(".csv"),
    "compare_runs.out": files(".csv"),
    "minute": {"float": 0.5, "NoneType": None},
    "drone": WHOLE | {"int": 0},
    "user": SEVERAL,
    "RunResult.levels.drone": SEVERAL,
    "RunResult.levels.seed": {"int": 0, "NoneType": None},
    "every_s": {"float": 30.0, "NoneType": None},
    "at_s": {"float": 30.0, "Sequence of float": [0.0, 30.0], "NoneType": None},
    "points": {"int": 5},
    "write_levels.out": files(".parquet"),
    "window": WHOLE,
    "battery_min": WHOLE,
    "level": WHOLE | {"int": 0},
    "at": {"str": "100,200", "tuple": (100.0, np.float64(200.0)), "NoneType": None},
    "measure": {"str": "qoe1_percent", "Sequence of str": ["qoe1_percent"], "NoneType": None},
    "key": {"str": "episode.steps", "Sequence of str": ["episode.steps"], "NoneType": None},
    "bench_run.task": {"str": "uav-v1/coverage/small"},
    "bench_run.policy": {
        "str": "hover",
        "Path": Path("hover"),
        "Sequence of str": ["hover"],
        "Sequence of Path": [Path("hover")],
    },
    "bench_export.task": {"str": "uav-v1/coverage/small"},
    "bench_export.seeds": {"int": 1},
    "bench_export.policy": {"str": "hover", "Path": Path("hover")},
    "observation": {"str": "local", "NoneType": None},
    "bench_run.seeds": {"int": 1, "NoneType": None},
    "bench_run.name": {"str": "mine", "NoneType": None},
    "bench_run.training_steps": {"int": 10, "NoneType": None},
    "track": {"str": "one"},
    "bench_board.out": files(".md"),
    "bench_board.figure": files(".svg"),
    "bench_verify.receipts": files(".json"),
    "bench_board.receipts": {"str": lambda here: str(receipts(here)), "Path": receipts}
    | {"NoneType": None},
    "revealed": {"str": lambda here: str(opened(here)), "Path": opened, "NoneType": None},
    "bench_seal.key": {"str": lambda here: str(here.place()), "Path": lambda here: here.place()},
    "bench_reveal.key": {"str": lambda here: str(key(here)), "Path": key},
    "bench_reveal.tasks": {"Sequence of str": ()},
    "cases": {"str": "1"},
    "preset": {"str": "default"},
    "load_policy.policy": POLICIES,
}
"""For each parameter, an example of each kind; ``function.parameter`` is of one function alone."""

WITH: dict[str, dict[str, Any]] = {
    "run": {"scenario": "tiny", "overrides": SHORT, "policy": "hover"},
    "run.seed": {"seeds": None},
    "run.first_seed": {"seeds": 2},
    "load": {"scenario": "tiny"},
    "train": {"scenario": "tiny", "overrides": SHORT, "episodes": 2},
    "compare": {"scenario": "tiny", "overrides": SHORT, "policies": ["hover", "random"]}
    | {"seeds": 1, "episodes": 1, "warmup": 0},
    "compare.first_seed": {"seeds": 1},
    "counterfactual": {"scenario": "tiny", "overrides": SHORT, "to": "hover", "fork": "0:1"},
    "sweep": {"scenario": "tiny", "values": {"episode.steps": [2, 3]}, "policies": ["hover"]}
    | {"out": lambda here: here.place(), "seeds": 1, "episodes": 1, "warmup": 0},
    "sweep.algorithms": {"train": True, "policies": None, "values": ["learning.episodes=2"]},
    "sweep.address": {"backend": "local"},
    "build_world": {"scenario": "tiny"},
    "read_run": {},
    "list_runs": {},
    "compare_runs": {"folders": lambda here: [here.saved, here.saved_other]},
    "film": {"run": lambda here: here.one, "file": lambda here: here.place(".gif")}
    | {"fps": 1, "speed": 3600, "width": 160},
    "write_report": {"runs": lambda here: here.swept},
    "write_report.against": {"runs": lambda here: [here.one, here.other]},
    "write_report.runs": {"out": lambda here: here.place(".html")},
    "write_replay": {"run_dir": lambda here: here.one},
    "plot": {"kind": "services", "runs": lambda here: here.one},
    "plot.runs.Comparison": {"kind": "compare"},
    "plot.runs.Sequence of Comparison": {"kind": "compare"},
    "plot.runs.Scenario": {"kind": "radio"},
    "plot.runs.Sequence of Scenario": {"kind": "radio"},
    "plot.runs.World": {"kind": "radio"},
    "plot.runs.Sequence of World": {"kind": "radio"},
    "plot.drone": {"kind": "visits"},
    "plot.minute": {"kind": "snapshot"},
    "plot.window": {"kind": "training", "runs": lambda here: here.training},
    "plot.battery_min": {"kind": "policy", "runs": "case8.npz"},
    "plot.level": {"kind": "radio", "runs": "urban_downlink"},
    "plot.at": {"kind": "radio", "runs": "urban_downlink"},
    "plot.against": {"kind": "compare", "runs": lambda here: here.comparison},
    "plot.measure": {"kind": "sweep", "runs": lambda here: here.swept},
    "plot.key": {"kind": "sweep", "runs": steps},
    "Done.plot.key": {"self": steps},
    "RunResult.levels": {"self": graded},
    "RunResult.map": {"minute": 1.0, "points": 3},
    "write_levels": {"run_dir": lambda here: graded(here).save(here.place())[0]},
    "RunResult.film": {"fps": 1, "speed": 3600, "width": 160},
    "RunResult.film.file": {},
    "find_optimum": {"scenario": "tiny"},
    "find_bounds": {"scenario": "tiny", "overrides": SHORT, "seeds": 1, "episodes": 1}
    | {"schedule": False},
    "bench_run": {"task": "uav-v1/coverage/small", "policy": "hover", "seeds": 1}
    | {"out": lambda here: here.place()},
    "bench_export": {"task": "uav-v1/coverage/small", "policy": "hover", "seeds": 1}
    | {"out": lambda here: here.place()},
    "bench_verify": {"folder": submitted},
    "bench_board": {"folders": lambda here: [submitted(here)]},
    "bench_reveal": {"key": key, "out": lambda here: here.place()},
    "reproduce": {"cases": "1", "seeds": 1, "episodes": 1, "out": lambda here: here.place()},
}
"""What else a function is called with, and beside one of its parameters."""

SELVES: dict[str, Any] = {
    "RunResult": lambda here: here.one,
    "TrainingResult": lambda here: here.training,
    "Comparison": lambda here: here.comparison,
    "Counterfactual": lambda here: here.fork,
    "Replay": lambda here: here.page,
    "Done": lambda here: here.swept,
}
REFUSED = {
    ("bench_verify", "revealed", "str"): "see --revealed",
    ("bench_verify", "revealed", "Path"): "see --revealed",
    ("bench_board", "revealed", "str"): "see --revealed",
    ("bench_board", "revealed", "Path"): "see --revealed",
    ("sweep", "address", "str"): "--address needs --backend ray",
}
"""What is refused although its kind is allowed, and why."""

CHEAP = {"load", "build_world", "read_run", "RunResult.qoe"}
"""The functions that the default tests call; the others are called by the thorough ones."""


def of(name: str, parameter: str) -> dict[str, Any]:
    """Return the examples of a parameter."""
    return EXAMPLES.get(f"{name}.{parameter}", EXAMPLES.get(parameter, {}))


def made(value: Any, here: Here) -> Any:
    """Return a value, which may have to be made of what is here."""
    asks = inspect.isfunction(value) and list(inspect.signature(value).parameters)[:1] == ["here"]
    return value(here) if asks else value


def variants(value: Any) -> list[Any]:
    """Return a value as it is, and as NumPy and other sequences have it."""
    if isinstance(value, list):
        whole = all(isinstance(each, int) for each in value)
        return [value, tuple(value), iter(value), *([np.array(value)] if whole else [])]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return [value, np.array([value])[0]]
    return [value]


def test_no_kind_is_left_out():
    missing = [
        f"{name}.{parameter}: {kind}"
        for name in FUNCTIONS
        for parameter, kind in asked(FUNCTIONS[name])
        if kind not in of(name, parameter)
    ]
    assert missing == []


@pytest.mark.parametrize(
    "name",
    [
        name if name in CHEAP else pytest.param(name, marks=pytest.mark.thorough)
        for name in FUNCTIONS
    ],
)
@pytest.mark.filterwarnings("ignore::desim_uav.DesimWarning")
def test_every_kind_is_taken(here, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if name == "bench_export":
        pytest.importorskip("minari")
    owner = name.partition(".")[0] if "." in name else ""
    for parameter, kind in asked(FUNCTIONS[name]):
        example = of(name, parameter)[kind]
        for value in variants(made(example, here)):
            keys = (name, f"{name}.{parameter}", f"{name}.{parameter}.{kind}")
            given = {key: each for beside in keys for key, each in WITH.get(beside, {}).items()}
            given = {key: made(each, here) for key, each in given.items()} | {parameter: value}
            if owner:
                given.setdefault("self", SELVES[owner](here))
            refused = REFUSED.get((name, parameter, kind))
            try:
                if refused is None:
                    FUNCTIONS[name](**given)
                else:
                    with pytest.raises(du.DesimError, match=refused):
                        FUNCTIONS[name](**given)
            except Exception as error:
                pytest.fail(f"{name}({parameter}={value!r}): {type(error).__name__}: {error}")


# ---- wrong types

WRONG: list[tuple[Any, set[str]]] = [
    (2.5, {"float"}),
    ("?", {"str", "Literal"}),
    (None, {"NoneType"}),
    ({"?": object()}, {"Mapping", "dict"}),
    ([object()], {"Sequence of tuple"}),
    (b"?", set()),
    (object(), set()),
]
"""Values, each with the kinds for which the type alone does not refuse them."""

BY_ITSELF = {"Any", "InFolders", "Policy"}
"""Kinds that any object may be of: see ``test_what_the_function_itself_refuses``."""

CALLED: dict[str, tuple[str, ...]] = {
    "Curriculum": ("__init__",),
    "InTurn": ("__init__",),
    "JointActions": ("__init__",),
    "Leaderboard": ("save",),
    "Simulation": ("__init__", "reset"),
    "SkipForced": ("__init__",),
    "SkipForcedParallel": ("__init__", "reset"),
    "TensorBoardCallback": ("__init__",),
    "TrainingProgress": ("evaluate",),
    "UavEnv": ("__init__", "reset", "restore", "fork"),
    "UavMoEnv": ("reset", "restore", "fork"),
    "UavParallelEnv": ("__init__", "reset", "restore", "fork"),
    "UavParallelVectorEnv": ("__init__", "reset", "save", "restore", "assign", "fork"),
    "UavVecEnv": ("__init__", "save", "restore", "fork"),
    "UavVectorEnv": ("__init__", "reset", "save", "restore", "assign", "fork"),
}
"""The methods of public classes that users call, beside those of results above."""

NOT_MADE = {of.__name__ for of in METHODS} | {
    *("DesimError", "DesimWarning", "Interrupted", "Policy", "RunSettings", "Scenario"),
    *("StopTraining", "Submitted", "World"),
}
"""Public classes that users do not make, or only as a plain record."""


def of_extras(names: Any) -> dict[str, Any]:
    """Return what is public under these names; what needs an extra that is missing is none."""
    found = {}
    for name in names:
        with suppress(MissingExtraError):
            found[name] = getattr(du, name)
    return found


METHODS_CALLED = {
    f"{name}.{method}": getattr(of, method)
    for name, of in of_extras(CALLED).items()
    for method in CALLED[name]
}
REFUSING = FUNCTIONS | of_extras(NOT_HERE) | METHODS_CALLED


def test_no_public_class_is_left_out():
    classes = {name for name, of in of_extras(du.__all__).items() if isinstance(of, type)}
    assert classes <= {*CALLED, *NOT_MADE}


@pytest.mark.parametrize("name", sorted(REFUSING))
def test_a_wrong_type_is_refused(name):
    """The types are looked at first, so nothing else of the arguments has to be right."""
    function, owned = REFUSING[name], {"self": None} if "." in name else {}
    takes: dict[str, set[str]] = {}
    for parameter, kind in asked(function):
        takes.setdefault(parameter, set()).add(kind)
    for parameter, kinds_of_it in takes.items():
        if any(kind.removeprefix("Sequence of ") in BY_ITSELF for kind in kinds_of_it):
            continue
        for value in (value for value, taken in WRONG if not taken & kinds_of_it):
            with pytest.raises((du.DesimError, gymnasium.error.Error)) as caught:
                function(**owned, **{parameter: value})
            assert str(caught.value).startswith(f"{parameter}: "), (parameter, value)
            assert ": must be " in str(caught.value)


def begun(kind: Any) -> Any:
    """Return an environment in which an episode has begun."""
    env = kind("tiny")
    env.reset()
    return env


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: du.run("tiny", policy=3), "policy 'builtins:int': it has no method 'begin'"),
        (lambda: du.run("tiny", policy=b"hover"), "policy 'builtins:bytes': it has no method"),
        (lambda: du.load_policy(None), "policy 'builtins:NoneType': it has no method 'begin'"),
        (lambda: du.compare("tiny", policies=[3]), "policy 'builtins:int': it has no method"),
        (lambda: du.compare("tiny", policies=3), "policies: 3: must be a sequence of texts"),
        (lambda: du.compare_runs([3, 4]), "folders: 3: must be a result"),
        (lambda: du.compare_runs(3), "folders: 3: must be a sequence of texts"),
        (lambda: du.film(3), "run: 3: must be a result"),
        (lambda: du.plot("visits", 3), "runs: 3: must be a result"),
        (lambda: du.plot("visits", [2.5]), "runs: 2.5: must be a result"),
        (lambda: du.write_report(3), "runs: 3: must be a result"),
        (lambda: du.write_replay(3), "run_dir: 3: must be a result"),
        (lambda: du.UavEnv("tiny", curriculum=[3]), "curriculum[0]: 3: must be a pair"),
        (lambda: du.SkipForced(gymnasium.make("CartPole-v1")), "must be a UavEnv, or a wrapper"),
        (lambda: du.InTurn(gymnasium.make("CartPole-v1")), "must be a UavEnv, or a wrapper"),
        (lambda: du.JointActions(du.UavEnv("tiny"), most="3"), "most"),
        (lambda: du.SkipForcedParallel(3), "env: 3: must be a UavParallelEnv, or a wrapper"),
        (lambda: begun(du.UavEnv).step(object()), "action"),
        (lambda: begun(du.UavParallelEnv).step(3), "actions"),
    ],
)
def test_what_the_function_itself_refuses(call, words):
    with pytest.raises((du.DesimError, gymnasium.error.Error), match=re.escape(words)):
        call()
