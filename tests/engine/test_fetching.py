"""Memory of the next environment that is fetched during a step changes nothing but time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from desim_uav import UavParallelVectorEnv
from desim_uav.engine.compiled import calls
from desim_uav.env import many


def played(monkeypatch: pytest.MonkeyPatch, cached: int) -> tuple[list[Any], set[int], Any]:
    """Return what some steps show, how much is fetched, and the states at the end."""
    step_all, sizes = calls.step_all, set()

    def noted(*arguments: Any) -> int:
        sizes.add(arguments[-1])
        return int(step_all(*arguments))

    monkeypatch.setattr(many, "CACHED", cached)
    monkeypatch.setattr(calls, "step_all", noted)
    env = UavParallelVectorEnv("case8", 3, world_seed=0)
    _, infos = env.reset(seed=0)
    rng, shown = np.random.default_rng(0), []
    for _ in range(12):
        mask = infos["action_mask"]
        seen, rewards, _, _, infos = env.step((mask * rng.random(mask.shape)).argmax(axis=2))
        shown.append((seen, rewards, mask))
    states = [own.engine for own in env.sessions]
    monkeypatch.setattr(calls, "step_all", step_all)
    env.close()
    return shown, sizes, states


def test_fetching_changes_nothing_but_time(monkeypatch: pytest.MonkeyPatch):
    expected, none, _ = played(monkeypatch, many.CACHED)
    shown, sizes, engines = played(monkeypatch, 0)
    np.testing.assert_equal(shown, expected)
    assert none == {0}
    assert sizes == {engines[0].memory.nbytes}
    assert all(own.state.fetch_at == own.state.fetch_end == 0 for own in engines)
