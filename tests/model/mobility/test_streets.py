"""Users on streets: shortest ways, one-way streets, the long run, and files that are wrong."""

from __future__ import annotations

import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import lil_array
from scipy.sparse.csgraph import dijkstra

from desim_uav.model.mobility import walking
from desim_uav.model.mobility.mobility import leaves_the_map
from desim_uav.model.mobility.street_files import ways_of
from desim_uav.model.mobility.street_graph import StreetWay, cut, graph_of
from desim_uav.model.mobility.streets import Streets
from desim_uav.model.mobility.walks import Area, Walks
from tests.verification.figure import Estimate, check
from tests.verification.walked import US, legs_at, places_at, speeds_at, walked

SIDE = (600.0, 500.0)


def net_of(folder: Path, points: Any, edges: Any, name: str = "a.net.xml") -> Path:
    """A network of SUMO: junctions by number, and edges (start, stop, points between)."""
    lines = ["<net>"]
    lines += [f'<junction id="{k}" type="x" x="{x}" y="{y}"/>' for k, (x, y) in enumerate(points)]
    for number, (start, stop, *between) in enumerate(edges):
        line = [points[start], *between, points[stop]]
        shape = " ".join(f"{x},{y}" for x, y in line) if between else ""
        lines.append(f'<edge id="{number}" from="{start}" to="{stop}" shape="{shape}">')
        lines.append(f'<lane id="{number}_0" shape="{shape or "0,0 1,1"}"/></edge>')
    file = folder / name
    file.write_text("\n".join([*lines, "</net>"]), encoding="utf-8")
    return file


def random_net(folder: Path, seed: int) -> Path:
    """A grid with some streets missing, some one-way, some bent, and a loop."""
    rng = np.random.default_rng(seed)
    points = [(100.0 * i + rng.uniform(0, 60), 100.0 * j + rng.uniform(0, 60))
              for j in range(5) for i in range(6)]  # fmt: skip
    edges: list[Any] = []
    for j in range(5):
        for i in range(6):
            here = 6 * j + i
            for there, inside in ((here + 1, i < 5), (here + 6, j < 4)):
                if not inside or rng.random() < 0.15:
                    continue
                middle = np.mean([points[here], points[there]], axis=0) + rng.uniform(-9, 9, 2)
                between = [tuple(map(float, middle))] if rng.random() < 0.5 else []
                edges.append((here, there, *between))
                if rng.random() < 0.7:
                    edges.append((there, here, *between))
    edges.append((7, 7, (points[7][0] + 20, points[7][1]), (points[7][0], points[7][1] + 20)))
    return net_of(folder, points, edges)


def trips_of(walks: Walks, user: int) -> list[list[tuple[float, float]]]:
    """The ways of a user between pauses, without the first one, as points."""
    first, last = walks.offsets[user : user + 2]
    trips: list[list[tuple[float, float]]] = [[]]
    for leg in walks.legs[first:last]:
        trips[-1].append((float(leg["x_m"]), float(leg["y_m"])))
        if leg["vx_mps"] == leg["vy_mps"] == 0.0:
            trips.append([])
    return trips[1:-1]


def shortest(model: Streets, start: tuple[float, float], stop: tuple[float, float]) -> float:
    """The shortest way along streets between two places on them, by a graph of its own."""
    nodes: dict[tuple[float, float], int] = {}
    arcs = []
    x, y, first = model.x_m, model.y_m, list(map(int, model.first))
    for street, (since, until) in enumerate(pairwise(first)):
        for k in range(since, until - 1):
            a, b = np.array([x[k], y[k]]), np.array([x[k + 1], y[k + 1]])
            line = [(0.0, (x[k], y[k])), (1.0, (x[k + 1], y[k + 1]))]
            for place in (start, stop):
                share = float((np.array(place) - a) @ (b - a) / ((b - a) @ (b - a)))
                off = np.hypot(*(a + share * (b - a) - place))
                if 0.0 <= share <= 1.0 and off < 1e-3:
                    line.append((share, place))
            for (s, one), (t, other) in pairwise(sorted(line)):
                numbers = [nodes.setdefault(p, len(nodes)) for p in (one, other)]
                arcs.append((*numbers, (t - s) * float(np.hypot(*(b - a)))))
                if not model.one_way[street]:
                    arcs.append((*numbers[::-1], arcs[-1][2]))
    table = lil_array((len(nodes), len(nodes)))
    for tail, head, far in arcs:
        before = table[tail, head]
        table[tail, head] = min(far, before) if before else max(far, 1e-12)
    return float(dijkstra(table.tocsr(), indices=nodes[start])[nodes[stop]])


