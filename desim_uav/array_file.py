"""Files of arrays and a text about them: what is learned is kept in these. They hold no code.

Such a file is a ZIP archive of NumPy's ``.npy`` members. It may come from anyone: what it says of
itself is read first, the arrays only once their sizes are known to be those that are wanted.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from desim_uav.errors import PolicyError, in_short
from desim_uav.regular_file import opened

LARGEST = 2**32
LONGEST_TEXT = 2**24
ABOUT = "about"


class Form(NamedTuple):
    """What an array is like."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]


class Stored:
    """A file of which the text has been read, and how large its arrays are."""

    def __init__(
        self,
        path: Path,
        what: str,
        names: Collection[str],
        version: int,
        longest_text: int = LONGEST_TEXT,
    ) -> None:
        """``what`` it is to be, with arrays of these names, and of which ``format``.

        ``longest_text``: what it may say of itself, in bytes.

        Raises PolicyError, naming the file, where it is none, or holds anything else.
        """
        self.path = path
        self.what = what
        self.about: dict[str, Any] = {}
        self.forms: dict[str, Form] = {}
        with self._opened() as archive:
            _check_members(archive, {f"{name}.npy" for name in (ABOUT, *names)})
            self.about = _text(archive, longest_text)
            found = self.about.get("format")
            if found != version:
                raise ValueError(
                    f"its format is {in_short(repr(found), 40)}; this version reads {version}"
                )
            self.forms = {name: _form(archive, name) for name in names}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays. Raises PolicyError, naming the file, where they are damaged."""
        with self._opened() as archive:
            found = {}
            for name, form in self.forms.items():
                with archive.open(f"{name}.npy") as member:
                    found[name] = npy.read_array(member, allow_pickle=False)
                    if member.read(1) or (found[name].shape, found[name].dtype) != form:
                        raise ValueError(f"{name} is not what it was a moment ago")
            return found

    @contextmanager
    def _opened(self) -> Iterator[zipfile.ZipFile]:
        try:
            with opened(self.path, LARGEST) as file, zipfile.ZipFile(file) as archive:
                yield archive
        except Exception as error:  # zipfile, zlib, NumPy and JSON have many ways to refuse a file
            reason = getattr(error, "strerror", None) or str(error).partition("\n")[0]
            reason = reason or type(error).__name__
            raise PolicyError(f"{self.path}: not a readable {self.what}: {reason}") from error


def pack(about: dict[str, Any], **arrays: NDArray[Any]) -> bytes:
    """The file: the same content gives the same bytes."""
    text = json.dumps(about, sort_keys=True, allow_nan=False).encode()
    content: dict[str, Any] = {ABOUT: np.frombuffer(text, np.uint8), **arrays}
    file = io.BytesIO()
    np.savez_compressed(file, **content)
    return file.getvalue()


def _check_members(archive: zipfile.ZipFile, members: set[str]) -> None:
    entries = archive.infolist()
    if len(entries) != len(members) or {entry.filename for entry in entries} != members:
        raise ValueError(f"it does not hold {', '.join(sorted(members))}, and no more")
    if sum(entry.file_size for entry in entries) > LARGEST:
        raise ValueError(f"it is larger than {LARGEST >> 30} GiB unpacked")


def _text(archive: zipfile.ZipFile, longest: int) -> dict[str, Any]:
    """What the file says of itself."""
    size = archive.getinfo(f"{ABOUT}.npy").file_size
    if size > longest:
        raise ValueError(f"it says more than {longest >> 20} MiB about itself")
    _form(archive, ABOUT)
    with archive.open(f"{ABOUT}.npy") as member:
        about = json.loads(npy.read_array(member, allow_pickle=False).tobytes().decode())
    if not isinstance(about, dict):
        raise ValueError(f"{ABOUT} is no mapping")
    return about


def _form(archive: zipfile.ZipFile, name: str) -> Form:
    """What the header of an array says, if it is as long as it says."""
    with archive.open(f"{name}.npy") as member:
        shape, dtype, header = _header(member)
    if dtype.hasobject:
        raise ValueError(f"{name} holds objects (allow_pickle is off)")
    if any(length < 0 for length in shape):
        raise ValueError(f"{name} has a length below 0")
    expected = header + math.prod(shape) * dtype.itemsize
    found = archive.getinfo(f"{name}.npy").file_size
    if expected != found:
        raise ValueError(f"{name} says it has {expected:,} bytes, and has {found:,}")
    return Form(shape, dtype)


def _header(member: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any], int]:
    """Shape, type, and how long the header itself is."""
    version = npy.read_magic(member)
    if version != (1, 0):  # later ones have headers of any length
        raise ValueError(f"its .npy format is {version}")
    shape, _, dtype = npy.read_array_header_1_0(member)
    return shape, dtype, member.tell()
