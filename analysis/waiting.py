"""Which service waits longest, and where?

python analysis/waiting.py RUN_DIR… [FILE.png]

A row for each service, anywhere and in each cluster of users, longest first: the time from a
request to its first service, mean and 95 % t-interval over seeds, and how many never saw one. Those
count with the time until their end, so their true wait is longer. Runs in different worlds have no
cluster in common: only anywhere is shown. The picture is a map of the mean wait by the cell in
which the user was when it asked, of all runs together; cells with fewer than ten requests are left
out.
"""

import numpy as np
import pandas as pd
from script import run_script

from desim_uav.experiment.statistics import estimate


def main(runs, with_figure):
    """Print the table; the map."""
    runs["never_served_percent"] = 100.0 * (runs["outcome"] == "never_served")
    runs["where"] = "anywhere"
    places = [runs]
    if runs["world_seed"].nunique() == 1:
        places.append(runs.assign(where="cluster " + runs["cluster"].astype("str")))
    rows = []
    for group, found in pd.concat(places).groupby(["policy", "service", "where"]):
        of_seeds = found.groupby(["seed", "world_seed"])
        wait = estimate(of_seeds["wait_s"].mean())
        never = estimate(of_seeds["never_served_percent"].mean())
        rows.append((*group, len(found), wait.mean, f"{wait:.1f}", f"{never:.1f}"))
    columns = ("policy", "service", "where", "requests", "mean", "wait, s", "never served, %")
    table = pd.DataFrame(rows, columns=columns)
    table = table.sort_values(["policy", "mean"], ascending=[True, False])
    print(table.drop(columns="mean").to_string(index=False))
    return wait_map(runs) if with_figure else None


def wait_map(runs):
    """The mean wait in each cell."""
    from matplotlib.figure import Figure

    often = runs.groupby("cell").filter(lambda requests: len(requests) >= 10)
    waits = often.groupby("cell")["wait_s"].mean()
    cells = [tuple(map(int, cell.split(", "))) for cell in waits.index]
    figure = Figure(figsize=(5.6, 4.6))
    axes = figure.add_subplot(xlabel="cell, ix", ylabel="cell, iy", aspect="equal")
    drawn = axes.scatter(*np.reshape(cells, (-1, 2)).T, c=waits, cmap="cividis", marker="s", s=200)
    axes.grid(visible=False)
    axes.margins(0.1)
    axes.locator_params(integer=True)
    figure.colorbar(drawn, label="mean wait for the first service, s")
    return figure


if __name__ == "__main__":
    run_script(main, __doc__)
