"""Extracts of maps: heights, rings, parts and projections, and what is refused by name."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from desim_uav.city.extract import read_extract
from desim_uav.city.footprints import city_of, convex_pieces, read_city
from desim_uav.city.heights import Heights, metres
from desim_uav.city.osm import LICENCE, rings_of
from desim_uav.errors import ScenarioError
from desim_uav.geodata.projection import Projection
from desim_uav.model.geometry.city import City
from desim_uav.model.geometry.polygons import area
from desim_uav.scenario.load import from_mapping
from tests.city.polygons import random_polygon

FLAT = Projection(0.0, 0.0)
PER_M = 1e-5 / FLAT.places_m(np.array([(1e-5, 1e-5)]))[0]
"""Degrees per metre at the equator, where maps of the tests are."""


def degrees(*places: tuple[float, float]) -> list[list[float]]:
    closed = [*places, places[0]]
    return [[x * float(PER_M[0]), y * float(PER_M[1])] for x, y in closed]


def box(x: float, y: float, dx: float, dy: float) -> list[list[float]]:
    return degrees((x, y), (x + dx, y), (x + dx, y + dy), (x, y + dy))


def geojson(file: Path, *features: tuple[list[Any], dict[str, Any]], **more: Any) -> Path:
    written = [
        {
            "type": "Feature",
            "properties": tags,
            "geometry": {"type": "Polygon", "coordinates": rings},
        }
        for rings, tags in features
    ]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": written, **more}))
    return file


OUTER = ((10, 10), (50, 10), (50, 50), (10, 50))
INNER = ((20, 20), (40, 20), (40, 40), (20, 40))
LATER = ((60, 10), (90, 10), (90, 40), (60, 40))


def osm(file: Path, more: str = "", head: str = "") -> Path:
    """A court whose outer ring has two ways, and a house whose outline has two parts."""
    places = [*OUTER, *INNER, *LATER, (75, 10), (75, 40)]
    nodes = "".join(
        f'<node id="{k}" lon="{x * PER_M[0]:.12f}" lat="{y * PER_M[1]:.12f}"/>'
        for k, (x, y) in enumerate(places)
    )

    def way(number: int, refs: list[int], **tags: str) -> str:
        nds = "".join(f'<nd ref="{ref}"/>' for ref in refs)
        return f'<way id="{number}">{nds}{tagged(tags)}</way>'

    def tagged(tags: dict[str, str]) -> str:
        return "".join(f'<tag k="{k.replace("__", ":")}" v="{v}"/>' for k, v in tags.items())

    ways = [
        way(1, [0, 1, 2]),
        way(2, [0, 3, 2]),
        way(3, [4, 5, 6, 7, 4]),
        way(4, [8, 9, 10, 11, 8], building="yes", height="99"),
        way(5, [8, 12, 13, 11, 8], building__part="yes", height="12 m"),
        way(6, [12, 9, 10, 13, 12], building__part="yes", building__levels="10"),
    ]
    members = "".join(
        f'<member type="way" ref="{ref}" role="{role}"/>'
        for ref, role in ((1, "outer"), (2, "outer"), (3, "inner"))
    )
    tags = tagged({"type": "multipolygon", "building": "yes", "height": "15"})
    relation = f'<relation id="7">{members}{tags}</relation>'
    file.write_text(f"{head}<osm>{nodes}{''.join(ways)}{relation}{more}</osm>")
    return file


def city(file: Path, size_m: tuple[float, float] = (100.0, 100.0), height_m: float = 8.0) -> City:
    return read_city(file, size_m, (0.0, 0.0), height_m)


def areas(of: City) -> dict[float, float]:
    """The built area by height of the roof."""
    return {
        roof: sum(area(p) for p, r in zip(of.pieces_m, of.roofs_m, strict=True) if r == roof)
        for roof in of.roofs_m.tolist()
    }


@pytest.mark.parametrize(
    ("text", "height_m"),
    [
        ("12", 12.0),
        ("12 m", 12.0),
        ("12.5m", 12.5),
        ("7,5", 7.5),
        ("40'", 12.192),
        ("39'4\"", 11.9888),
        ("30 ft", 9.144),
        ("tall", None),
        ("-3", None),
        ("0", None),
        ("12000", None),
        ("", None),
    ],
)
def test_heights_are_read_as_openstreetmap_writes_them(text: str, height_m: float | None) -> None:
    assert metres(text) == (None if height_m is None else pytest.approx(height_m))


def test_heights_follow_tags_levels_types_and_a_default_which_are_counted() -> None:
    heights = Heights(7.0)
    tags = [
        {"height": "21", "building:levels": "3"},
        {"building:levels": "3"},
        {"building": "garage"},
        {"building": "yes", "min_height": "4"},
        {"height": "high", "building:levels": "2"},
    ]
    assert [heights.of(f"way {k}", one) for k, one in enumerate(tags)] == pytest.approx(
        [21.0, 9.6, 3.0, 7.0, 6.4]
    )
    type_, unclear, parts = heights.notices()
    assert "2 buildings have neither a height nor levels: 1 have that of their type" in type_
    assert "of 1 buildings are not understood, first of way 4" in unclear
    assert "1 parts with a min_height stand on the ground" in parts


def test_a_court_of_two_ways_and_parts_instead_of_their_outline(tmp_path: Path) -> None:
    built = city(osm(tmp_path / "a.osm"))
    assert areas(built) == {
        15.0: pytest.approx(1600 - 400, abs=0.1),
        12.0: pytest.approx(450, abs=0.1),
        32.0: pytest.approx(450, abs=0.1),
    }
    assert built.attribution == LICENCE
    assert built.roof_at(30.0, 30.0) == 0.0
    assert built.roof_at(15.0, 30.0) == 15.0
    assert built.roof_at(80.0, 20.0) == 32.0


def test_geojson_has_holes_attribution_and_features_that_are_no_buildings(tmp_path: Path) -> None:
    file = geojson(
        tmp_path / "a.geojson",
        ([box(10, 10, 40, 40), box(20, 20, 20, 20)], {"building": "yes", "height": 15}),
        ([box(60, 60, 20, 20)], {"landuse": "grass"}),
        attribution="the town hall",
    )
    built = city(file)
    assert areas(built) == {15.0: pytest.approx(1200, abs=0.1)}
    assert built.attribution == "the town hall"
    assert any("1 features are no buildings" in one for one in built.notices)


def test_buildings_are_cut_off_at_the_edge_of_the_map(tmp_path: Path) -> None:
    file = geojson(
        tmp_path / "a.geojson",
        ([box(-10, -10, 40, 40)], {"height": 9}),
        ([box(500, 500, 10, 10)], {"height": 8}),
    )
    built = city(file)
    assert areas(built) == {9.0: pytest.approx(900, abs=0.1)}
    assert any("1 of 2 buildings are off the map" in one for one in built.notices)


def test_an_outline_that_crosses_itself_is_mended(tmp_path: Path) -> None:
    bow = degrees((10, 10), (50, 50), (50, 10), (10, 50))
    built = city(geojson(tmp_path / "a.geojson", ([bow], {"height": 9})))
    assert areas(built) == {9.0: pytest.approx(800, abs=0.1)}
    assert any("1 outlines that meet themselves are mended" in one for one in built.notices)


def test_the_middle_of_all_buildings_is_that_of_the_map(tmp_path: Path) -> None:
    file = geojson(tmp_path / "a.geojson", ([box(2000, 3000, 20, 10)], {"height": 9}))
    (piece,) = read_city(file, (100.0, 80.0), None, 8.0).pieces_m
    assert piece.mean(axis=0) == pytest.approx((50.0, 40.0), abs=0.002)


def geodesic_m(one: Any, other: Any) -> float:
    """The distance on WGS 84 by Vincenty's inverse formula."""
    a, f = 6378137.0, 1 / 298.257223563
    b = a * (1 - f)
    (l1, p1), (l2, p2) = np.radians(one), np.radians(other)
    u1, u2 = math.atan((1 - f) * math.tan(p1)), math.atan((1 - f) * math.tan(p2))
    lam = l2 - l1
    for _ in range(50):
        s = math.hypot(
            math.cos(u2) * math.sin(lam),
            math.cos(u1) * math.sin(u2) - math.sin(u1) * math.cos(u2) * math.cos(lam),
        )
        c = math.sin(u1) * math.sin(u2) + math.cos(u1) * math.cos(u2) * math.cos(lam)
        sigma = math.atan2(s, c)
        sin_a = math.cos(u1) * math.cos(u2) * math.sin(lam) / s
        cos2a = 1 - sin_a**2
        cm = c - 2 * math.sin(u1) * math.sin(u2) / cos2a
        big = f / 16 * cos2a * (4 + f * (4 - 3 * cos2a))
        lam = l2 - l1 + (1 - big) * f * sin_a * (sigma + big * s * (cm + big * c * (2 * cm**2 - 1)))
    u = cos2a * (a**2 - b**2) / b**2
    big_a = 1 + u / 16384 * (4096 + u * (-768 + u * (320 - 175 * u)))
    big_b = u / 1024 * (256 + u * (-128 + u * (74 - 47 * u)))
    off = (
        big_b
        * s
        * (
            cm
            + big_b / 4 * (c * (2 * cm**2 - 1) - big_b / 6 * cm * (4 * s**2 - 3) * (4 * cm**2 - 3))
        )
    )
    return b * big_a * (sigma - off)


