"""One drone as a decision process: step by step what the engine says, whatever it is told."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desim_uav.engine.base import CarriedDrone, RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError, UsageError
from desim_uav.model.energy.battery import Endurance
from desim_uav.model.rules import Action, Mode
from desim_uav.optimum.footprints import flown_to
from desim_uav.optimum.process import DroneProcess
from desim_uav.rules.admission import FirstCome
from desim_uav.rules.rewards import Coverage
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world
from tests.engine.helpers import HOP_US, US, in_3d, returning, strip
from tests.selection import at_length


@st.composite
def lone_drones(draw):
    """Small scenarios of one drone over users that stand still."""

    def pick(*options):
        return draw(st.sampled_from(options))

    cells = draw(st.tuples(st.integers(1, 6), st.integers(1, 6)))
    three_d, limited = draw(st.booleans()), pick(True, True, True, False)
    step_s = pick(60, 60, 60, 35.5, 90)
    cell_m = 160 if step_s == 35.5 else 240
    size_m = [cell_m * n for n in cells]
    levels = {"min_altitude_m": 20, "step_m": pick(10, 20)}
    obstacles = {"coverage": [0.0, 0.4], "height_m": [5, 60]}
    battery = {
        "kind": "endurance",
        "autonomy_min": pick(1, 1.5, 2.2, 3.7, 5, 8),
        "return_below": pick(0.2, 0.5, 0.8, 1.0),
        "on_crash": pick("respawn", "respawn", "respawn", "remove", "end_episode"),
        "respawn_after_min": pick(0, 0.4, 1, 2.3),
    }
    return {
        "map": {
            "size_m": size_m,
            "cells": list(cells),
            "dimensions": 3 if three_d else 2,
            **({"levels": levels, "obstacles": obstacles} if three_d else {}),
        },
        "drones": {
            "count": 1,
            "start_cells": pick(None, [[0, 0]]),
            "footprint_radius_m": pick(90, 180, 300, 600),
            "bandwidth_kbps": pick(None, 1000),
            "motion": {
                "kind": "bang_coast_bang",
                "timing": pick("minimum_time", "minimum_time", "fill_epoch"),
            },
            "battery": battery if limited else None,
        },
        "stations": {
            "count": draw(st.integers(1, 2)) if limited else 0,
            "radius_m": size_m[1] / 3,
            "full_charge_min": pick(0.7, 2, 5),
        },
        "users": {
            "count": draw(st.integers(1, 12)),
            "clusters": {"count": 2, "radius_m": [60, 400]},
            "mobility": {"kind": "static"},
        },
        "demand": {"kind": "continuous"},
        "reward": {"kind": pick("coverage", "coverage_battery", "multi_service")},
        "episode": {"steps": pick(1, 5, 20), "step_s": step_s, "carry_over": True},
    }


class Both:
    """An engine and a process told the same; each step of theirs is compared."""

    def __init__(self, world, seed=0):
        self.world, self.seed, self.episode = world, seed, -1
        self.process = DroneProcess(world)
        self.engine = Simulation(world, RunSettings((True,), world.scenario.episode.carry_over))
        self.state = self.process.start
        self.attached_us = self.promised_us = 0
        self.begin()

    def begin(self):
        """The next episode; of the one before, the time users were attached."""
        self.episode += 1
        self.shown = self.engine.reset(draw(self.world, self.seed, self.episode))

    def go_on(self):
        """Begin an episode if one has ended."""
        if self.shown.truncated or self.shown.terminated:
            self.attached_us += self.engine.log.attached_us
            assert self.attached_us == self.promised_us
            self.begin()

    def tell(self, action):
        """Compare all that follows; False where nothing does any more."""
        world = self.world
        outcome = self.process.outcome(self.state, action)
        for k, promised in enumerate(outcome.steps):
            self.go_on()
            self.shown = self.engine.step([world.actions.index(action)])
            self.promised_us += promised.attached_us
            replaced = outcome.state is None and k + 1 == len(outcome.steps)
            self.agrees(promised, replaced)
        if outcome.state is None and world.only_type.on_crash == "remove":
            return False
        self.go_on()
        seen = self.shown.observations[0]
        self.state = outcome.state
        if outcome.state is None:  # another drone: wherever the engine says
            places = world.starts if world.only_type.on_crash == "end_episode" else world.stations
            assert seen.cell in places
            self.state = ((*seen.cell, 0), world.only_type.capacity)
        assert seen.mode in (Mode.FLYING, Mode.CHARGED)
        assert (*seen.cell, seen.level) == self.state[0]
        assert seen.battery_s is None or round(seen.battery_s * US) == self.state[1]
        return True

    def agrees(self, promised, replaced):
        """One step. At an episode's end requests served all along complete, in the engine."""
        shown, row, seen = self.shown, self.engine.log.steps[-1], promised.observation
        last = shown.truncated
        assert (row.mode, row.attached_users) == (seen.mode, seen.attached_users)
        assert row.charge is None or row.charge / US == seen.battery_s
        assert row.return_drain is None or row.return_drain / US == seen.return_s
        if not last or self.world.scenario.reward.kind != "multi_service":
            assert row.reward == promised.reward
        if last or not replaced:
            own = ("step", "served_requests", "served", "asking") if last else ("step",)
            engines = shown.observations[0]
            assert engines == seen._replace(**{name: getattr(engines, name) for name in own})

    def allowed(self):
        """The process leaves out blocked moves, and nothing else."""
        allowed = self.process.allowed(self.state)
        mask = self.shown.masks[0]
        legal = [a for a, yes in zip(self.world.actions, mask, strict=True) if yes]
        assert set(allowed) <= set(legal)
        here = self.state[0]
        blocked = [a for a in legal if a not in allowed]
        assert all(self.process.neighbour(here, action) == here for action in blocked)
        return allowed


