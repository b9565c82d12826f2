"""Drones that are wrong about where they are: by hand."""

from __future__ import annotations

import pytest

from tests.engine.helpers import HOP_US, US, Flight, events, fly, in_3d, path_of, returning, seen

pytestmark = pytest.mark.usefixtures("every_engine")


def test_a_return_from_a_mistaken_place_is_flown_as_relative_hops():
    # True cell 2, believed 0: four hops right end on cell 6, beyond the station on 4; two back.
    world = returning(starts=[(2, 0)], steps=4)
    flight = Flight(world)
    log = flight.episode(path_of(world, error=[[(-2, 0)]]), "goto")
    assert seen(log, "arrive", "blocked", "land") == events("""
         30990663  3  arrive  0
         61981326  3  arrive  0
         92971989  3  arrive  0
        123962652  3  arrive  0
        154953315  3  arrive  0
        185943978  3  arrive  0
        185943978  3  land    0  -  -  0
    """)
    assert flight.shown[0].observations[0].cell == (0, 0)
    assert flight.shown[0].observations[0].return_s == pytest.approx(4 * HOP_US / US, abs=1e-9)
    assert log.distance_m == 6 * 240


def test_a_hop_off_the_map_ends_a_mistaken_path_at_no_cost():
    # True cell 7, believed 0: one of four hops right, and then four left from cell 8. Mistakes of
    # later decision epochs change nothing.
    world = returning(starts=[(7, 0)], steps=4)
    log = fly(world, path_of(world, error=[[(-7, 0), (3, 0), (-8, 0)]]), "goto")
    assert seen(log) == events("""
                0  10  depart   0
         30990663   3  arrive   0
         30990663   3  blocked  0
         30990663   3  depart   0
         61981326   3  arrive   0
         61981326   3  depart   0
         92971989   3  arrive   0
         92971989   3  depart   0
        123962652   3  arrive   0
        123962652   3  depart   0
        154953315   3  arrive   0
        154953315   3  land     0  -  -  0
        154953315   3  charge   0  -  -  0
        232429973   3  charged  0  -  -  0
    """)


def test_a_drone_that_believes_it_is_on_a_station_looks_again():
    world = returning(starts=[(3, 0)], steps=1)
    flight = Flight(world)
    log = flight.episode(path_of(world, error=[[(1, 0)]]), "goto")
    assert flight.shown[0].observations[0].return_s == 0.0
    assert seen(log, "depart", "land") == events("""
               0  10  depart  0
        30990663   3  land    0  -  -  0
    """)


@pytest.mark.parametrize(
    ("error", "cell"), [(0.49, 7), (0.51, 8), (-0.51, 6), (40.0, 8), (-40.0, 0), (-1.6, 5)]
)
def test_a_belief_is_a_cell_of_the_map(error: float, cell: int):
    world = returning(starts=[(7, 0)], steps=1)
    flight = Flight(world)
    flight.episode(path_of(world, error=[[(error, 0.3)]]))
    assert flight.shown[0].observations[0].cell == (cell, 0)
    assert flight.shown[1].observations[0].cell == (7, 0)


def test_a_hop_into_a_building_ends_a_mistaken_path():
    # Station on (2, 1); a building on (1, 0). True cell (0, 0), believed (0, 1): right is blocked
    # at once; from (0, 0) the one way of three hops goes forward first.
    world = in_3d([[1, 0, 30]], [(0, 0)], cells=(5, 2), steps=2, battery={"return_below": 1.0})
    flight = Flight(world)
    log = flight.episode(path_of(world, error=[[(0, 1)]]), "goto")
    assert flight.shown[0].observations[0].return_s == pytest.approx(2 * HOP_US / US, abs=1e-9)
    assert seen(log) == events("""
               0  10  blocked  0
               0  10  depart   0
        30990663   3  arrive   0
        30990663   3  depart   0
        61981326   3  arrive   0
        61981326   3  depart   0
        92971989   3  arrive   0
        92971989   3  land     0  -  -  0
        92971989   3  charge   0  -  -  0
        108467321  3  charged  0  -  -  0
    """)
