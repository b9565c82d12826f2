"""The processor time that each part of the leaderboard took, kept beside its submissions."""

from __future__ import annotations

import csv
import io
import resource
from pathlib import Path

from desim_uav.disk import write_at

COLUMNS = ("kind", "part", "processor_s")


class Times:
    """The times in a file, by the kind and the name of a part, in seconds."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def all(self) -> dict[tuple[str, str], float]:
        """Return all times that are kept."""
        if not self.file.exists():
            return {}
        with self.file.open(encoding="utf-8", newline="") as lines:
            rows = csv.DictReader(lines)
            return {(row["kind"], row["part"]): float(row["processor_s"]) for row in rows}

    def sums(self) -> dict[str, tuple[int, float]]:
        """Return how many parts of each kind have a time, and the sum of these."""
        sums: dict[str, tuple[int, float]] = {}
        for (kind, _), spent_s in self.all().items():
            count, sum_s = sums.get(kind, (0, 0.0))
            sums[kind] = (count + 1, sum_s + spent_s)
        return sums

    def add(self, kind: str, part: str, spent_s: float, *, anew: bool = False) -> None:
        """Add to the time of a part, or replace it if the part was made ``anew``; and keep it."""
        times = self.all()
        times[kind, part] = spent_s + (0.0 if anew else times.get((kind, part), 0.0))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows((*key, f"{times[key]:.1f}") for key in sorted(times))
        self.file.parent.mkdir(parents=True, exist_ok=True)
        write_at(self.file, text.getvalue().encode())


def spent_s() -> float:
    """Return the processor time of this process and of its ended children, in seconds."""
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in usage)
