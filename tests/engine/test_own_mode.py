"""A mode of one's own follows from the sets of modes it is in, also from episode to episode."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from desim_uav.engine import carry, episode
from desim_uav.engine.des import processes
from desim_uav.model.rules import AIRBORNE, DECIDES, GROUNDED, IN_QUEUE, TIMED, Mode
from desim_uav.rules import decide, words
from desim_uav.rules.battery import change_mode
from desim_uav.rules.flight import await_end
from tests.engine.helpers import US, Flight, path_of, returning

COOLS_US = 200 * US


def test_each_mode_is_in_the_air_or_on_a_station_unless_it_is_crashed():
    assert sorted([*AIRBORNE, *GROUNDED, Mode.CRASHED]) == sorted(Mode)
    assert IN_QUEUE < GROUNDED
    assert TIMED | DECIDES <= AIRBORNE | GROUNDED
    for name, modes in (("AIRBORNE", AIRBORNE), ("GROUNDED", GROUNDED), ("IN_QUEUE", IN_QUEUE)):
        assert set(getattr(words, name)) == set(modes)
    assert (set(words.DECIDES), set(words.TIMED)) == (set(DECIDES), set(TIMED))


@pytest.fixture
def cooling(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A mode in which a drone that has charged cools on the ground before it can be commanded."""
    number = len(Mode)
    mode: Any = int.__new__(Mode, number)
    mode._name_, mode._value_ = "COOLING", number

    def end_charging(world: Any, state: Any, drone: Any, station: int, phase: int) -> None:
        change_mode(world, state, drone, number)
        state.charges += 1
        state.stations[station].queue.remove(drone.index)
        drone.until_us = state.now_us + COOLS_US
        await_end(world, state, drone, COOLS_US)

    def on_arrival(world: Any, path: Any, state: Any, drone: Any) -> None:
        if drone.mode == number:
            change_mode(world, state, drone, words.CHARGED)
            drone.waits = 1
        else:
            decide.on_arrival(world, path, state, drone)

    for module in (carry, episode):
        monkeypatch.setattr(module, "MODES", (*Mode, mode))
    monkeypatch.setattr(carry, "TIMED", TIMED | {number})
    monkeypatch.setattr(words, "TIMED", (*words.TIMED, number))
    monkeypatch.setattr(words, "GROUNDED", (*words.GROUNDED, number))
    monkeypatch.setattr(words, "GOING_ON", number + 1)
    monkeypatch.setattr(processes, "end_charging", end_charging)
    monkeypatch.setattr(processes, "on_arrival", on_arrival)
    yield number


TOLD = ("hover", "charge", "charge", "charge", "charge", "hover")


def modes(flight: Flight) -> list[tuple[str, float | None, tuple[bool, ...]]]:
    """The mode, battery and mask of the drone at each epoch after the first."""
    return [
        (shown.observations[0].mode.name, shown.observations[0].battery_s, shown.masks[0])
        for shown in flight.shown[1:]
    ]


def test_a_mode_of_ones_own_is_carried_over_two_episodes(cooling: int):
    # It hovers for 60 s, charges for 30 s, and cools until 290 s: through the ends of two episodes.
    whole = Flight(returning(6, starts=[(4, 0)]))
    whole.episode(path_of(whole.world), " ".join(TOLD))
    assert [mode for mode, *_ in modes(whole)] == [
        *("FLYING", "COOLING", "COOLING", "COOLING", "CHARGED", "FLYING")
    ]
    flight, parts = Flight(returning(2, starts=[(4, 0)]), carry_over=True), []
    for first in (0, 2, 4):
        flight.episode(path_of(flight.world), " ".join(TOLD[first : first + 2]))
        parts += modes(flight)
        if first < 4:
            (carried,) = flight.engine.carried() or ()
            assert carried.mode == cooling
            assert carried.rest_us == (170 * US, 50 * US)[first // 2]
    assert parts == modes(whole)
    assert flight.engine.state.charges == 0, "it was charged in the first episode only"


def test_another_engine_takes_up_a_mode_of_ones_own(cooling: int):
    first, other = (Flight(returning(2, starts=[(4, 0)]), carry_over=True) for _ in range(2))
    first.episode(path_of(first.world), "hover charge")
    other.engine.carry(first.engine.carried())
    other.episode(path_of(other.world), "charge charge")
    first.episode(path_of(first.world), "charge charge")
    assert modes(other) == modes(first)
    assert other.engine.carried() == first.engine.carried()
    assert other.engine.carried()[0].mode == cooling  # type: ignore[index]


def test_a_mode_in_no_set_is_not_commanded(cooling: int, monkeypatch: pytest.MonkeyPatch):
    # Nothing says how it ends, so it lasts; the drone is not charged anew.
    monkeypatch.setattr(words, "TIMED", (words.FLYING,))
    monkeypatch.setattr(carry, "TIMED", TIMED)
    flight = Flight(returning(2, starts=[(4, 0)]), carry_over=True)
    flight.episode(path_of(flight.world), "hover charge")
    flight.episode(path_of(flight.world), "charge charge")
    assert {mode for mode, *_ in modes(flight)} == {"COOLING"}
    assert flight.engine.state.charges == 0