@pytest.mark.thorough
@pytest.mark.parametrize("examples", at_length(40, 200))
def test_as_in_the_engine(examples):
    """States, observations, rewards and attached time, decision after decision."""
    check = settings(max_examples=examples, deadline=None)(
        given(lone_drones(), st.integers(0, 2**20))(follow)
    )
    check()


def follow(scenario, seed):
    try:
        world = build_world(from_mapping(scenario), 0)
    except ScenarioError:
        return
    both, rng = Both(world, seed), np.random.default_rng(seed)
    for _ in range(40):
        allowed = both.allowed()
        weights = np.array([1.0 if action is Action.HOVER else 3.0 for action in allowed])
        if not both.tell(allowed[rng.choice(len(allowed), p=weights / weights.sum())]):
            break


@dataclass(frozen=True)
class Brisk(Endurance):
    """An autonomy that falls twice as fast while the drone speeds up or brakes."""

    def drains(self, flight, elapsed_us):
        drain, pieces = elapsed_us, flight.pieces
        for k in range(len(pieces) - 1):
            if pieces[k].acceleration_mps2 != 0.0:
                begins_us, ends_us = (
                    round(pieces[k].start_s * US),
                    round(pieces[k + 1].start_s * US),
                )
                drain += max(0, min(elapsed_us, ends_us) - begins_us)
        return drain

    def lasts(self, flight, charge):
        low, high = 0, charge  # it drains at least as fast as time passes
        while low < high:
            middle = (low + high) // 2
            if self.drains(flight, middle) < charge:
                low = middle + 1
            else:
                high = middle
        return low


@dataclass(frozen=True)
class PlainBrisk(Brisk):
    """The same, but told of transits, not of rows."""

    def drain_of(self, flight, elapsed_us):
        assert flight.profile.shape[1] == 4
        return self.drains(flight, elapsed_us)


BATTERIES = ["endurance", f"{__name__}:Brisk", f"{__name__}:PlainBrisk"]


def flown(world, state, action):
    """What the engine says of a decision: each step of it, and the state at the next one."""
    engine = Simulation(world, RunSettings((True,), carry_over=True, keep_events=True))
    engine.carry((CarriedDrone(Mode.FLYING, *state, 0, None, (), 0.0, 0, None),))
    engine.reset(draw(world, 0, 0))
    drone, steps, decides = engine.drones[0], [], False
    while not decides:
        engine.step([world.actions.index(action)])
        row = engine.log.steps[-1]
        place = (*world.grid.cell_of(row.x_m, row.y_m), world.grid.level_of(row.z_m))
        attached_us = attached(engine.log.events, row.t_us - world.step_us, row.t_us)
        told = (row.mode, place, row.charge / US, row.attached_users, row.reward)
        steps.append((*told, attached_us))
        gone = engine.log.crashes and world.only_type.on_crash != "respawn"
        decides = bool(drone.waits or gone)
    there = (drone.x, drone.y, drone.level), engine.state.observations[0].charge
    return steps, None if engine.log.crashes else there


