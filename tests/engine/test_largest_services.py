"""Tasks and sensors at their largest: what they add up to fits in 64 bits, or is refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from desim_uav.engine.base import EpisodeLog
from desim_uav.engine.compiled import largest_sums
from desim_uav.engine.compiled.largest_sums import LARGEST, sums_of
from desim_uav.errors import ScenarioError
from desim_uav.model.services import Stage
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine.helpers import US, Ask, Flight, merged, path_of, radio

HERE = __name__
SOON, FAST = 10**12, 1e9
"""A bandwidth in bit/s, and in kbit/s: the largest one, at which a Mbit takes a microsecond."""

TASK = {
    "kind": "compute",
    "input_mbit": [1e6],
    "cycles_per_bit": [4611.686],
    "bandwidth_kbps": [FAST],
}
CYCLES = 4_611_686 * 10**12
"""The thousandths of a cycle of this task, a billionth below 2^62."""

READING = {
    "kind": "collect",
    "updates": {"kind": "poisson", "mean_s": 60},
    "size_mbit": [1e6],
    "bandwidth_kbps": [FAST / 10],
    "delivered": "ground",
}
SENSING = {"kind": "sensing", "service": "a"}


def world_of(service: dict[str, Any], count: int = 1, **changes: Any) -> World:
    """A drone that hovers over its users, for an episode of two hours."""
    demand = {"kind": "dynamic", "mix": {"a": 1}}
    given = {} if "radio" in changes.get("drones", {}) else {"bandwidth_kbps": FAST}
    base = {
        "map": {"size_m": [240, 240], "cells": [1, 1], "dimensions": 2},
        "drones": {"count": 1, "battery": None, **given},
        "stations": {"count": 0},
        "users": {"positions_m": [[120, 120]] * count, "mobility": {"kind": "static"}},
        "services": {"a": service},
        "demand": SENSING if service["kind"] == "collect" else demand,
        "episode": {"steps": 2, "step_s": 3600},
        "reward": {"kind": "coverage"},
    }
    return build_world(from_mapping(merged(base, changes)), 0)


def hovering(world: World, asks: dict[int, list[Ask]]) -> EpisodeLog:
    flight = Flight(world)
    hover = len(world.actions) - 1 - 2 * bool(world.scenario.limited_battery)
    shown = flight.engine.reset(path_of(world, asks))
    while not (shown.terminated or shown.truncated):
        shown = flight.engine.step([hover] * world.scenario.drone_count)
    return flight.engine.log


TASKS = {0: [(0.0, 0.0, 0.0, 0, 10**12, 4_611_686, 0, SOON)]}
"""One task at the time 0: its time, three fields that are not used, and what it draws."""


@pytest.mark.usefixtures("every_engine")
class TestInBothEngines:
    @pytest.mark.parametrize("sharing", ["first_come", "processor_sharing", "earliest_deadline"])
    def test_cycles_of_a_task(self, sharing: str):
        """The input is sent in 1 s. A core of 1000 GHz needs 4,611.686 s; one of 1 kHz has done
        7,199 million cycles after two hours.
        """
        for ghz in (1000.0, 1e-6):
            world = world_of(TASK, drones={"processor": {"ghz": ghz, "sharing": sharing}})
            (one,) = hovering(world, TASKS).requests
            assert one.asked_cycles == CYCLES <= LARGEST < CYCLES + 10**12
            if ghz > 1:
                assert one.t_end_us == 4_612_686_000
            else:
                assert (one.done, one.required) == (7199 * US, CYCLES)

    @pytest.mark.parametrize("offloading", ["never", "split", "shortest"])
    def test_cycles_of_a_user(self, offloading: str):
        """The user alone would take 146,000 years, until about 2^62 µs."""
        world = world_of(
            TASK,
            drones={"processor": {"ghz": 1e-6}},
            users={"processor": {"ghz": 1e-6}},
            offloading=offloading,
        )
        (one,) = hovering(world, TASKS).requests
        assert (one.asked_cycles, one.t_end_us) == (CYCLES, 7200 * US)
        assert one.own_us == 7200 * US
        assert one.own_share == pytest.approx(7.2e9 / (CYCLES * (1 - one.part)), rel=1e-6)

    def test_a_store_without_a_limit(self):
        """Four updates of 10^18 millionths of a bit fit into 2^62; room for a fifth is missing."""
        world = world_of(READING, count=6, drones={"backhaul": {"kind": "capacity", "kbps": FAST}})
        asks = {user: [(0.0, 0.0, 0.0, 0, 10**18, SOON // 10)] for user in range(6)}
        log = hovering(world, asks)
        assert [one.sent_us for one in log.updates[:4]] == [0] * 4
        assert min(one.sent_us for one in log.updates[4:]) > 0
        assert [one.received_us for one in log.updates[:4]] == [10 * US] * 4
        assert {one.size for one in log.updates} == {10**18}

    def test_the_store_of_an_access_point(self):
        """Links of 1 Mbit/s never send an update of a Tbit, but room is kept for it."""
        wide = {"radio": radio(), "backhaul": {"kind": "capacity", "kbps": FAST}}
        far = radio(classes=[{"snr_db": 90, "bit_s_hz": 1}])
        reading = {key: value for key, value in READING.items() if key != "bandwidth_kbps"}
        world = world_of(
            reading,
            count=6,
            drones={"radio": far},
            access_points=[{"at_m": [120, 120], "height_m": 20, **wide}],
        )
        log = hovering(world, {user: [(0.0, 0.0, 0.0, 0, 10**18, 0)] for user in range(6)})
        sent = sorted(one.sent_us for one in log.updates)
        assert sent == [-1, -1, 0, 0, 0, 0]

    def test_what_a_processor_draws_in_a_day(self):
        """200 W beside those of hovering are 1.7e19 pJ, more than 64 bits hold."""
        battery = {"kind": "rotary_wing", "capacity_wh": 10_000}
        day = {"steps": 1, "step_s": 86_400}
        used = []
        for watts in (0, 200):
            world = world_of(
                TASK,
                drones={"battery": battery, "processor": {"kappa": 0, "electronics_w": watts}},
                stations={"count": 1},
                episode=day,
            )
            log = hovering(world, {})
            used.append(log.steps[0].used)
        assert used[1] - used[0] == 200 * 86_400 * US

    def test_a_processor_of_a_million_watts(self):
        """It begins after 1 s, and then empties a battery of 10 kWh in less than 36 s."""
        world = world_of(
            TASK,
            drones={
                "battery": {"kind": "rotary_wing", "capacity_wh": 10_000, "on_crash": "remove"},
                "processor": {"ghz": 100, "kappa": 1e-27},
            },
            stations={"count": 1},
        )
        log = hovering(world, TASKS)
        (crash,) = [event for event in log.events or () if event[2] == "crash"]
        assert 36.9 * US < crash[0] < 37 * US


# ---- what is refused


@dataclass(frozen=True)
class Divided:
    """A service of one's own whose amounts are counted, but not what they are divided from."""

    times: ClassVar = 2**40
    per: ClassVar = 2**40

    def values(self) -> Any:
        return {"bits": np.array([2**30]), "by": np.array([self.times])}

    def stages(self) -> Any:
        return (Stage("bits", times="by", per=self.per),)


