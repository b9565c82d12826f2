"""How evenly are users served, by policy?

python analysis/fairness.py RUN_DIR… [FILE.png]

A row a policy, of the users' mean QoE1 in a run: Jain's index (1: all alike), Gini's (0: all
alike), the mean of the worst-off tenth of the users beside that of all, in percent; mean and 95 %
t-interval over seeds. The picture holds the Lorenz curves, averaged over seeds: the deeper one sags
under the diagonal, the less even.
"""

import math

import numpy as np
import pandas as pd
from script import run_script

from desim_uav import qoe
from desim_uav.experiment.statistics import estimate


def main(runs, with_figure):
    """Print the table; the Lorenz curves."""
    rows, curves = [], {}
    for policy, of_policy in runs.groupby("policy", sort=False):
        seeds = [found for _, found in of_policy.groupby(["seed", "world_seed"])]
        values = (f"{estimate(map(of, seeds)):{form}}" for of, form in MEASURES.values())
        rows.append((policy, len(seeds), *values))
        curves[policy] = [lorenz(found) for found in seeds]
    print(pd.DataFrame(rows, columns=("policy", "seeds", *MEASURES)).to_string(index=False))
    return lorenz_curves(curves) if with_figure else None


def gini(requests):
    """Gini's index of the users' mean QoE1; None if no user was served.

    It is 0 if all n users have the same QoE1, and 1 - 1/n if only one has any: twice the area
    between the Lorenz curve and the diagonal.
    """
    curve = lorenz(requests)
    if len(curve) < 2 or np.isnan(curve).any():
        return None
    return float(1 - (curve[1:] + curve[:-1]).sum() / (len(curve) - 1))


def lorenz(requests):
    """The share of all QoE1 that the worst-off k of n users have, for k from 0 to n."""
    rising = np.sort(of_each_user(requests))
    total = rising.sum()
    return np.append(0.0, np.cumsum(rising)) / (total if total > 0 else np.nan)


def of_each_user(requests):
    """The mean QoE1 of each user that asked, by user."""
    return qoe.Fairness().add(requests).of_each_user()


def worst_tenth(of_users):
    """The mean of the lowest tenth, one user at least, in percent."""
    return 100 * np.sort(of_users)[: math.ceil(len(of_users) / 10)].mean()


def lorenz_curves(curves):
    """The share of all QoE1 over the share of users, worst-off first."""
    from matplotlib.figure import Figure

    from desim_uav.report.figures.style import look

    figure = Figure(figsize=(5, 4.6))
    axes = figure.add_subplot(xlabel="share of users, worst-off first", ylabel="share of all QoE1")
    shares = np.linspace(0, 1, 101)
    axes.plot(shares, shares, color="0.6", linestyle="-", linewidth=0.8, label="all alike")
    for number, (policy, found) in enumerate(curves.items()):
        of_seeds = [np.interp(shares, np.linspace(0, 1, len(curve)), curve) for curve in found]
        axes.plot(shares, np.mean(of_seeds, axis=0), label=policy, **look(number))
    axes.legend()
    return figure


MEASURES = {
    "Jain": (qoe.fairness, ".3f"),
    "Gini": (gini, ".3f"),
    "worst tenth, QoE1 %": (lambda requests: worst_tenth(of_each_user(requests)), ".1f"),
    "all, QoE1 %": (lambda requests: 100 * of_each_user(requests).mean(), ".1f"),
}


if __name__ == "__main__":
    run_script(main, __doc__)
