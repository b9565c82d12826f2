"""The draws of an episode, and what is left to no chance."""

from __future__ import annotations

import numpy as np
import pytest

from desim_uav.engine.batch.memory import (
    AT_ERROR,
    AT_LEG_OFFSETS,
    AT_RESPAWN,
    AT_ROW_OFFSETS,
    AT_ROWS,
    NOISY,
    P_AFTER_PREVIOUS,
    P_AT_RANDOM,
    PATH_HEADER,
    RESPAWNS_DRAWN,
)
from desim_uav.engine.batch.paths import paths_of
from desim_uav.model.mobility import RandomWalks, Static
from desim_uav.sample_path import SamplePaths, draw, draw_all
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
    packed, _ = paths_of(draw_all(world, 0, range(3)))
    single, _ = paths_of(draw_all(world, 0, [0]))
    assert packed.i.size == single.i.size + 2 * PATH_HEADER
    assert packed.f.size == single.f.size


def test_what_is_drawn_is_drawn_for_each_episode():
    world = world_of("case8")
    one, other = draw(world, 0, 0), draw(world, 0, 1)
    assert not np.array_equal(one.walks.legs, other.walks.legs)
    assert not np.array_equal(one.requests.rows[:10], other.requests.rows[:10])
    packed, ((_, _), (at_i, at_f)) = paths_of(draw_all(world, 0, [0, 1]))
    assert 0 < at_i < packed.i.size
    assert at_f == packed.f.size == 0, "legs of random walks are not packed"


@pytest.mark.parametrize("case", ["case1", "case4", "case6", "case8", "case9"])
def test_what_is_packed_is_what_was_drawn(case):
    """Left to chance are respawn places (4), requests (6), walks (8) and position errors (9)."""
    world = world_of(case)
    packed, starts = paths_of(draw_all(world, 3, range(5, 9)))
    for episode, (at_i, at_f) in enumerate(starts, start=5):
        path, whole, real = draw(world, 3, episode), packed.i[at_i:], packed.f[at_f:]

        def section(first, like, whole=whole):
            return whole[whole[first] :][: like.size].reshape(like.shape)

        walking = path.walking
        assert whole[P_AT_RANDOM] == isinstance(walking, RandomWalks)
        if isinstance(walking, RandomWalks):
            assert (section(AT_LEG_OFFSETS, walking.states) == walking.states.view(np.int64)).all()
        else:
            assert (section(AT_LEG_OFFSETS, walking.offsets) == walking.offsets).all()
            assert (real[: walking.legs.size] == walking.legs.reshape(-1)).all()
        rows, offsets, after_previous = path.requests
        assert (section(AT_ROWS, rows) == rows).all()
        assert (section(AT_ROW_OFFSETS, offsets) == offsets).all()
        assert whole[P_AFTER_PREVIOUS] == after_previous
        assert (section(AT_RESPAWN, path.respawn) == path.respawn).all()
        assert whole[RESPAWNS_DRAWN] == path.respawn.shape[1]
        assert whole[NOISY] == (path.position_error is not None)
        if path.position_error is not None:
            errors = real[whole[AT_ERROR] :][: path.position_error.size]
            assert (errors == path.position_error.reshape(-1)).all()


def test_one_path_is_packed_as_it_is_among_others():
    world = world_of("case9")
    one, _ = paths_of(SamplePaths.of(draw(world, 0, 7)))
    same, _ = paths_of(draw_all(world, 0, [7]))
    assert (one.i == same.i).all()
    assert (one.f == same.f).all()
