"""Reads and checks ``world.json`` of a run folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from desim_uav.model.geometry.city import NO_CITY, City
from desim_uav.model.geometry.grid import Grid
from desim_uav.report.json_file import Form, read_json
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World

MOST_CELLS = 1_000_000

Metres = Annotated[float, Field(gt=-1e15, lt=1e15, allow_inf_nan=False)]
Length = Annotated[float, Field(gt=0, lt=1e15, allow_inf_nan=False)]
Height = Annotated[float, Field(ge=0, lt=1e15, allow_inf_nan=False)]
Cells = list[Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=2, max_length=2)]]
Position = Annotated[list[Metres], Field(min_length=3, max_length=3)]


class Cluster(Form):
    """The disc that contains the homes of some users."""

    x_m: Metres
    y_m: Metres
    radius_m: Length


class StoredCity(Form):
    """The convex pieces of the buildings of a city (see ``model.geometry.city.City``)."""

    attribution: Annotated[str, Field(max_length=10_000)]
    roofs_m: list[Height]
    pieces_m: list[
        Annotated[
            list[Annotated[list[Metres], Field(min_length=2, max_length=2)]], Field(min_length=3)
        ]
    ]

    @field_validator("pieces_m")
    @classmethod
    def _one_a_roof(cls, pieces: list[Any], info: ValidationInfo) -> list[Any]:
        roofs = info.data.get("roofs_m")
        if roofs is not None and len(pieces) != len(roofs):
            raise ValueError(f"must be {len(roofs)} pieces, one for each of roofs_m")
        return pieces


class Stored(Form):
    """The parts of a world that pictures, replays and analyses need."""

    size_m: Annotated[list[Length], Field(min_length=2, max_length=2)]
    cells: Annotated[list[Annotated[int, Field(gt=0)]], Field(min_length=2, max_length=2)]
    cell_height_m: list[list[Height]]
    levels_m: list[Height]
    open_levels_m: Annotated[list[Height], Field(min_length=1)]
    stations: Cells
    start_cells: Cells
    clusters: list[Cluster]
    users: Annotated[list[Position], Field(min_length=1)]
    city: StoredCity | None = None

    @field_validator("cells")
    @classmethod
    def _not_too_many(cls, cells: list[int]) -> list[int]:
        if cells[0] * cells[1] > MOST_CELLS:
            raise ValueError(f"more than {MOST_CELLS:,}")
        return cells

    @field_validator("cell_height_m")
    @classmethod
    def _one_a_cell(cls, heights: list[list[float]], info: ValidationInfo) -> list[list[float]]:
        nx, ny = info.data.get("cells", (0, 0))
        if nx and (len(heights) != nx or any(len(column) != ny for column in heights)):
            raise ValueError(f"must be {nx} lists of {ny} heights")
        return heights

    @field_validator("stations", "start_cells")
    @classmethod
    def _on_the_map(cls, places: Cells, info: ValidationInfo) -> Cells:
        nx, ny = info.data.get("cells", (0, 0))
        if nx and not all(ix < nx and iy < ny for ix, iy in places):
            raise ValueError(f"must be cells [ix, iy] below [{nx}, {ny}]")
        return places


def _city_of(content: dict[str, Any] | None) -> City:
    if content is None:
        return NO_CITY
    pieces = tuple(np.array(piece, np.float64) for piece in content["pieces_m"])
    return City(pieces, np.array(content["roofs_m"], np.float64), content["attribution"])


def read_world(folder: Path) -> dict[str, Any]:
    """Return the content of ``world.json``. Raises PolicyError with the file and the key."""
    return read_json(folder / "world.json", Stored, "the world of a run")


def stored_world(content: dict[str, Any], scenario: Scenario) -> World:
    """Return the world in a folder, even if the scenario would give another one today."""
    width_m, depth_m = content["size_m"]
    grid = Grid(
        width_m,
        depth_m,
        np.array(content["cell_height_m"], np.float64),
        tuple(content["open_levels_m"]),
        scenario.map.levels.step_m,
        len(content["levels_m"]),
        _city_of(content.get("city")),
    )
    stations, starts = (
        tuple((ix, iy) for ix, iy in content[name]) for name in ("stations", "start_cells")
    )
    discs = [(c["x_m"], c["y_m"], c["radius_m"]) for c in content["clusters"]]
    clusters = np.array(discs, np.float64).reshape(-1, 3)
    homes = np.array(content["users"], np.float64)
    return World(scenario, scenario.effective_world_seed, grid, stations, starts, clusters, homes)
