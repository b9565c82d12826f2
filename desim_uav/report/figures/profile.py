"""Performance profiles: which share of runs reaches which score, by policy."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.lines import Line2D

from desim_uav.report.curves import Panel
from desim_uav.report.figures.style import Figure, headed, look, short, styled


@styled
def profile_figure(panels: Sequence[Panel]) -> Figure:
    """Draw the curves of each panel with their bands; a policy looks the same in all of them.

    A name that ends with a star is that of a policy that knows the future.
    """
    names = list(dict.fromkeys(curve.name for panel in panels for curve in panel.curves))
    figure = Figure(figsize=(1.9 + 4.1 * len(panels), 3.9))
    for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        for curve in panel.curves:
            style = look(names.index(curve.name))
            axes.plot(curve.x, curve.y, **style)
            axes.fill_between(curve.x, curve.low, curve.high, alpha=0.15, color=style["color"])
        axes.axvline(0, color="0.3", ls="-", linewidth=0.9, zorder=1)
        axes.set(xlabel="score (0: baseline, 1: bound)", title=panel.title)
        axes.set(xlim=(panel.curves[0].x[0], panel.curves[0].x[-1]), ylim=(-0.02, 1.02))
    figure.axes[0].set_ylabel("share of runs that reach the score")
    entries = [Line2D([], [], label=short(name), **look(n)) for n, name in enumerate(names)]
    figure.legend(handles=entries, loc="outside right center")
    future = "; * knows the future" if any(name.endswith("*") for name in names) else ""
    headed(figure, f"Performance profiles, with pointwise 95 % bands{future}")
    return figure
