"""How the parameters of verbs look in a terminal, by their names.

What they mean, their defaults and what they may be stands in the verbs themselves. A parameter
without a look here gets one from its type.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

MAKING, SCENARIO, OUTPUT = "What is run", "The scenario", "What comes out"
"""Headings that group options in the help."""

Complete = Callable[[str], list[str]]


class Look(NamedTuple):
    """The look of a parameter: what stands for its value, its heading, and its flags.

    An option has the flag ``--its-name`` unless it has others; an ``argument`` has none. With
    ``commas``, several values stand in one word.
    """

    metavar: str = ""
    heading: str | None = None
    flags: tuple[str, ...] = ()
    argument: bool = False
    repeated: bool = False
    commas: bool = False
    complete: Complete | None = None


def complete_scenarios(incomplete: str) -> list[str]:
    """Return the shipped scenarios, for a shell that completes what is typed."""
    from desim_uav.shipped import scenario_names

    return [name for name in scenario_names() if name.startswith(incomplete)]


def complete_policies(incomplete: str) -> list[str]:
    """Return built-in and shipped policies, for a shell that completes what is typed."""
    from desim_uav.shipped import trained_names

    known = ["baseline", "hover", "random", *trained_names()]
    return [name for name in known if name.startswith(incomplete)]


def complete_tasks(incomplete: str) -> list[str]:
    """Return the tasks of the benchmark, for a shell that completes what is typed."""
    from desim_uav.experiment.bench.tasks import tasks

    return [name for name in tasks() if name.startswith(incomplete)]


def complete_papers(incomplete: str) -> list[str]:
    """Return the papers of the gallery, for a shell that completes what is typed."""
    from desim_uav.experiment.gallery import ENTRIES

    return [name for name in ENTRIES if name.startswith(incomplete)]


POLICY = Look("POLICY", MAKING, complete=complete_policies)
POLICIES = Look("P,Q…", MAKING, commas=True)
OVERRIDES = Look("KEY.PATH=VALUE", SCENARIO, ("-S",), repeated=True)
NUMBER, FOLDER, MODE = Look("N", MAKING), Look("DIR", OUTPUT), Look(heading=MAKING)
RUN = Look("RUN_DIR", argument=True)

LOOKS: dict[str, Look] = {
    "scenario": Look("SCENARIO", argument=True, complete=complete_scenarios),
    "overrides": OVERRIDES,
    "values": OVERRIDES._replace(metavar="KEY.PATH=V,W…"),
    "seed": Look("N", SCENARIO),
    "world_seed": Look("N", SCENARIO),
    "policy": POLICY,
    "to": POLICY,
    "policies": POLICIES,
    "algorithm": Look("A", MAKING),
    "algorithms": POLICIES._replace(metavar="A,B…", flags=("--algorithm",)),
    "engine": Look("auto|des|batch", MAKING),
    "seeds": NUMBER,
    "first_seed": NUMBER,
    "episodes": NUMBER,
    "warmup": NUMBER,
    "jobs": NUMBER._replace(flags=("-j", "--jobs")),
    "train": MODE,
    "decide": MODE,
    "fork": Look("EPISODE:STEP", MAKING),
    "backend": Look("local|ray", MAKING),
    "address": Look("ADDRESS", MAKING),
    "preset": Look("default|paper|both", MAKING),
    "cases": Look("1-9", MAKING),
    "track": Look("one|any", MAKING),
    "task": Look("TASK", argument=True, complete=complete_tasks),
    "out": FOLDER,
    "events": Look(heading=OUTPUT),
    "resume": Look(heading=OUTPUT),
    "checkpoint_every": Look("N", OUTPUT),
    "training_steps": Look("N", OUTPUT),
    "name": Look("NAME", OUTPUT),
    "against": Look("POLICY"),
    "compare.against": Look("POLICY", OUTPUT),
    "compare.out": Look("FILE.csv", OUTPUT),
    "compare_runs.folders": Look("SCENARIO|RUN…", argument=True, complete=complete_scenarios),
    "bench_run.policy": Look("POLICY", MAKING),
    "bench_verify.folder": Look("DIR", argument=True),
    "bench_board.folders": Look("DIR…", argument=True),
    "bench_board.out": Look("FILE.md", OUTPUT, ("-o", "--out")),
    "bench_board.figure": Look("FILE", OUTPUT),
    "files": Look("FILE…", argument=True, complete=complete_scenarios),
    "show": Look("NAME"),
    "names": Look("[NAME…]", argument=True, complete=complete_papers),
    "gallery.figure": FOLDER,
    "markdown": Look("FILE", OUTPUT),
    "by": Look("service|episode|user|outcome"),
    "run_dir": RUN,
    "beside": RUN._replace(metavar="RUN_DIR2"),
    "html": Look("FILE"),
    "write_replay.episodes": Look("0-9"),
    "write_report.runs": RUN._replace(metavar="RUN_DIR…"),
    "write_report.out": Look("FILE.html"),
    "film.run": RUN,
    "plot.episode": Look("N"),
    "title": Look("TITLE"),
    "kind": Look("KIND", argument=True),
    "runs": RUN._replace(metavar="RUN…"),
    "plot.out": Look("FILE", flags=("-o", "--out")),
    "minute": Look("M"),
    "drone": Look("D"),
    "level": Look("K"),
    "at": Look("X,Y"),
    "measure": Look("NAME"),
    "key": Look("KEY[=VALUE]"),
}


def look_of(verb: str, name: str) -> Look:
    """Return the look of a parameter of a verb."""
    return LOOKS.get(f"{verb}.{name}", LOOKS.get(name, Look()))


def flags_of(verb: str, name: str) -> tuple[str, ...]:
    """Return the flags of an option, the short one first if it has one."""
    return look_of(verb, name).flags or (f"--{name.replace('_', '-')}",)
