"""Links of imagined futures: what is seen of them stays, and what is not seen is drawn anew."""

from __future__ import annotations

from statistics import NormalDist
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

from desim_uav.engine.choose import make_engine
from desim_uav.engine.des import Simulation
from desim_uav.experiment.run import play
from desim_uav.model.radio.draws import KEY_WORDS, UNSEEN, draws_of_link, imagined_links
from desim_uav.model.radio.radio import LinkClasses, Shadowing
from desim_uav.model.random.philox import key_of
from desim_uav.model.random.streams import Purpose
from desim_uav.model.rules import Action
from desim_uav.policies.hover import Hover
from desim_uav.policies.planning.future import imagined
from desim_uav.policies.planning.inner import InnerEngine
from desim_uav.policies.planning.links import seen_links
from desim_uav.policies.rollout import Rollout
from desim_uav.sample_path import draw
from tests.audit.invariants import audit
from tests.audit.sight import draws_of
from tests.engine.helpers import before_end, some_command
from tests.engine.towns import WORLDS, told, town

CELL, USERS, DRONES, POINTS = 7, 40, 2, 1
NUMBERS = np.arange(USERS)
CHANCE = 0.3
TRUE = key_of(0, Purpose.LINK, 0)


def new_key(sample: int) -> Any:
    """A second key."""
    return key_of(sample, Purpose.PLANNER, 0)


def foreseen(key: Any, sample: int, transmitter: int, cell: int = CELL) -> list[Any]:
    """The draws of the users' links in an imagined episode, all of whose chances are CHANCE."""
    cells = np.full(DRONES + POINTS, CELL)
    cells[1] = UNSEEN
    chances = np.full((DRONES + POINTS, USERS), CHANCE)
    words = imagined_links(key, new_key(sample), cells, chances)
    return [draws_of_link(words, NUMBERS, transmitter, user, cell) for user in range(USERS)]


def drawn(key: Any, transmitter: int, cell: int = CELL) -> list[Any]:
    """The draws of the users' links under a key."""
    return [draws_of_link(key, NUMBERS, transmitter, user, cell) for user in range(USERS)]


@pytest.mark.parametrize("transmitter", [0, -1])
def test_what_is_seen_of_a_link_stays_and_the_rest_is_drawn_anew(transmitter: int):
    uniforms = []
    for sample in range(50):
        new = drawn(new_key(sample), transmitter)
        for true, other, found in zip(
            drawn(TRUE, transmitter), new, foreseen(TRUE, sample, transmitter), strict=True
        ):
            clear = true[0] < CHANCE
            assert (found[0] < CHANCE) is clear, "the line of sight is as it is seen"
            assert found[1:] == ((true[1], other[2]) if clear else (other[1], true[2]))
            low, high = (0.0, CHANCE) if clear else (CHANCE, 1.0)
            uniforms.append((found[0] - low) / (high - low))
    assert kstest(uniforms, "uniform").pvalue > 0.01


@pytest.mark.parametrize(("transmitter", "cell"), [(0, CELL + 1), (-1, CELL + 1), (1, CELL)])
def test_links_from_elsewhere_or_to_a_silent_transmitter_are_all_new(transmitter: int, cell: int):
    assert foreseen(TRUE, 3, transmitter, cell) == drawn(new_key(3), transmitter, cell)


def test_nothing_else_of_the_true_draws_matters():
    """Under another key, links that are seen in the same state have the same lines of sight."""
    other = key_of(1, Purpose.LINK, 0)
    for one, two, first, second in zip(
        drawn(TRUE, 0), drawn(other, 0), foreseen(TRUE, 5, 0), foreseen(other, 5, 0), strict=True
    ):
        alike = (one[0] < CHANCE) == (two[0] < CHANCE)
        unseen = 2 if one[0] < CHANCE else 1
        assert not alike or (first[0], first[unseen]) == (second[0], second[unseen])


def test_the_audit_has_formulas_of_its_own():
    radio = LinkClasses(shadowing=Shadowing(2, 6), line_of_sight="drawn")
    chances = np.random.default_rng(0).random((DRONES + POINTS, USERS))
    words = imagined_links(TRUE, new_key(1), np.array([CELL, UNSEEN, CELL]), chances)
    for transmitter in (0, 1, -1):
        for cell in (CELL, CELL + 1):
            for user in range(USERS):
                ours = draws_of_link(words, NUMBERS, transmitter, user, cell)
                told_of = draws_of(words, radio, transmitter, user, cell, USERS)
                normals = [
                    NormalDist().inv_cdf(((int(word) >> 12) + 0.5) / 2**52) for word in ours[1:]
                ]
                expected = [ours[0], 2 * normals[0], 6 * normals[1]]
                assert [*told_of] == pytest.approx(expected, abs=1e-12)


def moved(engine: Any, steps: int, seed: int) -> None:
    """Let the drones do something for some steps."""
    rng = np.random.default_rng(seed)
    shown = engine.latest or engine.snapshot()
    for _ in range(steps):
        shown = engine.step([some_command(engine.world, mask, rng) for mask in shown.masks])


@pytest.mark.thorough
@pytest.mark.parametrize("name", WORLDS)
def test_both_engines_play_an_imagined_future_and_the_audit_agrees(name: str):
    world = town(**WORLDS[name])
    engine = make_engine("batch", world, told(world))
    engine.reset(draw(world, 1, 0))
    moved(engine, 3, 0)
    saved, links = engine.save(), seen_links(engine)
    assert links is not None
    now_us, logs = 3 * world.step_us, []
    for sample in (0, 1):
        future = imagined(saved, 5, sample, links)
        assert len(future.path.link_key) > KEY_WORDS
        checked = Simulation(world, told(world), audit=audit)
        for each in (InnerEngine(world, told(world)), checked):
            each.restore(future)
            moved(each, 3, 1)
            logs.append([tuple(event) for event in each.log.events or ()])
    assert logs[0] == logs[1]
    assert logs[2] == logs[3]
    assert logs[0] != logs[2], "each sample has links of its own"
    before = [[event for event in log if event[0] < now_us] for log in logs]
    assert before[0] == before[2]


@pytest.mark.thorough
def test_links_of_an_imagined_future_begin_as_they_are():
    """Drones that hover, and users who stand still, keep their links as they were for ever."""
    world = town(users={"count": 12, "mobility": {"kind": "static"}})
    engine = make_engine("batch", world, told(world))
    engine.reset(draw(world, 1, 0))
    moved(engine, 3, 0)
    saved, inner = engine.save(), InnerEngine(world, told(world))
    inner.restore(imagined(saved, 5, 0, seen_links(engine)))
    hover = [world.actions.index(Action.HOVER)] * 3
    for _ in range(3):
        inner.step(hover)
    later = before_end(inner.log)[len(saved.log.events or ()) :]
    assert len([event for event in later if event[2] == "request"]) > 3
    assert not [event for event in later if event[2] in ("enter", "exit", "class")]


@pytest.mark.thorough
def test_a_rollout_flies_over_links_that_are_drawn():
    world = town()
    tables = []
    for engine in ("des", "batch"):
        policy = Rollout(base=Hover(), samples=3, horizon=3)
        ((log, _),) = play(world, policy, "mine", seed=0, engine=engine)
        tables.append([(step.x_m, step.y_m, step.attached_users) for step in log.steps])
    assert tables[0] == tables[1]
    assert len({place[:2] for place in tables[0]}) > 3, "it does not hover"
