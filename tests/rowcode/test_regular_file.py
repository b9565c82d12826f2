"""Files of a bounded size: what is read, and what reading takes."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest

from desim_uav.rowcode.regular_file import MIB, content_of


@pytest.mark.parametrize("size", [0, 1, 2 * MIB - 1, 2 * MIB])
def test_a_file_is_read_whole(tmp_path: Path, size: int):
    content = bytes(range(256)) * (size // 256) + bytes(size % 256)
    (tmp_path / "file").write_bytes(content)
    assert content_of(tmp_path / "file", 2 * MIB) == content


def test_a_larger_file_is_refused(tmp_path: Path):
    (tmp_path / "file").write_bytes(bytes(MIB + 1))
    with pytest.raises(ValueError, match="larger than 1 MiB"):
        content_of(tmp_path / "file", MIB)


def test_a_small_file_takes_little_memory_however_large_it_may_be(tmp_path: Path):
    (tmp_path / "file").write_bytes(b"small")
    tracemalloc.start()
    try:
        content_of(tmp_path / "file", 1024 * MIB)
        used = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert used < 4 * MIB
