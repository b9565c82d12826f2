"""Files of arrays and a JSON description, which hold learned policies and contain no code.

Such a file is a ZIP archive of NumPy's ``.npy`` members. It may come from an untrusted source, so
its description and the shapes of its arrays are checked before the arrays are read.
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
from desim_uav.rowcode.regular_file import opened, utf8

LARGEST = 2**32
LONGEST_TEXT = 2**24
ABOUT = "about"


class Form(NamedTuple):
    """The shape and the type of an array."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]


class Stored:
    """A file whose description and array shapes have been read, but not its arrays."""

    def __init__(
        self,
        path: Path,
        what: str,
        names: Collection[str],
        version: int,
        longest_text: int = LONGEST_TEXT,
    ) -> None:
        """Open a file and check that it holds the arrays ``names`` in the format ``version``.

        ``what`` names the kind of file in messages; ``longest_text`` is the largest size of the
        description in bytes. Raises PolicyError, which names the file, if it cannot be read or
        holds anything else.
        """
        self.path = path
        self.what = what
        self.about: dict[str, Any] = {}
        self.forms: dict[str, Form] = {}
        with self._opened() as archive:
            _check_members(archive, {f"{name}.npy" for name in (ABOUT, *names)})
            self.about = _text(archive, longest_text)
            format_number = self.about.get("format")
            if format_number != version:
                raise ValueError(
                    f"its format is {in_short(repr(format_number), 40)}; "
                    f"this version of desim-uav reads format {version}"
                )
            self.forms = {name: _form(archive, name) for name in names}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Read the arrays. Raises PolicyError, which names the file, if they are damaged."""
        with self._opened() as archive:
            content = {}
            for name, form in self.forms.items():
                with archive.open(f"{name}.npy") as member:
                    content[name] = npy.read_array(member, allow_pickle=False)
                    if member.read(1) or (content[name].shape, content[name].dtype) != form:
                        raise ValueError(f"{name} was changed while it was read")
            return content

    @contextmanager
    def _opened(self) -> Iterator[zipfile.ZipFile]:
        try:
            with opened(self.path, LARGEST) as file, zipfile.ZipFile(file) as archive:
                yield archive
        except Exception as error:  # zipfile, zlib, NumPy and JSON have many ways to refuse a file
            reason = getattr(error, "strerror", None) or str(error).partition("\n")[0]
            reason = reason or type(error).__name__
            raise PolicyError(f"{self.path}: not a readable {self.what}: {reason}") from error


def names_in(path: Path) -> set[str]:
    """Return the names of the arrays in a file; none if it is not such a file."""
    try:
        with opened(path, LARGEST) as file, zipfile.ZipFile(file) as archive:
            return {name.removesuffix(".npy") for name in archive.namelist()}
    except Exception:  # its reader will say what is wrong with it
        return set()


def pack(about: dict[str, Any], **arrays: NDArray[Any]) -> bytes:
    """Return the bytes of a file. The same content always gives the same bytes."""
    text = json.dumps(about, sort_keys=True, allow_nan=False).encode()
    content: dict[str, Any] = {ABOUT: np.frombuffer(text, np.uint8), **arrays}
    file = io.BytesIO()
    np.savez_compressed(file, **content)
    return file.getvalue()


def _check_members(archive: zipfile.ZipFile, members: set[str]) -> None:
    entries = archive.infolist()
    if len(entries) != len(members) or {entry.filename for entry in entries} != members:
        raise ValueError(f"it must hold exactly {', '.join(sorted(members))}")
    if sum(entry.file_size for entry in entries) > LARGEST:
        raise ValueError(f"it is larger than {LARGEST >> 30} GiB unpacked")


def _text(archive: zipfile.ZipFile, longest: int) -> dict[str, Any]:
    """Read the description in the file."""
    size = archive.getinfo(f"{ABOUT}.npy").file_size
    if size > longest:
        raise ValueError(f"its description is larger than {longest >> 20} MiB")
    _form(archive, ABOUT)
    with archive.open(f"{ABOUT}.npy") as member:
        about = json.loads(utf8(npy.read_array(member, allow_pickle=False).tobytes()))
    if not isinstance(about, dict):
        raise ValueError(f"{ABOUT} must be a mapping")
    return about


def _form(archive: zipfile.ZipFile, name: str) -> Form:
    """Read the header of an array, and check that the size of the array agrees with it."""
    with archive.open(f"{name}.npy") as member:
        shape, dtype, header = _header(member)
    if dtype.hasobject:
        raise ValueError(f"{name} holds objects (allow_pickle is off)")
    if any(length < 0 for length in shape):
        raise ValueError(f"the shape of {name} has a negative length")
    expected = header + math.prod(shape) * dtype.itemsize
    size = archive.getinfo(f"{name}.npy").file_size
    if expected != size:
        raise ValueError(f"{name} has {size:,} bytes, but its header announces {expected:,}")
    return Form(shape, dtype)


def _header(member: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any], int]:
    """Read the shape and the type from a header, and the length of the header in bytes."""
    version = npy.read_magic(member)
    if version != (1, 0):  # later ones have headers of any length
        raise ValueError(f"its .npy format is {version}; only (1, 0) is read")
    shape, _, dtype = npy.read_array_header_1_0(member)
    return shape, dtype, member.tell()
