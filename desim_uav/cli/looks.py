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


class OptionLook(NamedTuple):
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

    names = ["baseline", "hover", "random", *trained_names()]
    return [name for name in names if name.startswith(incomplete)]


def complete_tasks(incomplete: str) -> list[str]:
    """Return the tasks of the benchmark, for a shell that completes what is typed."""
    from desim_uav.experiment.bench.tasks import tasks

    return [name for name in tasks() if name.startswith(incomplete)]


def complete_papers(incomplete: str) -> list[str]:
    """Return the published papers, for a shell that completes what is typed."""
    from desim_uav.experiment.papers import ENTRIES

    return [name for name in ENTRIES if name.startswith(incomplete)]


POLICY = OptionLook("POLICY", MAKING, complete=complete_policies)
POLICIES = OptionLook("P,Q…", MAKING, commas=True)
OVERRIDES = OptionLook("KEY.PATH=VALUE", SCENARIO, ("-S",), repeated=True)
NUMBER, FOLDER, MODE = (
    OptionLook("N", MAKING),
    OptionLook("DIR", OUTPUT),
    OptionLook(heading=MAKING),
)
RUN = OptionLook("RUN_DIR", argument=True)

LOOKS: dict[str, OptionLook] = {
    "scenario": OptionLook("SCENARIO", argument=True, complete=complete_scenarios),
    "overrides": OVERRIDES,
    "values": OVERRIDES._replace(metavar="KEY.PATH=V,W…"),
    "seed": OptionLook("N", SCENARIO),
    "world_seed": OptionLook("N", SCENARIO),
    "policy": POLICY,
    "to": POLICY,
    "policies": POLICIES,
    "algorithm": OptionLook("A", MAKING),
    "algorithms": POLICIES._replace(metavar="A,B…", flags=("--algorithm",)),
    "engine": OptionLook("auto|des|batch", MAKING),
    "seeds": NUMBER,
    "first_seed": NUMBER,
    "episodes": NUMBER,
    "warmup": NUMBER,
    "jobs": NUMBER._replace(flags=("-j", "--jobs")),
    "train": MODE,
    "decide": MODE,
    "fork": OptionLook("EPISODE:STEP", MAKING),
    "backend": OptionLook("local|ray", MAKING),
    "address": OptionLook("ADDRESS", MAKING),
    "preset": OptionLook("default|paper|both", MAKING),
    "cases": OptionLook("1-9", MAKING),
    "track": OptionLook("one|any", MAKING),
    "task": OptionLook("TASK", argument=True, complete=complete_tasks),
    "out": FOLDER,
    "events": OptionLook(heading=OUTPUT),
    "resume": OptionLook(heading=OUTPUT),
    "checkpoint_every": OptionLook("N", OUTPUT),
    "training_steps": OptionLook("N", OUTPUT),
    "name": OptionLook("NAME", OUTPUT),
    "against": OptionLook("POLICY"),
    "compare.against": OptionLook("POLICY", OUTPUT),
    "compare.out": OptionLook("FILE.csv", OUTPUT),
    "compare_runs.folders": OptionLook("SCENARIO|RUN…", argument=True, complete=complete_scenarios),
    "bench_run.policy": OptionLook("POLICY", MAKING),
    "observation": OptionLook("NAME", MAKING),
    "bench_verify.folder": OptionLook("DIR", argument=True),
    "bench_board.folders": OptionLook("DIR…", argument=True),
    "bench_board.out": OptionLook("FILE.md", OUTPUT, ("-o", "--out")),
    "bench_board.figure": OptionLook("FILE", OUTPUT),
    "bench_verify.receipts": OptionLook("FILE", OUTPUT),
    "bench_board.receipts": OptionLook("FILE"),
    "revealed": OptionLook("DIR"),
    "bench_seal.key": OptionLook("FILE"),
    "bench_reveal.key": OptionLook("FILE"),
    "bench_reveal.tasks": OptionLook("[TASK…]", argument=True, complete=complete_tasks),
    "files": OptionLook("FILE…", argument=True, complete=complete_scenarios),
    "show": OptionLook("NAME"),
    "copy": FOLDER,
    "paper.name": OptionLook("[NAME]", argument=True, complete=complete_papers),
    "by": OptionLook("service|episode|user|group|outcome"),
    "root": OptionLook("[DIR]", argument=True),
    "run_dir": RUN,
    "beside": RUN._replace(metavar="RUN_DIR2"),
    "html": OptionLook("FILE"),
    "write_replay.episodes": OptionLook("0-9"),
    "write_report.runs": RUN._replace(metavar="RUN_DIR…"),
    "write_report.out": OptionLook("FILE.html"),
    "film.run": RUN,
    "plot.episode": OptionLook("N"),
    "write_levels.out": OptionLook("FILE", flags=("-o", "--out")),
    "user": OptionLook("U"),
    "every_s": OptionLook("S"),
    "at_s": OptionLook("T"),
    "title": OptionLook("TITLE"),
    "kind": OptionLook("KIND", argument=True),
    "runs": RUN._replace(metavar="RUN…"),
    "plot.out": OptionLook("FILE", flags=("-o", "--out")),
    "minute": OptionLook("M"),
    "drone": OptionLook("D"),
    "level": OptionLook("K"),
    "at": OptionLook("X,Y"),
    "measure": OptionLook("NAME"),
    "key": OptionLook("KEY[=VALUE]"),
}


def look_of(verb: str, name: str) -> OptionLook:
    """Return the look of a parameter of a verb."""
    return LOOKS.get(f"{verb}.{name}", LOOKS.get(name, OptionLook()))


def flags_of(verb: str, name: str) -> tuple[str, ...]:
    """Return the flags of an option, the short one first if it has one."""
    return look_of(verb, name).flags or (f"--{name.replace('_', '-')}",)
