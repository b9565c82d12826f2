"""The folder of a sweep: a manifest, and a file for each job that has ended.

``results/`` is one Parquet dataset with a row per job. Each job's file is written in one step, so
the same command can continue a sweep however it ended.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from desim_uav import __version__
from desim_uav.checksums import of_row
from desim_uav.disk import write_whole
from desim_uav.errors import PolicyError, UsageError
from desim_uav.experiment.provenance import versions
from desim_uav.experiment.sweep.grid import Axis
from desim_uav.experiment.sweep.job import Failure, Job, JobOutcome, JobRow
from desim_uav.experiment.sweep.plan import ScenarioSource
from desim_uav.lock import held
from desim_uav.measures.known import ALWAYS, KNOWN
from desim_uav.report.json_file import MOST_BYTES
from desim_uav.rowcode.regular_file import content_of, text_of

if TYPE_CHECKING:
    import pyarrow as pa

MANIFEST, FAILED, RESULTS, TABLES = "manifest.json", "failed.json", "results", "policies"
DIGEST = b"row_sha256"
"""The key of a row's checksum: Parquet has checksums for its pages, but not for its metadata."""
PLAN = {"scenario": dict, "columns": dict, "episodes": int, "warmup": int, "jobs": list}
"""The entries of a manifest that its readers need, with their types."""


class SweepFolder:
    """Stores the rows of a sweep's jobs and reads them again."""

    def __init__(self, out: Path, axes: Sequence[Axis], measures: Sequence[str] = ALWAYS) -> None:
        self.out = out
        self.columns = {"job": "string"} | {axis.key: axis.dtype for axis in axes}
        self.columns |= {"policy": "string", "algorithm": "string", "seed": "int64"}
        self.columns |= {"world_seed": "int64"} | dict.fromkeys(measures, "float64")

    @contextmanager
    def held(self) -> Iterator[None]:
        """Keep other sweeps from writing to the folder. Raises UsageError if one already does."""
        try:
            self.out.absolute().parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UsageError(f"--out {self.out}: {error.strerror or error}") from error
        with held(self.out):
            yield

    def open(
        self, source: ScenarioSource, todo: Sequence[Job], resume: bool, command: list[str]
    ) -> bool:
        """Make the folder for these jobs, or check that it belongs to them.

        ``source`` is the scenario. A sweep can be continued with more jobs, but must keep all
        that it has. Returns whether the folder held a sweep.

        Raises UsageError if the folder cannot be used, and PolicyError if it belongs
        to another sweep.
        """
        plan = self._plan(source, todo)
        try:
            exists = self._begun()
            if exists and not resume:
                raise UsageError(
                    f"--out {self.out}: the folder holds a sweep; continue it with --resume"
                )
            if exists and (self.out / MANIFEST).exists():
                self._check(plan)
            self.out.mkdir(parents=True, exist_ok=True)
            about = {"command": command, "started": datetime.now(UTC).isoformat()}
            content = json.dumps(plan | about | {"versions": versions()}, indent=1)
            write_whole(self.out / MANIFEST, (content + "\n").encode())
            for name in (RESULTS, TABLES):
                (self.out / name).mkdir(exist_ok=True)
            return exists
        except OSError as error:
            raise UsageError(f"--out {self.out}: {error.strerror or error}") from error

    def rows(self, todo: Sequence[Job]) -> dict[str, JobRow]:
        """Return the rows of the jobs that have ended, by job. Damaged rows are left out."""
        row_of = {}
        for job in todo:
            row = read_row(self.out, self.columns, job.id)
            if row is not None:
                row_of[job.id] = row
        return row_of

    def keep(self, job: Job, outcome: JobOutcome) -> JobRow:
        """Store the row of a job that has ended, after the Q-table that it learned."""
        assert outcome.measures is not None, "the job has not failed"
        row = self._typed_row(job.row(outcome.measures))
        if outcome.table is not None:
            write_whole(self.out / TABLES / f"{job.id}.npz", outcome.table)
        write_whole(self._file(job), self._parquet(row))
        return row

    def list_failures(self, failures: Sequence[Failure]) -> None:
        """Write ``failed.json``, or remove it if no job failed."""
        file = self.out / FAILED
        if failures:
            content = json.dumps([failure.content() for failure in failures], indent=1)
            write_whole(file, (content + "\n").encode())
        else:
            file.unlink(missing_ok=True)

    def _plan(self, source: ScenarioSource, todo: Sequence[Job]) -> dict[str, Any]:
        arms = list({id(job.arm): job.arm for job in todo}.values())
        combinations = {arm.combination.settings: arm for arm in arms}
        return {
            "scenario": {"name": arms[0].scenario.name} | source.about(),
            "columns": self.columns,
            "episodes": todo[0].episodes,
            "warmup": todo[0].warmup,
            "seeds": list(dict.fromkeys(job.seed for job in todo)),
            "policies": list(dict.fromkeys(arm.policy for arm in arms if not arm.algorithm)),
            "algorithms": list(dict.fromkeys(arm.algorithm for arm in arms if arm.algorithm)),
            "combinations": [
                {"settings": list(settings), "scenario_hash": arm.scenario_hash}
                for settings, arm in combinations.items()
            ],
            "jobs": [job.id for job in todo],
        }

    def _begun(self) -> bool:
        """Return whether a sweep has begun here, even if its manifest is not complete."""
        if not self.out.exists():
            return False
        if not self.out.is_dir():
            raise UsageError(f"--out {self.out}: exists and is not a folder")
        there = [path.name for path in self.out.iterdir()]
        exists = MANIFEST in there or any(name.startswith(f".{MANIFEST}-") for name in there)
        if there and not exists:
            raise UsageError(f"--out {self.out}: the folder is not empty and holds no sweep")
        return exists

    def _check(self, plan: dict[str, Any]) -> None:
        """Raise PolicyError if the folder's sweep is not a part of this one."""
        there = read_manifest(self.out / MANIFEST)
        for what, was, now in (
            ("by desim-uav", there["versions"]["desim-uav"], __version__),
            ("with columns", _typed(there["columns"]), _typed(plan["columns"])),
            ("with --episodes", there["episodes"], plan["episodes"]),
            ("with --warmup", there["warmup"], plan["warmup"]),
        ):
            if was != now:
                raise PolicyError(
                    f"{self.out}: the folder holds another sweep: {what} {was}, not {now}"
                )
        ids = set(plan["jobs"])
        others = sum(job not in ids for job in there["jobs"])
        if others:
            changed = there["scenario"]["sha256"] != plan["scenario"]["sha256"]
            reason = "the scenario's file" if changed else "values, policies, seeds or files"
            raise PolicyError(
                f"{self.out}: the folder holds another sweep: {others} of its "
                f"{len(there['jobs'])} jobs are not among these {len(ids)} ({reason} differ); "
                "name another --out"
            )
        for file in sorted((self.out / RESULTS).glob("*")):
            if not file.name.startswith(".") and file.stem not in ids:
                raise PolicyError(f"{file}: not a row of this sweep; move it elsewhere")

    def _file(self, job: Job) -> Path:
        return self.out / RESULTS / f"{job.id}.parquet"

    def _typed_row(self, values: JobRow) -> JobRow:
        """Return a value for each column, as it is read again: counts of measures are floats."""
        import pyarrow as pa

        row = {name: values.get(name) for name in self.columns}  # some may have no energy
        return dict(pa.Table.from_pylist([row], _schema(self.columns)).to_pylist()[0])

    def _parquet(self, row: JobRow) -> bytes:
        import pyarrow as pa
        import pyarrow.parquet as pq

        file = pa.BufferOutputStream()
        schema = _schema(self.columns).with_metadata({DIGEST: of_row(row).encode()})
        pq.write_table(pa.Table.from_pylist([row], schema), file, write_page_checksum=True)
        return bytes(file.getvalue())


