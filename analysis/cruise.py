"""What a choice of cruise speed changes: energy of hops, and policies with and without a choice.

python analysis/cruise.py [--seeds N] [--episodes N] [--energy W] [--clock] [--3d] [NAME…]

The first table is a closed form: what it takes to fly a cell of case 8 at a speed, and a step in
which the drone hovers for what remains. For the second one, drones learn in case 8 with the battery
``rotary_wing`` by Q-learning, with the reward ``qoe`` for QoE3 less the energy used, one training
per seed in the world of that seed, from seed 201 on. Then they fly greedily for 20 episodes. All is
the same but the speeds from which commands choose. Drones decide when they are free, or with
``--clock`` at each step, and fly on one level, or with ``--3d`` between buildings, as in case 8.
NAMEs are those of the motions to compare, of which "choice" is one.

Values begin at 0, which is less than they become. Elsewhere they begin at 3. The value of what
follows a short flight is discounted less than that of what follows a long one, so values above the
true ones make drones prefer the shortest flights until they have tried them in each cell for long.
"""

import argparse
import math
from dataclasses import dataclass

import numpy as np
from script import count, row

import desim_uav as du
from desim_uav.experiment.statistics import estimate, paired
from desim_uav.experiment.train.course import train
from desim_uav.model.energy.propulsion.rotary_wing import ROTORS, best_speeds, powers_of
from desim_uav.model.energy.rotary_wing import RotaryWing
from desim_uav.model.motion.motion import REST, BangCoastBang
from desim_uav.model.observations import Feature, RowObservation
from desim_uav.policies.tabular import Greedy

FIRST_SEED, EVALUATED = 201, 20
GAMMA, EPSILON = 0.8, 0.3
CAPACITY_WH = 100.0  # with which a hover lasts for 36 minutes; an episode has 30
CELL_M, STEP_S, TOP_MPS = 240.0, 60.0, 18.3
FILLING_MPS = 0.5 * (4.0 * STEP_S - math.sqrt((4.0 * STEP_S) ** 2 - 16.0 * CELL_M))
"""The cruise speed of `fill_epoch`, at an acceleration of 4 m/s²."""

SPEEDS = (FILLING_MPS, 5.0, 6.0, 8.3, 10.2, 12.0, 14.0, 18.3, 22.0)
MOTIONS = {
    "fill_epoch": {"timing": "fill_epoch"},
    "8.3 m/s": {"cruise": [8.3]},
    "18.3 m/s": {"cruise": [18.3]},
    "choice": {"cruise": [5.0, 10.2, 18.3]},
}
"""The motions by name; all return at the highest speed, which is about V_mr."""


@dataclass(frozen=True)
class Place(RowObservation):
    """The cell, and in 3D the level, at which a drone believes itself to be.

    The paper's state has the minutes left, too. Here batteries are full at the start of an episode
    and last to its end, and with fewer states each of them is visited more often.
    """

    information = "local"

    def features(self, facts):
        """Return two or three whole numbers."""
        sizes = dict(zip(("cell_x", "cell_y"), facts.grid.cells, strict=True))
        if facts.three_d:
            sizes["level"] = facts.grid.levels_under_ceiling
        return tuple(Feature(name, 0, size - 1, True) for name, size in sizes.items())

    def write(self, world, state, drone):
        """Write them."""
        here = state.observations[drone.index]
        drone.features[0], drone.features[1] = here.x, here.y
        if world.three_d:
            drone.features[2] = here.level


def main(names, seeds, episodes, **how):
    """Print both tables."""
    print(row(("speed", "flight", "hop", "per metre", "power", "step, then hover")))
    print(row(["---"] * 6))
    for speed in SPEEDS:
        print(row(hop(speed)))
    best = best_speeds(powers_of(ROTORS["zeng2019"]))
    print(f"\nV_me = {best.endurance_mps:.5f} m/s, V_mr = {best.range_mps:.5f} m/s\n")
    found = {}
    for name in names:
        for seed in seeds:
            found[name, seed] = measured(name, seed, episodes, **how)
            print(f"# {name}, seed {seed}: {found[name, seed]}", flush=True)
    print()
    print(row(("motion", "QoE3 %", "choice: more", "J/Mbit", "choice: ratio", "W", "time")))
    print(row(["---"] * 7))
    chosen = [found["choice", seed] for seed in seeds] if "choice" in names else []
    for name in names:
        print(row(line(name, [found[name, seed] for seed in seeds], chosen)))


def hop(speed_mps):
    """Return what a hop between two cells takes at a speed, as text."""
    battery = RotaryWing()
    flight = BangCoastBang(30.0).cruise_transit(CELL_M, STEP_S, speed_mps)
    flight_s, used = flight.duration_us / 1e6, battery.drains(flight, flight.duration_us) / 1e6
    rest = battery.drains(REST, round(STEP_S * 1e6) - flight.duration_us) / 1e6
    return (
        *(
            f"{speed_mps:.3g} m/s",
            f"{flight_s:.1f} s",
            f"{used:,.0f} J",
            f"{used / CELL_M:.2f} J/m",
        ),
        *(f"{used / flight_s:.1f} W", f"{used + rest:,.0f} J"),
    )


