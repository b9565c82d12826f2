"""The delay of tasks that are computed by their user, offloaded, or split, as Wang et al. have it.

python analysis/offloading.py [FILE.png]

Wang et al. (Computation offloading optimization for UAV-assisted mobile edge computing: a deep
deterministic policy gradient approach, Wireless Networks 27, 2021) draw the delay of all tasks of
an episode over their size, from 60 to 140 Mibit. Their learned policies lie between the lines of
this table: all is computed by the users, all is offloaded to the drone, or each task is split where
both parts are done at once, for users right below the drone. Each figure is a run of
analysis/offloading.yaml. The delays are proportional to the bits, so one task stands for all those
that users have one after the other. The table has the formula beside each line; the exit code is 6
if they are more than 2 µs apart.
"""

import sys
from pathlib import Path

from script import row

import desim_uav as du
from desim_uav.disk import write_whole

SCENARIO = Path(__file__).with_suffix(".yaml")
LINES = {"local": "never", "edge only": "always", "best split": "split"}
SIZES_MIBIT = (60, 80, 100, 120, 140)
CYCLES_PER_BIT, USER_HZ, DRONE_HZ, LINK_BPS = 1000, 0.6e9, 1.2e9, 9_967_226
APART_S, DOES_NOT_HOLD = 2e-6, 6


def main(picture=None):
    """Print the table, draw the figure, and return the exit code."""
    found = {size: {line: simulated_s(line, size) for line in LINES} for size in SIZES_MIBIT}
    print(row(["Mibit", *(f"{line}, s | formula, s" for line in LINES)]))
    print(row(["---:"] * (1 + 2 * len(LINES))))
    furthest_s = 0.0
    for size, ours in found.items():
        theory = formulas_s(size)
        pairs = [(ours[line], theory[line]) for line in LINES]
        furthest_s = max(furthest_s, *(abs(one - other) for one, other in pairs))
        print(row([size, *(f"{time_s:.6f}" for pair in pairs for time_s in pair)]))
    print(f"\nfurthest apart: {1e6 * furthest_s:.2f} µs")
    if picture:
        write_whole(Path(picture), drawn(found, Path(picture).suffix))
    return DOES_NOT_HOLD if furthest_s > APART_S else 0


def simulated_s(line, size_mibit):
    """Return the delay of a task in a run of the scenario."""
    asked = {"offloading": LINES[line], "services.task.input_mbit": [size_mibit * 2**20 / 1e6]}
    (task,) = du.run(SCENARIO, asked, policy="hover", progress=False).requests.itertuples()
    return task.t_end_s - task.t_request_s


def formulas_s(size_mibit):
    """Return the delay of each line; both parts of a split take the same time."""
    bits = size_mibit * 2**20
    local_s = bits * CYCLES_PER_BIT / USER_HZ
    edge_s = bits / LINK_BPS + bits * CYCLES_PER_BIT / DRONE_HZ
    return {
        "local": local_s,
        "edge only": edge_s,
        "best split": local_s * edge_s / (local_s + edge_s),
    }


def drawn(found, suffix):
    """Return the figure as the content of a file."""
    from matplotlib.figure import Figure

    from desim_uav.report.figures.style import styled, to_bytes

    @styled
    def draw():
        figure = Figure(figsize=(6, 4), layout="constrained")
        axes = figure.subplots()
        for line in LINES:
            axes.plot(SIZES_MIBIT, [ours[line] for ours in found.values()], "o-", label=line)
        axes.set(xlabel="size of all tasks, Mibit", ylabel="delay, s", ylim=(0, None))
        axes.legend()
        return to_bytes(figure, suffix)

    return draw()


if __name__ == "__main__":
    if sys.argv[1:] and sys.argv[1].startswith("-"):
        print(__doc__)
        sys.exit(0)
    sys.exit(main(*sys.argv[1:2]))