@pytest.mark.parametrize("latitude", [-60.0, -5.0, 20.0, 48.0, 70.0])
def test_distances_over_two_kilometres_are_exact_to_a_millimetre(latitude: float) -> None:
    projection = Projection(11.5, latitude, 1000.0, 1000.0)
    assert projection.places_m(np.array([(11.5, latitude)]))[0] == pytest.approx((1000, 1000))
    rng = np.random.default_rng(int(latitude) + 90)
    wide = 0.009 / math.cos(math.radians(latitude))
    for one, other in rng.uniform(-1.0, 1.0, (40, 2, 2)) * (wide, 0.009) + (11.5, latitude):
        x, y = projection.places_m(np.array([one, other]))
        assert math.dist(x, y) == pytest.approx(geodesic_m(one, other), abs=1e-3)


def test_rings_close_whatever_the_direction_and_order_of_their_ways() -> None:
    (ring,), closed = rings_of([["a", "b", "c"], ["d", "c"], ["a", "e", "d"]])
    assert closed
    assert ring[0] == ring[-1]
    assert sorted(ring[:-1]) == ["a", "b", "c", "d", "e"]
    assert rings_of([["a", "b", "c"], ["c", "d"]]) == ([], False)
    whole = ["x", "y", "z", "x"]
    assert rings_of([whole, ["a", "b"], ["p", "q", "p"]]) == ([whole], False)


