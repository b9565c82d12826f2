"""Are the runs of the benchmark long enough? Episode by episode, and half by half.

python analysis/bench_blocks.py [--halves] [-j 2]

Flies the baseline and two networks in the small multi-service, in 8 of its test worlds, for 48
episodes that are carried over from one to the next. Prints by how much one network is above the
baseline in each episode, and the range of the difference between the networks over blocks of
several lengths, both as the mean of QoE1 and QoE3 in percentage points.

With --halves the submissions of the best two policies in each line of the leaderboard are replayed.
The table has the mean difference of their scores, paired by seed, over the first eight and the last
eight of the 16 episodes, with 95 % intervals.
"""

import argparse
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
from leaderboard import entries
from script import row

import desim_uav as du
from desim_uav.env.tasks import WORLDS
from desim_uav.errors import DesimError, UsageError, printable
from desim_uav.experiment.bench.board import board
from desim_uav.experiment.bench.kept import bound_of, reference_of
from desim_uav.experiment.bench.measure import flown_again, measures
from desim_uav.experiment.bench.score import measures_of, paired, score
from desim_uav.experiment.bench.tasks import EPISODES
from desim_uav.experiment.processes import results_of
from desim_uav.shipped import bench_folder

POLICIES = ("baseline", "ppo_case8_any.npz", "mappo_case8_any.npz")
WORLDS_FLOWN, FLOWN = 8, 48
BLOCKS = (5, 8, 16)
HALVES = (range(EPISODES // 2), range(EPISODES // 2, EPISODES))


def main():
    """Print both tables of the networks, or that of the leaderboard; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--halves", action="store_true", help="replay the leaderboard's best")
    parser.add_argument("-j", dest="jobs", type=int, default=1, help="replays at a time")
    asked = parser.parse_args()
    try:
        if asked.jobs < 1:
            raise UsageError(f"-j {asked.jobs}: must be at least 1")
        halves(asked.jobs) if asked.halves else blocks()
    except DesimError as error:
        print(printable(f"bench_blocks.py: {error}"), file=sys.stderr)
        return error.exit_code
    return 0


def blocks():
    """Print how the networks do by episode, and how they differ in blocks of episodes."""
    first, second = (scores_of(name) - scores_of(POLICIES[0]) for name in POLICIES[1:])
    print(f"{POLICIES[1]} above the baseline, by episode: {first.round(1).tolist()}")
    apart = first - second
    print(f"mean difference of the networks: {apart.mean():+.2f}")
    for length in BLOCKS:
        means = [apart[at : at + length].mean() for at in range(0, FLOWN - length + 1, length)]
        print(f"in blocks of {length} episodes: {min(means):+.2f} to {max(means):+.2f}")


def scores_of(policy: str) -> pd.Series:
    """Return the mean of QoE1 and QoE3 by episode, over the worlds."""
    flown = du.run(
        bench_folder() / "multi-service-small.yaml",
        policy=policy,
        seeds=WORLDS["test"][:WORLDS_FLOWN],
        episodes=FLOWN,
        warmup=0,
        engine="batch",
        progress=False,
    ).episodes
    return flown.groupby("episode")[["qoe1_percent", "qoe3_percent"]].mean().mean(axis=1)


def halves(jobs):
    """Print by how much the best policy of each line is above the second one, by half."""
    print(row(("Task", "Track", "Best", "Second", "First half", "Second half")))
    print(row(["---"] * 6))
    there = [each for entry in entries() if (each := entry.submission()) is not None]
    for table in board(there):
        if "task" not in table:
            continue
        best = [one["policy"] for one in table["rows"] if one["scores"]][:2]
        of_track = [one for one in there if one.track.name == table["track"]]
        scores = []
        for name in best:
            (one,) = (s for s in of_track if (s.task.name, s.about.name) == (table["task"], name))
            scores.append(by_half(one, jobs))
        pairs = [paired(*each).difference for each in zip(*scores, strict=True)]
        cells = [f"{each.value:+.3f} [{each.low:+.3f}, {each.high:+.3f}]" for each in pairs]
        print(row((table["task"], table["track"], *best, *cells)), flush=True)


def by_half(submission, jobs):
    """Return the scores of both halves of the runs of a submission (halves, trainings, seeds)."""
    work = [
        (submission.task, submission.track, line["seed"], commands, submission.about.ceiling)
        for line, commands in zip(submission.rows, submission.commands, strict=True)
    ]
    found = np.array(results_of(halves_of, work, jobs))
    return found.T.reshape(len(HALVES), -1, len(submission.about.seeds))


def halves_of(task, track, seed, commands, ceiling):
    """Return the scores of both halves of a run, between the reference and bound of all of it."""
    world, results = flown_again(task, track, seed, commands, ceiling)
    zero, bound = reference_of(task, track, seed), bound_of(task, track, seed)
    rows = [measures(part_of(results, episodes), world.scenario) for episodes in HALVES]
    return [score(measures_of(task), one, zero, bound) for one in rows]


def part_of(results, episodes):
    """Return the tables that measures are made of, with half of the episodes, twice.

    Measures that are sums are therefore those of as many episodes as a run has.
    """

    def part(table):
        return None if table is None else pd.concat([table[table["episode"].isin(episodes)]] * 2)

    tables = (results.requests, results.episodes, results.sensors)
    requests, of_episodes, sensors = map(part, tables)
    return replace(results, requests=requests, episodes=of_episodes, sensors=sensors)


if __name__ == "__main__":
    sys.exit(main())