@pytest.mark.parametrize("by", ["walking", "driving"])
@pytest.mark.parametrize("seed", range(3))
def test_ways_are_shortest_ways(tmp_path: Path, by: Any, seed: int):
    model = Streets(random_net(tmp_path, seed), by, (1.0, 9.0), (5.0, 30.0))
    walks = walked(model, 12, SIDE, 3600.0, seed)
    assert not leaves_the_map(walks, Area(*SIDE), 3600 * US)
    ways = 0
    for user in range(12):
        trips = trips_of(walks, user)
        for trip in trips[: 4 if by == "walking" else 8]:
            far_m = float(np.hypot(*np.diff(np.array(trip), axis=0).T).sum())
            assert far_m == pytest.approx(shortest(model, trip[0], trip[-1]), abs=0.01)
            ways += 1
    assert ways > 40


def test_python_draws_the_same_walks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for start in ("stationary", "home"):
        model = Streets(random_net(tmp_path, 5), "driving", (1.0, 9.0), (0.0, 30.0), start)
        compiled = walked(model, 8, SIDE, 900.0)
        with monkeypatch.context() as patch:
            patch.setattr(walking, "compiled_walk", lambda mobility: None)
            plain = walked(model, 8, SIDE, 900.0)
        assert plain.offsets.tolist() == compiled.offsets.tolist()
        assert plain.legs.tolist() == compiled.legs.tolist()


def test_one_way_streets(tmp_path: Path):
    """Round a square of one-way streets, from (0, 0) to (300, 0) and so on, nobody drives back."""
    corners = [(0.0, 0.0), (300.0, 0.0), (300.0, 300.0), (0.0, 300.0)]
    file = net_of(tmp_path, corners, [(0, 1), (1, 2), (2, 3), (3, 0)])
    walks = walked(Streets(file, "driving", (5.0, 5.0), (0.0, 0.0)), 50, SIDE, 900.0)
    legs = walks.legs
    x, y = legs["x_m"] + 1e-3 * legs["vx_mps"] - 150.0, legs["y_m"] + 1e-3 * legs["vy_mps"] - 150.0
    assert (x * legs["vy_mps"] - y * legs["vx_mps"] > 0.0).all()
    on_foot = walked(Streets(file, "walking", (5.0, 5.0), (0.0, 0.0)), 50, SIDE, 900.0).legs
    x, y = on_foot["x_m"] - 150.0, on_foot["y_m"] - 150.0
    assert (x * on_foot["vy_mps"] - y * on_foot["vx_mps"] < -1.0).any()


def test_the_long_run_on_one_street(tmp_path: Path):
    """Ways along one street: x (1 - x) at times of walking; the mean speed as for waypoints."""
    file = net_of(tmp_path, [(0.0, 100.0), (400.0, 100.0)], [(0, 1, (100.0, 100.0))])
    model = Streets(file, "walking", (1.0, 19.0), (0.0, 0.0))
    walks = walked(model, 8000, SIDE, 900.0)
    for t in (0.0, 33.3, 900.0):
        away2 = (places_at(walks, t)[:, 0] / 400.0 - 0.5) ** 2
        check([Estimate.of(f"place at {t:g} s", away2, 0.05)])
        check([Estimate.of(f"speed at {t:g} s", speeds_at(walks, t), 6.113219)])
    rests = walked(Streets(file, "walking", (2.0, 2.0), (50.0, 150.0)), 8000, SIDE, 900.0)
    whole_s = 400.0 / 3.0 / 2.0 + 100.0
    for t in (0.0, 200.0, 900.0):
        check([Estimate.of(f"pauses at {t:g} s", speeds_at(rests, t) == 0.0, 100.0 / whole_s)])


@pytest.mark.thorough
@pytest.mark.parametrize("by", ["walking", "driving"])
def test_a_stationary_start_stays_as_it_is(tmp_path: Path, by: Any):
    """Means of the places' powers and of pauses do not change from time 0 on."""
    users = 20_000
    model = Streets(random_net(tmp_path, 1), by, (1.0, 9.0), (0.0, 60.0))
    walks = walked(model, users, SIDE, 1200.0)
    other = walked(model, users, SIDE, 1200.0, seed=1)
    for t in (10.0, 400.0, 1200.0):
        for axis in (0, 1):
            for power in (1, 2):
                begin = places_at(other, 0.0)[:, axis] ** power
                later = places_at(walks, t)[:, axis] ** power
                error = np.sqrt((begin.var() + later.var()) / users)
                assert abs(begin.mean() - later.mean()) < 4.0 * error
        rests = [(speeds_at(w, s) == 0.0).mean() for w, s in ((other, 0.0), (walks, t))]
        assert abs(rests[0] - rests[1]) < 4.0 * np.sqrt(2.0 * 0.25 / users)


