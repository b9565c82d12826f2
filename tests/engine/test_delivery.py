"""Stored updates that come to the ground over a backhaul, worked by hand.

Links hold 400 kbit/s and backhauls carry 500, so that a stored Mbit takes 2 s if no link is busy.
"""

from __future__ import annotations

from typing import Any

import pytest

from desim_uav.engine.base import EpisodeLog, RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.rules import delivery
from desim_uav.scenario.load import from_mapping, to_plain
from desim_uav.world import World, build_world
from tests.audit.ages import audit_logs
from tests.engine.helpers import fly, path_of, radio, seen
from tests.engine.test_sensors import NEAR, US, carrying, fates, held, taken, world_of

pytestmark = pytest.mark.usefixtures("every_engine")


def joined(store_mbit: float | None = None, kbps: float = 500, **changes: Any) -> World:
    """The world of ``carrying`` with a backhaul."""
    drones = {"store_mbit": store_mbit, "backhaul": {"kind": "capacity", "kbps": kbps}}
    users = changes.pop("users", [NEAR])
    return carrying(users, **{"drones": drones, **changes})


def half(at_s: float, mbit: float = 1.0) -> tuple[float, ...]:
    """An update that is sent at 400 kbit/s."""
    return held(at_s, mbit, 400.0)


def fly_audited(world: World, asks: Any, *told: str, **path: Any) -> EpisodeLog:
    log = fly(world, path_of(world, asks, **path), *told)
    audit_logs([log], world)
    return log


def test_stored_updates_have_what_links_leave() -> None:
    """1 Mbit is received at 7.5 s. Until 10 s the next one is, and 0.25 Mbit go on at 100 kbit/s.

    The rest takes 1.5 s at 500 kbit/s, and the second one 2 s.
    """
    log = fly_audited(joined(), {0: [half(5), half(6)]}, "hover")
    assert [one.received_us / US for one in log.updates] == [7.5, 10.0]
    assert fates(log) == [("delivered", 11.5), ("delivered", 13.5)]
    one, two = log.updates
    assert (one.before_us / US, one.after_us / US) == (11.5, 6.5)
    assert (two.before_us / US, two.after_us / US) == (8.5, 7.5)
    assert [(e[0] / US, e[2], e[3], e[4], e[-1]) for e in seen(log, "deliver")] == [
        (11.5, "deliver", 0, 0, 0),
        (13.5, "deliver", 0, 0, 1),
    ]
    (sensor,) = log.sensors
    assert (sensor.falls, sensor.delivered, sensor.peaks_us) == (2, 2, 20 * US)
    twice = 11.5**2 + (8.5**2 - 6.5**2) + (234**2 - 7.5**2)
    assert sensor.area_us2 == twice * US * US


def test_the_last_bit_counts_to_the_microsecond() -> None:
    """A Mbit at 300,001 bit/s takes 3,333,323 µs, rounded up; the next one the same."""
    world = joined(kbps=300.001, bandwidth_kbps=1000)
    log = fly_audited(world, {0: [held(0, 1, 250.0), held(100, 1, 250.0)]}, "hover hover")
    assert [one.ended_us for one in log.updates] == [4 * US + 3_333_323, 104 * US + 3_333_323]


def test_updates_are_delivered_in_the_order_in_which_they_came() -> None:
    """The older one is larger, so it is received at 8 s, and delivered second."""
    log = fly_audited(
        joined(users=[NEAR, NEAR], kbps=800), {0: [half(1, 2.8)], 1: [half(2, 0.4)]}, "hover"
    )
    assert [one.received_us / US for one in log.updates] == [8.0, 3.0]
    assert fates(log) == [("delivered", 11.5), ("delivered", 4.0)]


def test_room_is_free_as_soon_as_an_update_is_delivered() -> None:
    """The store holds one of them. The next is sent from 9.5 s on, when the first is delivered."""
    log = fly_audited(joined(1.5), {0: [half(5), half(6)]}, "hover")
    assert [one.sent_us / US for one in log.updates] == [5.0, 9.5]
    assert fates(log) == [("delivered", 9.5), ("delivered", 14.0)]


def test_a_landing_delivers_the_rest() -> None:
    """At 60 s, the first of two has gone, and of the second 0.75 Mbit."""
    log = fly_audited(joined(), {0: [half(54), half(55)]}, "hover charge")
    assert [one.received_us / US for one in log.updates] == [56.5, 59.0]
    assert fates(log) == [("delivered", 60.0), ("delivered", 60.0)]
    one, two = log.updates
    assert (one.before_us, one.after_us) == (two.before_us, two.after_us) == (60 * US, 5 * US)
    (sensor,) = log.sensors
    assert (sensor.falls, sensor.delivered) == (1, 2)


def test_a_drone_on_its_way_home_still_has_its_backhaul() -> None:
    """It receives 28 Mbit until 70 s, while it flies away, and begins to return at 120 s.

    The backhaul needs 56 s, until 126 s, when the drone has not landed yet.
    """
    world = joined(battery={"autonomy_min": 10, "return_below": 1.0})
    log = fly_audited(world, {0: [half(0, 28)]}, "hover left goto charge")
    (update,), (landed,) = log.updates, seen(log, "land")
    assert (update.received_us, update.ended_us) == (70 * US, 126 * US)
    assert landed[0] > 126 * US


