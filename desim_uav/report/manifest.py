"""``manifest.json`` of a run folder, read back and checked."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from desim_uav.report.json_file import Form, read_json

Text = Annotated[str, Field(max_length=10_000)]
Count = Annotated[int, Field(ge=0, lt=2**63)]


class Named(Form):
    """What a run is: enough to name it."""

    scenario: Text
    policy: Text
    seed: Count


class Settings(Named):
    """And how it was made: enough to make it again."""

    world_seed: Count
    engine: Literal["des", "batch"]
    ceilings: list[Literal["tallest", "none"]]
    carry_over: bool
    warmup: Count


def read_manifest(folder: Path) -> dict[str, Any]:
    """What a run says of itself. Raises PolicyError where it is not a run's."""
    return _read(folder, Named)


def read_settings(folder: Path) -> Settings:
    """How a run was made. Raises PolicyError where its manifest does not tell."""
    return Settings.model_validate(_read(folder, Settings))


def _read(folder: Path, form: type[Form]) -> dict[str, Any]:
    return read_json(folder / "manifest.json", form, "the manifest of a run")