def test_users_begin_at_home(tmp_path: Path):
    """From home they go straight to the nearest street, and then along streets."""
    file = net_of(tmp_path, [(0.0, 100.0), (400.0, 100.0)], [(0, 1), (1, 0)])
    model = Streets(file, "walking", (2.0, 2.0), (0.0, 0.0), "home")
    walks = walked(model, 30, SIDE, 900.0)
    homes = walks.legs[walks.offsets[:-1]]
    assert homes["y_m"].std() > 50.0
    second = walks.legs[walks.offsets[:-1] + 1]
    near = np.clip(homes["x_m"], 0.0, 400.0)
    assert np.allclose(second["x_m"], near, atol=1e-3) and np.allclose(second["y_m"], 100.0)
    assert np.allclose(places_at(walks, 899.0)[:, 1], 100.0, atol=1e-3)
    assert legs_at(walks, 0.0).tolist() == walks.offsets[:-1].tolist()


def test_ways_are_cut_at_the_edge_of_the_map():
    way = StreetWay(((-10.0, 5.0), (10.0, 5.0), (30.0, 5.0), (30.0, -5.0), (50.0, 15.0)))
    pieces = cut([way, StreetWay(((-5.0, -5.0), (-9.0, 3.0)))], Area(40.0, 20.0))
    assert [piece.points for piece in pieces] == [
        ((0.0, 5.0), (10.0, 5.0), (30.0, 5.0), (30.0, 0.0)),
        ((35.0, 0.0), (40.0, 5.0)),
    ]


def test_the_largest_part_is_kept():
    """An island, and a one-way street that leads nowhere back."""
    square = [(0.0, 0.0), (50.0, 0.0), (50.0, 50.0), (0.0, 50.0), (0.0, 0.0)]
    ways = [StreetWay(((200.0, 0.0), (260.0, 0.0))), StreetWay(tuple(square))]
    ways.append(StreetWay(((50.0, 50.0), (90.0, 50.0)), one_way=True))
    graph, left_out_m = graph_of(ways)
    assert left_out_m == 100.0 and graph.street_m.sum() == 200.0
    assert len(graph.tails) == 1 and len(graph.arcs) == 2
    with pytest.raises(ValueError, match="all are one-way"):
        graph_of(ways[2:])


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("<net><edge", ":1: it is not well-formed XML"),
        ('<!DOCTYPE a SYSTEM "/etc/passwd"><net/>', ":1: a document type or entity is not allowed"),
        ("<nets/>", ":1: <nets>: expected <net>"),
        ('<net>\n<edge id="1" from="a" to="b"/></net>', ":2: there is no junction 'a'"),
        ('<net><junction id="1" type="x" x="1e99" y="0"/></net>', ":1: x: '1e99': must be"),
        ("<net/>", ": there are no streets for walking"),
    ],
)
def test_files_that_are_wrong(tmp_path: Path, text: str, problem: str):
    file = tmp_path / "a.net.xml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError) as error:
        Streets(file)
    assert str(error.value).startswith(f"{file}{problem}")


def line_of(place: object) -> str:
    """A GeoJSON file with a street to a place."""
    street = {"type": "LineString", "coordinates": [[0, 0], place]}
    return json.dumps({"type": "Feature", "geometry": street, "properties": {}})


@pytest.mark.parametrize("origin", [None, (0.0, 0.0)])
@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{", ":1:2: it is not JSON"),
        (line_of([0, 91]), ": feature 0: its places are no longitudes and latitudes"),
        (line_of(["a", 1]), ": feature 0: a line is a list of places"),
        (line_of([10**250, 1]), ": feature 0: its places are no longitudes and latitudes"),
        (line_of([0, 1]).replace("[0, 1]", "[0, " + "9" * 5000 + "]"), ": 9999999999999999999…"),
        ("<osm>", ":1: it is not well-formed XML"),
        ('<osm><node id="3" lon="inf" lat="1"/></osm>', ":1: node 3: (inf, 1) is no longitude"),
        ("<net>", ":1: it is not well-formed XML"),
    ],
)
def test_what_is_wrong_in_a_file_is_told_before_what_its_origin_is(
    tmp_path: Path, text: str, problem: str, origin: tuple[float, float] | None
):
    file = tmp_path / "a.file"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError) as error:
        Streets(file, origin=origin)
    assert str(error.value).startswith(f"{file}{problem}")


