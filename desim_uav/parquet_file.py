"""Tables as Parquet files with checksums, which are checked when they are read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from desim_uav.checksums import verify
from desim_uav.columns import NULLABLE, Columns, arrow_schema, misfit
from desim_uav.errors import PolicyError, did_you_mean
from desim_uav.records import TABLES

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq


def parquet(name: str, frame: pd.DataFrame) -> bytes:
    """Return one of ``TABLES`` as the bytes of a Parquet file."""
    import pyarrow as pa

    file = pa.BufferOutputStream()
    rows = as_arrow(name, frame)
    with parquet_writer(file, rows.schema) as writer:
        writer.write_table(rows)
    return bytes(file.getvalue())


def parquet_writer(file: object, schema: pa.Schema) -> pq.ParquetWriter:
    """Return a writer with page checksums, so that later damage is noticed."""
    import pyarrow.parquet as pq

    return pq.ParquetWriter(file, schema, write_page_checksum=True)


def as_arrow(name: str, frame: pd.DataFrame) -> pa.Table:
    """Return a frame as an Arrow table, with the metadata that pandas needs."""
    import pyarrow as pa

    schema = arrow_schema(TABLES[name].among(frame.columns))
    return pa.Table.from_pandas(frame, schema, preserve_index=False)


def no_such(folder: Path, what: str) -> PolicyError:
    """Return the error that a folder is not there, with the nearest name beside it."""
    with suppress(OSError):
        beside = [path.name for path in islice(folder.parent.iterdir(), 10_000) if path.is_dir()]
        return PolicyError(f"{folder}: no such {what}{did_you_mean(folder.name, beside)}")
    return PolicyError(f"{folder}: no such {what}")


def read_table(folder: Path, name: str, columns: dict[str, str]) -> pd.DataFrame:
    """Read a table of a finished run.

    Raises PolicyError, which names the file, if it is missing or unreadable, has changed since it
    was written, or if a column is missing or has another type.
    """
    import pandas as pd

    return pd.concat(read_parts(folder, name, columns), ignore_index=True)


def read_parts(folder: Path, name: str, columns: dict[str, str]) -> Iterator[pd.DataFrame]:
    """Yield a table of a finished run by row groups, at least one. Raises as ``read_table``."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = folder / f"{name}.parquet"
    try:
        if not folder.is_dir():
            raise no_such(folder, "run folder")
        if not file.is_file():
            raise PolicyError(f"{file}: no such table; is {folder} a run folder?")
        verify(file)
        whole = file.absolute()  # "a:b/c" would be taken for a URI
        with pq.ParquetFile(whole, page_checksum_verification=True) as parquet_file:
            groups = range(parquet_file.num_row_groups)
            for rows in ([group] for group in groups) if groups else ([],):
                table = parquet_file.read_row_groups(rows)
                table.validate(full=True)
                problem = misfit(columns, table)
                if problem is not None:
                    raise PolicyError(f"{file}: {problem}")
                yield as_frame(table, columns)
    except (pa.ArrowException, OSError, ValueError) as error:
        reason = str(error).partition("\n")[0]
        if isinstance(error, UnicodeDecodeError) or "Invalid UTF8" in reason:
            reason = "a text in it is not UTF-8"
        raise PolicyError(f"{file}: not a readable Parquet file: {reason}") from error


def as_written(name: str, frame: pd.DataFrame) -> pd.DataFrame:
    """Return a frame of one of ``TABLES`` as it is after it was written and read."""
    return as_frame(as_arrow(name, frame), TABLES[name])


def as_frame(table: pa.Table, columns: dict[str, str]) -> pd.DataFrame:
    """Return a frame; the file's own metadata for pandas, which has no checksum, is ignored."""
    import pandas as pd

    frame = table.to_pandas(ignore_metadata=True)
    if isinstance(columns, Columns):
        columns = columns.among(table.column_names)
    for name in (name for name, dtype in columns.items() if dtype in NULLABLE):
        kind = pd.Int64Dtype() if columns[name] == "Int64" else pd.BooleanDtype()
        frame[name] = table[name].to_pandas(types_mapper=lambda _, kind=kind: kind)
    return frame
