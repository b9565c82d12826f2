"""What each reward does to the quality of experience, as a Markdown table.

python analysis/rewards.py [--first-seed N] [--seeds N] [--against NAME] [CASE…] [NAME={kind: …}…]

In each case (4 and 8 unless told otherwise) drones learn from each reward by Q-learning with the
default training, one training per seed in the world of that seed (5 seeds from 9000 on unless told
otherwise). The table has QoE1, QoE3 and the crashes per drone and episode of what they have
learned, over 20 episodes after 2 of warm-up: means over the seeds, and differences to the case's
own reward or another one, paired by seed, with 95 % intervals. The baseline, which does not learn,
is beside them. Further rewards are given by a name and their YAML, for instance
'own={kind: "careful:Careful"}'.
"""

import argparse

import yaml
from script import count, row

import desim_uav as du
from desim_uav.experiment.evaluate import evaluate
from desim_uav.experiment.reproduce import EPISODES, WARMUP
from desim_uav.experiment.statistics import estimate, paired
from desim_uav.experiment.train.course import train
from desim_uav.policies.tabular import Greedy
from desim_uav.scenario.description import described

REWARDS = {
    "R1": {"kind": "coverage"},
    "R2": {"kind": "coverage_battery"},
    "R3": {"kind": "multi_service"},
    "qoe, crash 0": {"kind": "qoe", "crash": 0.0},
    "qoe, crash 0, no difference": {"kind": "qoe", "crash": 0.0, "difference": False},
    "qoe, crash 3": {"kind": "qoe", "crash": 3.0},
    "qoe": {"kind": "qoe"},
    "qoe, QoE3 only": {"kind": "qoe", "w1": 0.0},
}
MEASURES = ("qoe1_percent", "qoe3_percent", "crashes_per_drone_episode")
HEADINGS = ("case", "reward", "QoE1 %", "difference", "QoE3 %", "difference", "crashes")
FIRST_SEED = 9000
"""No default of the training was chosen by looking at this seed or a later one.

The price of a crash in ``qoe`` was chosen on the seeds 9000 to 9009.
"""


def main(cases, seeds, rewards, against):
    """Print the table."""
    print(row(HEADINGS), row(["---"] * len(HEADINGS)), sep="\n")
    for case in cases:
        own = described(du.load(case).reward)["kind"]
        name = against or next(name for name, keys in REWARDS.items() if keys["kind"] == own)
        ordered = {name: rewards[name], **rewards}
        kept = None
        for name, keys in ordered.items():
            found = [learned(case, seed, keys) for seed in seeds]
            kept = kept or found
            print(line(case, name, found, kept), flush=True)
        print(line(case, "baseline", [flown(case, seed) for seed in seeds], kept), flush=True)


def learned(case, seed, reward):
    """Train with a reward in the world of a seed; return the measures of the greedy policy."""
    scenario = du.load(case, {"seed": seed, "reward": reward})
    table, _ = train(scenario, engine="batch")
    return evaluate(scenario, Greedy.of_table(table, "learned"), seed, EPISODES, WARMUP, "batch")


def flown(case, seed):
    """Return the measures of the baseline in the world of a seed."""
    return evaluate(du.load(case, {"seed": seed}), "baseline", seed, EPISODES, WARMUP, "batch")


def line(case, name, found, kept):
    """Return the row of a reward from its measures of each seed, and those to compare with."""
    columns = [[one[measure] for one in found] for measure in MEASURES]
    others = [[one[measure] for one in kept] for measure in MEASURES]
    cells = [case.removeprefix("case"), name]
    for column, other in zip(columns[:2], others[:2], strict=True):
        cells += [f"{estimate(column).mean:.1f}", difference(paired(column, other))]
    return row([*cells, f"{estimate(columns[2]):.3f}"])


def difference(found):
    """Return a paired difference and its interval as text, the latter if there are two seeds."""
    interval = "" if found.half_width is None else f" ± {found.half_width:.1f}"
    return f"{found.mean:+.1f}{interval}"


def arguments():
    """Return the cases, the seeds and the rewards that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED, help="the first seed")
    parser.add_argument("--seeds", type=count(), default=5, help="how many seeds")
    parser.add_argument("--against", choices=REWARDS, help="the reward of the differences")
    parser.add_argument("asked", nargs="*", help="cases, and rewards as NAME={kind: …}")
    given = parser.parse_intermixed_args()
    cases = [f"case{text}" for text in given.asked if "=" not in text] or ["case4", "case8"]
    pairs = (text.split("=", 1) for text in given.asked if "=" in text)
    own = {name: yaml.safe_load(text) for name, text in pairs}
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    return cases, seeds, REWARDS | own, given.against


if __name__ == "__main__":
    main(*arguments())