DOCTYPE = '<!DOCTYPE x [<!ENTITY e "y">]>'


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("a.geojson", "{", "a.geojson:1:2: it is not JSON"),
        ("a.geojson", "[]", "it is no GeoJSON"),
        ("a.geojson", '{"type": "Point"}', "type: 'Point': must be FeatureCollection"),
        ("a.geojson", '{"type": "FeatureCollection", "features": []}', "it has no buildings"),
        ("a.geojson", "[" * 100_000, "nested too deeply|it is not JSON"),
        ("a.osm", f"{DOCTYPE}<osm/>", "a.osm:1: a document type or entity is not allowed"),
        ("a.geojson", '{"type": ' + "9" * 5000 + "}", "9999999999999999999… is too large"),
        ("a.osm", "<gpx/>", "<gpx>: expected <osm>"),
        ("a.osm", "<osm><way>", "a.osm:1: <way> has no attribute 'id'"),
        ("a.osm", "<osm>", "a.osm:1: it is not well-formed XML"),
        ("a.osm", '<osm><node id="3" lon="x" lat="1"/></osm>', "node 3: lon and lat must be"),
        (
            "a.osm",
            '<osm><way id="8"><nd ref="1"/><nd ref="2"/><nd ref="3"/><nd ref="1"/>'
            '<tag k="building" v="yes"/></way></osm>',
            "way 8: node 1 is not in the file",
        ),
    ],
)
def test_malformed_files_are_refused_with_the_element(
    tmp_path: Path, name: str, text: str, problem: str
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=problem):
        read_extract(tmp_path / name)
    with pytest.raises(ScenarioError, match=f"map.buildings.file.*{name}") as refused:
        from_mapping({"map": {"buildings": {"file": name, "origin": [0, 0]}}}, base=tmp_path)
    assert len(refused.value.problems) == 1


@pytest.mark.parametrize(
    ("ring", "problem"),
    [
        ([[0, 0], [1, 0], [0, 0]], "feature 1: a ring has at least 4 places"),
        ([[0, 0], [1, 0], [1, 1], [0, 1]], "feature 1: a ring has at least 4 places"),
        ([[0, 0], [500, 0], [500, 9], [0, 0]], r"feature 1: \(500, 0\) is no longitude"),
        ([[179.9, 0], [-179.9, 0], [-179.9, 0.1], [179.9, 0]], "feature 1: it spans more than 1"),
        ([["a", 0], [1, 0], [1, 1], ["a", 0]], "feature 1: a ring is a list of places"),
        ([[10**250, 0], [1, 0], [1, 1], [10**250, 0]], "no longitude and latitude"),
        (7, "feature 1: a ring is a list of places"),
    ],
)
def test_malformed_rings_are_refused_with_the_feature(
    tmp_path: Path, ring: Any, problem: str
) -> None:
    file = geojson(tmp_path / "a.geojson", ([box(0, 0, 9, 9)], {}), ([ring], {}))
    with pytest.raises(ValueError, match=problem):
        read_extract(file)


