"""Memory for marks of links that is too small is made larger, in both engines."""

from __future__ import annotations

from typing import Any

import pytest

from desim_uav.engine.choose import make_engine
from desim_uav.engine.compiled import pack
from desim_uav.engine.des import Simulation, skies
from desim_uav.sample_path import draw
from tests.engine.test_line_of_sight import WORLDS, flown, told, town


@pytest.mark.parametrize("name", ["with shadowing", "past buildings"])
def test_too_little_memory_is_made_larger(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    world = town(**WORLDS[name])
    path = draw(world, 1, 0)
    expected = flown(Simulation(world, told(world)), path)
    monkeypatch.setattr(skies, "MARKS_A_USER", 1)
    monkeypatch.setattr(skies, "STRETCHES", 1)
    assert flown(Simulation(world, told(world)), path) == expected
    roomy = pack.room_for
    rooms: list[Any] = []

    def narrow(users: int, buffers: Any, legs: int) -> Any:
        rooms.append(buffers)
        times = len(rooms)
        return roomy(users, buffers, legs)._replace(marks=6 * times, stretches=times)

    monkeypatch.setattr(pack, "room_for", narrow)
    assert flown(make_engine("batch", world, told(world)), path) == expected
    assert len(rooms) > 1
