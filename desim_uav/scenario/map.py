"""What a scenario says of the map: its size, cells and levels, buildings and no-fly zones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    field_validator,
    model_validator,
)

from desim_uav.geodata.attribution import together
from desim_uav.model.geometry.city import NO_CITY, City
from desim_uav.model.geometry.polygons import MOST_CORNERS, checked
from desim_uav.scenario.buildings import Buildings, BuildingsOfFile, BuildingsOfItu
from desim_uav.scenario.components import errors, strictly
from desim_uav.scenario.fields import (
    Altitude,
    CellCount,
    FractionRange,
    Height,
    HeightRange,
    Index,
    Metres,
    Point,
    Side,
    rising,
)
from desim_uav.scenario.section import Forms, Section

SIDE_M = 2400.0
"""The side of the paper's map: radii that are not given are scaled to the shorter side of a map."""


class Levels(Section):
    """The altitudes drones fly at: the lowest, and the step between levels (3D)."""

    later: ClassVar = ("max_altitude_m",)

    min_altitude_m: Height = 20.0
    """The lowest level, in metres. In 2D it is the only one."""
    step_m: Height = 20.0
    """The vertical distance between two levels, in metres."""
    max_altitude_m: Height | None = None
    """The altitude up to which there are levels, in metres (3D only): also where buildings are
    lower or where there are none. null means up to the tallest building. Drones that may fly above
    the tallest building have one level above it in any case.
    """


class DrawnObstacles(Section):
    """Buildings to be drawn: covered fraction, heights, the side of a square (null: the cell)."""

    coverage: FractionRange = (0.05, 0.15)
    """The range from which the covered fraction of the map is drawn."""
    height_m: HeightRange = (20.0, 60.0)
    """The range from which the height of each building is drawn, in metres."""
    square_m: Metres | None = None
    """The side of a building's square, in metres; null means the size of a cell."""


class ListedObstacles(Section):
    """Buildings one by one: [cell x, cell y, height in metres]."""

    cells: tuple[tuple[Index, Index, Height], ...]
    """The buildings one by one: [cell x, cell y, height in metres]."""


def _obstacles(value: object) -> Any:
    if isinstance(value, DrawnObstacles | ListedObstacles):
        return value
    if not isinstance(value, Mapping):
        raise ValueError("must be a mapping, or null for none")
    return strictly(_listed_or_drawn(value), dict(value))


def _listed_or_drawn(keys: Mapping[str, Any]) -> type[Section]:
    return ListedObstacles if "cells" in keys else DrawnObstacles


Obstacles = Annotated[
    DrawnObstacles | ListedObstacles, Forms(_listed_or_drawn), BeforeValidator(_obstacles)
]


class NoFly(Section):
    """A zone in which no drone may fly: a polygon, from one altitude to another."""

    polygon_m: Annotated[tuple[Point, ...], Field(min_length=3, max_length=MOST_CORNERS)]
    """The corners [x, y] of the polygon, in metres, in either direction. Its edges must meet only
    at the corners between neighbours.
    """
    altitude_m: Annotated[tuple[Altitude, Altitude], AfterValidator(rising)] = (0.0, 10_000.0)
    """The lowest and the highest altitude of the zone, in metres."""

    @field_validator("polygon_m")
    @classmethod
    def _is_simple(cls, corners: tuple[Point, ...]) -> tuple[Point, ...]:
        checked(corners)
        return corners


class Map(Section):
    """The map: its size, its cells, and in 3D its levels and obstacles."""

    later: ClassVar = ("no_fly", "buildings")

    size_m: tuple[Side, Side] = (SIDE_M, SIDE_M)
    """The width (to the east) and depth (to the north) of the map, in metres."""
    cells: tuple[CellCount, CellCount] = (10, 10)
    """The number of cells along x and along y. Drones fly from cell centre to cell centre."""
    dimensions: Literal[2, 3] = 3
    """3: drones change altitude between buildings. 2: they fly above everything."""
    levels: Levels = Levels()
    """The altitudes at which drones fly."""
    obstacles: Obstacles | None = DrawnObstacles()
    """The buildings (3D only): drawn, or listed under `cells`; null means none."""
    buildings: Buildings | None = None
    """The buildings of a city (3D only), of a file or drawn after ITU-R P.1410, instead of
    `obstacles`; null means none.
    """
    no_fly: Annotated[tuple[NoFly, ...], Field(max_length=1000)] = ()
    """The zones in which no drone may fly. They need `motion: {space: free}` of all drones."""

    @model_validator(mode="after")
    def _nothing_stands_in_the_way_in_2d(self) -> Map:
        if self.dimensions == 2 and "obstacles" not in self.model_fields_set:
            self._settle(obstacles=None)
        return self

    @model_validator(mode="after")
    def _buildings_are_the_obstacles(self) -> Map:
        if self.buildings is None:
            return self
        if "obstacles" not in self.model_fields_set:
            self._settle(obstacles=None)
        elif self.obstacles is not None:
            raise errors([(("buildings",), "not beside map.obstacles, which are buildings", None)])
        if isinstance(self.buildings, BuildingsOfFile):
            try:
                self.city_of_file  # noqa: B018
            except ValueError as error:
                problem = str(error)
                raise errors([(("buildings", "file"), problem, str(self.buildings.file))]) from None
        return self

    @property
    def city_of_file(self) -> City:
        """The buildings of the map's file; none if it has no file. Raises ValueError."""
        if not isinstance(self.buildings, BuildingsOfFile):
            return NO_CITY
        from desim_uav.city.footprints import read_city

        own = self.buildings
        city = read_city(own.file, self.size_m, own.origin, own.height_m)
        if own.attribution is None:
            return city
        return replace(city, attribution=together([own.attribution, city.attribution]))

    @property
    def drawn_up_to_m(self) -> float | None:
        """The height that buildings reach that are drawn; None if none are drawn."""
        if isinstance(self.buildings, BuildingsOfItu):
            return self.buildings.tallest_m
        if isinstance(self.obstacles, DrawnObstacles):
            low_m, high_m = self.obstacles.height_m
            return math.nextafter(high_m, low_m)  # heights are drawn from [low, high)
        return None

    @property
    def tallest_m(self) -> float:
        """The height of the tallest building that there can be, in metres; 0 without any."""
        if self.dimensions == 2:
            return 0.0
        if isinstance(self.buildings, BuildingsOfItu):
            return self.buildings.tallest_m
        if self.buildings is not None:
            return self.city_of_file.tallest_m
        if self.obstacles is None:
            return 0.0
        if isinstance(self.obstacles, DrawnObstacles):
            return self.obstacles.height_m[1]
        return max((height for *_, height in self.obstacles.cells), default=0.0)

    @property
    def most_levels(self) -> int:
        """The largest number of levels that there can be (see ``grid.altitudes``)."""
        lowest_m, step_m = self.levels.min_altitude_m, self.levels.step_m
        if self.dimensions == 2:
            return 1
        above = int(max(self.tallest_m - lowest_m, -step_m) // step_m) + 2
        most_m = max(self.levels.max_altitude_m or 0.0, lowest_m)
        return max(above, int((most_m - lowest_m) // step_m) + 1)

    @property
    def cell_m(self) -> tuple[float, float]:
        """The size of a cell along x and y."""
        return self.size_m[0] / self.cells[0], self.size_m[1] / self.cells[1]