def read_row(out: Path, columns: Mapping[str, str], job: str) -> JobRow | None:
    """Return the row of a job, or None if it has not ended or its file is damaged."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        content = pa.BufferReader(content_of(out / RESULTS / f"{job}.parquet", MOST_BYTES))
        with pq.ParquetFile(content, page_checksum_verification=True) as file:
            table = file.read()
        table.validate(full=True)
        schema = _schema(columns)
    except (OSError, ValueError, pa.ArrowException):
        return None
    if not table.schema.equals(schema) or table.column("job").to_pylist() != [job]:
        return None
    row, metadata = dict(table.to_pylist()[0]), table.schema.metadata or {}
    return row if metadata.get(DIGEST) == of_row(row).encode() else None


def _schema(columns: Mapping[str, str]) -> pa.Schema:
    import pyarrow as pa

    return pa.schema([(name, pa.type_for_alias(of)) for name, of in columns.items()])


def read_manifest(file: Path) -> dict[str, Any]:
    """Read the manifest of a sweep. Raises PolicyError if it is unreadable or incomplete."""
    try:
        manifest = json.loads(text_of(file, MOST_BYTES))
    except (OSError, ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or error
        raise PolicyError(f"{file}: not a readable manifest: {reason}") from error
    for key, of_type in PLAN.items():
        if not isinstance(manifest, dict) or not isinstance(manifest.get(key), of_type):
            raise PolicyError(f"{file}: not the manifest of a sweep: it has no {key}")
    if not isinstance(manifest.get("versions"), dict) or "desim-uav" not in manifest["versions"]:
        raise PolicyError(f"{file}: not the manifest of a sweep: it has no versions")
    return dict(manifest)


def _typed(columns: dict[str, str]) -> str:
    keys = {name: of for name, of in columns.items() if name not in KNOWN}
    return ", ".join(f"{name} ({of})" for name, of in keys.items())
