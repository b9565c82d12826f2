"""Would the tests notice an error? Makes one error at a time in the simulator and runs tests.

python tests/mutation.py [--only TEXT] [--list] [--csv FILE]

Each error is made in a copy of the source tree, in which the named tests have passed before. The
first test that fails has noticed it. None of these tests compares the two engines with each other,
because both run the rules of ``desim_uav/rules``: an error there changes both of them alike.

The script is run by hand: some errors require kernels to be compiled again, so all of them take
about ten minutes. The exit code is 6 if an error is not noticed, and 1 if the tests fail in the
unchanged tree.
"""

from __future__ import annotations

import argparse
import csv
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COPIED = ("desim_uav", "scenarios", "policies", "tests", "analysis", "pyproject.toml", "README.md")
NOT_NOTICED = 6
COLUMNS = ("error", "file in `desim_uav/`", "noticed by", "seconds")


@dataclass(frozen=True)
class Mutation:
    """An error: ``old``, which occurs once in ``file`` of ``desim_uav``, becomes ``new``."""

    what: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]

    def applied(self, source: str) -> str:
        """Return the changed text. Raises ValueError unless ``old`` occurs exactly once."""
        if source.count(self.old) != 1:
            times = source.count(self.old)
            raise ValueError(
                f"{self.what}: {self.file} contains {self.old!r} {times} times, not once"
            )
        return source.replace(self.old, self.new)