@pytest.mark.parametrize(
    ("text", "origin", "problem"),
    [
        (line_of([0, 1]), None, "write origin: [longitude, latitude]"),
        ("<net/>", (0.0, 0.0), "origin: a network of SUMO is in metres"),
    ],
)
def test_an_origin_for_degrees_only(
    tmp_path: Path, text: str, origin: tuple[float, float] | None, problem: str
):
    file = tmp_path / "a.file"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(problem)):
        Streets(file, origin=origin)


def test_streets_off_the_map(tmp_path: Path):
    file = net_of(tmp_path, [(-100.0, 100.0), (400.0, 100.0)], [(0, 1), (1, 0)])
    (problem,) = Streets(file).problems(3, Area(300.0, 200.0))
    assert "cut_at_m: [300, 200]" in problem
    assert Streets(file, cut_at_m=(300.0, 200.0)).problems(3, Area(300.0, 200.0)) == []
    assert Streets(file, offset_m=(100.0, 0.0)).problems(3, Area(500.0, 200.0)) == []


OSM = """<osm>
<node id="1" lon="10.0" lat="50.0"/><node id="2" lon="10.001" lat="50.0"/>
<node id="3" lon="10.001" lat="50.001"/><node id="4" lon="10.002" lat="50.0"/>
<way id="1"><nd ref="1"/><nd ref="2"/><nd ref="4"/><tag k="highway" v="residential"/></way>
<way id="2"><nd ref="3"/><nd ref="2"/><tag k="highway" v="footway"/></way>
<way id="3"><nd ref="4"/><nd ref="3"/><nd ref="9"/><nd ref="1"/><tag k="highway" v="primary"/>
<tag k="oneway" v="-1"/></way>
<way id="4"><nd ref="1"/><nd ref="3"/><tag k="highway" v="path"/><tag k="foot" v="no"/></way>
<way id="5"><nd ref="1"/><nd ref="3"/><tag k="building" v="yes"/></way>
<way id="6"><nd ref="1"/><nd ref="3"/><tag k="highway" v="service"/>
<tag k="access" v="private"/></way>
</osm>"""


def test_streets_of_openstreetmap(tmp_path: Path):
    """A degree of longitude is 71,695.7 m at 50 degrees north, and one of latitude 111,229 m."""
    file = tmp_path / "a.osm"
    file.write_text(OSM, encoding="utf-8")
    on_foot = Streets(file, origin=(9.999, 49.999))
    assert on_foot.ends_m[-1] == pytest.approx(
        2 * 71.6957 + 111.229 + np.hypot(71.6957, 111.229), abs=0.02
    )
    assert min(on_foot.x_m) == pytest.approx(71.6957, abs=1e-3)
    assert min(on_foot.y_m) == pytest.approx(111.229, abs=1e-3)
    ways, _ = ways_of(file, True, (0.0, 0.0), (10.0, 50.0))
    assert [way.one_way for way in ways] == [False, True]
    north, east = ways[1].points[0], ways[1].points[1]
    assert north == pytest.approx((71.694, 111.229), abs=0.01) and east[1] == pytest.approx(
        0, abs=0.01
    )
    with pytest.raises(ValueError, match=r"a\.osm: its places are longitudes and latitudes; write"):
        Streets(file)


def test_streets_of_geojson(tmp_path: Path):
    lines = [[[0.001, 0.001], [0.002, 0.001]], [[0.002, 0.001], [0.002, 0.002, 7.5]]]
    features: list[Any] = [
        {"type": "Feature", "geometry": {"type": "MultiLineString", "coordinates": lines}},
        {"type": "Feature", "geometry": {"type": "Point", "coordinates": [0, 0]}},
        {
            "type": "Feature",
            "properties": {"highway": "motorway"},
            "geometry": {"type": "LineString", "coordinates": [[0.002, 0.002], [0.001, 0.001]]},
        },
    ]
    file = tmp_path / "a.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    model = Streets(file, origin=(0.0, 0.0))
    assert model.ends_m[-1] == pytest.approx(111.3195 + 110.5743, abs=0.01)
    ways, _ = ways_of(file, True, (0.0, 0.0), (0.0, 0.0))
    assert len(ways) == 3
    parts = [{"type": "LineString", "coordinates": line} for line in lines]
    features[0]["geometry"] = {"type": "GeometryCollection", "geometries": parts}
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    assert ways_of(file, True, (0.0, 0.0), (0.0, 0.0))[0] == ways
    parts[0]["coordinates"] = [[0, 0], [1, "a"]]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    with pytest.raises(ValueError, match=r"feature 0: a line is a list of places"):
        Streets(file, origin=(0.0, 0.0))
