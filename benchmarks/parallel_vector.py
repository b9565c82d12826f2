"""Steps a second of ``UavParallelVectorEnv``, beside mobile-env and simple_spread, in one run.

    pip install mobile-env mpe2          (or into an environment of their own, and then)
    python benchmarks/parallel_vector.py [--peer-python /path/to/a/bin/python]
                                         [--case case8] [--rounds 7] [--seconds 2]

A step is one step of all agents of one environment. Ours is UavParallelVectorEnv of the case with
1,024 environments, which begin their next episodes in the step after the end (NEXT_STEP); resets
with all draws count as time, not as steps, and so does the choice of a random allowed action for
each drone, from numbers drawn before the clock starts. The same with ``copy=True``, with the worlds
of "train" (after WARM_UP steps, in which most of them are drawn), and with 64 environments. The
others are mobile-env's medium scenario and mpe2's simple_spread, with random
actions, as in peers.py.

Each has a process of its own and one thread; the rounds go from one to the next, so that whatever
else the machine does meets all. CPU time; medians of the rounds. Then the share of the time that is
not spent in compiled code, and the share that is serial: outside the tasks that threads share. Then
two threads beside one: in wall time, with two processes for what the machine has to give, and in
CPU time, where the time of two threads is the serial time plus the time in tasks of the busier one
of the two. The latter depends less on what else the machine does; but a thread that is interrupted
leaves more tasks to the other one.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import threading
import time
from itertools import cycle
from typing import Any

import fused
from fused import Block, answer, ask, in_blocks, rate, started, told
from peers import mobile_env, simple_spread

ENVS, FEW = 1024, 64
AIMS = [("1,024 views", "mobile-env", 300), ("1,024 views", "simple_spread", 15)]
TWO_THREADS_AIM = 1.7
THREADS, SHARE = "threads", "share"
PEERS = {
    "mobile-env": lambda: in_blocks(mobile_env()),
    "simple_spread": lambda: in_blocks(simple_spread()),
}
NAMES = ["1,024 views", "1,024 copies", "1,024 train", "64 views", *PEERS]
WARM_UP = 31 * 5


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--peer-python", default=sys.executable, help="has mobile-env and mpe2")
    parser.add_argument("--case", default="case8", help="the scenario")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each measurement")
    parser.add_argument("--work", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.work:
        name, case = args.work.rsplit("@", 1)
        work(name, case, args.seconds)
        return
    compare(args.case, args.peer_python, args.rounds, args.seconds)
    compare_threads(args.case, args.rounds, args.seconds)


def compare(case: str, peer_python: str, rounds: int, seconds: float) -> None:
    """Print how fast each is, the ratios, and the share of compiled code."""
    names = [f"{name}@{case}" for name in NAMES]
    pythons = {f"{name}@{case}": peer_python for name in PEERS}
    medians = fused.measured(names, pythons, rounds, seconds, __file__, 22)
    for ours, theirs, aim in AIMS:
        ratio = medians[f"{ours}@{case}"] / medians[f"{theirs}@{case}"]
        print(f"{ours} / {theirs}: {ratio:.3g} (aim: {aim})")
    worker = started(sys.executable, f"{SHARE}@{case}", seconds, __file__)
    python, serial = answer(worker)
    worker.communicate()
    print(f"1,024 views, not in compiled code: {python:.1%} of the CPU time; serial: {serial:.1%}")


def compare_threads(case: str, rounds: int, seconds: float) -> None:
    """The environments in one thread and in two; and two processes with one thread each."""
    workers = [started(sys.executable, f"{THREADS}@{case}", seconds, __file__) for _ in range(2)]
    for worker in workers:
        answer(worker)
    wall: fused.Rates = {name: [] for name in ("one thread", "two threads", "two processes")}
    cpu: fused.Rates = {name: [] for name in ("one thread", "two threads")}
    for _ in range(rounds):
        for threads, name in enumerate(cpu, 1):
            ask(workers[0], threads)
            by_wall, by_cpu = answer(workers[0])
            wall[name].append(by_wall)
            cpu[name].append(by_cpu)
        for worker in workers:
            ask(worker, 1)
        wall["two processes"].append(sum(answer(worker)[0] for worker in workers))
    for worker in workers:
        worker.communicate()
    print(f"\n{case}, 1,024 environments, wall time")
    one, two, processes = told(wall).values()
    print(f"two threads / one: {two / one:.2f} (aim: {TWO_THREADS_AIM})")
    print(f"two processes / one: {processes / one:.2f}; near 2 on a machine that is free")
    print("\nserial CPU time, and that in tasks of the busier thread")
    one, two = told(cpu).values()
    print(f"two threads / one: {two / one:.2f} (aim: {TWO_THREADS_AIM})")


def work(name: str, case: str, seconds: float) -> None:
    """Answer each line that is read with a number of steps a second."""
    if name == THREADS:
        work_in_threads(case, seconds)
    elif name == SHARE:
        print(json.dumps(shares_of_time(case, seconds)), flush=True)
    else:
        makers = {
            "1,024 views": lambda: ours(case, ENVS, False),
            "1,024 copies": lambda: ours(case, ENVS, True),
            "1,024 train": lambda: in_worlds(case),
            "64 views": lambda: ours(case, FEW, False),
        }
        fused.work({**makers, **PEERS}[name], seconds)


def work_in_threads(case: str, seconds: float) -> None:
    """The same for as many threads as the line says, by wall time and by CPU time."""
    from desim_uav.env import many

    busy: dict[int, float] = {}
    work: Any = many.work_off

    def timed(tasks: Any) -> int:
        start = time.thread_time()
        stopped: int = work(tasks)
        own = threading.get_ident()
        busy[own] = busy.get(own, 0.0) + time.thread_time() - start
        return stopped

    many.work_off = timed
    blocks = [ours(case, ENVS, False, threads)[0] for threads in (1, 2)]
    for block in blocks:
        rate(block, seconds / 4, time.perf_counter)
    print(json.dumps(""), flush=True)
    main_thread = threading.get_ident()
    for line in sys.stdin:
        busy.clear()
        taken, start, begun = 0, time.perf_counter(), time.thread_time()
        while time.perf_counter() < start + seconds:
            taken += blocks[int(line) - 1]()
        wall_s, own_s = time.perf_counter() - start, time.thread_time() - begun
        serial_s = own_s - busy[main_thread]
        print(json.dumps([taken / wall_s, taken / (serial_s + max(busy.values()))]), flush=True)


def in_worlds(case: str) -> tuple[Block, list[str]]:
    """Environments whose episodes draw training worlds, of which most have been drawn."""
    block, packages = ours(case, ENVS, False, world_seed="train")
    for _ in range(WARM_UP):
        block()
    return block, packages


def ours(
    case: str, count: int, copied: bool, threads: int = 1, world_seed: Any = 0
) -> tuple[Block, list[str]]:
    """Environments in which random allowed actions are taken, a step of all in each block."""
    import numpy as np

    from desim_uav import UavParallelVectorEnv

    env = UavParallelVectorEnv(case, count, threads=threads, world_seed=world_seed, copy=copied)
    _, infos = env.reset(seed=0)
    rng = np.random.default_rng(0)
    drawn = cycle([rng.random(infos["action_mask"].shape, np.float32) for _ in range(16)])
    begun = np.zeros(count, bool)

    def block() -> int:
        nonlocal infos, begun
        actions = (infos["action_mask"] * next(drawn)).argmax(axis=2)
        _, _, terminated, truncated, infos = env.step(actions)
        steps = count - int(begun.sum())  # the others only began an episode
        begun = terminated[:, 0] | truncated[:, 0]
        return steps

    return block, ["desim-uav", "numpy", "numba"]


def shares_of_time(case: str, seconds: float) -> tuple[float, float]:
    """The shares of the CPU time outside calls of compiled code, and outside the threads' tasks."""
    from desim_uav.engine.compiled import calls, paths
    from desim_uav.env import many

    block, _ = ours(case, ENVS, False)
    spent = {"compiled": 0.0, "tasks": 0.0}

    def timed(function: Any, what: str = "compiled") -> Any:
        def call(*arguments: Any) -> Any:
            start = time.process_time()
            result = function(*arguments)
            spent[what] += time.process_time() - start
            return result

        return call

    rate(block, seconds / 4, time.process_time)
    # Drawing sample paths is compiled but for some microseconds per call.
    calls.step_all, calls.begin_all = timed(calls.step_all), timed(calls.begin_all)
    many.draw_all, paths._copy_parts = timed(many.draw_all), timed(paths._copy_parts)
    many.work_off = timed(many.work_off, "tasks")
    shares: list[list[float]] = []
    for _ in range(5):
        spent.update(compiled=0.0, tasks=0.0)
        start = time.process_time()
        rate(block, seconds, time.process_time)
        passed = time.process_time() - start
        shares.append([1.0 - each / passed for each in spent.values()])
    python, serial = map(statistics.median, zip(*shares, strict=True))
    return python, serial


if __name__ == "__main__":
    main()
