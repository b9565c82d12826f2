"""Reads a finished sweep for figures and reports, from its folder alone."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from desim_uav.errors import PolicyError, UsageError, did_you_mean
from desim_uav.experiment.statistics import estimate
from desim_uav.experiment.sweep.folder import (
    FAILED,
    MANIFEST,
    RESULTS,
    read_manifest,
    read_row,
)
from desim_uav.experiment.sweep.job import JobRow
from desim_uav.measures.known import ALWAYS, KNOWN
from desim_uav.parquet_file import no_such
from desim_uav.report.json_file import MOST_BYTES
from desim_uav.report.text import word
from desim_uav.rowcode.regular_file import text_of

MOST_KEYS = 2
"""The most keys that a figure shows."""

FIXED = ("job", "policy", "algorithm", "seed", "world_seed")
"""The columns of a sweep that are neither keys of the scenario nor measures."""


@dataclass(frozen=True)
class SweepResults:
    """The rows of a sweep, its manifest and its failures."""

    folder: Path
    manifest: dict[str, Any]
    rows: Sequence[JobRow]
    failures: Sequence[dict[str, Any]]
    order: tuple[str, ...] = ()
    """The keys to show, in order; empty means all that vary, in the order of the sweep."""

    @property
    def scenario(self) -> str:
        """The name of the scenario that was swept."""
        return str(self.manifest["scenario"].get("name", ""))

    @cached_property
    def keys(self) -> dict[str, list[Any]]:
        """The keys that vary, each with its values: numbers ascending, others as first met."""
        others = (*FIXED, *KNOWN)
        columns = [key for key in self.manifest["columns"] if key not in others]
        columns = list(self.order) or columns
        values = {key: _ordered(row[key] for row in self.rows) for key in columns}
        return {key: column for key, column in values.items() if len(column) > 1}

    @property
    def measures(self) -> tuple[str, ...]:
        """The names of the measures that its rows have."""
        return tuple(name for name in KNOWN if name in self.manifest["columns"])

    @cached_property
    def policies(self) -> list[str]:
        """The policies and algorithms that have rows, in the order of the command."""
        listed = [*self.manifest.get("policies", ()), *self.manifest.get("algorithms", ())]
        there = list(dict.fromkeys(row["policy"] for row in self.rows))
        in_order = [name for name in dict.fromkeys(listed) if name in there]
        return [*in_order, *(name for name in there if name not in in_order)]

    def estimates(self) -> list[dict[str, Any]]:
        """Return a row for each combination and policy: cells, ``policy`` and ``measures``.

        A measure has ``n``, ``mean`` and ``half_width`` (None if there is none), over seeds.
        """
        return list(self._estimates())

    def _estimates(self) -> Iterator[dict[str, Any]]:
        places: dict[str, dict[Any, int]] = {
            key: {value: k for k, value in enumerate(values)} for key, values in self.keys.items()
        }
        groups: dict[tuple[int, ...], list[JobRow]] = {}
        for row in self.rows:
            at = [places[key][row[key]] for key in self.keys]
            groups.setdefault((*at, self.policies.index(row["policy"])), []).append(row)
        for _, rows in sorted(groups.items(), key=lambda item: item[0]):
            cells = {key: rows[0][key] for key in self.keys}
            measures = {name: asdict(estimate(row[name] for row in rows)) for name in self.measures}
            yield cells | {"policy": rows[0]["policy"], "measures": measures}


def read_sweep(folder: Path) -> SweepResults:
    """Read the folder of a sweep. Raises PolicyError if it cannot be read or has no row."""
    if not folder.is_dir():
        raise no_such(folder, "sweep folder")
    if not is_sweep(folder):
        raise PolicyError(f"{folder}: not a sweep folder: it has no {RESULTS}/ or no {MANIFEST}")
    manifest = read_manifest(folder / MANIFEST)
    columns = {str(name): str(of) for name, of in manifest["columns"].items()}
    missing = [name for name in (*FIXED, *ALWAYS) if name not in columns]
    if missing:
        raise PolicyError(
            f"{folder / MANIFEST}: not the manifest of a sweep: it has no column {missing[0]}"
        )
    rows = [row for job in manifest["jobs"] for row in _rows(folder, columns, str(job))]
    if not rows:
        raise PolicyError(f"{folder}: no job of this sweep has ended")
    return SweepResults(folder, manifest, rows, _failures(folder / FAILED))


def is_sweep(folder: Path) -> bool:
    """Return whether a folder looks like that of a sweep."""
    return (folder / RESULTS).is_dir() and (folder / MANIFEST).is_file()


def content(results: SweepResults, fixed: Mapping[str, Any]) -> dict[str, Any]:
    """Return the data of a sweep's figure, as plain data."""
    return {
        "scenario": results.scenario,
        "episodes": results.manifest["episodes"],
        "keys": results.keys,
        "held": {key: word(value) for key, value in fixed.items()},
        "policies": results.policies,
        "estimates": results.estimates(),
    }