def scenario_of(name, seed, episodes, energy, clock, three_d):
    """Return case 8 with a battery measured in energy and this motion."""
    decisions = "clock" if clock else {"kind": "event", "patience_s": STEP_S}
    return du.load(
        "case8",
        {
            "seed": seed,
            "map.dimensions": 3 if three_d else 2,
            "drones.battery": {"kind": "rotary_wing", "capacity_wh": CAPACITY_WH},
            "drones.motion": {"max_speed_mps": TOP_MPS, **MOTIONS[name]},
            "decisions": decisions,
            "episode.carry_over": False,
            "reward": {"kind": "qoe", "w1": 0.0, "crash": 10.0, "energy": energy},
            "observation": {"kind": "cruise:Place"},
            "learning.gamma": GAMMA,
            "learning.episodes": episodes,
            "learning.initial_q": 0.0,
            "learning.alpha": {"start": 1.0, "decay": 0.01 ** (1 / episodes), "end": 0.01},
            "learning.epsilon": EPSILON,
        },
    )


def measured(name, seed, episodes, **how):
    """Train with a motion in the world of a seed; return the measures of the greedy policy."""
    scenario = scenario_of(name, seed, episodes, **how)
    table, _ = train(scenario, engine="batch")
    flown = du.run(
        scenario,
        policy=Greedy.of_table(table, "learned"),
        seed=seed,
        episodes=EVALUATED,
        warmup=2,
        events=True,
        engine="batch",
        progress=False,
    )
    rows = flown.episodes
    used_j, served_mbit = 3600 * rows["energy_wh"].sum(), rows["served_mbit"].sum()
    time_s = rows["duration_s"].sum() * scenario.drone_count
    return {
        "qoe3": round(float(rows["qoe3_percent"].mean()), 3),
        "j_per_mbit": round(float(used_j / served_mbit), 3),
        "power_w": round(float(used_j / time_s), 2),
        "time": times(flown.legs, time_s),
        "crashes": int(rows["crashes"].sum()),
    }


def times(legs, time_s):
    """Return the share of the drones' time in moves at each speed, in climbs, and in returns."""
    motion, shares = BangCoastBang(30.0), {}
    lasts = {motion.cruise_transit(CELL_M, STEP_S, v).duration_us / 1e6: v for v in SPEEDS}
    end_s = 30 * STEP_S
    for leg in legs[legs["duration_s"] > 0].to_dict("records"):
        speed = lasts[min(lasts, key=lambda duration_s: abs(duration_s - leg["duration_s"]))]
        what = "return" if leg["mode"] == "returning" else f"{speed:g} m/s"
        what = "climb" if leg["z_from_m"] != leg["z_to_m"] and what != "return" else what
        lasted_s = min(leg["duration_s"], end_s - leg["t_s"])
        shares[what] = shares.get(what, 0.0) + lasted_s / time_s
    return {what: round(float(share), 4) for what, share in sorted(shares.items())}


def line(name, own, chosen):
    """Return the row of a motion, given its measures and those of the choice, by seed."""
    qoe3, used = ([one[key] for one in own] for key in ("qoe3", "j_per_mbit"))
    more = ratio = "-"
    if chosen and name != "choice":
        more = f"{paired([one['qoe3'] for one in chosen], qoe3):.2f}"
        ratios = [c["j_per_mbit"] / j for c, j in zip(chosen, used, strict=True)]
        ratio = f"{estimate(ratios):.3f}"
    kinds = sorted({what for one in own for what in one["time"]})
    means = {what: np.mean([one["time"].get(what, 0.0) for one in own]) for what in kinds}
    time = ", ".join(f"{what} {100 * share:.0f} %" for what, share in means.items())
    power = f"{estimate([one['power_w'] for one in own]).mean:.1f}"
    return (
        name,
        f"{estimate(qoe3).mean:.1f}",
        more,
        f"{estimate(used).mean:.2f}",
        ratio,
        power,
        time,
    )


def arguments():
    """Return the motions, the seeds and the episodes, and how drones fly and learn."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=count(), default=16, help="how many seeds, from 201 on")
    parser.add_argument("--episodes", type=count(), default=6000, help="episodes of a training")
    parser.add_argument("--energy", type=float, default=0.5, help="the weight of energy")
    parser.add_argument("--clock", action="store_true", help="decide at each step")
    parser.add_argument("--3d", dest="three_d", action="store_true", help="fly between buildings")
    parser.add_argument("names", nargs="*", help=f"of {', '.join(MOTIONS)}; default: all")
    given = parser.parse_args()
    for name in given.names:
        if name not in MOTIONS:
            parser.error(f"{name}: must be one of {', '.join(MOTIONS)}")
    seeds = range(FIRST_SEED, FIRST_SEED + given.seeds)
    how = {"energy": given.energy, "clock": given.clock, "three_d": given.three_d}
    return given.names or list(MOTIONS), seeds, given.episodes, how


if __name__ == "__main__":
    *asked, how = arguments()
    main(*asked, **how)
