"""Steps a second of compiled training, beside SimPy training and other environments, in one run.

    pip install mobile-env mpe2 vmas     (or into environments of their own, and then)
    python benchmarks/fused.py [--peer-python /path/to/a/bin/python] [--vmas-python /path/to/one]
                               [--rounds 7] [--seconds 2]

A step is one parallel step of all agents, draws and resets count as time. Ours learn in it:
independent Q-learners, compiled and with SimPy, both from the episodes FIRST to LAST of one
training, again and again. The others only step, with random actions drawn before the clock starts:
mobile-env and mpe2's simple_spread as in peers.py, VMAS's simple_spread with 1,024 environments at
once, whose episodes are as long as mpe2's; one step of one of them is a step.

Each has a process of its own and one thread; the rounds go from one to the next, so that whatever
else the machine does meets all. CPU time; medians of the rounds. Then, in wall time, two trainings
of case 8 in two threads, and in two processes (what the machine has to give), beside one.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from itertools import cycle
from typing import Any

from peers import Steps, mobile_env, simple_spread

Block = Callable[[], int]
"""Takes some steps; their number."""
Runner = Callable[[], tuple[Block, list[str]]]
"""Prepares what is measured; with the packages that it has imported."""
Rates = dict[str, list[float]]
"""Steps a second, round by round."""

FIRST, LAST = 1000, 2000
TOGETHER, VMAS_ENVS, VMAS_STEPS = "threads", 1024, 25
PINNED = dict.fromkeys(
    (
        *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"),
        *("NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMEXPR_NUM_THREADS"),
    ),
    "1",
)
AIMS = [
    ("case 8", "mobile-env", 1000),
    ("case 8", "case 8 SimPy", 10),
    ("case 8", "VMAS", 0.45),
    ("case 1", "case 1 SimPy", 30),
]
TWO_THREADS_AIM = 1.7


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--peer-python", default=sys.executable, help="has mobile-env and mpe2")
    parser.add_argument("--vmas-python", default=sys.executable, help="has vmas")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each measurement")
    parser.add_argument("--work", choices=[*RUNNERS, TOGETHER], help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.work == TOGETHER:
        work_in_threads(args.seconds)
    elif args.work:
        work(RUNNERS[args.work], args.seconds)
    else:
        pythons = {"mobile-env": args.peer_python, "simple_spread": args.peer_python}
        compare({**pythons, "VMAS": args.vmas_python}, args.rounds, args.seconds)
        compare_threads(args.rounds, args.seconds)


def compare(pythons: dict[str, str], rounds: int, seconds: float) -> None:
    """Print how fast each is, and the ratios."""
    medians = measured(list(RUNNERS), pythons, rounds, seconds)
    for ours, theirs, aim in AIMS:
        print(f"{ours} / {theirs}: {medians[ours] / medians[theirs]:.3g} (aim: {aim})")


def measured(
    names: list[str],
    pythons: dict[str, str],
    rounds: int,
    seconds: float,
    file: str = __file__,
    width: int = 15,
) -> dict[str, float]:
    """Ask a process for each, in turn, how fast it is; print what they say; the medians."""
    workers, described = {}, {}
    for name in names:
        workers[name] = started(pythons.get(name, sys.executable), name, seconds, file)
        described[name] = answer(workers[name])
    rates: Rates = {name: [] for name in workers}
    for _ in range(rounds):
        for name, worker in workers.items():
            ask(worker, 1)
            rates[name].append(answer(worker))
    for worker in workers.values():
        worker.communicate()
    return told(rates, described, width)


def compare_threads(rounds: int, seconds: float) -> None:
    """Two trainings at once, in threads of one process and in processes, beside one."""
    first, second = (started(sys.executable, TOGETHER, seconds) for _ in range(2))
    for worker in (first, second):
        answer(worker)
    rates: Rates = {name: [] for name in ("one", "two threads", "two processes")}
    for _ in range(rounds):
        for count, name in enumerate(["one", "two threads"], 1):
            ask(first, count)
            rates[name].append(answer(first))
        for worker in (first, second):
            ask(worker, 1)
        rates["two processes"].append(answer(first) + answer(second))
    for worker in (first, second):
        worker.communicate()
    print("\ncase 8, wall time")
    medians = told(rates)
    one, threads, processes = medians.values()
    print(f"two threads / one: {threads / one:.2f} (aim: {TWO_THREADS_AIM})")
    print(f"two processes / one: {processes / one:.2f}; near 2 on a machine that is free")


def told(
    rates: Rates, described: dict[str, str] | None = None, width: int = 15
) -> dict[str, float]:
    """Print a table, with what each is; the medians."""
    described = described or dict.fromkeys(rates, "")
    medians = {name: statistics.median(rates[name]) for name in rates}
    print(f"{'':{width}}{'steps/s':>10}{'lowest':>10}{'highest':>10}")
    for name, median in medians.items():
        low, high = min(rates[name]), max(rates[name])
        print(f"{name:{width}}{median:10.0f}{low:10.0f}{high:10.0f}   {described[name]}".rstrip())
    return medians


# ---- processes


def started(python: str, name: str, seconds: float, file: str = __file__) -> subprocess.Popen[str]:
    command = [python, file, "--work", name, "--seconds", str(seconds)]
    variables = {**os.environ, **PINNED, "PYGAME_HIDE_SUPPORT_PROMPT": "1"}
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=variables
    )


def ask(worker: subprocess.Popen[str], threads: int) -> None:
    print(threads, file=worker.stdin, flush=True)


def answer(worker: subprocess.Popen[str]) -> Any:
    line = worker.stdout.readline() if worker.stdout else ""
    if not line:
        raise SystemExit(f"{worker.args!r} failed; is it installed there?")
    return json.loads(line)


def work(runner: Runner, seconds: float) -> None:
    """Say what was imported; then a number of steps a second for each line that is read."""
    warnings.filterwarnings("ignore")
    block, packages = runner()
    rate(block, seconds / 4, time.process_time)
    versions = ", ".join(f"{package} {version(package)}" for package in packages)
    print(json.dumps(f"{versions}, Python {platform.python_version()}"), flush=True)
    for _ in sys.stdin:
        print(json.dumps(rate(block, seconds, time.process_time)), flush=True)


def work_in_threads(seconds: float) -> None:
    """The same by wall time, with as many trainings at once as the line says."""
    blocks = [training("case8", "batch", seed)[0] for seed in range(2)]

    def one(block: Block) -> float:
        return rate(block, seconds, time.perf_counter)

    with ThreadPoolExecutor(len(blocks)) as pool:
        list(pool.map(one, blocks))
        print(json.dumps(""), flush=True)
        for line in sys.stdin:
            print(json.dumps(sum(pool.map(one, blocks[: int(line)]))), flush=True)


def rate(block: Block, seconds: float, clock: Callable[[], float]) -> float:
    """Steps a second in about so many seconds."""
    taken, start = 0, clock()
    while clock() < start + seconds:
        taken += block()
    return taken / (clock() - start)


# ---- what is measured


def training(
    case: str, engine: str, seed: int = 0, changes: Sequence[str] = ()
) -> tuple[Block, list[str]]:
    from desim_uav.learning.training import Training
    from desim_uav.scenario.load import load
    from desim_uav.shipped import scenario_path
    from desim_uav.world import build_world

    world = build_world(load(scenario_path(case), changes), 0)
    learned = Training(world, seed, "batch")
    while learned.episode < FIRST:
        learned.play(FIRST - learned.episode)
    memory = learned.remember()
    measured = Training(world, seed, engine)
    measured.recall(memory)

    def block() -> int:
        if measured.episode == LAST:
            measured.recall(memory)
        rows = measured.play(LAST - measured.episode)
        return len(rows) // len(measured.learners) * world.scenario.episode.steps

    return block, ["desim-uav", "numpy", "numba"]


def in_blocks(peer: tuple[Steps, list[str]]) -> tuple[Block, list[str]]:
    """A peer of peers.py."""
    steps, packages = peer

    def block() -> int:
        steps(10)
        return 10

    return block, packages


def vmas() -> tuple[Block, list[str]]:
    import torch
    from vmas import make_env

    torch.set_num_threads(1)
    env = make_env(
        "simple_spread", num_envs=VMAS_ENVS, device="cpu", seed=0, max_steps=VMAS_STEPS, n_agents=3
    )
    drawn = [[env.get_random_action(agent) for agent in env.agents] for _ in range(100)]
    actions = cycle(drawn)

    def block() -> int:
        _, _, done, _ = env.step(next(actions))
        if done[0]:  # only their time ends them, and they began together
            env.reset()
        return VMAS_ENVS

    return block, ["vmas", "torch"]


RUNNERS: dict[str, Runner] = {
    "case 1": lambda: training("case1", "batch"),
    "case 8": lambda: training("case8", "batch"),
    "case 1 SimPy": lambda: training("case1", "des"),
    "case 8 SimPy": lambda: training("case8", "des"),
    "mobile-env": lambda: in_blocks(mobile_env()),
    "simple_spread": lambda: in_blocks(simple_spread()),
    "VMAS": vmas,
}

if __name__ == "__main__":
    main()
