"""Are users far from their cluster's centre served worse?

python analysis/distance.py RUN_DIR… [FILE.png]

A row for each 60 m of distance at the moment of the request, the last one for all beyond: QoE1 in
percent, mean and 95 % t-interval over seeds, and the number of requests; below the table Spearman's
rank correlation of the two, likewise over seeds. A falling column and an interval below zero say
yes.
"""

import pandas as pd
from script import run_script

from desim_uav.errors import PolicyError
from desim_uav.experiment.statistics import estimate

WIDTH_M, LAST_M = 60, 720


def main(runs, with_figure):
    """Print the table; the curve with its intervals."""
    if runs["cluster"].isna().any():
        raise PolicyError("the scenario of these runs has no clusters of users")
    runs["qoe1_percent"] = 100 * runs["qoe1"]
    from_m = WIDTH_M * (runs["from_centre_m"] // WIDTH_M)
    runs["from_m"] = from_m.clip(upper=LAST_M).astype(int)
    curves = {}
    for policy, of_policy in runs.groupby("policy", sort=False):
        bins = of_policy.groupby("from_m")
        curves[policy] = {m: estimate(of_seeds(found, mean_qoe1)) for m, found in bins}
        shown = [(f"{m} on", f"{e:.1f}") for m, e in curves[policy].items()]
        table = pd.DataFrame(shown, columns=("distance, m", "QoE1, %"))
        print(f"{policy}\n{table.assign(requests=bins.size().to_numpy()).to_string(index=False)}")
        print(f"rank correlation: {estimate(of_seeds(of_policy, correlation)):.3f}")
    return curve(curves) if with_figure else None


def of_seeds(requests, measure):
    """A measure of each replication."""
    return [measure(found) for _, found in requests.groupby(["seed", "world_seed"])]


def mean_qoe1(requests):
    """In percent."""
    return requests["qoe1_percent"].mean()


def correlation(requests):
    """Spearman's, by ranks."""
    return requests["from_centre_m"].rank().corr(requests["qoe1"].rank())


def curve(curves):
    """QoE1 over the distance."""
    from matplotlib.figure import Figure

    from desim_uav.report.figures.style import look, marker

    figure = Figure(figsize=(6, 4))
    axes = figure.add_subplot(xlabel="distance from the cluster's centre, m", ylabel="QoE1, %")
    for shift, (policy, found) in enumerate(curves.items()):
        middle = [m + WIDTH_M / 2 + 3 * shift for m in found]
        means = [e.mean for e in found.values()]
        axes.plot(middle, means, label=policy, marker=marker(shift), **look(shift))
        ends = [(m, e) for m, e in zip(middle, found.values(), strict=True) if e.half_width]
        for m, e in ends:
            axes.errorbar(m, e.mean, e.half_width, capsize=3, lw=1.1, color=look(shift)["color"])
    axes.legend()
    return figure


if __name__ == "__main__":
    run_script(main, __doc__)