def test_an_outline_without_area_is_not_said_to_be_off_the_map(tmp_path: Path) -> None:
    line = degrees((10, 10), (20, 10), (30, 10))
    far = box(500, 500, 9, 9)
    both = geojson(tmp_path / "a.geojson", ([box(0, 0, 9, 9)], {}), ([line], {}), ([far], {}))
    expected = [
        "1 of 3 outlines enclose no area and are left out",
        "1 of 3 buildings are off the map",
    ]
    assert [notice for notice in city(both).notices if "of 3" in notice] == expected


def test_an_extract_that_is_elsewhere_is_refused(tmp_path: Path) -> None:
    file = geojson(tmp_path / "a.geojson", ([box(500, 500, 9, 9)], {}))
    with pytest.raises(ValueError, match=r"none of 1 buildings is on the map of 100 x 100 m"):
        city(file)


def test_files_that_are_too_large_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = geojson(tmp_path / "a.geojson", *[([box(k, 0, 1, 1)], {}) for k in range(4)])
    monkeypatch.setattr("desim_uav.city.footprints.MOST_PIECES", 3)
    with pytest.raises(ValueError, match="more than 3 convex pieces"):
        city(file)
    monkeypatch.setattr("desim_uav.city.extract.MOST_BYTES", 100)
    file.write_text(file.read_text() + " ")
    with pytest.raises(ValueError, match="cut a smaller extract"):
        read_extract(file)


def test_pieces_of_random_polygons_cover_them_and_share_no_area() -> None:
    rng = np.random.default_rng(3)
    holes = 0
    for _ in range(60):
        polygon = random_polygon(rng, (50.0, 50.0), 30.0)
        holes += len(polygon.interiors)
        pieces = [shapely.Polygon(one) for one in convex_pieces(polygon, "x")]
        assert sum(one.area for one in pieces) == pytest.approx(polygon.area, rel=1e-9)
        assert shapely.union_all(pieces).symmetric_difference(polygon).area < 1e-6
        assert all(one.convex_hull.area == pytest.approx(one.area) for one in pieces)
    assert holes > 10


def test_an_extract_without_a_map_is_a_city(tmp_path: Path) -> None:
    extract = read_extract(osm(tmp_path / "b.osm"))
    assert len(extract.elements) == 4
    assert len(city_of(extract, (100.0, 100.0), FLAT, 8.0).pieces_m) >= 6


def collection(file: Path, *geometries: dict[str, Any], **more: Any) -> Path:
    feature = {
        "type": "Feature",
        "properties": {"building": "yes", "height": 9},
        "geometry": {"type": "GeometryCollection", "geometries": geometries},
    }
    file.write_text(json.dumps({"type": "FeatureCollection", "features": [feature], **more}))
    return file


def polygon(*place: float) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": [box(*place)]}


def test_polygons_of_a_collection_are_one_building(tmp_path: Path) -> None:
    nested = {"type": "GeometryCollection", "geometries": [polygon(60, 60, 10, 20)]}
    door = {"type": "Point", "coordinates": [0, 0]}
    file = collection(tmp_path / "a.geojson", polygon(10, 10, 20, 20), door, nested)
    assert len(read_extract(file).elements) == 1
    built = city(file)
    assert areas(built) == {9.0: pytest.approx(600, abs=0.1)}
    assert not built.notices


@pytest.mark.parametrize(
    ("geometry", "problem"),
    [
        ({"type": "polygon"}, r"feature 0: geometry: type: 'polygon': must be one of Point, Multi"),
        ({"type": []}, r"feature 0: geometry: type: \[\]: must be one of"),
        ({"type": "GeometryCollection"}, "feature 0: geometries: must be a list"),
        ([], "feature 0: geometry: type: None: must be one of"),
    ],
)
def test_geometries_that_are_none_are_refused(tmp_path: Path, geometry: Any, problem: str) -> None:
    file = collection(tmp_path / "a.geojson", polygon(0, 0, 9, 9), geometry)
    with pytest.raises(ValueError, match=problem):
        read_extract(file)


def crs(name: object) -> dict[str, Any]:
    return {"crs": {"type": "name", "properties": {"name": name}}}