def test_a_crash_loses_what_has_not_come_to_the_ground() -> None:
    """Two updates are received at 58 and 59 s; the battery is empty at 60 s."""
    battery = {"autonomy_min": 1.0, "on_crash": "remove"}
    asks = {0: [half(57, 0.4), half(57.5, 0.4)]}
    log = fly_audited(joined(battery=battery), asks, "hover hover")
    assert [one.received_us / US for one in log.updates] == [58.0, 59.0]
    assert fates(log) == [("delivered", 59.6), ("lost", 60.0)]
    (sensor,) = log.sensors
    assert (sensor.delivered, sensor.lost) == (1, 1)


def test_what_is_under_way_at_the_end_is_stored() -> None:
    log = fly_audited(joined(steps=1), {0: [half(56), half(57)]}, "hover")
    assert fates(log) == [("stored", 60.0), ("buffered", 60.0)]


def elastic(kbps: float | None, *, mast: bool = False) -> World:
    """The world of ``test_sensors``, with a backhaul for the drone, or for an access point."""
    plain = to_plain(world_of().scenario)
    plain["services"]["reading"]["delivered"] = "ground"
    backhaul = {} if kbps is None else {"backhaul": {"kind": "capacity", "kbps": kbps}}
    own = {"radio": radio(sharing="max_rate"), **backhaul}
    far = {"radio": radio(sharing="max_rate", classes=[{"snr_db": 90, "bit_s_hz": 1}])}
    plain["drones"] = {"count": 1, "battery": None, **(far if mast else own)}
    if mast:
        plain["access_points"] = [{"at_m": [300, 350], "height_m": 20, **own}]
    return build_world(from_mapping(plain), 0)


@pytest.mark.parametrize("mast", [False, True])
def test_elastic_links_come_first(mast: bool) -> None:
    """Over 500 kbit/s: 1 Mbit until 3 s and the next one until 5 s take all; then 2 s for each."""
    log = fly_audited(elastic(500, mast=mast), {0: [taken(1), taken(1.5)]})
    assert [one.received_us / US for one in log.updates] == [3.0, 5.0]
    assert fates(log) == [("delivered", 7.0), ("delivered", 9.0)]


def test_an_access_point_without_a_backhaul_is_at_the_ground() -> None:
    log = fly_audited(elastic(None, mast=True), {0: [taken(1), taken(1.5)]})
    assert fates(log) == [("delivered", 2.0), ("delivered", 3.0)]


def test_a_long_store_is_delivered_without_moving_all_of_it_each_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """While 0.04 Mbit are received every 0.1001 s, hardly any go on; then one every 0.1 s.

    Each update is copied into the store, and moves within it once at most, on average.
    """
    copied: list[int] = []
    original = delivery.copy_update

    def counting(to: Any, update: Any) -> None:
        copied.append(update.number)
        original(to, update)

    monkeypatch.setattr(delivery, "copy_update", counting)
    count, last_s = 64, 0.1001 * 63 + 0.1
    asks = {0: [half(0.1001 * k, 0.04) for k in range(count)]}
    log = fly_audited(joined(kbps=401), asks, "hover")
    assert [fate for fate, _ in fates(log)] == ["delivered"] * count
    ended = [at_s for _, at_s in fates(log)]
    assert ended == sorted(ended) and ended[-1] - last_s > 6.0
    assert len(copied) <= 2 * count


@pytest.mark.parametrize("engine", ["des", "batch"])
def test_ages_do_not_depend_on_what_is_logged(engine: str) -> None:
    """Without a log, what is stored is known all the same."""
    world, rewards = joined(9.0), []
    path = path_of(world, {0: [half(5), half(6), half(50, 8), half(130)]})
    for logs in (True, False):
        own = make_engine(engine, world, RunSettings((True,), False, logs, logs))
        own.reset(path)
        rewards.append([own.step([0]).rewards for _ in range(4)])
    assert rewards[0] == rewards[1]


def test_a_saved_state_has_what_is_under_way() -> None:
    """A Mbit is received at 4.5 s; 0.25 of it go on until 5 s, and the rest at 100 kbit/s.

    18 Mbit are received from 5 to 50 s: 10 go on until 70 s, when the state has been saved, and
    0.75 until 77.5 s, while 3 Mbit are received, and 7.25 until 92 s.
    """
    world = joined(30.0)
    path = path_of(world, {0: [half(2), half(5, 18), half(70, 3)]})
    ends = []
    for names in (("des", "des"), ("des", "batch"), ("batch", "des")):
        one, other = (make_engine(name, world, RunSettings((True,), False)) for name in names)
        one.reset(path)
        one.step([4])
        other.restore(one.save())
        while not (other.terminated or other.truncated):
            other.step([4])
        ends.append([update.ended_us for update in other.log.updates])
    assert ends[0] == ends[1] == ends[2]
    assert sorted(ends[0]) == [12_500_000, 92_000_000, 98_000_000]
