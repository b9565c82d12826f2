"""What does an interruption cost?

python analysis/interruptions.py RUN_DIR… [FILE.png]

A row a policy and service: interrupted requests minus uninterrupted ones of the same seed, service
and required time, weighted by the interrupted ones, then mean and 95 % t-interval over seeds.
Completion times are of the completed alone. Requests never served are left out: nothing of theirs
could be interrupted. It is a difference, not only an effect: where drones are scarce, requests are
interrupted more often and served less for other reasons too.
"""

import pandas as pd
from script import run_script

from desim_uav.experiment.statistics import estimate

MEASURES = {
    "completion, s": ("completion_s", 1),
    "QoE1, points": ("qoe1", 100),
    "QoE2, steps": ("qoe2_iterations", 1),
}
SIDES = pd.MultiIndex.from_product([["mean", "size"], [False, True]])


def main(runs, with_figure):
    """Print the table; the costs as bars."""
    served = runs[runs["outcome"] != "never_served"]
    served = served.assign(interrupted=served["interruptions"] > 0)
    both = pd.concat([served.assign(row="all"), served.assign(row=served["service"])])
    rows, costs = [], {}
    for group, found in both.groupby(["policy", "row"]):
        costs[group] = [
            estimate(scale * costs_of_seeds(found, column)) for column, scale in MEASURES.values()
        ]
        share = f"{100 * found['interrupted'].mean():.1f}"
        rows.append((*group, len(found), share, *(f"{cost:.2f}" for cost in costs[group])))
    columns = ("policy", "service", "served requests", "interrupted, %", *MEASURES)
    print(pd.DataFrame(rows, columns=columns).to_string(index=False))
    return bars(costs) if with_figure else None


def costs_of_seeds(requests, measure):
    """Interrupted minus uninterrupted, like with like, of each seed."""
    seed = ["seed", "world_seed"]
    alike = requests.dropna(subset=measure).groupby(
        [*seed, "service", "requested_s", "interrupted"]
    )
    sides = alike[measure].agg(["mean", "size"]).unstack("interrupted")
    sides = sides.reindex(columns=SIDES).dropna()
    weight = sides["size", True]
    weighted = (sides["mean", True] - sides["mean", False]) * weight
    return weighted.groupby(seed).sum() / weight.groupby(seed).sum()


def bars(costs):
    """A panel a measure."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 1.4 + 0.28 * len(costs)))
    panels = figure.subplots(1, len(MEASURES), sharey=True)
    for number, (axes, label) in enumerate(zip(panels, MEASURES, strict=True)):
        names = [", ".join(group) for group in costs]
        means = [found[number].mean or 0 for found in costs.values()]
        axes.barh(names, means, color="0.7")
        for row, found in enumerate(costs.values()):
            if found[number].half_width:
                mean, half_width = found[number].mean, found[number].half_width
                axes.errorbar(mean, row, xerr=half_width, capsize=3, color="k")
        axes.axvline(0, color="0.3", linestyle="-", linewidth=0.9)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel(f"cost in {label}")
    panels[0].invert_yaxis()
    return figure


if __name__ == "__main__":
    run_script(main, __doc__)
