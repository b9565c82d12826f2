"""Reads and checks ``manifest.json`` of a run folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from desim_uav.report.json_file import Form, read_json

Text = Annotated[str, Field(max_length=10_000)]
Count = Annotated[int, Field(ge=0, lt=2**63)]


class Named(Form):
    """The entries that are needed to name a run."""

    scenario: Text
    policy: Text
    seed: Count


class Settings(Named):
    """The entries that are needed to play a run again."""

    world_seed: Count
    engine: Literal["des", "batch"]
    ceilings: list[Literal["tallest", "none"]]
    carry_over: bool
    warmup: Count


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a run. Raises PolicyError if it is not that of a run."""
    return _read(folder, Named)


def read_settings(folder: Path) -> Settings:
    """Return the settings of a run. Raises PolicyError if its manifest lacks one."""
    return Settings.model_validate(_read(folder, Settings))


def _read(folder: Path, form: type[Form]) -> dict[str, Any]:
    return read_json(folder / "manifest.json", form, "the manifest of a run")