@dataclass(frozen=True)
class JustFits(Divided):
    times: ClassVar = 2**32


@pytest.mark.parametrize(
    ("service", "problem"),
    [
        (
            TASK | {"cycles_per_bit": [1, 4611.687]},
            "services.a.input_mbit: .*times the largest of cycles_per_bit, it is "
            "4,611,687,000,000,000,000 thousandths of a cycle; at most 4,611,686,018,427,387,904",
        ),
        (
            {"kind": f"{HERE}:Divided"},
            "services.a: .*before it is divided by 1,099,511,627,776, its largest amount is "
            "1,180,591,620,717,411,303,424; at most 4,611,686,018,427,387,904",
        ),
    ],
)
def test_products_that_do_not_fit_are_refused_at_load(service: Any, problem: str):
    with pytest.raises(ScenarioError, match=problem):
        world_of(service, drones={"processor": {"ghz": 1}})


def test_a_product_that_fits_is_not_refused():
    world_of({"kind": f"{HERE}:JustFits"}, drones={"radio": radio()})


def test_each_sum_is_refused_from_its_bound_on(monkeypatch: pytest.MonkeyPatch):
    reading = READING | {"buffer": 7}
    sensors = {"name": "sensors", "count": 5, "demand": {"kind": "sensing", "service": "reading"}}
    world = world_of(
        TASK,
        services={"reading": reading},
        drones={"battery": {"kind": "rotary_wing"}, "processor": {}},
        stations={"count": 1},
        users=[{"name": "others"}, sensors],
    )
    own = {
        "drones.processor, episode": 10**6 * 7200 * US,
        "services.reading.buffer, users.count, episode": 2 * 5 * 8 * 7200 * US,
    }
    sums = {one.keys: one for one in sums_of(world)}
    for keys, most in own.items():
        assert sums[keys].most == most
        message = f"{keys}: {sums[keys].what}"
        monkeypatch.setattr(largest_sums, "LARGEST", most)
        assert message not in largest_sums.too_large(world)
        monkeypatch.setattr(largest_sums, "LARGEST", most - 1)
        assert message in largest_sums.too_large(world)
