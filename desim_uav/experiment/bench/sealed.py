"""Sealed sets: test worlds, seeds and paths that follow from a secret key until it is revealed.

Everybody can compute the seal, which is a hash of the key, once the key is known, and nobody can
find the key from the seal. The seeds are one-way functions of the key.
"""

from __future__ import annotations

import hashlib
import json
import re
import secrets
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from pydantic import Field

from desim_uav.disk import file_place, write_at
from desim_uav.errors import PolicyError
from desim_uav.experiment.bench.tasks import BENCHMARK, REGISTRY, TRACKS, BenchTrack
from desim_uav.report.json_file import Form, read_json
from desim_uav.rowcode.regular_file import text_of
from desim_uav.run_folder import RunPlace

KEY = re.compile(r"[0-9a-f]{64}")
MOST_BYTES = 1000


class Revealed(Form):
    """The least content of the registry of a revealed set."""

    benchmark: str
    seal: str
    key: str
    files: dict[str, str]
    next_files: dict[str, str] = Field(default_factory=dict)


def read_key(file: Path) -> str:
    """Return the key in a file. Raises PolicyError if there is none, or another content."""
    try:
        key = text_of(file, MOST_BYTES).strip()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise PolicyError(f"{file}: the key cannot be read: {reason}") from error
    if not KEY.fullmatch(key):
        raise PolicyError(f"{file}: not a key: it must have 64 digits from 0 to 9 and a to f")
    return key


def make_key(file: Path) -> None:
    """Write a new random key to a file that only its owner can read.

    Raises UsageError if it cannot be written.
    """
    write_at(file_place(file, "--key"), (secrets.token_hex(32) + "\n").encode(), 0o600)


def seal_of(key: str) -> str:
    """Return the seal of a key, which is public."""
    return _hashed(key, "seal")


def tracks_of(key: str, folder: Path) -> dict[str, BenchTrack]:
    """Return the tracks of a sealed set, whose references and bounds are in a folder."""
    return {
        name: replace(
            track,
            seeds=[int(_hashed(key, f"{name} {k}")[:16], 16) >> 1 for k in range(len(track.seeds))],
            about=f"{track.about}, on seeds that were sealed",
            seal=seal_of(key),
            folder=folder,
        )
        for name, track in TRACKS.items()
    }


def reveal(key: str, out: Path | None) -> Path:
    """Return the folder of a set that is no longer secret.

    A new one has no references and bounds yet. Raises PolicyError if there is a set of another key.
    """
    if out is not None and (out / REGISTRY).exists():
        if any(track.seal != seal_of(key) for track in revealed(out).values()):
            raise PolicyError(f"{out}: it has the revealed set of another key")
        return out
    place = RunPlace(out, f"{BENCHMARK}-revealed")
    content = {"benchmark": BENCHMARK, "seal": seal_of(key), "key": key, "files": {}}
    with place.draft() as draft:
        draft.write_text(REGISTRY, json.dumps(content, indent=1) + "\n")
        folder = place.publish(draft)
    (folder / "SHA256SUMS").unlink(missing_ok=True)  # the registry has the hashes of all files
    return folder


def revealed(folder: Path | None) -> Mapping[str, BenchTrack]:
    """Return the tracks of a revealed set, or those of the public one for None.

    Raises PolicyError if the folder has none, or if its seal is not that of its key.
    """
    if folder is None:
        return TRACKS
    file = folder / REGISTRY
    content = Revealed.model_validate(read_json(file, Revealed, "the registry of a revealed set"))
    if content.benchmark != BENCHMARK or not KEY.fullmatch(content.key):
        raise PolicyError(f"{file}: not a revealed set of {BENCHMARK}")
    if content.seal != seal_of(content.key):
        raise PolicyError(f"{file}: seal: it is not that of the key")
    return tracks_of(content.key, folder)


def _hashed(key: str, what: str) -> str:
    return hashlib.sha256(f"desim-uav bench {BENCHMARK}, {what}: {key}".encode()).hexdigest()
