"""The referee's receipts: which submissions were verified, and how.

They are in a file of the referee, not in the folders of submissions, whose authors could write
them. A receipt names the digest of a submission, so it does not hold for one that was changed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from desim_uav.disk import file_place, write_at
from desim_uav.experiment.bench.submission import COMMANDS, MANIFEST, ROWS
from desim_uav.report.json_file import Form, read_json

CLAIMED, REPLAYED, DECIDED = "claimed", "replayed", "decided again"
"""What a row is worth: what its author states, commands that reach it, or a policy that gives these
commands when it sees no future."""

NO_CHECKS: Mapping[str, str] = MappingProxyType({})


class Receipts(Form):
    """The content of a file of receipts: by the digest of a submission, how it was verified."""

    verified: dict[str, str]


def digest_of(folder: Path) -> str:
    """Return the SHA-256 of the rows, commands and manifest of a submission."""
    sha256 = hashlib.sha256()
    for name in (ROWS, COMMANDS, MANIFEST):
        sha256.update(hashlib.sha256((folder / name).read_bytes()).digest())
    return sha256.hexdigest()


def read_receipts(file: Path) -> dict[str, str]:
    """Return the receipts of a file. Raises PolicyError if it cannot be read."""
    return dict(Receipts.model_validate(read_json(file, Receipts, "receipts")).verified)


def add_receipt(file: Path, folder: Path, decided: bool) -> None:
    """Note in a file that a submission was verified; a new file is made if there is none."""
    verified = read_receipts(file) if file.exists() else {}
    verified[digest_of(folder)] = DECIDED if decided else REPLAYED
    text = json.dumps({"verified": verified}, indent=1) + "\n"
    write_at(file_place(file, "--receipts"), text.encode())
