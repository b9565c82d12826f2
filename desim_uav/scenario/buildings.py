"""What a scenario says of the buildings of a city: from a file, or a synthetic one."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from desim_uav.city.extract import read_extract
from desim_uav.city.itu import TALLEST
from desim_uav.scenario.components import errors, strictly
from desim_uav.scenario.fields import Height
from desim_uav.scenario.section import Forms, Fraction, Section
from desim_uav.shipped import shipped_extract

Longitude = Annotated[float, Field(ge=-180, le=180)]
Latitude = Annotated[float, Field(ge=-85, le=85)]


class BuildingsOfFile(Section):
    """The buildings of an extract of a map: GeoJSON, or OpenStreetMap XML."""

    file: Path
    """The file, relative to the scenario's file; or the name of one that comes with the package."""
    height_m: Height = 8.0
    """The height in metres of buildings without the tags `height` and `building:levels` whose type
    says nothing either.
    """
    origin: tuple[Longitude, Latitude] | None = None
    """The longitude and latitude in degrees of the south-western corner of the map, [0, 0]; null
    means that the middle of all buildings is the middle of the map.
    """
    attribution: Annotated[str, Field(max_length=1000)] | None = None
    """Whose data they are, for manifests and pages; null means what the file says. Data of
    OpenStreetMap are always attributed to its contributors.
    """
    blocked_share: Fraction = 0.5
    """Drones that fly from cell to cell do not fly where more of a cell is built than this."""

    @model_validator(mode="after")
    def _is_readable(self) -> BuildingsOfFile:
        try:
            read_extract(self.file)
        except ValueError as error:
            raise errors([(("file",), str(error), str(self.file))]) from error
        return self


class BuildingsOfItu(Section):
    """A synthetic city after ITU-R P.1410: equal squares between streets, with random heights."""

    kind: Literal["itu"]
    """`itu`: a city by three numbers."""
    alpha: Annotated[float, Field(gt=0, le=0.99)]
    """The share of the ground that is built."""
    beta: Annotated[float, Field(ge=1, le=20_000)]
    """The number of buildings per km²."""
    gamma: Annotated[float, Field(ge=0.1, le=250)]
    """The scale of the Rayleigh distribution of the heights, in metres."""
    blocked_share: Fraction = 0.5
    """Drones that fly from cell to cell do not fly where more of a cell is built than this."""

    @property
    def tallest_m(self) -> float:
        """The height that no building exceeds, in metres."""
        return TALLEST * self.gamma


def _buildings(value: object, info: ValidationInfo) -> Any:
    if isinstance(value, BuildingsOfFile | BuildingsOfItu):
        return value
    if not isinstance(value, Mapping):
        raise ValueError("must be a mapping with a file, or with kind: itu; or null for none")
    keys = dict(value)
    if _itu_or_file(keys) is BuildingsOfItu:
        return strictly(BuildingsOfItu, {"kind": "itu", **keys})
    if isinstance(keys.get("file"), str):
        keys["file"] = _absolute(keys["file"], (info.context or {}).get("base"))
    return strictly(BuildingsOfFile, keys)


def _itu_or_file(keys: Mapping[str, Any]) -> type[Section]:
    numbers = "file" not in keys and not {"alpha", "beta", "gamma"}.isdisjoint(keys)
    return BuildingsOfItu if "kind" in keys or numbers else BuildingsOfFile


def _absolute(file: str, base: Path | None) -> str:
    path = os.path.abspath((base or Path()) / file)  # noqa: PTH100
    own = shipped_extract(file)
    return path if own is None or Path(path).exists() else str(own)


Buildings = Annotated[
    BuildingsOfFile | BuildingsOfItu, Forms(_itu_or_file), BeforeValidator(_buildings)
]
