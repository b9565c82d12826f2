"""Files of arrays and a text about them: what is learned is kept in these. They hold no code."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import PolicyError

LARGEST = 2**32
ABOUT = "about"


def pack(about: dict[str, Any], **arrays: NDArray[Any]) -> bytes:
    """The file: the same content gives the same bytes."""
    text = json.dumps(about, sort_keys=True, allow_nan=False).encode()
    content: dict[str, Any] = {ABOUT: np.frombuffer(text, np.uint8), **arrays}
    file = io.BytesIO()
    np.savez_compressed(file, **content)
    return file.getvalue()


def unpack(
    path: Path, what: str, names: Collection[str], version: int
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """What a file says, and its arrays, by name; ``what`` it is to be, and of which ``format``.

    Raises PolicyError, naming the file, where it is none, or holds anything else.
    """
    members = {f"{name}.npy" for name in (ABOUT, *names)}
    try:
        content = path.read_bytes()
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
        if len(entries) != len(members) or {entry.filename for entry in entries} != members:
            raise ValueError(f"it does not hold {', '.join(sorted(members))}, and no more")
        if sum(entry.file_size for entry in entries) > LARGEST:
            raise ValueError(f"it is larger than {LARGEST >> 30} GiB unpacked")
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in names}
            about = json.loads(stored[ABOUT].tobytes().decode())
        found = about.get("format") if isinstance(about, dict) else None
        if found != version:
            raise ValueError(f"its format is {found!r}; this version reads {version}")
    except Exception as error:  # zipfile, zlib, NumPy and JSON have many ways to refuse a file
        reason = getattr(error, "strerror", None) or str(error).partition("\n")[0]
        reason = reason or type(error).__name__
        raise PolicyError(f"{path}: not a readable {what}: {reason}") from error
    return about, arrays
