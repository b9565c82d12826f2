"""By how much do policies differ on the same users and requests?

python analysis/paired_difference.py RUN_DIR… [FILE.png]

Runs of two policies or more on common seeds; the first run's policy is the reference. A row a
measure and policy: that policy minus the reference, seed by seed, mean and 95 % t-interval over the
seeds they share, and whether zero lies outside. Means are over a seed's
requests; waits of requests never served count until their end. QoE3, crashes and rewards are not of
requests: desim-uav compare RUN_DIR… has them.
"""

import pandas as pd
from script import run_script

from desim_uav.errors import PolicyError
from desim_uav.experiment.statistics import paired

MEASURES = {
    "QoE1, points": ("qoe1", 100),
    "QoE2, steps": ("qoe2_iterations", 1),
    "wait, s": ("wait_s", 1),
    "completion, s": ("completion_s", 1),
    "interruptions": ("interruptions", 1),
    "handovers": ("handovers", 1),
}


def main(runs, with_figure):
    """Print the table; the intervals."""
    reference, *others = runs["policy"].unique()
    if not others:
        raise PolicyError(f"all runs are of one policy, {reference}: none to compare it with")
    means = runs.groupby(["policy", "seed", "world_seed"])[[c for c, _ in MEASURES.values()]].mean()
    rows, found = [], {}
    for label, (column, scale) in MEASURES.items():
        by_policy = scale * means[column].unstack("policy")
        for policy in others:
            minus = found[label, policy] = paired(by_policy[policy], by_policy[reference])
            outside = "≠ 0" if minus.excludes_zero else ""
            rows.append((label, f"{policy} - {reference}", minus.n, f"{minus:.3f}", outside))
    columns = ("measure", "difference", "seeds", "mean", "")
    print(pd.DataFrame(rows, columns=columns).to_string(index=False))
    return intervals(found, others, reference) if with_figure else None


def intervals(found, others, reference):
    """A panel a measure, a line a policy."""
    from matplotlib.figure import Figure

    from desim_uav.report.figures.style import headed, look, marker

    figure = Figure(figsize=(9, 3 + 0.4 * len(others)))
    for axes, label in zip(figure.subplots(2, 3, sharey=True).flat, MEASURES, strict=True):
        for row, policy in enumerate(others):
            minus = found[label, policy]
            if minus.mean is not None:
                dressed = {"color": look(row + 1)["color"], "marker": marker(row + 1)}
                axes.errorbar(minus.mean, row, xerr=minus.half_width or None, capsize=3, **dressed)
        axes.axvline(0, color="0.3", linestyle="-", linewidth=0.9, zorder=1)
        axes.grid(visible=False, axis="y")
        axes.set_yticks(range(len(others)), others)
        axes.set_ylim(-0.6, len(others) - 0.4)
        axes.set_xlabel(label)
    several = any(minus.half_width is not None for minus in found.values())
    words = "95 % t-intervals" if several else "one seed allows no interval"
    headed(figure, f"minus {reference}, paired by seed, {words}")
    return figure


if __name__ == "__main__":
    run_script(main, __doc__)
