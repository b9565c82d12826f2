"""The world of a run folder, read back: what is written, and nothing else."""

import json

import pytest

from desim_uav.errors import PolicyError
from desim_uav.report.world import read_world, stored_world
from desim_uav.run_folder import world_content
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world


@pytest.fixture
def world_file(tmp_path):
    content = world_content(build_world(load(scenario_path("case8")), 0))

    def write(**changes):
        (tmp_path / "world.json").write_text(json.dumps(content | changes))
        return tmp_path, content

    return write


def test_is_what_was_written(world_file):
    folder, content = world_file()
    read = read_world(folder)
    assert read == content
    assert len(read["clusters"]) == 4


@pytest.mark.parametrize("name", ["case8", "tiny"])
def test_is_a_world_again(tmp_path, name):
    scenario = load(scenario_path(name))
    world = build_world(scenario, scenario.seed)
    (tmp_path / "world.json").write_text(json.dumps(world_content(world)))
    stored = stored_world(read_world(tmp_path), scenario)
    assert world_content(stored) == world_content(world)
    assert (stored.seed, stored.grid.level_step_m) == (world.seed, world.grid.level_step_m)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("size_m", [2400]),
        ("size_m", [2400, -1]),
        ("size_m", [2400, "<script>"]),
        ("cells", [10, 1.5]),
        ("cells", None),
        ("cell_height_m", [[0, 0], [0, 0]]),
        ("cells", [10**4, 10**4]),
        ("cells", [True, True]),
        ("size_m", [1e300, 1]),
        ("open_levels_m", []),
        ("levels_m", [-1]),
        ("users", []),
        ("users", [[0, 0]]),
        ("stations", [[1]]),
        ("stations", [[1, -1]]),
        ("start_cells", [[0, 10]]),
        ("start_cells", {"a": 1}),
        ("clusters", [{"x_m": 1, "y_m": 1}]),
        ("clusters", [[1, 2, 3]]),
    ],
)
def test_what_is_none_is_named(world_file, key, value):
    folder, _ = world_file(**{key: value})
    with pytest.raises(PolicyError, match=rf"world.json: not the world of a run: {key}"):
        read_world(folder)


@pytest.mark.parametrize("text", ["", "{", "[]", "NaN", "[" * 100_000, "\udcff"])
def test_no_world(tmp_path, text):
    with pytest.raises(PolicyError, match=r"world\.json"):
        read_world(tmp_path)
    (tmp_path / "world.json").write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(PolicyError, match=r"world\.json"):
        read_world(tmp_path)
