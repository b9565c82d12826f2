"""Does one version of policies/ppo.py learn as well as another, and in how much less time?

    git show COMMIT:policies/ppo.py > before.py
    python analysis/ppo_curves.py before.py policies/ppo.py --out runs/ppo_curves

Trains in world 0 of case 8 with each file in turn, for each of some seeds, and saves the network
after each quarter of the steps. Each network is run on the same seeds, which no training uses. The
tables have the processor time of the trainings, and the means over trainings of QoE1, QoE3 and
crashes after each quarter, with 95 % t-intervals of the difference from the first file. What is
in the folder already, of the same text and options, is not made again.
"""

import argparse
import hashlib
import importlib.util
import json
import os
import sys
import time
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as policies/ppo.py does
import numpy as np
from script import row

import desim_uav as du
from desim_uav.errors import DesimError, UsageError, require_within
from desim_uav.experiment.statistics import estimate, paired
from desim_uav.scenario.load import load
from desim_uav.shipped import find_scenario

SETTINGS = ("world_seed=0", "episode.steps=120", "reward={kind: qoe, w1: 0.5, crash: 15}")
"""Those of the trainings in docs/howto/ppo.md."""

MEASURES = ("qoe1_percent", "qoe3_percent", "crashes")
FIRST_SEED, SEEDS = 9400, 8
EPISODES, WARMUP = 10, 2
ROLLOUT = 6144
"""The steps of all drones between two updates."""


def trained(program, folder, seed, steps, central):
    """Train, save the network after each quarter of the steps, and return the processor time."""
    spec = importlib.util.spec_from_file_location("ppo_of_a_version", program)
    ppo = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(ppo)
    scenario = load(find_scenario("case8"), [*ppo.DEFAULTS, *SETTINGS])
    left = [1, 2, 3, 4]

    def save(network):
        done = network.about["training"]["steps_done"]
        if left and done >= left[0] * steps // 4 - ROLLOUT:
            (folder / f"{left.pop(0)}.npz").write_bytes(network.to_bytes())

    ppo.train(scenario, ppo.options_of(steps=1, seed=seed, central=central))  # loads the engine
    since_s = time.process_time()
    ppo.train(scenario, ppo.options_of(steps=steps, seed=seed, central=central), save)
    return time.process_time() - since_s


def measured(network):
    """Return the means of the measures of a network over the seeds of the evaluation."""
    those = {"seeds": SEEDS, "first_seed": FIRST_SEED, "world_seed": 0, "progress": False}
    lengths = {"episodes": EPISODES, "warmup": WARMUP, "engine": "batch"}
    rows = du.run("case8", policy=str(network), **those, **lengths).summaries()
    return {name: float(np.mean([one[name] for one in rows])) for name in MEASURES}


def kept(place, made):
    """Return what is in a file, or else what ``made`` returns, which is kept there."""
    if not place.exists():
        place.write_text(json.dumps(made()))
    return json.loads(place.read_text())


def folder_of(program, asked):
    """The folder of a program's trainings, whose name depends on its text and on all options."""
    options = (asked.steps, asked.central, SETTINGS, FIRST_SEED, SEEDS, EPISODES, WARMUP)
    text = program.read_bytes() + repr(options).encode()
    return asked.out / f"{program.stem}-{hashlib.sha256(text).hexdigest()[:12]}"


def main():
    """Train and measure what is missing, and print the tables; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("programs", nargs="+", type=Path, help="versions of policies/ppo.py")
    parser.add_argument("--seeds", type=int, default=5, help="trainings of each version")
    parser.add_argument("--first-seed", type=int, default=0, help="of the trainings")
    parser.add_argument("--steps", type=int, default=1_200_000, help="of all drones together")
    parser.add_argument("--central", action="store_true", help="a critic that sees all (MAPPO)")
    parser.add_argument("--out", type=Path, required=True, help="the folder of the networks")
    try:
        compare(parser.parse_args())
    except DesimError as error:
        print(f"ppo_curves.py: {error}", file=sys.stderr)
        return error.exit_code
    return 0


def compare(asked):
    """Train and measure what is missing, and print the tables. Raises DesimError."""
    require_within(vars(asked), {"seeds": (1, 2**20), "steps": (4 * ROLLOUT, 2**50)})
    for program in asked.programs:
        if not program.is_file():
            raise UsageError(f"{program}: no such file")
    folders = {program: folder_of(program, asked) for program in asked.programs}
    spent_s, curves = ({program: [] for program in folders} for _ in range(2))
    for seed in range(asked.first_seed, asked.first_seed + asked.seeds):
        for program, place in folders.items():
            folder = place / str(seed)
            folder.mkdir(parents=True, exist_ok=True)
            training = partial(trained, program, folder, seed, asked.steps, asked.central)
            spent_s[program].append(kept(folder / "spent_s.json", training))
            curve = []
            for quarter in range(1, 5):
                network = folder / f"{quarter}.npz"
                curve.append(kept(folder / f"{quarter}.json", partial(measured, network)))
            curves[program].append(curve)
            last = ", ".join(f"{name} {curve[-1][name]:.2f}" for name in MEASURES)
            print(f"{program} {seed}: {spent_s[program][-1]:.0f} s, {last}", file=sys.stderr)
    table_of_times(spent_s, asked.steps)
    table_of_curves(curves, asked.steps)


def table_of_times(spent_s, steps):
    """Print the steps per second of processor time, and how many times those of the first file."""
    first = np.array(next(iter(spent_s.values())))
    print(row(("version", "steps per CPU-second", "times the first")))
    print(row(["---"] * 3))
    for program, those in spent_s.items():
        speed = estimate(steps / np.array(those))
        print(row((program, f"{speed:.0f}", f"{estimate(first / np.array(those)):.2f}")))


def table_of_curves(curves, steps):
    """Print the means after each quarter, and the differences from the first file."""
    reference = next(iter(curves.values()))
    print()
    print(row(("version", "steps", *(cell for name in MEASURES for cell in (name, "difference")))))
    print(row(["---"] * (2 + 2 * len(MEASURES))))
    for program, curve in curves.items():
        for quarter in range(4):
            cells = []
            for name in MEASURES:
                mine, theirs = ([one[quarter][name] for one in of] for of in (curve, reference))
                minus = "" if curve is reference else f"{paired(mine, theirs):.2f}"
                cells += [f"{estimate(mine):.2f}", minus]
            print(row((program, f"{(quarter + 1) * steps // 4:,}", *cells)))


if __name__ == "__main__":
    sys.exit(main())
