"""Bounds on what the best policies can reach, as results in Python and in notebooks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

import pandas as pd

from desim_uav.report import notebook
from desim_uav.report.optimum import HEADINGS, optima, title_of


class Found(Mapping[str, Any]):
    """A result whose entries are those that the command line prints with ``--json``."""

    def __init__(self, content: dict[str, Any]) -> None:
        self._content = content

    def content(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return self._content

    def __getitem__(self, key: str) -> Any:
        return self._content[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._content)

    def __len__(self) -> int:
        return len(self._content)


class Optimum(Found):
    """How well any policy could do in a scenario; an entry is ``found["cover"]``, for instance.

    ``runs`` are the bounds of runs, or None if there are none.
    """

    @property
    def runs(self) -> Bounds | None:
        """The bounds of runs, if runs were bounded."""
        return None if self["runs"] is None else Bounds(self["runs"])

    @cached_property
    def frame(self) -> pd.DataFrame:
        """One row per optimum, as the command line shows it."""
        names = [heading.replace("\n", " ") for heading in HEADINGS]
        return pd.DataFrame([row[:5] for row in optima(self._content)], columns=names)

    def __repr__(self) -> str:
        return f"<Optimum in {title_of(self._content)}>"

    def _repr_html_(self) -> str:
        rows = [row[:5] for row in optima(self._content)]
        return notebook.heading(title_of(self._content)) + notebook.table(HEADINGS, rows, [0, 4])


class Bounds(Found):
    """Upper bounds of QoE3 and QoE1 for all policies, on each seed and as means over the seeds."""

    @cached_property
    def frame(self) -> pd.DataFrame:
        """One row per seed."""
        return pd.DataFrame(self["seeds"])

    @cached_property
    def means(self) -> pd.DataFrame:
        """One row per bound: mean, half-width and interval over the seeds."""
        return pd.DataFrame(self["means"]).T

    def __repr__(self) -> str:
        means = ", ".join(
            f"{name} {estimate['mean']:.2f}"
            for name, estimate in self["means"].items()
            if estimate["mean"] is not None
        )
        return f"<Bounds on {len(self['seeds'])} seed(s), {self['episodes']} episode(s): {means}>"

    def _repr_html_(self) -> str:
        title = f"Bounds for all policies, runs of {self['episodes']} episode(s)"
        rows = [
            [
                name,
                estimate["n"],
                *("" if estimate[of] is None else f"{estimate[of]:.2f}" for of in OF_MEANS),
            ]
            for name, estimate in self["means"].items()
        ]
        headings = ["bound", "seeds", *(of.replace("_", "-") for of in OF_MEANS)]
        return notebook.heading(title) + notebook.table(headings, rows, [0])


OF_MEANS = ("mean", "half_width", "low", "high")
"""The columns that a result shows of each mean over seeds."""
