"""Steps a second with tasks and with sensors, per user and drone, beside case 8, in one run.

    python benchmarks/services.py [--rounds 7] [--seconds 1]

A step is one parallel step of all drones, and draws and resets count as time. The drones learn from
the first episode on, compiled. ``edge`` and ``harvest`` are the shipped scenarios, with 300 cameras
and three drones, and with 60 sensors and four drones. The others have four drones with rotary
wings, too, which carry updates of sensors to the ground: 60 sensors with an update a minute, and
1,000 sensors with one in ten minutes.

The time of a step is divided by the number of users and by that of drones. What happens in a step
differs much: up to 60 sensors of ``harvest`` share the bandwidth of a drone, and get other rates
whenever one of them begins or ends. So the events that are logged are counted too, in one episode
of drones with random commands.

All are in one process with one thread, in turn. CPU time; medians of the rounds.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import time
from typing import Any, NamedTuple

import desim_uav as du
from desim_uav.learning.training import Training
from desim_uav.scenario.load import from_mapping, load
from desim_uav.scenario.schema import Scenario
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world

AIM = 0.5
"""The least steps per second, times users and drones, as a share of those of case 8."""


def sensors(count: int, size_m: float, every_s: float) -> Scenario:
    """Return a scenario of sensors whose updates four drones carry to the ground."""
    group: dict[str, Any] = {"name": "meters", "count": count, "mobility": {"kind": "static"}}
    group["clusters"] = {"count": count // 15, "radius_m": [200, 400]}
    group["demand"] = {"kind": "sensing", "service": "reading"}
    updates = {"kind": "poisson", "mean_s": every_s}
    reading = {"kind": "collect", "updates": updates, "size_mbit": [0.5], "buffer": 10}
    radio = {"kind": "link_classes", "power_dbm": 10, "sharing": "equal"}
    fleet = {"count": 4, "battery": {"kind": "rotary_wing"}, "radio": radio, "store_mbit": 50}
    return from_mapping(
        {
            "name": "sensors",
            "map": {"dimensions": 2, "size_m": [size_m] * 2, "cells": [round(size_m / 300)] * 2},
            "drones": fleet,
            "stations": {"count": 4},
            "users": [group],
            "services": {"reading": {**reading, "keeps": "newest", "delivered": "ground"}},
            "reward": {"kind": "age", "scale_s": 60},
        }
    )


class Measured(NamedTuple):
    """A training that is measured, and what happens in a step of its scenario."""

    training: Training
    links: int
    events: float

    def us_per_step(self, seconds: float) -> float:
        """Train for about so many seconds, and return the microseconds of CPU time per step."""
        steps, begun = 0, time.process_time()
        while time.process_time() < begun + seconds:
            played = len(self.training.play(256)) // len(self.training.learners)
            steps += played * self.training.world.scenario.episode.steps
        return (time.process_time() - begun) / steps * 1e6


def measured(scenario: Scenario) -> Measured:
    training = Training(build_world(scenario, 0), 0, "batch")
    training.play(256)
    links = len(training.world.homes) * scenario.drone_count
    logged = du.run(scenario, policy="random", episodes=1, engine="batch", events=True).events
    return Measured(training, links, len(logged) / scenario.episode.steps)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=1.0, help="of each measurement")
    args = parser.parse_args()
    scenarios = {
        "case 8": load(scenario_path("case8")),
        "edge": load(scenario_path("edge")),
        "harvest": load(scenario_path("harvest")),
        "60 sensors": sensors(60, 1500.0, 60.0),
        "1,000 sensors": sensors(1000, 3000.0, 600.0),
    }
    all_of = {name: measured(scenario) for name, scenario in scenarios.items()}
    times: dict[str, list[float]] = {name: [] for name in all_of}
    for _ in range(args.rounds):
        for name, own in all_of.items():
            times[name].append(own.us_per_step(args.seconds))
    print(f"{'':15}{'steps/s':>9}{'ns per user, drone':>20}{'events/step':>13}{'ns/event':>10}")
    us = {name: statistics.median(own) for name, own in times.items()}
    for name, (_, links, events) in all_of.items():
        each_ns = 1000 * us[name] / links
        per_event_ns = 1000 * us[name] / events
        print(f"{name:15}{1e6 / us[name]:9.0f}{each_ns:20.1f}{events:13.1f}{per_event_ns:10.0f}")
    one, *others = all_of
    for name in others:
        per_link = us[one] / all_of[one].links / us[name] * all_of[name].links
        per_event = us[one] / all_of[one].events / us[name] * all_of[name].events
        print(
            f"{name} / {one}: {per_link:.2f} steps/s per user and drone (aim: {AIM}), "
            f"{per_event:.2f} events/s"
        )
    most_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"largest resident memory of the process: {most_mib:.0f} MiB")


if __name__ == "__main__":
    main()
