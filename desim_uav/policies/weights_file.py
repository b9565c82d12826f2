"""Files with the few numbers of a policy, by their names: arrays and text, but no code."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav import array_file
from desim_uav.checksums import verify
from desim_uav.errors import PolicyError
from desim_uav.shipped import find_table

FORMAT = 1

Floats = NDArray[np.float64]


def to_bytes(array: str, names: Mapping[str, Any], weights: Floats, about: dict[str, Any]) -> bytes:
    """Return the bytes of a policy file with the ``weights`` (names,) in an array of this name."""
    described = about | {"format": FORMAT, "weights": [*names]}
    return array_file.pack(described, **{array: np.asarray(weights, np.float64)})


def weights_in(array: str, names: Mapping[str, Any], file: str) -> dict[str, float]:
    """Return the weights in a policy file by their names.

    Raises PolicyError, which names the file, if it does not hold exactly these weights.
    """
    path: Path = find_table(file)
    verify(path, strangers=True)
    stored = array_file.Stored(path, "policy file", [array], FORMAT)
    if stored.about.get("weights") != [*names]:
        raise PolicyError(f"{path}: its weights must be {', '.join(names)}")
    if stored.forms[array] != ((len(names),), np.dtype(np.float64)):
        raise PolicyError(f"{path}: {array} must hold {len(names)} numbers (float64)")
    weights: Floats = stored.arrays()[array]
    if not np.isfinite(weights).all():
        raise PolicyError(f"{path}: {array} has values that are not finite")
    return dict(zip(names, weights.tolist(), strict=True))
