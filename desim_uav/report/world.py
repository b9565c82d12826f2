"""``world.json`` of a run folder, read back and checked."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, ValidationError

from desim_uav.errors import PolicyError

Metres = Annotated[float, Field(allow_inf_nan=False)]
Length = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(gt=0, le=10**6)]
Cell = tuple[int, int]


class _Cluster(BaseModel):
    x_m: Metres
    y_m: Metres
    radius_m: Length


class _World(BaseModel):
    """What pictures and analyses need of a world."""

    size_m: tuple[Length, Length]
    cells: tuple[Count, Count]
    cell_height_m: list[list[Metres]]
    stations: list[Cell]
    start_cells: list[Cell]
    clusters: list[_Cluster]


def read_world(folder: Path) -> dict[str, Any]:
    """What ``world.json`` of a run says. Raises PolicyError, naming the file."""
    file = folder / "world.json"
    try:
        world = _World.model_validate_json(file.read_bytes()).model_dump()
    except OSError as error:
        raise PolicyError(f"{file}: cannot be read: {error.strerror or error}") from error
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise PolicyError(f"{file}: not the world of a run: {where}: {first['msg']}") from error
    (nx, ny), heights = world["cells"], world["cell_height_m"]
    if len(heights) != nx or any(len(column) != ny for column in heights):
        raise PolicyError(f"{file}: not the world of a run: cell_height_m is not {nx} x {ny}")
    return world
