"""The draws of an episode, and what is left to no chance."""

from __future__ import annotations

import numpy as np
import pytest

from desim_uav.engine.batch.memory import paths_of
from desim_uav.model.mobility import Static
from desim_uav.sample_path import draw
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world


def world_of(case, *overrides):
    return build_world(load(scenario_path(case), overrides), 0)


def test_what_is_left_to_no_chance_is_asked_for_once(monkeypatch):
    asked = []
    walks = Static.walks
    monkeypatch.setattr(Static, "walks", lambda *given: asked.append(1) or walks(*given))
    world = world_of("case1")
    paths = [draw(world, 0, episode) for episode in range(3)]
    assert len(asked) == 1
    assert [path.episode for path in paths] == [0, 1, 2]
    assert paths[0].walks is paths[2].walks
    _, starts = paths_of(paths)
    assert starts.tolist() == [[0, 0]] * 3


def test_what_is_drawn_is_drawn_for_each_episode():
    world = world_of("case8")
    one, other = draw(world, 0, 0), draw(world, 0, 1)
    assert not np.array_equal(one.walks.legs, other.walks.legs)
    assert not np.array_equal(one.requests.rows[:10], other.requests.rows[:10])
    packed, ((_, _), (at_i, at_f)) = paths_of([one, other])
    assert 0 < at_i < packed.i.size
    assert at_f == packed.f.size == 0, "legs of random walks are not packed"


@pytest.mark.parametrize("case", ["case4", "case6"])
def test_part_of_an_episode_may_be_drawn(case):
    """Respawn places (case 4), requests (case 6): users stand still in both."""
    world = world_of(case)
    one, other = draw(world, 0, 0), draw(world, 0, 1)
    assert one.walks is other.walks
    _, starts = paths_of([one, other])
    assert starts[1].all()
