"""The processor time that each part of the leaderboard took, kept beside its submissions."""

from __future__ import annotations

import csv
import io
import resource
from collections.abc import Mapping
from pathlib import Path

from desim_uav.disk import write_at

NAME = "leaderboard_times.csv"


def kept(submissions: Path) -> dict[str, float]:
    """Return the kept times in seconds, by what was made."""
    file = submissions.with_name(NAME)
    if not file.exists():
        return {}
    with file.open(encoding="utf-8", newline="") as lines:
        return {row["made"]: float(row["processor_s"]) for row in csv.DictReader(lines)}


def keep(submissions: Path, spent_s: Mapping[str, float]) -> None:
    """Add times to the kept ones; that of something made again is replaced."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["made", "processor_s"])
    found = kept(submissions) | dict(spent_s)
    writer.writerows([made, f"{found[made]:.1f}"] for made in sorted(found))
    write_at(submissions.with_name(NAME), text.getvalue().encode())


def spent_s() -> float:
    """Return the processor time of this process and of its ended children, in seconds."""
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in usage)
