"""Steps a second with links of classes, beside the disc and beside mobile-env, in one run.

    pip install mobile-env               (or into an environment of its own, and then)
    python benchmarks/radio.py [--peer-python /path/to/its/bin/python] [--rounds 7] [--seconds 2]

A step is one parallel step of all agents, draws and resets count as time. Ours learn in it, as in
fused.py. Case 8 has its disc of 600 m, or 15 rings of which the widest has about this radius.
urban_downlink is the shipped scenario (120 users, 4 drones, 15 rings), without interference as it
stands, and with co_channel.

mobile-env's large central scenario (30 users, 13 stations) only steps, with random actions drawn
before the clock starts, as in peers.py. In mobile-env there is no interference at all, so the
ratio with interference compares a model that has it with one that does not.

Each has a process of its own and one thread; the rounds go from one to the next, so that whatever
else the machine does meets all. CPU time; medians of the rounds.
"""

from __future__ import annotations

import argparse
import sys

from fused import Runner, in_blocks, measured, training, work
from peers import mobile_env

RINGS = "drones.radio={kind: link_classes, power_dbm: 7, classes: cqi}"
INTERFERENCE = "drones.radio.interference=co_channel"
PEER = "mobile-env large"
WIDTH = 30

MOST = [("case 8, disc", "case 8, rings", 3)]
"""How many times as long a step of the second may take as one of the first."""
LEAST = [("urban_downlink", PEER, 100), ("urban_downlink, co_channel", PEER, 20)]
"""How many times as fast the first has to be."""

RUNNERS: dict[str, Runner] = {
    "case 8, disc": lambda: training("case8", "batch"),
    "case 8, rings": lambda: training("case8", "batch", changes=[RINGS]),
    "urban_downlink": lambda: training("urban_downlink", "batch"),
    "urban_downlink, co_channel": lambda: training(
        "urban_downlink", "batch", changes=[INTERFERENCE]
    ),
    PEER: lambda: in_blocks(mobile_env("mobile-large-central-v0")),
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--peer-python", default=sys.executable, help="has mobile-env")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each measurement")
    parser.add_argument("--work", choices=RUNNERS, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.work:
        work(RUNNERS[args.work], args.seconds)
        return
    pythons = {PEER: args.peer_python}
    medians = measured(list(RUNNERS), pythons, args.rounds, args.seconds, __file__, WIDTH)
    for one, other, aim in MOST:
        ratio = medians[one] / medians[other]
        print(f"time of {other} / {one}: {ratio:.3g} (aim: at most {aim})")
    for one, other, aim in LEAST:
        ratio = medians[one] / medians[other]
        print(f"{one} / {other}: {ratio:.3g} (aim: at least {aim})")
    print("mobile-env has no interference, so the last ratio is not of equal models.")


if __name__ == "__main__":
    main()
