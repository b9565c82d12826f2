"""Sums of whole numbers at their largest: equal in both engines, or refused with the key."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from desim_uav.engine.base import EpisodeLog, RunSettings
from desim_uav.engine.choose import ENGINES, check_engine, make_engine
from desim_uav.engine.compiled import calls, largest_sums
from desim_uav.engine.compiled.forks import Forks
from desim_uav.engine.compiled.largest_sums import LARGEST, sums_of
from desim_uav.engine.compiled.pack import lacking
from desim_uav.errors import ScenarioError, SimulationError
from desim_uav.experiment import tables
from desim_uav.model.demand.asking import RowDemand
from desim_uav.model.demand.requests import Requests
from desim_uav.model.energy.battery import MOST_CHARGE, RowEnergy
from desim_uav.model.mobility import walking
from desim_uav.model.rules import US
from desim_uav.model.services import Stage
from desim_uav.rowcode.compiled_rows import pointer_to
from desim_uav.rowcode.kernels import kernel
from desim_uav.rowcode.packing import packed
from desim_uav.rowcode.rows import Table, blank
from desim_uav.rowcode.views import View
from desim_uav.rules import requests, wide
from desim_uav.rules.qoe_reward import fair_times
from desim_uav.rules.rows import Constants, State, User, Wide
from desim_uav.rules.wide import WORD, add_product
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine.helpers import Flight, path_of, strip

HERE = __name__


# ---- sums in two words

wide_at: Any = pointer_to(Wide)


@kernel
def compiled_product(total: int, one: int, other: int) -> None:
    """Add a product in compiled code."""
    add_product(wide_at(total), one, other)


LAST = 2**WORD - 1


def factors() -> list[tuple[int, int]]:
    """Pairs of whole numbers below 2^62: the corners of the arithmetic, and random ones."""
    corners = [0, 1, 2**31 - 1, 2**31, 2**32 + 1, 2**61, LAST - 1, LAST]
    rng = np.random.default_rng(0)
    found = [(one, other) for one in corners for other in corners]
    for one, other in rng.integers(0, LAST, (200, 2)).tolist():
        found.append((one >> int(rng.integers(0, 62)), other >> int(rng.integers(0, 62))))
    return found


@pytest.mark.parametrize("before", [0, 1, LAST])
def test_a_sum_in_two_words_is_exact_in_both(before: int):
    for one, other in factors():
        plain, block = blank(Wide), packed(blank(Wide))
        for total in (plain, View(block, Wide)):
            total.low = before
        add_product(plain, one, other)
        compiled_product(block.ctypes.data, one, other)
        expected = before + one * other
        assert wide.value_of(plain) == wide.value_of(View(block, Wide)) == expected
        assert 0 <= plain.low <= LAST


@pytest.mark.usefixtures("every_engine")
class TestInBothEngines:
    """Episodes whose integrals need more than 64 bits, or nearly as many."""

    def test_bandwidth_over_time(self):
        # Two drones of 10^12 Hz each, all in use for an hour: 7.2 * 10^21 Hz µs.
        world = strip(
            ((0, 0), (8, 0)),
            users=[(120, 120), (2040, 120)],
            bandwidth_kbps=1e9,
            episode={"steps": 1, "step_s": 3600},
        )
        log = hovering(world, {user: [(0, 3600, 1e9)] for user in range(2)})
        assert log.bandwidth_us_hz == 2 * 10**12 * 3600 * US > 2**72
        assert row_of(world, log)["bandwidth_percent"] == 100.0

    def test_a_volume_at_the_highest_rate(self):
        # 10^18 millionths of a bit, 10^12 of them in a microsecond: delivered in a second.
        service = {"kind": "transfer", "volume_mbit": [1e6], "bandwidth_kbps": [1e9]}
        world = strip(
            users=[(120, 120)],
            bandwidth_kbps=1e9,
            services={"file": service},
            demand={"kind": "dynamic", "mix": {"file": 1}},
        )
        engine = Flight(world).engine
        shown = engine.reset(path_of(world, {0: [(0, 10**12, 1e9)]}))
        while not shown.truncated:
            shown = engine.step([len(world.actions) - 1])
        log = engine.log
        (request,) = log.requests
        assert (request.done, request.t_end_us) == (10**18, 10**6)
        assert log.bandwidth_us_hz == 10**18


def hovering(world: World, asks: dict[int, Any]) -> EpisodeLog:
    """An episode in which all drones hover."""
    return Flight(world).episode(path_of(world, asks))


def row_of(world: World, log: EpisodeLog) -> Any:
    """The row of the table of episodes."""
    return tables.episodes_table([log], world, tables.requests_table([log], world)).iloc[0]


def wide_band(mhz: float, count: int, hours: float, **radio: Any) -> World:
    """Drones at one place that serve one user with all their bandwidth, more or less."""
    own = {"kind": "link_classes", "power_dbm": 60, "bandwidth_mhz": mhz, "sharing": "equal"}
    given = {
        "map": {"dimensions": 2},
        "drones": {"count": count, "battery": None, "radio": own | radio},
        "stations": {"count": 0},
        "users": {"positions_m": [[1320, 2280]], "mobility": {"kind": "static"}},
        "services": {"file": {"kind": "transfer", "volume_mbit": [1000000]}},
        "demand": {"kind": "dynamic", "think_time_s": 1, "mix": {"file": 1}},
        "reward": {"kind": "coverage"},
        "episode": {"steps": round(60 * hours)},
    }
    return build_world(from_mapping(given), 1)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("world", "percent"), [((10_000, 1, 0.5), 94.828), ((400, 3, 8), 33.2586)], ids=str
)
def test_wide_bands_for_a_long_time(world: Any, percent: float):
    found = []
    for name in ENGINES:
        made = wide_band(*world)
        engine = make_engine(name, made, RunSettings((True,) * world[1], carry_over=False))
        shown = engine.reset(draw(made, 1, 0))
        while not shown.truncated:
            shown = engine.step([len(made.actions) - 1] * world[1])
        found.append(row_of(made, engine.log))
    one, other = found
    assert one.equals(other)
    assert one["bandwidth_percent"] == pytest.approx(percent, abs=0.001)


# ---- products and quotients of floats, where whole numbers would not suffice

constants_at, state_at = calls.constants_at, calls.state_at


@kernel
def compiled_times(world: int, state: int, lasted_us: int) -> float:
    """Return ``fair_times`` in compiled code."""
    share: float = fair_times(constants_at(world), state_at(state), lasted_us)
    return share


def test_the_time_of_a_million_users_among_ten_thousand_drones():
    world, state = blank(Constants), blank(State)
    world.sharers, world.step_us = 11_000, 86_400 * US
    state.users = Table(blank(User) for _ in range(100))
    lasted_us = 10**6 * world.step_us
    blocks = packed(world), packed(state)
    places = (block.ctypes.data for block in blocks)
    expected = 10**6 * 11_000 / 100
    assert fair_times(world, state, lasted_us) == pytest.approx(expected, rel=1e-15)
    assert compiled_times(*places, lasted_us) == fair_times(world, state, lasted_us)


def test_measures_of_many_users_in_a_very_long_episode():
    world = strip(users=[(120, 120)] * 12)
    engine = make_engine("batch", world, RunSettings((True,), carry_over=False))
    engine.reset(path_of(world))
    state, end_us = engine.state, 2**53
    state.now_us = end_us
    state.attached_us, state.attached_from_us = -7 * end_us, 0  # and 12 are attached now
    state.opened, state.open_us, state.served_us = 12, 9 * end_us, 8 * end_us
    forks = Forks(engine, 1)
    forks.take()
    calls.look_at_all(forks.table, np.array([True]))
    compiled = forks.outputs.numbers[0, 1:4].tolist()
    assert compiled == list(requests.measures(engine.constants, state))
    assert compiled[1:] == pytest.approx([end_us / (60 * US * 12), 100 * 5 / 12], rel=1e-15)


# ---- what is refused


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        (
            {"users": [(0, 0)] * 600, "episode": {"steps": 104_000, "step_s": 86_400}},
            "users.count, episode: the time of all users together is too long",
        ),
        (
            {"battery": {"autonomy_min": 1e6}, "episode": {"steps": 100_000}},
            "drones.battery, episode: what a drone may use is too much",
        ),
    ],
)
def test_only_simpy_runs_what_64_bits_cannot_hold(changes: Any, problem: str):
    world = strip(**changes)
    assert lacking(world) == [problem]
    check_engine("des", world)
    with pytest.raises(ScenarioError, match=problem):
        check_engine("batch", world)


def test_each_sum_is_refused_from_its_bound_on(monkeypatch: pytest.MonkeyPatch):
    free = {"kind": "bang_coast_bang", "space": "free", "max_speed_mps": 10}
    world = strip(
        ((0, 0), (8, 0)),
        battery={"autonomy_min": 10},
        bandwidth_kbps=5000,
        separation_m=10,
        drones={"motion": {**free, "margin_m": 10}},
    )
    sums = list(sums_of(world))
    assert [one.keys for one in sums] == [
        "users.count, episode",
        "drones.count, episode",
        "drones.count, separation_m, episode",
        "drones.battery, episode",
        "drones.radio",
    ]
    assert all(0 < one.most <= LARGEST for one in sums)
    for one in sums:
        monkeypatch.setattr(largest_sums, "LARGEST", one.most)
        assert f"{one.keys}: {one.what}" not in largest_sums.too_large(world)
        monkeypatch.setattr(largest_sums, "LARGEST", one.most - 1)
        assert f"{one.keys}: {one.what}" in largest_sums.too_large(world)


@dataclass(frozen=True)
class TooLong:
    """A service of one's own, whose service time or bandwidth is too large."""

    duration_us: ClassVar = 2**62 + 1
    bps: ClassVar = 0

    def values(self) -> Any:
        return {"lasts": np.array([self.duration_us]), "takes": np.array([self.bps])}

    def stages(self) -> Any:
        return (Stage("lasts", rate="takes", timed=True),)


