"""What a choice of cruise speed changes: energy of hops, and policies with and without a choice.

python analysis/cruise.py [--seeds N] [--episodes N] [--energy W] [--clock] [NAME…]

The first table is a closed form: what it takes to fly a cell of case 8 at a speed, and a step in
which the drone hovers for what remains. For the second one, drones learn in case 8 with the battery
``rotary_wing`` by Q-learning, with the reward ``qoe`` for QoE3 less the energy used, one training
per seed in the world of that seed, from seed 100 on. Then they fly greedily for 20 episodes. All is
the same but the speeds from which commands choose. With ``--clock`` drones decide at each step, as
in case 8, and else when they are free. NAMEs are those of the motions to compare; "choice" is one.
"""

import argparse

import numpy as np

import desim_uav as du
from desim_uav.experiment.statistics import estimate, paired
from desim_uav.experiment.train.course import train
from desim_uav.model.motion import REST, BangCoastBang
from desim_uav.model.propulsion.rotary_wing import ROTORS, best_speeds, powers_of
from desim_uav.model.rotary_wing import RotaryWing
from desim_uav.policies.tabular import Greedy

FIRST_SEED, EVALUATED = 100, 20
CELL_M, STEP_S, TOP_MPS = 240.0, 60.0, 18.3
SPEEDS = (4.07, 6.0, 8.3, 10.2, 12.0, 14.0, 18.3, 22.0)
MOTIONS = {
    "fill_epoch": {"timing": "fill_epoch"},
    "8.3 m/s": {"cruise": [8.3]},
    "18.3 m/s": {"cruise": [18.3]},
    "10.2 m/s": {"cruise": [10.2]},
    "choice": {"cruise": [6.0, 10.2, 18.3]},
}
"""The motions by name; all return at the highest speed, which is about V_mr."""


def main(names, seeds, episodes, energy, clock):
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
            found[name, seed] = measured(name, seed, episodes, energy, clock)
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
        *(f"{speed_mps:g} m/s", f"{flight_s:.1f} s", f"{used:,.0f} J", f"{used / CELL_M:.2f} J/m"),
        *(f"{used / flight_s:.1f} W", f"{used + rest:,.0f} J"),
    )


def scenario_of(name, seed, episodes, energy, clock):
    """Return case 8 with a battery measured in energy and this motion."""
    decisions = "clock" if clock else {"kind": "event", "patience_s": STEP_S}
    return du.load(
        "case8",
        {
            "seed": seed,
            "drones.battery": {"kind": "rotary_wing"},
            "drones.motion": {"max_speed_mps": TOP_MPS, **MOTIONS[name]},
            "decisions": decisions,
            "episode.carry_over": clock,
            "reward": {"kind": "qoe", "w1": 0.0, "crash": 10.0, "energy": energy},
            "learning.episodes": episodes,
            "learning.alpha": {"start": 1.0, "decay": 0.02 ** (1 / episodes), "end": 0.05},
            "learning.epsilon": {"start": 0.4, "decay": 0.02 ** (1 / episodes), "end": 0.02},
        },
    )


def measured(name, seed, episodes, energy, clock):
    """Train with a motion in the world of a seed; return the measures of the greedy policy."""
    scenario = scenario_of(name, seed, episodes, energy, clock)
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
    for leg in legs[legs["duration_s"] > 0].to_dict("records"):
        speed = lasts[min(lasts, key=lambda duration_s: abs(duration_s - leg["duration_s"]))]
        what = "return" if leg["mode"] == "returning" else f"{speed:g} m/s"
        what = "climb" if leg["z_from_m"] != leg["z_to_m"] and what != "return" else what
        shares[what] = shares.get(what, 0.0) + leg["duration_s"] / time_s
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


def row(cells):
    """Return a row of a Markdown table."""
    return "| " + " | ".join(map(str, cells)) + " |"


def arguments():
    """Return what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5, help="how many seeds, from 100 on")
    parser.add_argument("--episodes", type=int, default=3000, help="episodes of a training")
    parser.add_argument("--energy", type=float, default=0.3, help="the weight of energy")
    parser.add_argument("--clock", action="store_true", help="decide at each step")
    parser.add_argument("names", nargs="*", help=f"of {', '.join(MOTIONS)}; default: all")
    given = parser.parse_args()
    seeds = range(FIRST_SEED, FIRST_SEED + given.seeds)
    return given.names or list(MOTIONS), seeds, given.episodes, given.energy, given.clock


if __name__ == "__main__":
    main(*arguments())