MUTATIONS = (
    # ---- geometry and motion
    Mutation(
        "a footprint 1 mm too wide",
        "sky/foresee.py",
        "rings.radii_m[leg.level * _circles(rings)])\n",
        "rings.radii_m[leg.level * _circles(rings)] + 1e-3)\n",
        ("engine/test_footprints.py",),
    ),
    Mutation(
        "no deceleration before a drone arrives",
        "model/motion/motion.py",
        "distance - ramp_distance, speed, -acceleration",
        "distance - ramp_distance, speed, 0.0",
        ("model/motion/test_motion.py",),
    ),
    Mutation(
        "crossing times rounded half up instead of half to even",
        "model/geometry/relative.py",
        "int(np.rint(since_s * 1e6))",
        "int(np.floor(since_s * 1e6 + 0.5))",
        ("model/geometry/test_coverage.py",),
    ),
    Mutation(
        "interference changes half as fast as it can",
        "model/radio/bounds.py",
        "return link.least - most, link.most - least",
        "return link.least - 0.5 * most, link.most - 0.5 * least",
        ("model/radio/test_air_bounds.py", "model/radio/test_air.py"),
    ),
    Mutation(
        "a level is taken to change as fast all the time as in the middle of it",
        "model/radio/bounds.py",
        "bound_rates(link, np.sqrt(x * x + y * y), z, speed * half)",
        "bound_rates(link, np.sqrt(x * x + y * y), z, 0.0)",
        ("model/radio/test_air_bounds.py", "model/radio/test_air.py"),
    ),
    Mutation(
        "a level rises at most as fast with the height as it must",
        "model/radio/slopes.py",
        "across_high * most - along * low",
        "across_low * most - along * low",
        ("model/radio/test_air_bounds.py", "model/radio/test_air.py"),
    ),
    Mutation(
        "sight lines do not change where they pass a roof's edge",
        "model/radio/shadows.py",
        "    if kind == 1:\n",
        "    if kind == 1:\n        return 1.0, 0.0, 0.0, 0.0, 0.0\n    if kind == 1:\n",
        ("model/radio/test_link_sight.py",),
    ),
    Mutation(
        "a stationary elevation is overlooked",
        "experiment/papers/stationary.py",
        "if least <= 0.0 <= most and not (rises or sinks) and high - low > FINEST_DEG:",
        "if False:",
        ("experiment/test_stationary.py",),
    ),
    Mutation(
        "durations of transits truncated instead of rounded",
        "model/motion/motion.py",
        "return Transit(profile, round(duration * US), distance)",
        "return Transit(profile, int(duration * US), distance)",
        ("model/motion/test_motion.py",),
    ),
    Mutation(
        "A* with an overestimate of the remaining time",
        "model/motion/planner.py",
        "estimate_us = through + time_on_open_map(",
        "estimate_us = through + 2 * time_on_open_map(",
        ("model/motion/test_planner.py",),
    ),
    # ---- draws and order
    Mutation(
        "users' walks drawn from the random stream of the demand",
        "model/mobility/mobility.py",
        "states = states_of(seeds, Purpose.MOBILITY, episodes, len(homes), first)",
        "states = states_of(seeds, Purpose.DEMAND, episodes, len(homes), first)",
        ("model/random/test_streams.py",),
    ),
    Mutation(
        "footprint entries processed before exits",
        "model/rules.py",
        "    EXIT = 2\n    ARRIVAL = 3\n    ENTRY = 4\n",
        "    ENTRY = 2\n    ARRIVAL = 3\n    EXIT = 4\n",
        ("engine/test_attachment.py",),
    ),
    Mutation(
        "depletions processed before arrivals",
        "rules/battery.py",
        "key(DEPLETION, drone.index, -1)",
        "key(DEPLETION - 4, drone.index, -1)",
        ("engine/test_crashes.py",),
    ),
    Mutation(
        "events of one instant in the order in which they were scheduled, SimPy engine",
        "engine/des/clock.py",
        "t_us, key, True, True\n",
        "t_us, 1, True, True\n        key = 1\n",
        ("engine/test_crashes.py",),
    ),
    Mutation(
        "events of one instant in the reverse order, compiled engine",
        "engine/compiled/slots.py",
        "precedes(t_other, other_key, t_us, key)",
        "precedes(t_other, key, t_us, other_key)",
        ("engine/test_attachment.py",),
    ),
    Mutation(
        "users attached at once instead of after everything else of the instant",
        "rules/settle.py",
        "        if nothing_before(state, place):\n",
        "        if True:\n",
        ("engine/test_attachment.py",),
    ),
    # ---- service
    Mutation(
        "the served time of a request is lost at a handover",
        "rules/service.py",
        "min(request.done + elapsed_us * request.rate, request.required)",
        "min(elapsed_us * request.rate, request.required)",
        ("engine/test_attachment.py",),
    ),
    Mutation(
        "an interruption of 0 µs is counted",
        "rules/service.py",
        "elif request.started_us > request.stopped_us:",
        "else:",
        ("engine/test_attachment.py",),
    ),
    Mutation(
        "an interruption that lasts until the end of the request is not counted",
        "rules/service.py",
        "request.interruptions += int(now_us > request.stopped_us)",
        "request.interruptions += 0",
        ("engine/test_footprints.py",),
    ),
    Mutation(
        "a second service by the same drone is counted as a handover",
        "rules/service.py",
        "if request.last_server != drone.index:",
        "if True:",
        ("engine/test_admission.py",),
    ),
    Mutation(
        "the attached time of a request begins before the request",
        "rules/service.py",
        "max(user.held_since_us, request.t_request_us)",
        "user.held_since_us",
        ("engine/test_requests.py",),
    ),
    Mutation(
        "requests wait in the order in which they reach a drone",
        "rules/stages.py",
        "len(queue)\n    while place > 0:\n",
        "len(queue)\n    while place < 0:\n",
        ("engine/test_admission.py",),
    ),
    Mutation(
        "a stage begins with what was done in the one before",
        "rules/stages.py",
        "request.done = amount, 0\n",
        "request.done = amount, request.done\n",
        ("engine/test_stages.py",),
    ),
    Mutation(
        "stages that are done do not count as progress",
        "rules/stages.py",
        "(float(request.stage) + share)",
        "share",
        ("engine/test_stages.py",),
    ),
    Mutation(
        "a request that has ended still counts as open in the footprints around its user",
        "rules/service.py",
        "    count_asking(state, user, -1)\n",
        "",
        ("engine/test_step_rewards.py",),
    ),
    Mutation(
        "admission stops at the first request that does not fit",
        "rules/admission.py",
        "            if fits(world, state, drone, user):\n",
        "            if count == 0 and fits(world, state, drone, user):\n",
        ("engine/test_admission.py",),
    ),
    Mutation(
        "a request keeps its rate if its link passes to another class and nothing else changes",
        "rules/service.py",
        "        drone.regraded = user.index + 1\n",
        "",
        ("engine/test_shares.py",),
    ),
    Mutation(
        "a user attaches to the drone with the lowest number instead of the first one entered",
        "rules/attachment.py",
        "if first < 0 or entered_us < first_us:",
        "if first < 0:",
        ("engine/test_attachment.py",),
    ),
    Mutation(
        "of drones entered together a user attaches to the one with the highest number",
        "rules/attachment.py",
        "if first < 0 or entered_us < first_us:",
        "if first < 0 or entered_us <= first_us:",
        ("engine/test_attachment.py",),
    ),
    Mutation(
        "a drone that returns to a station goes on serving",
        "rules/flight.py",
        "(world, state, drone, words.RETURNING)\n"
        "    silence(world, path, state, drone, words.COVERAGE)\n",
        "(world, state, drone, words.RETURNING)\n",
        ("engine/test_returns.py",),
    ),
    Mutation(
        "the way back is planned under the ceiling for drones that have none",
        "rules/flight.py",
        "first + world.ceilings[drone.index] * places + from_place",
        "first + 1 * places + from_place",
        ("engine/test_returns.py",),
    ),
    # ---- sensors and their updates
    Mutation(
        "an age falls to that of an older update that is delivered later",
        "rules/ages.py",
        "if generated_us > sensor.fresh_us:",
        "if True:",
        ("engine/test_sensors.py",),
    ),
    Mutation(
        "an age counts as if it had been what it is now since it was counted last",
        "rules/ages.py",
        "now_us + sensor.since_us - 2 * sensor.fresh_us",
        "2 * (now_us - sensor.fresh_us)",
        ("engine/test_sensors.py",),
    ),
    Mutation(
        "updates that are delivered are not counted",
        "rules/ages.py",
        "sensor.delivered += 1",
        "sensor.delivered += 0",
        ("engine/test_sensors.py",),
    ),
    Mutation(
        "a full buffer drops the latest update that waits instead of the oldest",
        "rules/updates.py",
        "        _drop(world, path, state, user, waiting)\n\n\n@rule\ndef _is_being_sent",
        "        _drop(world, path, state, user, max(waiting, sensor.count - 2))\n\n\n"
        "@rule\ndef _is_being_sent",
        ("engine/test_sensors.py",),
    ),
    Mutation(
        "an update that is turned away keeps its room in the store",
        "rules/updates.py",
        "    give_room_back(state, drone, user)\n    close(",
        "    close(",
        ("engine/test_sensors.py",),
    ),
    Mutation(
        "the first of two updates that wait is sent, although the last one should be",
        "rules/updates.py",
        "if sensor.count > 1 and world.updates",
        "if sensor.count > 2 and world.updates",
        ("engine/test_sensors.py",),
    ),
    Mutation(
        "a new update replaces those of sensors at other drones",
        "rules/updates.py",
        "other.holder != user.holder or",
        "other.holder == user.holder or",
        ("engine/test_sensors.py",),
    ),
    Mutation(
        "updates that are lost in a crash are not counted",
        "rules/delivery.py",
        "lost += drone.freight[u].count",
        "lost += 0",
        ("engine/test_sensors.py",),
    ),
    Mutation(
        "the room of an update is not free when the backhaul has delivered it",
        "rules/delivery.py",
        "    drone.stored_ubit -= update.size\n",
        "",
        ("engine/test_delivery.py",),
    ),
    Mutation(
        "a landing delivers again what the backhaul has delivered",
        "rules/delivery.py",
        "    drone.freight[update.user].count -= 1\n",
        "",
        ("engine/test_delivery.py",),
    ),
    Mutation(
        "stored updates have the whole backhaul, whatever links carry",
        "rules/backhaul.py",
        "shared_bps += request.rate",
        "shared_bps += 0",
        ("engine/test_delivery.py",),
    ),
    Mutation(
        "after a delivery over a backhaul the update that came last is the next one",
        "rules/delivery.py",
        "copy_update(store[k], store[upload.first + k])",
        "copy_update(store[k], store[len(store) - 1 - k])",
        ("engine/test_delivery.py",),
    ),
    # ---- bands
    Mutation(
        "requests that wait for one of two bands wait for the other one, too",
        "rules/bands.py",
        "    _exchange_entries(drone.waiting, aside.waiting)\n",
        "",
        ("engine/test_uplink.py",),
    ),
    Mutation(
        "uploads share the band of downloads although they have one of their own",
        "rules/bands.py",
        "if drone.band not in (band, BOTH):",
        "if drone.band == UP:",
        ("engine/test_uplink.py",),
    ),
    Mutation(
        "what is free in one band is free in the other one as well",
        "rules/bands.py",
        "    drone.free_hz, aside.free_hz = aside.free_hz, drone.free_hz\n",
        "",
        ("engine/test_uplink.py",),
    ),
    # ---- batteries, stations, episodes
    Mutation(
        "the drone that landed last is charged first, SimPy engine",
        "engine/des/processes.py",
        "        self.pads = [simpy.Resource(clock, world.pads) for _ in state.stations]\n",
        "        self.pads = [simpy.Resource(clock, world.pads) for _ in state.stations]\n"
        "        last = type('Last', (list,), {'append': lambda own, one: own.insert(0, one)})\n"
        "        for pads in self.pads:\n"
        "            pads.put_queue = last()\n",
        ("engine/test_charging_queue.py",),
    ),
    Mutation(
        "the drone that landed last is first in the queue of its station",
        "rules/charging.py",
        "state.stations[station].queue.append(drone.index)",
        "state.stations[station].queue.insert(0, drone.index)",
        ("engine/test_charging_queue.py",),
    ),
    Mutation(
        "the time in a queue in the episode before is counted again",
        "rules/charging.py",
        "max(drone.since_us, 0)",
        "drone.since_us",
        ("engine/test_charging_queue.py",),
    ),
    Mutation(
        "the end of charging rounded down instead of up",
        "model/energy/battery.py",
        "return takes_us + (1 if rest > 0 else 0)",
        "return takes_us",
        ("model/energy/test_battery.py",),
    ),
    Mutation(
        "hops of a return are flown in minimum time although they should fill a step",
        "model/motion/motion.py",
        'if self.return_timing == "minimum_time":',
        "if True:",
        ("engine/test_returns.py",),
    ),
    Mutation(
        "a battery that drains a minute per action drains only the time of a hop",
        "model/energy/battery.py",
        "_share(action_us, elapsed_us, flight.duration_us)",
        "_share(flight.duration_us, elapsed_us, flight.duration_us)",
        ("engine/test_returns.py",),
    ),
    Mutation(
        "a battery runs empty 1 µs too late",
        "rules/battery.py",
        "due(state, slot, drone.since_us + lasts, key",
        "due(state, slot, drone.since_us + lasts + 1, key",
        ("engine/test_crashes.py",),
    ),
    Mutation(
        "a battery that is empty at the very end of a leg is not noticed",
        "rules/battery.py",
        "if lasts <= span_us:",
        "if lasts < span_us:",
        ("engine/test_crashes.py",),
    ),
    Mutation(
        "a crashed drone is replaced only after more than its downtime",
        "rules/crash.py",
        "down_us >= own.respawn_after_us",
        "down_us > own.respawn_after_us",
        ("engine/test_crashes.py",),
    ),
    Mutation(
        "a return is allowed at any charge of the battery",
        "rules/decide.py",
        "may_return = own.limited != 0 and charge <= own.return_charge",
        "may_return = own.limited != 0",
        ("engine/test_masks.py",),
    ),
    Mutation(
        "a drone with a full battery is allowed to charge",
        "rules/decide.py",
        "is_full = charge >= own.full",
        "is_full = charge > own.full",
        ("engine/test_masks.py",),
    ),
    Mutation(
        "drones are not carried over to the next episode",
        "engine/carry.py",
        "return self.truncated and not self.terminated and self.settings.carry_over",
        "return self.truncated and not self.terminated and False",
        ("engine/test_episodes.py",),
    ),
    # ---- measures and rewards
    Mutation(
        "QoE1 averaged over served requests only",
        "qoe.py",
        'derived["qoe1"] = requests["served_s"] / requests["requested_s"]',
        'derived["qoe1"] = (requests["served_s"] / requests["requested_s"])'
        '.where(requests["served_s"] > 0)',
        ("test_qoe.py",),
    ),
    Mutation(
        "QoE2 counts the wait before the first service only",
        "qoe.py",
        '_between(requests["served_s"], open_s) / step_s',
        'derived["wait_s"] / step_s',
        ("test_qoe.py",),
    ),
    Mutation(
        "Ages averaged over episodes, not over time",
        "measures/ages.py",
        "lasted_s = duration_s.to_numpy(float)",
        "lasted_s = np.ones(len(sensors))",
        ("measures/test_by_hand.py",),
    ),
    Mutation(
        "Mean peaks averaged over sensors and episodes, not over falls",
        "measures/ages.py",
        'falls = sensors["falls"].to_numpy()',
        'falls = (sensors["falls"] > 0).to_numpy().astype(int)',
        ("measures/test_by_hand.py",),
    ),
    Mutation(
        "R1 not limited to 1",
        "rules/rewards.py",
        "return 1.0 if capped and share > 1.0 else share",
        "return share",
        ("model/test_rewards.py",),
    ),
    Mutation(
        "a battery at exactly c1 counts as above it",
        "rules/rewards.py",
        "if charge > round(c1_us):",
        "if charge >= round(c1_us):",
        ("model/test_rewards.py",),
    ),
    Mutation(
        "R3 pays for the requests in a footprint instead of those that are served",
        "rules/rewards.py",
        "+ (0 if self.served_only else services)",
        "+ services",
        ("engine/test_step_rewards.py",),
    ),
    Mutation(
        "R3 pays for the requests that are served although those that are covered should count",
        "rules/rewards.py",
        "+ (0 if self.served_only else services)",
        "+ 0",
        ("engine/test_step_rewards.py",),
    ),
    Mutation(
        "the cost of a return is limited to 1 although it should not be",
        "rules/rewards.py",
        "if capped and cost > 1.0:",
        "if cost > 1.0:",
        ("engine/test_step_rewards.py",),
    ),
    Mutation(
        "the cost of a risky return has the wrong sign",
        "rules/rewards.py",
        "drone.terms[1] = self.cost_sign * cost * way_home",
        "drone.terms[1] = -self.cost_sign * cost * way_home",
        ("model/test_rewards.py",),
    ),
    # ---- learning
    Mutation(
        "the greedy action may be a forbidden one",
        "learning/learner.py",
        "    for action in range(len(allowed)):\n        if allowed[action]:\n            value =",
        "    for action in range(len(allowed)):\n        if True:\n            value =",
        ("learning/test_algorithms.py",),
    ),
    Mutation(
        "the steps of a return are not discounted",
        "learning/learner.py",
        "lesson.discount *= learner.gamma",
        "lesson.discount = learner.gamma",
        ("learning/test_learner.py",),
    ),
    Mutation(
        "Q-learning bootstraps from a forbidden action",
        "learning/q_learning.py",
        "            if lesson.allowed[action]:\n",
        "            if True:\n",
        ("learning/test_algorithms.py",),
    ),
    # ---- lines of sight, shadowing and times to trigger
    Mutation(
        "marks count from the start of the span",
        "sky/links.py",
        "        link.marked_us = leg.marked_us - span_us[0]\n",
        "        link.marked_us = 0\n",
        ("engine/test_line_of_sight.py",),
    ),
    Mutation(
        "a leg is recalled whatever the classes before it are",
        "sky/leg_memory.py",
        "            classes |= sky.held[first + k] << (CLASS_BITS * k)\n",
        "            classes |= 0 * k\n",
        ("sky/test_leg_memory.py",),
    ),
    Mutation(
        "shadowing makes links better",
        "model/radio/stretches.py",
        "        link.base_dbm -= mark.extra_db\n",
        "        link.base_dbm += mark.extra_db\n",
        ("engine/test_line_of_sight.py",),
    ),
    Mutation(
        "an access point has the draws of a drone",
        "rules/air.py",
        "    return -1 - drone.point if drone.point >= 0 else drone.index\n",
        "    return drone.index\n",
        ("engine/test_line_of_sight.py",),
    ),
    Mutation(
        "buildings do not matter",
        "engine/sky.py",
        "    return cells_as_prisms(height_m if blocks else 0.0 * height_m, world.grid.cell_m)\n",
        "    return cells_as_prisms(0.0 * height_m, world.grid.cell_m)\n",
        ("engine/test_line_of_sight.py",),
    ),
    Mutation(
        "times to trigger go on after a handover",
        "rules/association.py",
        "    for d in range(len(state.senders)):\n        links.better_since[d] = -1\n",
        "",
        ("engine/test_access_points.py",),
    ),
    Mutation(
        "drones that meet in one place and stay there have other levels until the step ends",
        "model/radio/air.py",
        "    if link.state == 0 and _stay_level(air, lasts):\n",
        "    if link.state == 2 and _stay_level(air, lasts):\n",
        ("engine/test_instants.py",),
    ),
    Mutation(
        "a user without a drone takes another than the strongest",
        "rules/association.py",
        "            best = d\n    return best\n",
        "            best = d if best < 0 else best\n    return best\n",
        ("engine/test_access_points.py",),
    ),
    Mutation(
        "the quality of links counts users who are not attached",
        "rules/decide.py",
        "int(user.holder == drone.index)",
        "int(user.covering[drone.index] >= 0)",
        ("engine/test_line_of_sight.py",),
    ),
    # ---- free flight
    Mutation(
        "a mixed fleet: drones from cell to cell are allowed to fly by numbers",
        "rules/decide.py",
        "    return action != words.FLY\n",
        "    return True\n",
        ("engine/test_mixed.py",),
    ),
    Mutation(
        "a mixed fleet: hops have the numbers of another type's",
        "engine/constants.py",
        "for own in world.types[:number])",
        "for own in world.types[: max(number - 1, 0)])",
        ("engine/test_mixed.py",),
    ),
    Mutation(
        "free flight: a climb counts as level flight",
        "model/geometry/coverage.py",
        "dx * dx + dy * dy + dz * dz",
        "dx * dx + dy * dy + 0.0 * dz",
        ("model/geometry/test_oblique.py",),
    ),
    Mutation(
        "free flight: the wind pushes the wrong way",
        "model/motion/limits.py",
        "return float((wx * x + wy * y) / level + 0.0),",
        "return float(-(wx * x + wy * y) / level + 0.0),",
        ("model/motion/test_limits.py",),
    ),
    Mutation(
        "free flight: the corners of obstacles are grown by less than the margin",
        "model/geometry/polygons.py",
        "margin_m / (1.0 + one @ other)",
        "margin_m / 2.0",
        ("model/geometry/test_polygons.py",),
    ),
    Mutation(
        "free flight: obstacles have no bottom",
        "model/geometry/prisms.py",
        "    begin, end = _cut(z0 - bottom, z1 - bottom, 0.0, 1.0)\n",
        "    begin, end = 0.0, 1.0\n",
        ("model/geometry/test_prisms.py",),
    ),
    Mutation(
        "free flight: a drone at an obstacle cannot fly away",
        "model/geometry/prisms.py",
        "deepest > max(depth_m, TOUCH_M)",
        "deepest > -TOUCH_M",
        ("model/geometry/test_prisms.py",),
    ),
    Mutation(
        "free flight: the nearest node that is seen is taken for the best one",
        "model/geometry/roads.py",
        "through = away_m[k] + ways.lengths_m[station, k]",
        "through = away_m[k] + 0.0 * ways.lengths_m[station, k]",
        ("model/geometry/test_roads.py",),
    ),
    Mutation(
        "free flight: two drones that come near do not part again",
        "model/geometry/separation.py",
        "state = 1 - state",
        "state = NEAR",
        ("model/geometry/test_separation.py",),
    ),
    Mutation(
        "free flight: the air speed is least at the start of each ramp",
        "model/energy/work.py",
        "if low < 0.0:",
        "if high < 0.0:",
        ("model/energy/test_work.py",),
    ),
    Mutation(
        "free flight: a leg has the wind from the side only",
        "rules/free_flight.py",
        "flight.tail_mps, flight.side_mps = wind_along(wind, ahead)",
        "_, flight.side_mps = wind_along(wind, ahead)",
        ("engine/test_free_in_wind.py",),
    ),
    Mutation(
        "free flight: a drone is asked as soon as a short leg ends",
        "rules/epochs.py",
        "max(flight.duration_us, world.patience_us) if off_grid",
        "flight.duration_us if off_grid",
        ("engine/test_free_by_event.py",),
    ),
    Mutation(
        "free flight: a drone gives way to nobody",
        "rules/free_flight.py",
        "gives_way = world.gives_way and",
        "gives_way = 0 * world.gives_way and",
        ("engine/test_conflicts.py",),
    ),
    Mutation(
        "separation: a drone at rest is where it is told to fly",
        "rules/transits.py",
        "leg.x1_m, leg.y1_m, leg.z1_m = leg.x0_m, leg.y0_m, leg.z0_m",
        "leg.x0_m, leg.y0_m, leg.z0_m = leg.x0_m, leg.y0_m, leg.z0_m",
        ("engine/test_conflicts.py",),
    ),
    Mutation(
        "tasks: a line is in the order of users, not of arrivals",
        "rules/tasks.py",
        "if one.arrived_us != two.arrived_us:",
        "if False:",
        ("engine/test_task_logs.py",),
    ),
    Mutation(
        "tasks: one that is done at its deadline is late",
        "rules/tasks.py",
        "key(words.COMPLETION, AFTER_ALL, user.index)",
        "key(words.COMPLETION, -1, user.index)",
        ("engine/test_task_logs.py",),
    ),
    Mutation(
        "tasks: what was sent to one drone counts at another one, though it must not",
        "rules/tasks.py",
        "world.terms[request.service].restarts and",
        "False and",
        ("engine/test_task_logs.py",),
    ),
    Mutation(
        "tasks: all processors compute on the ground",
        "rules/processing.py",
        "if not world.processors[drone.radio].on_ground:",
        "if False:",
        ("engine/test_task_logs.py",),
    ),
    Mutation(
        "tasks: one moves at what its site has for it, whatever the other drone has",
        "rules/migration.py",
        "bps = min(part_bps(drone), part_bps(site))",
        "bps = part_bps(site)",
        ("engine/test_migration.py",),
    ),
    Mutation(
        "tasks: one that moves stays on its way when its user is handed over again",
        "rules/migration.py",
        "if not is_there and request.line != MOVING:",
        "if not is_there:",
        ("engine/test_migration.py",),
    ),
    Mutation(
        "tasks: one that moves is lost with the drone that it moves to",
        "rules/processing.py",
        "elif user.request.number >= 0 and is_moving_to(state, user, drone):",
        "elif False:",
        ("engine/test_migration.py",),
    ),
    # ---- the shield
    Mutation(
        "shield: a hover needs no way to a station after it",
        "rules/shield.py",
        "allowed = allowed and hovers\n",
        "allowed = allowed and charge > 0\n",
        ("engine/test_shield.py",),
    ),
    Mutation(
        "shield: a command takes nothing, only the way home does",
        "rules/reserve.py",
        "return flown + hovered + drawn_uj",
        "return drawn_uj",
        ("engine/test_shield.py",),
    ),
    Mutation(
        "shield: a leg of free flight needs no way to a station after it",
        "rules/free_flight.py",
        "if shielded and not _has_way_after",
        "if False and not _has_way_after",
        ("engine/test_shield.py",),
    ),
)


