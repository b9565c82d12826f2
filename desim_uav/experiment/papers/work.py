"""The work of ``desim-uav paper``: a published experiment, computed whole and kept in a folder."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from os import times
from pathlib import Path
from time import perf_counter
from typing import Any

from desim_uav.errors import UsageError, did_you_mean
from desim_uav.experiment.papers import ENTRIES, Entry
from desim_uav.experiment.papers.row import FigureRow
from desim_uav.experiment.progress import progress
from desim_uav.experiment.provenance import clock, processor, versions
from desim_uav.run_folder import RunPlace

HERE = Path(__file__).parent
COLUMNS = ("figure", "where", "theirs", "ours", "apart", "limit", "holds")
MEASURED = HERE / "measured.json"
"""What each command printed when it was last run for the documentation, by paper."""


@dataclass(frozen=True)
class Listed:
    """A paper in the list of all: what is compared, and how its command ended when last measured.

    The numbers of rows that hold, fail and are open, the seconds, and the peak memory in MiB are
    None if they have not been measured.
    """

    name: str
    paper: str
    doi: str | None
    compared: str
    hold: int | None
    fail: int | None
    open: int | None
    seconds: float | None
    peak_mib: int | None


@dataclass(frozen=True)
class Computed:
    """A paper whose rows have been computed, with what that took."""

    name: str
    rows: tuple[FigureRow, ...]
    seconds: float
    processor_s: float
    """The processor time, with that of other processes that were started."""
    peak_mib: int | None
    """The largest memory of a process since it began; None where the system does not tell it."""
    date: str

    @property
    def entry(self) -> Entry:
        """The entry of the paper, with its citation and what computes its figures."""
        return ENTRIES[self.name]

    def count(self) -> dict[str, int]:
        """Return how many rows hold, how many do not, and how many are open."""
        verdicts = [row.holds for row in self.rows]
        return {
            "hold": verdicts.count(True),
            "fail": verdicts.count(False),
            "open": verdicts.count(None),
        }

    def summary(self) -> str:
        """Return in one line how many figures hold."""
        counted = self.count()
        claimed = counted["hold"] + counted["fail"]
        return f"{counted['hold']} of {claimed} figures hold, {counted['open']} are open"

    def content(self) -> dict[str, Any]:
        """Return all of it as plain values."""
        return {
            "name": self.name,
            "paper": self.entry.paper,
            "doi": self.entry.doi,
            "compared": self.entry.compared,
            **self.count(),
            "seconds": round(self.seconds, 1),
            "processor_s": round(self.processor_s, 1),
            "peak_mib": self.peak_mib,
            "command": f"desim-uav paper {self.name}",
            "date": self.date,
            "processor": processor(),
            "versions": versions(),
            "rows": [row.content() for row in self.rows],
        }

    def markdown(self) -> str:
        """Return the citation, the table, and what it took, in Markdown."""
        from desim_uav.report.papers import markdown_table

        where = "" if self.entry.doi is None else f" {link_of(self.entry.doi)}"
        memory = "" if self.peak_mib is None else f", {self.peak_mib} MiB"
        took = f"{self.seconds:.1f} s, of the processor {self.processor_s:.1f} s{memory}"
        table = markdown_table(COLUMNS, [row.cells() for row in self.rows])
        return (
            f"# {self.name}\n\n{self.entry.paper}.{where}\n\n{table}\n"
            f"{self.summary()}. `desim-uav paper {self.name}` took {took} ({processor()}).\n"
        )


def link_of(doi: str) -> str:
    """Return the address of a DOI."""
    return f"https://doi.org/{doi}"


@cache
def measured() -> dict[str, dict[str, Any]]:
    """Return the contents of all papers that have been measured, by name."""
    content: dict[str, dict[str, Any]] = json.loads(MEASURED.read_text(encoding="utf-8"))
    return content


def listing() -> list[Listed]:
    """Return all papers, with what is known of each."""
    names = ("hold", "fail", "open", "seconds", "peak_mib")
    listed = []
    for name, entry in ENTRIES.items():
        known = measured().get(name, {})
        numbers = {each: known.get(each) for each in names}
        listed.append(Listed(name, entry.paper, entry.doi, entry.compared, **numbers))
    return listed


def check(name: str) -> None:
    """Raise UsageError if there is no such paper."""
    if name not in ENTRIES:
        hint = did_you_mean(name, ENTRIES)
        raise UsageError(f"no such paper: {name!r}{hint}; there are {', '.join(ENTRIES)}")


def compute(name: str, show_progress: bool = False) -> Computed:
    """Compute the rows of a paper. Raises UsageError if there is no such paper."""
    check(name)
    began, processor_s, rows = perf_counter(), _processor_s(), []
    expected = len(measured().get(name, {}).get("rows", ())) or 1
    with progress(show_progress, expected, "figures") as advance:
        for row in ENTRIES[name].rows():
            rows.append(row)
            advance()
    return Computed(
        name,
        tuple(rows),
        perf_counter() - began,
        _processor_s() - processor_s,
        _peak_mib(),
        clock()(),
    )


def keep(computed: Computed, place: RunPlace) -> Path:
    """Write the rows, the table, the figure and the scenarios into a folder, whole or not at all.

    Returns the folder. Raises UsageError if nothing can be written there.
    """
    with place.draft() as draft:
        draft.write_json("paper.json", computed.content())
        draft.write_text("table.md", computed.markdown())
        for name in computed.entry.scenarios:
            draft.write_bytes(name, (HERE / name).read_bytes())
        if computed.entry.draw is not None:
            from desim_uav.report.figures.style import to_bytes

            draft.write_bytes("figure.png", to_bytes(computed.entry.draw(), ".png"))
        return place.publish(draft)


def cells(listed: Sequence[Listed]) -> list[tuple[str, ...]]:
    """Return the list of papers as text: name, paper, what is compared, rows, seconds, memory."""
    return [
        (
            one.name,
            one.paper + ("" if one.doi is None else f" {link_of(one.doi)}"),
            one.compared,
            *("-" if number is None else str(number) for number in (one.hold, one.fail, one.open)),
            "-" if one.seconds is None else f"{one.seconds:.0f}",
            "-" if one.peak_mib is None else str(one.peak_mib),
        )
        for one in listed
    ]


LIST_COLUMNS = ("name", "paper", "what is compared", "hold", "fail", "open", "s", "MiB")


def _processor_s() -> float:
    """Return the processor time so far, with that of processes that have ended."""
    used = times()
    return used.user + used.system + used.children_user + used.children_system


def _peak_mib() -> int | None:
    """Return the largest memory of this process, or of one that it started."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    whose = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    most = max(resource.getrusage(who).ru_maxrss for who in whose)
    return int(most / (2**20 if sys.platform == "darwin" else 2**10))
