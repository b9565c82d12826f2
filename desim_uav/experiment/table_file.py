"""Tables that users ask for, as files of the kind that the name says."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from desim_uav.disk import file_place, write_at

ENDINGS = (".csv", ".parquet")


class TableTarget:
    """The file of a table, which is checked before the table is made.

    Raises UsageError for a file of another kind, or one that cannot be written.
    """

    def __init__(self, out: Path, option: str = "--out") -> None:
        self._place, self._suffix = file_place(out, option, ENDINGS), out.suffix.lower()

    def write(self, frame: Any) -> None:
        """Write the table in one step."""
        write_at(self._place, table_bytes(frame, self._suffix))


def table_bytes(frame: Any, suffix: str) -> bytes:
    """Return a frame as the content of a file with an ending."""
    if suffix == ".csv":
        return bytes(frame.to_csv(index=False).encode())
    file = io.BytesIO()
    frame.to_parquet(file, index=False)
    return file.getvalue()