def main() -> int:
    """Make the errors, run the tests, print the table, and return the exit code."""
    options = _arguments()
    chosen = [m for m in MUTATIONS if options.only in m.what]
    try:
        for mutation in chosen:
            mutation.applied(_source(ROOT, mutation).read_text(encoding="utf-8"))
    except ValueError as error:
        print(f"mutation.py: {error}", file=sys.stderr)
        return 2
    if options.list or not chosen:
        print(*(m.what for m in chosen), sep="\n")
        return 0 if chosen else 2
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        _copy(tree)
        if not _passes(tree, chosen):
            return 1
        rows = list(_rows(tree, chosen))
    table = [f"| {' | '.join(row)} |" for row in (COLUMNS, ["---"] * len(COLUMNS), *rows)]
    print(*table, sep="\n")
    if options.csv is not None:
        with options.csv.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])
    missed = sum(noticed == "NOT NOTICED" for _, _, noticed, _ in rows)
    print(f"{len(rows) - missed} of {len(rows)} noticed", file=sys.stderr)
    return NOT_NOTICED if missed else 0


def _arguments() -> argparse.Namespace:
    summary, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        description=summary, epilog=rest.partition("\n\n")[2], allow_abbrev=False
    )
    parser.add_argument(
        "--only", default="", metavar="TEXT", help="only errors whose name contains TEXT"
    )
    parser.add_argument("--list", action="store_true", help="only list the errors")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="also write the table to FILE")
    return parser.parse_args()