def attached(events, from_us, to_us):
    """The time for which users were attached in a span, by the log."""
    sign = {"attach": 1, "detach": -1}
    return sum(sign.get(kind, 0) * (to_us - max(t_us, from_us)) for t_us, _, kind, *_ in events)


def as_flown(world, process, state, action):
    """Whether the process says the same."""
    found = process.outcome(state, action)
    steps = []
    for reward, seen, attached_us in found.steps:
        place = (*seen.cell, seen.level)
        now = (seen.mode, place, seen.battery_s, seen.attached_users, reward, attached_us)
        steps.append(now)
    return (steps, found.state) == flown(world, state, action)


@pytest.mark.thorough
@pytest.mark.parametrize("on_crash", ["respawn", "remove", "end_episode"])
@pytest.mark.parametrize("kind", BATTERIES)
def test_every_action_in_random_states(kind, on_crash):
    """Over a map with buildings. Every fourth battery would not outlast two steps of hovering."""
    battery = {"kind": kind, "autonomy_min": 6, "return_below": 1.0, "on_crash": on_crash}
    world = in_3d(
        [[0, 1, 30], [2, 0, 45], [3, 1, 25]],
        [(0, 0)],
        cells=(4, 3),
        users=[(130, 100), (300, 400), (620, 390), (840, 600)],
        radius_m=200.0,
        battery={**battery, "respawn_after_min": 1.5},
        stations={"full_charge_min": 3},
        episode={"steps": 30},
    )
    process, rng = DroneProcess(world), np.random.default_rng(0)
    nodes = flown_to(world)
    ends = set()
    for k in range(48):
        most_us = 2 * world.step_us if k % 4 == 0 else world.only_type.capacity
        state = nodes[rng.integers(len(nodes))], int(rng.integers(1, most_us))
        for action in process.allowed(state):
            assert as_flown(world, process, state, action), (state, action)
            after = process.outcome(state, action)
            ends.add((action, after.state is None))
    assert {(action, False) for action in world.actions} <= ends
    assert {(action, True) for action in world.actions if action is not Action.CHARGE} <= ends


# ---- worked by hand


def outcome(world, node, battery_s, action):
    """What follows; the states in seconds."""
    found = DroneProcess(world).outcome((node, round(battery_s * US)), Action[action])
    state = None if found.state is None else (found.state[0], found.state[1] / US)
    return found.steps, state


def told(steps):
    """Of each step: what the drone does, its battery, and the time users were attached."""
    return [
        (step.observation.mode.name, step.observation.battery_s, step.attached_us) for step in steps
    ]


def test_a_move():
    """The user is 60 m short of the next cell: in reach from half the way on, 15.495331 s."""
    world = returning(users=[(300, 120)], radius_m=60.0)
    (step,), state = outcome(world, (0, 0, 0), 500, "RIGHT")
    assert state == ((1, 0, 0), 440)
    assert (step.observation.attached_users, step.reward) == (1, 0.5 + 0.2)
    assert step.attached_us == 60 * US - 15_495_331


def test_a_return_and_a_charge():
    """Two hops to the station in 61.98 s; 438.02 s are left of 600, 161.98 charge in 80.99 s."""
    steps, state = outcome(returning(), (6, 0, 0), 500, "GOTO_CHARGING_STATION")
    landed_us = 2 * HOP_US
    left_s = 500 - landed_us / US
    assert told(steps) == [
        ("RETURNING", 440.0, 0),
        ("CHARGING", left_s + 2 * (120 - landed_us / US), 0),
        ("CHARGED", 600.0, 0),
    ]
    assert state == ((4, 0, 0), 600)


def test_just_enough_to_land():
    """The battery is empty on arrival: it charges 600 s in 300."""
    steps, state = outcome(returning(), (5, 0, 0), HOP_US / US, "GOTO_CHARGING_STATION")
    assert [step.observation.mode.name for step in steps] == ["CHARGING"] * 5 + ["CHARGED"]
    assert state == ((4, 0, 0), 600)
    steps, state = outcome(returning(), (5, 0, 0), (HOP_US - 1) / US, "GOTO_CHARGING_STATION")
    assert (steps[0].observation.mode.name, state) == ("CRASHED", None)


