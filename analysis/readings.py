"""What other readings of the paper do to the nine cases, as a Markdown table.

python analysis/readings.py [--learned] [CASE…]

It has QoE1 to QoE3, the share of users covered at least once, the crashes per drone and episode,
and the reward of the baseline under each reading. With --learned it has drones that learned from
the rewards under each reading by Q-learning, beside those of analysis/paper/rows.csv; that takes
some minutes. All figures are means over the seeds 100 to 109, each with 20 episodes after 2 of
warm-up. Differences of QoE1 and QoE3 are from the case as it is, in percentage points, paired by
seed, with 95 % intervals.
"""

import sys
from pathlib import Path

import pandas as pd
from script import row

import desim_uav as du
from desim_uav.experiment.evaluate import evaluate
from desim_uav.experiment.reproduce import EPISODES, FIRST_SEED, WARMUP
from desim_uav.experiment.statistics import paired
from desim_uav.experiment.train.course import train
from desim_uav.policies.tabular import Greedy
from desim_uav.scenario.load import to_plain

SEEDS = range(FIRST_SEED, FIRST_SEED + 10)
PAPER = Path(__file__).parent / "paper" / "rows.csv"
FLIGHT = {
    "drones.motion.return_timing": "fill_epoch",
    "drones.battery.kind": "per_action",
    "stations.placement": "equidistant",
}
REWARD = {"reward.capped": False, "reward.served_only": False}
MEASURES = ["qoe1_percent", "qoe2_iterations", "qoe3_percent"]
CRASHES = "crashes_per_drone_episode"


def main(cases, learned):
    """Print the table of the baseline, or that of the learners."""
    headings = ["case", "reading", "QoE1 %", "difference", "QoE2 steps", "QoE3 %", "difference"]
    headings += ["crashes"] if learned else ["covered once %", "crashes", "reward"]
    print(row(headings), row(["---"] * len(headings)), sep="\n")
    for case in cases:
        for line in of_learners(case) if learned else of_baseline(case):
            print(line, flush=True)


def readings(case, keys):
    """Yield the scenario as it is and under each reading that says something about it."""
    yield "as it is", du.load(f"case{case}")
    plain = to_plain(du.load(f"case{case}"))
    for key, value in keys.items():
        section, *_, name = key.split(".")
        limited = plain["drones"]["battery"] is not None
        if limited if section != "reward" else name in plain["reward"]:
            yield f"`{name}: {str(value).lower()}`", du.load(f"case{case}", {key: value})


def of_baseline(case):
    """Yield the lines of a case."""
    kept = None
    for name, scenario in readings(case, FLIGHT | REWARD):
        flown = {"seeds": SEEDS, "episodes": EPISODES, "warmup": WARMUP}
        runs = du.run(scenario, **flown, engine="batch", progress=False)
        found, by_seed = runs.qoe(), runs.qoe("seed")
        kept = by_seed if kept is None else kept
        crashes = found["crashes"] / (EPISODES * scenario.drone_count)
        cells = [f"{runs.covered_once().mean():.1f}", f"{crashes:.3f}"]
        cells = [*shown(found, by_seed, kept), *cells, f"{found['reward_mean']:.2f}"]
        yield row([case, name, *cells])


def of_learners(case):
    """Yield the lines of a case: that of the paper's table, and one of a training per reading."""
    asked = f"case == {case} and preset == 'default' and policy == 'q_learning'"
    kept = pd.read_csv(PAPER).query(asked).set_index("seed").loc[list(SEEDS)]
    for name, scenario in readings(case, REWARD):
        learned = (evaluated(scenario, seed) for seed in SEEDS)
        by_seed = kept if name == "as it is" else pd.DataFrame(learned)
        found = by_seed[[*MEASURES, CRASHES]].mean()
        yield row([case, name, *shown(found, by_seed, kept), f"{found[CRASHES]:.3f}"])


def evaluated(scenario, seed):
    """Train in the world of a seed and return the measures of the greedy policy."""
    scenario = scenario.model_copy(update={"seed": seed})
    table, _ = train(scenario, engine="batch")
    return evaluate(scenario, Greedy.of_table(table, "learned"), seed, EPISODES, WARMUP, "batch")


def shown(found, by_seed, kept):
    """Return QoE1 to QoE3 as text, with what QoE1 and QoE3 are more than in the case as it is."""
    qoe1, qoe2, qoe3 = (f"{found[name]:.1f}" for name in MEASURES)
    more1, _, more3 = (f"{paired(by_seed[name], kept[name]):.1f}" for name in MEASURES)
    return [qoe1, more1, qoe2, qoe3, more3]


if __name__ == "__main__":
    given = sys.argv[1:]
    chosen = [int(case) for case in given if case != "--learned"]
    main(chosen or range(1, 10), "--learned" in given)
