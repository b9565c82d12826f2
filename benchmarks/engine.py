"""What a state event costs the SimPy engine, beside the raw cost of a SimPy timeout.

    python benchmarks/engine.py [--scenario case8] [--policy baseline] [--episodes 40] [--runs 9]

A state event is one distinct (time, phase, drone, user) key of the event log; rows that share it
(exit, detach, stop) count once. ``causes`` is a stricter count: attachments and starts of service
that follow from another event of the same instant are left out. The commands are recorded first,
so that the policy costs nothing; events are logged; CPU time, median of the runs.
"""

from __future__ import annotations

import argparse
import statistics
import time

import simpy

from desim_uav.engine.base import EpisodeLog
from desim_uav.engine.des import Simulation
from desim_uav.experiment.run import run_settings
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.policies import load_policy
from desim_uav.policies.base import decide
from desim_uav.sample_path import draw
from desim_uav.scenario.load import load
from desim_uav.shipped import find_scenario
from desim_uav.world import build_world

CONSEQUENCES = {"attach", "detach", "serve", "stop"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="case8")
    parser.add_argument("--policy", default="baseline")
    parser.add_argument("--episodes", type=int, default=40)
    parser.add_argument("--runs", type=int, default=9)
    args = parser.parse_args()

    scenario = load(find_scenario(args.scenario))
    world = build_world(scenario, scenario.effective_world_seed)
    policy = load_policy(args.policy)
    settings = run_settings(world, policy, keep_events=True)
    paths = [draw(world, scenario.seed, episode) for episode in range(args.episodes)]

    engine = Simulation(world, settings)
    commands, keys, causes = [], 0, 0
    for path in paths:
        policy.begin(world, Streams(scenario.seed, Purpose.LEARNER, path.episode), False)
        shown = engine.reset(path)
        given = []
        while not (shown.terminated or shown.truncated):
            given.append(decide(policy, shown, world))
            shown = engine.step(given[-1])
        commands.append(given)
        keys += _keys(engine.log, set())
        causes += _keys(engine.log, CONSEQUENCES)

    seconds, timeouts = [], []
    for _ in range(args.runs):
        engine = Simulation(world, settings)
        start = time.process_time()
        for path, given in zip(paths, commands, strict=True):
            engine.reset(path)
            for command in given:
                engine.step(command)
        seconds.append(time.process_time() - start)
        timeouts.append(_timeout_s())
    cpu, timeout = statistics.median(seconds), statistics.median(timeouts)
    per_key, per_cause, episodes = cpu / keys, cpu / causes, args.episodes
    print(f"{args.scenario}, {args.policy}, {episodes} episodes, median of {args.runs} runs")
    print("                              all keys   causes only")
    print(f"state events an episode       {keys / episodes:8.1f}    {causes / episodes:8.1f}")
    print(f"CPU a state event, µs         {per_key * 1e6:8.2f}    {per_cause * 1e6:8.2f}")
    print(f"in raw SimPy timeouts         {per_key / timeout:8.2f}    {per_cause / timeout:8.2f}")
    print(f"a raw SimPy timeout, µs       {timeout * 1e6:8.2f}")
    print(f"CPU an episode, ms            {cpu / episodes * 1e3:8.2f}")


def _keys(log: EpisodeLog, left_out: set[str]) -> int:
    rows = log.events or ()
    counted = (row for row in rows if row[2] not in left_out)
    return len({(t, phase, drone, user) for t, phase, _, drone, user, *_ in counted})


def _timeout_s(count: int = 100_000) -> float:
    """CPU seconds to create, queue and run one timeout with a callback, thirty pending."""
    env = simpy.Environment()

    def again(event: simpy.Event) -> None:
        simpy.Timeout(env, 7).callbacks.append(again)

    for k in range(30):
        simpy.Timeout(env, k).callbacks.append(again)
    start = time.process_time()
    for _ in range(count):
        env.step()
    return (time.process_time() - start) / count


if __name__ == "__main__":
    main()
