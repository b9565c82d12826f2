"""Reads and checks ``manifest.json`` of a run folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from desim_uav.report.json_file import Form, read_json

ManifestText = Annotated[str, Field(max_length=10_000)]
PLAYERS = ("des", "batch")
Count = Annotated[int, Field(ge=0, lt=2**63)]


class Named(Form):
    """The entries that are needed to name a run."""

    scenario: ManifestText
    policy: ManifestText
    seed: Count
    name: ManifestText = ""


class Settings(Named):
    """The entries that are needed to play a run again."""

    world_seed: Count
    engine: Literal["auto", "des", "batch"]
    ceilings: list[Literal["tallest", "none"]]
    carry_over: bool
    warmup: Count


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a run. Raises PolicyError if it is not that of a run."""
    return _read(folder, Named)


def read_settings(folder: Path) -> Settings:
    """Return the settings of a run. Raises PolicyError if its manifest lacks one."""
    return Settings.model_validate(_read(folder, Settings))


def engine_of(manifest: Mapping[str, Any]) -> str | None:
    """Return which engine was asked for, and which has played how many episodes."""
    engine, played = manifest.get("engine"), read_played_by(manifest)
    each = ", ".join(f"{name}: {count}" for name, count in played.items())
    return f"{engine} ({each})" if engine == "auto" and each else engine


def read_played_by(manifest: Mapping[str, Any]) -> dict[str, int]:
    """Return how many episodes each engine has played, as far as a manifest says so."""
    played = manifest.get("played_by")
    counts = played.items() if isinstance(played, dict) else ()
    return {name: count for name, count in counts if name in PLAYERS and type(count) is int}


def _read(folder: Path, form: type[Form]) -> dict[str, Any]:
    return read_json(folder / "manifest.json", form, "the manifest of a run")