@dataclass(frozen=True)
class TooWide(TooLong):
    duration_us: ClassVar = 60 * US
    bps: ClassVar = 10**12 + 1


@dataclass(frozen=True)
class Endless(RowEnergy):
    """A battery of one's own that holds more than can be counted."""

    capacity_uj: ClassVar = MOST_CHARGE + 1
    autonomy_min: float = 30.0
    return_below: float = 0.2
    on_crash: str = "respawn"
    respawn_after_min: float = 10.0

    def drains(self, flight: Any, elapsed_us: int) -> int:
        return elapsed_us

    def lasts(self, flight: Any, charge: int) -> int:
        return charge


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"episode": {"steps": 1_000_000, "step_s": 86_400}}, r"2\^53 microseconds \(285 years\)"),
        (
            {"services": {"a": {"kind": f"{HERE}:TooLong"}}},
            "services.a: .*from 1 to 4,611,686,",
        ),
        ({"services": {"a": {"kind": f"{HERE}:TooWide"}}}, "services.a: .*from 0 to 1,000,000"),
        (
            {"drones": {"battery": {"kind": f"{HERE}:Endless"}}, "stations": {"count": 1}},
            "drones.battery: .*capacity_uj must be at most 70,368,744,177,664",
        ),
    ],
)
def test_what_cannot_be_counted_is_refused_at_load(changes: Any, problem: str):
    with pytest.raises(ScenarioError, match=problem):
        strip(**changes)