def chosen_keys(results: SweepResults, value_at: Mapping[str, str | None]) -> SweepResults:
    """Keep the rows that a figure of at most two keys shows.

    ``value_at`` has the keys to show (None) and those to hold at a value, in this order. Raises
    UsageError if a key does not vary, has no such value, or more than two keys are left.
    """
    keys, rows = results.keys, results.rows
    for key, text in value_at.items():
        if key not in keys:
            varied = ", ".join(keys) or "none"
            hint = did_you_mean(key, keys)
            raise UsageError(
                f"key: {key}: the key does not vary in this sweep{hint}; keys that vary: {varied}"
            )
        if text is not None:
            value = _named(key, text, keys[key])
            rows = [row for row in rows if row[key] == value]
    free = [key for key in keys if value_at.get(key) is None]
    if len(free) > MOST_KEYS:
        many = ", ".join(free)
        example = f"--key {free[-1]}={word(keys[free[-1]][0])}"
        raise UsageError(
            f"{results.folder}: {len(free)} keys vary ({many}), and a figure shows at most "
            f"{MOST_KEYS}; hold the others at a value, as in {example}"
        )
    if not rows:
        raise PolicyError(f"{results.folder}: no job with these values has ended")
    order = [*(key for key, text in value_at.items() if text is None), *free]
    selection = replace(results, rows=rows, order=tuple(dict.fromkeys(order)))
    if not selection.keys:
        raise UsageError(f"{results.folder}: no key is left that varies, so there is no figure")
    return selection


def _named(key: str, text: str, values: Sequence[Any]) -> Any:
    for value in values:
        if text == word(value) or (_is_number(value) and _number(text) == value):
            return value
    raise UsageError(f"key: {key}={text}: its values are {', '.join(map(word, values))}")


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _ordered(column: Iterable[Any]) -> list[Any]:
    values = list(dict.fromkeys(column))
    return sorted(values) if all(map(_is_number, values)) else values


def _rows(folder: Path, columns: Mapping[str, str], job: str) -> Iterator[JobRow]:
    """Yield the row of a job if it has ended. Raises PolicyError if its file is damaged."""
    file = folder / RESULTS / f"{job}.parquet"
    if re.fullmatch("[0-9a-f]+", job) is None:
        raise PolicyError(f"{folder / MANIFEST}: not the manifest of a sweep: job {job!r}")
    if file.exists():
        row = read_row(folder, columns, job)
        if row is None:
            raise PolicyError(
                f"{file}: damaged or of another sweep; desim-uav sweep --resume computes it again"
            )
        yield row


def _failures(file: Path) -> list[dict[str, Any]]:
    if not file.exists():
        return []
    try:
        rows = json.loads(text_of(file, MOST_BYTES))
    except (OSError, ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or error
        raise PolicyError(f"{file}: not a readable list of failures: {reason}") from error
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise PolicyError(f"{file}: not a list of failed jobs")
    return rows