@pytest.mark.parametrize(("after_min", "steps"), [(0, 1), (0.5, 1), (0.6, 2), (1.5, 2), (10, 11)])
def test_a_crash(after_min, steps):
    """After 30 s in the air; the one that replaces it comes at a decision epoch."""
    world = strip(users=[(120, 120)], battery={"respawn_after_min": after_min})
    found, state = outcome(world, (0, 0, 0), 30, "HOVER")
    assert told(found) == [("CRASHED", 0.0, 30 * US)] + [("CRASHED", 0.0, 0)] * (steps - 1)
    assert state is None


@pytest.mark.parametrize("kind", BATTERIES[1:])
def test_a_battery_of_ones_own(kind):
    """A hop takes 4.15 s more than its time: 2.075 s each while speeding up and while braking."""
    battery = {"kind": kind, "autonomy_min": 10, "return_below": 1.0, "on_crash": "remove"}
    world = strip(battery=battery, users=[(1560, 120)], radius_m=600.0, steps=9)
    steps, state = outcome(world, (6, 0, 0), 500, "GOTO_CHARGING_STATION")
    left_us, landed_us = 500 * US - 2 * (HOP_US + 4_150_000), 2 * HOP_US
    assert told(steps) == [
        ("RETURNING", 433.681326, 0),  # the second hop has braked for 93,674 us
        ("CHARGING", (left_us + 2 * (120 * US - landed_us)) / US, 0),
        ("CHARGED", 600.0, 0),
    ]
    assert state == ((4, 0, 0), 600)
    steps, state = outcome(world, (6, 0, 0), 33, "LEFT")
    assert (told(steps), state) == ([("CRASHED", 0.0, 29_920_332)], None)  # braking for 1.004669 s
    process = DroneProcess(world)
    for battery_s, action in [(500, Action.GOTO_CHARGING_STATION), (33, Action.LEFT)]:
        assert as_flown(world, process, ((6, 0, 0), battery_s * US), action)


# ---- what is refused


def lone(**changes):
    base = {"drones": {"count": 1, "battery": None}, "stations": {"count": 0}}
    base |= {"users": {"mobility": {"kind": "static"}}, "demand": {"kind": "continuous"}}
    base |= {"reward": {"kind": "multi_service"}}
    return build_world(from_mapping(base | changes), 0)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"users": {"mobility": {"kind": "random_walk"}}}, "users.mobility"),
        ({"drones": {"count": 2, "battery": None}}, "drones.count"),
        ({"position_noise": {}}, "position_noise"),
        ({"demand": {"kind": "static"}}, "demand.kind"),
        (
            {"drones": {"count": 1, "battery": None, "admission": {"kind": f"{__name__}:Other"}}},
            "drones.admission",
        ),
        ({"reward": {"kind": f"{__name__}:OfTheStep"}}, "reward"),
    ],
)
def test_what_is_not_known_for_certain(changes, key):
    with pytest.raises(UsageError, match=f"^{key}: ") as refused:
        process = DroneProcess(lone(**changes))
        process.outcome(process.start, Action.HOVER)
    assert "\n" not in str(refused.value)
    assert refused.value.exit_code == 2


def test_a_reward_that_reads_no_requests_takes_any_demand():
    world = lone(demand={"kind": "dynamic"}, reward={"kind": "coverage_battery"})
    assert DroneProcess(world).start == ((*world.starts[0], 0), 0)


class Other(FirstCome):
    """An admission rule of one's own."""


class OfTheStep(Coverage):
    """A reward that grows with time."""

    def terms(self, drone, open_requests, facts):
        return {"late": float(drone.step)}


class OfTheCell(Coverage):
    """A reward for being far east, and for a full battery."""

    def terms(self, drone, open_requests, facts):
        return {"east": drone.cell[0] * 1.0, "battery": drone.battery_s / drone.capacity_s}


def test_a_reward_of_ones_own():
    (step,), _ = outcome(
        returning(reward={"kind": f"{__name__}:OfTheCell"}), (6, 0, 0), 360, "RIGHT"
    )
    assert step.reward == 7.5