@dataclass(frozen=True)
class Greedy(RowDemand):
    """Asks for more than can be counted."""

    times: int = 1
    bps: int = 0

    def next_request(self, asker: Any, stream: Any, services: Any) -> None:
        asker.wait_us = 0
        asker.service = 0
        asker.required_us = 2**62 + self.times
        asker.bandwidth_bps = self.bps


@dataclass(frozen=True)
class Plain:
    """Asks, in a table, for more than can be counted."""

    due_us: int = 0
    required: int = 1
    kbps: int = 0

    def requests(self, users: int, services: Any, streams: Any, horizon_us: int) -> Requests:
        row = [self.due_us, 0, self.required, self.kbps * 1000 + (self.kbps > 0)]
        return Requests(np.array([row] * users, np.int64), np.arange(users + 1), True)


@pytest.mark.parametrize(
    ("demand", "problem"),
    [
        ({"kind": f"{HERE}:Greedy"}, "drew what is no request: .*4611686018427387905 µs"),
        ({"kind": f"{HERE}:Plain", "due_us": -1}, "request 0: its time in µs is -1"),
        ({"kind": f"{HERE}:Plain", "required": 0}, "what it requires.* from 1 to"),
        ({"kind": f"{HERE}:Plain", "kbps": 10**9}, "its bandwidth in bit/s is 1000000000001"),
    ],
)
def test_requests_that_cannot_be_counted_are_refused(demand: Any, problem: str):
    world = strip(demand=demand)
    with pytest.raises(SimulationError, match=problem):
        draw(world, 0, 0)


def test_times_of_walks_and_of_demand_end_somewhere():
    assert walking.later(5, 1e300) == 5 + 2**61
    assert walking.later(5, 0.0) == 6
    assert later_in_compiled_code(5, 1e300) == 5 + 2**61


@kernel
def later_in_compiled_code(t_us: int, seconds: float) -> int:
    """Return ``later`` in compiled code."""
    end_us: int = walking.later(t_us, seconds)
    return end_us