@pytest.mark.parametrize(
    "name",
    [
        "urn:ogc:def:crs:OGC:1.3:CRS84",
        "EPSG:4326",
        "urn:ogc:def:crs:EPSG::4326",
        "http://www.opengis.net/def/crs/OGC/1.3/CRS84",
    ],
)
def test_a_legacy_crs_that_is_wgs84_changes_nothing(tmp_path: Path, name: str) -> None:
    house = ([box(10, 10, 20, 20)], {"height": 9})
    told = city(geojson(tmp_path / "a.geojson", house, **crs(name)))
    assert areas(told) == areas(city(geojson(tmp_path / "b.geojson", house, crs=None)))


@pytest.mark.parametrize(
    ("where", "said", "problem"),
    [
        ("file", crs("EPSG:25832"), r"a\.geojson: crs: EPSG:25832: places must be longitudes"),
        ("file", crs("EPSG:14326"), r"a\.geojson: crs: EPSG:14326: .* \(CRS84 or EPSG:4326\)"),
        ("file", {"crs": {"type": "link"}}, r"a\.geojson: crs: \{'type': 'link'\}: places must"),
        ("file", {"crs": 3857}, r"a\.geojson: crs: 3857: places must"),
        ("geometry", crs("EPSG:3857"), r"a\.geojson: feature 0: crs: EPSG:3857: places must"),
    ],
)
def test_places_of_another_crs_are_refused(
    tmp_path: Path, where: str, said: dict[str, Any], problem: str
) -> None:
    in_geometry, in_file = (said, {}) if where == "geometry" else ({}, said)
    file = collection(tmp_path / "a.geojson", polygon(0, 0, 9, 9) | in_geometry, **in_file)
    with pytest.raises(ValueError, match=problem):
        read_extract(file)


def edited(file: Path, *changes: tuple[str, str]) -> Path:
    """The extract of ``osm`` after these changes of its text."""
    text = osm(file).read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file.write_text(text)
    return file


MEMBER = '<member type="way" ref="3" role="inner"/>'
COURT = "".join(f'<nd ref="{k}"/>' for k in (4, 5, 6, 7, 4))


@pytest.mark.parametrize(
    ("changes", "built_m2"),
    [
        ((MEMBER, MEMBER.replace("3", "99")), 1600),
        ((COURT, COURT[: -len('<nd ref="4"/>')]), 1600),
        ((MEMBER, MEMBER + MEMBER.replace("3", "99")), 1200),
    ],
    ids=["missing", "open", "one of two"],
)
def test_a_courtyard_that_the_extract_lacks_is_built_over(
    tmp_path: Path, changes: tuple[str, str], built_m2: float
) -> None:
    built = city(edited(tmp_path / "a.osm", changes))
    assert areas(built)[15.0] == pytest.approx(built_m2, abs=0.1)
    assert [one for one in built.notices if "closed" in one] == [
        f"{tmp_path / 'a.osm'}: 1 buildings have courtyards whose outlines are not closed in the "
        "extract and are built over, first relation 7"
    ]


def test_a_building_whose_outer_ring_the_extract_lacks_is_left_out(tmp_path: Path) -> None:
    built = city(edited(tmp_path / "a.osm", ('ref="2" role="outer"', 'ref="99" role="outer"')))
    assert 15.0 not in areas(built)
    assert any(
        "not closed in the extract are left out, first relation 7" in n for n in built.notices
    )


def test_buildings_under_the_ground_are_left_out(tmp_path: Path) -> None:
    under = '<tag k="height" v="15"/><tag k="location" v="underground"/>'
    built = city(edited(tmp_path / "a.osm", ('<tag k="height" v="15"/>', under)))
    assert set(areas(built)) == {12.0, 32.0}
    words = f"{tmp_path / 'a.osm'}: 1 buildings with location=underground are left out, first "
    assert words + "relation 7" in built.notices
    low, deep = {"height": 9, "layer": -1}, {"height": 7, "location": "underground"}
    two = [([box(10, 10, 20, 20)], low), ([box(50, 50, 20, 20)], deep)]
    built = city(geojson(tmp_path / "a.geojson", *two))
    assert areas(built) == {9.0: pytest.approx(400, abs=0.1)}
    words = f"{tmp_path / 'a.geojson'}: 1 buildings with location=underground are left out, first "
    assert built.notices == (words + "feature 1",)
    alone = geojson(tmp_path / "b.geojson", two[1])
    with pytest.raises(ValueError, match=r"b\.geojson: it has no buildings above the ground"):
        read_extract(alone)