def _source(tree: Path, mutation: Mutation) -> Path:
    return tree / "desim_uav" / mutation.file


def _copy(tree: Path) -> None:
    """Copy the tree with its compiled code, so that only changed files are compiled again."""
    tree.mkdir()
    for name in COPIED:
        source = ROOT / name
        copy = shutil.copytree if source.is_dir() else shutil.copy2
        copy(source, tree / name)


def _passes(tree: Path, chosen: Sequence[Mutation]) -> bool:
    """Return whether all tests pass in the unchanged tree, without which nothing can be noticed."""
    tests = sorted({test for mutation in chosen for test in mutation.tests})
    print(f"unchanged tree: {len(tests)} test files", file=sys.stderr)
    failed = _first_failure(tree, tests)
    if failed:
        print(f"mutation.py: {failed} fails in the unchanged tree", file=sys.stderr)
    return not failed


def _rows(tree: Path, chosen: Sequence[Mutation]) -> Iterator[tuple[str, str, str, str]]:
    for number, mutation in enumerate(chosen, 1):
        file = _source(tree, mutation)
        source = file.read_text(encoding="utf-8")
        file.write_text(mutation.applied(source), encoding="utf-8")
        since = time.monotonic()
        try:
            failed = _first_failure(tree, mutation.tests)
        finally:
            file.write_text(source, encoding="utf-8")
        seconds = f"{time.monotonic() - since:.0f}"
        noticed = f"`{failed}`" if failed else "NOT NOTICED"
        print(f"{number}/{len(chosen)} {mutation.what}: {noticed}, {seconds} s", file=sys.stderr)
        yield mutation.what, f"`{mutation.file}`", noticed, seconds


def _first_failure(tree: Path, tests: Sequence[str]) -> str:
    """Return the first test that fails in these files of ``tests/``, or "" if all pass."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-rfE", "-p", "no:cacheprovider"]
    command += ["-m", "not slow"]  # some errors are noticed by thorough tests only
    paths = os.pathsep.join([str(tree), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [*command, *(f"tests/{test}" for test in tests)],
        cwd=tree,
        env=os.environ | {"PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode == 0:
        return ""
    failed = re.search(r"^(?:FAILED|ERROR) tests/(\S+)", done.stdout, re.MULTILINE)
    if done.returncode != 1 or failed is None:
        raise RuntimeError(f"pytest ended with {done.returncode}:\n{done.stdout}{done.stderr}")
    return failed[1]


if __name__ == "__main__":
    sys.exit(main())
