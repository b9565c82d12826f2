"""Steps a second of the environments, beside mobile-env and PettingZoo's simple_spread, in one run.

    pip install mobile-env mpe2          (or into an environment of their own, and then)
    python benchmarks/peers.py [--peer-python /path/to/its/bin/python] [--rounds 7] [--seconds 2]

A step is one parallel step of all agents: of mobile-env's medium central scenario (15 users, 7
stations), of mpe2's simple_spread with 3 agents, and of cases 1 and 8, each drone an agent, on the
SimPy engine; and of case 8 as one Gymnasium environment in the compiled engine. Resets
count as time, not as steps. Actions are random, from numbers drawn before the clock starts; ours
have to be looked up in each step's masks, which counts. Each environment has a process of its own;
the rounds go from one to the next, so that whatever else the machine does meets all.
CPU time; median of the rounds.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import random
import statistics
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from importlib.metadata import version
from itertools import cycle
from typing import Any

Steps = Callable[[int], None]
"""Takes so many steps, with a reset wherever an episode ends."""

TARGETS = [
    ("case8", "mobile-env", 10),
    ("case8", "simple_spread", None),
    ("case1", "simple_spread", None),
    ("case8 compiled", "simple_spread", None),
]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--peer-python", default=sys.executable, help="interpreter of the peers")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each measurement, about")
    parser.add_argument("--work", choices=ENVIRONMENTS, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.work:
        work(args.work, args.seconds)
    else:
        compare(args.peer_python, args.rounds, args.seconds)


def compare(peer_python: str, rounds: int, seconds: float) -> None:
    """Ask a process for each environment, in turn, how fast it is; print what they say."""
    workers = {}
    for name in ENVIRONMENTS:
        python = sys.executable if name.startswith("case") else peer_python
        command = [python, __file__, "--work", name, "--seconds", str(seconds)]
        variables = {**os.environ, "PYGAME_HIDE_SUPPORT_PROMPT": "1"}
        workers[name] = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=variables
        )
    described = {name: _answer(worker) for name, worker in workers.items()}
    rates: dict[str, list[float]] = {name: [] for name in workers}
    for _ in range(rounds):
        for name, worker in workers.items():
            print("go", file=worker.stdin, flush=True)
            rates[name].append(_answer(worker))
    for worker in workers.values():
        worker.communicate()
    medians = {name: statistics.median(rates[name]) for name in rates}
    print(f"{'':15}{'steps/s':>10}{'lowest':>10}{'highest':>10}   imported")
    for name, median in medians.items():
        low, high = min(rates[name]), max(rates[name])
        print(f"{name:15}{median:10.0f}{low:10.0f}{high:10.0f}   {described[name]}")
    for ours, theirs, target in TARGETS:
        ratio = medians[ours] / medians[theirs]
        print(f"{ours} / {theirs}: {ratio:.1f}" + (f" (aim: {target})" if target else ""))


def _answer(worker: subprocess.Popen[str]) -> Any:
    line = worker.stdout.readline() if worker.stdout else ""
    if not line:
        raise SystemExit(f"{' '.join(map(str, worker.args))} failed; is it installed there?")
    return json.loads(line)


def work(name: str, seconds: float) -> None:
    """Say what was imported; then a number of steps a second for each line that is read."""
    warnings.filterwarnings("ignore")
    steps, packages = ENVIRONMENTS[name]()
    versions = ", ".join(f"{package} {version(package)}" for package in packages)
    count = 100
    steps(count)  # whatever is loaded or compiled at first
    elapsed = _elapsed_s(steps, count)
    while elapsed < seconds / 4:
        count *= 2
        elapsed = _elapsed_s(steps, count)
    count = max(1, round(count * seconds / elapsed))
    print(json.dumps(f"{versions}, Python {platform.python_version()}"), flush=True)
    for _ in sys.stdin:
        print(json.dumps(count / _elapsed_s(steps, count)), flush=True)


def _elapsed_s(steps: Steps, count: int) -> float:
    start = time.process_time()
    steps(count)
    return time.process_time() - start


# ---- the environments


def ours(case: str) -> tuple[Steps, list[str]]:
    from desim_uav.env import UavParallelEnv

    env = UavParallelEnv(case, engine="des")
    rng = random.Random(0)
    drawn = cycle([rng.random() for _ in range(10_000)])
    allowed: dict[bytes, list[int]] = {}
    seen, _ = env.reset(seed=0)

    def choice(mask: Any) -> int:
        key = mask.tobytes()
        actions = allowed.get(key)
        if actions is None:
            actions = allowed[key] = mask.nonzero()[0].tolist()
        return actions[int(next(drawn) * len(actions))]

    def steps(count: int) -> None:
        nonlocal seen
        for _ in range(count):
            if not env.agents:
                seen, _ = env.reset()
            actions = {agent: choice(one["action_mask"]) for agent, one in seen.items()}
            seen, *_ = env.step(actions)

    return steps, ["desim-uav", "numpy", "numba"]


def compiled(case: str) -> tuple[Steps, list[str]]:
    from desim_uav.env import UavEnv

    env = UavEnv(case, engine="batch")
    rng = random.Random(0)
    drawn = cycle([rng.random() for _ in range(10_000)])
    drones = env.drones
    allowed: dict[bytes, list[int]] = {}
    over, mask = True, b""
    width = 0

    def choices() -> list[int]:
        actions = []
        for first in range(0, drones * width, width):
            own = mask[first : first + width]
            if own not in allowed:
                allowed[own] = [k for k, legal in enumerate(own) if legal]
            actions.append(allowed[own][int(next(drawn) * len(allowed[own]))])
        return actions

    def steps(count: int) -> None:
        nonlocal over, mask, width
        for _ in range(count):
            if over:
                _, info = env.reset(seed=None if width else 0)
                mask = info["action_mask"].tobytes()
                width = len(mask) // drones
            _, _, terminated, truncated, info = env.step(choices())
            over, mask = terminated or truncated, info["action_mask"].tobytes()

    return steps, ["desim-uav", "numpy", "numba"]


def mobile_env(scenario: str = "mobile-medium-central-v0") -> tuple[Steps, list[str]]:
    import gymnasium
    import mobile_env  # noqa: F401

    env = gymnasium.make(scenario).unwrapped  # no checks at each step
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = cycle([env.action_space.sample() for _ in range(1000)])

    def steps(count: int) -> None:
        for _ in range(count):
            _, _, terminated, truncated, _ = env.step(next(actions))
            if terminated or truncated:
                env.reset()

    return steps, ["mobile-env", "numpy", "gymnasium"]


def simple_spread() -> tuple[Steps, list[str]]:
    from mpe2 import simple_spread_v3

    env = simple_spread_v3.parallel_env(N=3)
    env.reset(seed=0)
    spaces = {agent: env.action_space(agent) for agent in env.possible_agents}
    for index, space in enumerate(spaces.values()):
        space.seed(index)
    drawn = [{agent: space.sample() for agent, space in spaces.items()} for _ in range(1000)]
    actions = cycle(drawn)

    def steps(count: int) -> None:
        for _ in range(count):
            if not env.agents:
                env.reset()
            env.step(next(actions))

    return steps, ["mpe2", "pettingzoo", "numpy"]


ENVIRONMENTS: dict[str, Callable[[], tuple[Steps, list[str]]]] = {
    "case1": lambda: ours("case1"),
    "case8": lambda: ours("case8"),
    "case8 compiled": lambda: compiled("case8"),
    "mobile-env": mobile_env,
    "simple_spread": simple_spread,
}

if __name__ == "__main__":
    main()
