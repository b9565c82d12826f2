"""What drones are commanded: the same contract for the three kinds of fleets."""

from __future__ import annotations

import copy
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, MultiDiscrete

from desim_uav.commands import CellCommands, Commands, EachCommands, FreeCommands
from desim_uav.commands.given import CommandError
from desim_uav.errors import ScenarioError
from desim_uav.model.rules import Action
from desim_uav.rules.rows import Course
from desim_uav.rules.words import AIMS
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world

BATTERY = {"autonomy_min": 6, "return_below": 0.8}
KINDS = {
    "cells": [("cells", BATTERY), ("cells", None)],
    "free": [("free", BATTERY), ("free", None)],
    "each": [("cells", None), ("free", BATTERY), ("cells", BATTERY), ("free", None)],
}


def world_of(kind: str) -> World:
    types = [
        {
            "name": f"type{k}",
            "count": 1,
            "battery": battery,
            "motion": {"space": space, **({"cruise": [2, 8]} if space == "free" else {})},
        }
        for k, (space, battery) in enumerate(KINDS[kind])
    ]
    described = {
        "map": {"size_m": [800, 800], "cells": [4, 4], "dimensions": 2},
        "drones": types,
        "stations": {"count": 1, "radius_m": 200},
        "users": {"count": 4},
    }
    return build_world(from_mapping(described), 1)


AIM = [name for name in Course.kinds if name.startswith("aim_")]


def written(commands: Commands, drone: int, command: Any) -> Any:
    """The row of a drone, as far as a command is written into it."""
    row = SimpleNamespace(index=drone, command=-7, course=SimpleNamespace(**dict.fromkeys(AIM, 0)))
    commands.of(drone).give(row, command)
    return row


def aim_of(row: Any) -> list[float]:
    return [getattr(row.course, name) for name in AIM]


def test_one_class_for_each_kind_of_fleet():
    classes = {"cells": CellCommands, "free": FreeCommands, "each": EachCommands}
    for kind, cls in classes.items():
        world = world_of(kind)
        assert type(world.commands) is cls
        assert world.actions is world.commands.actions
        assert world.commands is world.commands, "made once"
        assert copy.deepcopy(world.commands) is world.commands


@pytest.mark.parametrize("kind", KINDS)
class TestEachFleet:
    def test_samples_of_the_spaces_become_rows_in_every_way(self, kind: str):
        commands = world_of(kind).commands
        drones = range(len(KINDS[kind]))
        spaces = [commands.of(drone).space(drone) for drone in drones]
        for drone, space in enumerate(spaces):
            space.seed(drone)
        for _ in range(20):
            given = [space.sample() for space in spaces]
            joined = commands.joined(given)
            split = list(commands.split(joined))
            indices, aims = commands.arrays(joined)
            rows = [written(commands, drone, one) for drone, one in enumerate(split)]
            assert [row.command for row in rows] == indices[0].tolist()
            assert (aims is None) == (kind == "cells")
            if aims is not None:
                assert len(AIM) == AIMS
                assert list(map(aim_of, rows)) == aims[0].tolist()

    def test_what_is_drawn_is_in_the_space_of_the_drone(self, kind: str):
        commands = world_of(kind).commands
        rng, mask = np.random.default_rng(1), [True, True]
        for drone in range(len(KINDS[kind])):
            own = commands.of(drone)
            drawn = [own.drawn(drone, rng, mask) for _ in range(20)]
            for one in drawn:
                shown = np.array(one, np.float32) if isinstance(one, list) else one
                assert shown in own.space(drone)
                assert own.read(drone, one) == one

    def test_saved_commands_are_played_again(self, kind: str):
        commands, rng = world_of(kind).commands, np.random.default_rng(2)
        drones = range(len(KINDS[kind]))
        steps = [
            [commands.of(d).drawn(d, rng, [True] * 3) for d in drones],
            [commands.actions.index(Action.HOVER) for _ in drones],
        ]
        rows = [[written(commands, d, one) for d, one in enumerate(step)] for step in steps]
        kept = commands.kept([number for step in rows for row in step for number in aim_of(row)])
        assert (kept is None) == (kind == "cells")
        played = commands.played([[row.command for row in step] for step in rows], kept)
        again = [[written(commands, d, one) for d, one in enumerate(step)] for step in played]
        assert again == rows

    def test_numbers_that_do_not_fit_are_refused(self, kind: str):
        commands = world_of(kind).commands
        wrong = np.zeros((1, len(KINDS[kind]), 1))
        with pytest.raises(CommandError, match="do not fit"):
            commands.played([[0] * len(KINDS[kind])], wrong)

    @pytest.mark.parametrize("wrong", [None, "x", [0.5], [float("nan")] * 4, object()])
    def test_what_is_no_command(self, kind: str, wrong: Any):
        commands = world_of(kind).commands
        for drone in range(len(KINDS[kind])):
            assert commands.of(drone).read(drone, wrong) is None
            with pytest.raises(CommandError, match="a command of "):
                written(commands, drone, wrong)

    def test_actions_have_names_and_a_drone_knows_its_own(self, kind: str):
        commands = world_of(kind).commands
        for drone, (space, _) in enumerate(KINDS[kind]):
            named = commands.of(drone).named
            assert ("fly" in named) == (space == "free")
            assert ("right" in named) == (space == "cells")
            assert "hover" in named
            assert all(commands.actions[k].name.lower() == name for name, k in named.items())


def test_the_space_of_many_environments():
    of_cells = world_of("cells").commands.of_all("a test").space_of_each(3)
    assert of_cells == MultiDiscrete(np.full((3, 2), 7))
    of_free = world_of("free").commands.of_all("a test").space_of_each(3)
    assert of_free == Box(-1.0, 1.0, (3, 2, 4), np.float32)


def test_only_drones_that_all_move_alike_have_one_array():
    for kind in KINDS:
        commands = world_of(kind).commands
        if kind == "each":
            with pytest.raises(ScenarioError, match="a test needs drones of one of the two kinds"):
                commands.of_all("a test")
        else:
            assert commands.of_all("a test") is commands
