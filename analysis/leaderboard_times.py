"""The processor time that each part of the leaderboard took, kept beside its submissions."""

from __future__ import annotations

import csv
import io
import resource
from pathlib import Path

from desim_uav.disk import write_at
from desim_uav.experiment.provenance import processor

COLUMNS = ("kind", "part", "processor_s", "processor")


class Times:
    """The times in a file, by the kind and the name of a part, in seconds, and the processors."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def all(self) -> dict[tuple[str, str], tuple[float, str]]:
        """Return all times that are kept, with the name of the processor."""
        if not self.file.exists():
            return {}
        with self.file.open(encoding="utf-8", newline="") as lines:
            return {
                (row["kind"], row["part"]): (float(row["processor_s"]), row["processor"])
                for row in csv.DictReader(lines)
            }

    def sums(self) -> dict[str, tuple[int, float]]:
        """Return how many parts of each kind have a time, and the sum of these."""
        sums: dict[str, tuple[int, float]] = {}
        for (kind, _), (spent_s, _) in self.all().items():
            count, sum_s = sums.get(kind, (0, 0.0))
            sums[kind] = (count + 1, sum_s + spent_s)
        return sums

    def processors(self) -> list[str]:
        """Return the names of the processors, each once."""
        return list(dict.fromkeys(name for _, name in self.all().values()))

    def add(self, kind: str, part: str, spent_s: float, *, anew: bool = False) -> None:
        """Add to the time of a part, or replace it if the part was made ``anew``; and keep it."""
        times = self.all()
        before_s, _ = (0.0, "") if anew else times.get((kind, part), (0.0, ""))
        times[kind, part] = (before_s + spent_s, processor())
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows((*key, f"{s:.1f}", name) for key, (s, name) in sorted(times.items()))
        self.file.parent.mkdir(parents=True, exist_ok=True)
        write_at(self.file, text.getvalue().encode())


def spent_s() -> float:
    """Return the processor time of this process and of its ended children, in seconds."""
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in usage)
