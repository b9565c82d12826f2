"""Overrides at random never end in "the simulation failed", and never take long."""

import pytest

from tests.scenario.fuzz import is_wrong, numeric_keys, outcomes


def test_every_section_has_numeric_keys():
    sections = {key.split(".")[0] for key in numeric_keys()}
    assert sections >= {"map", "drones", "stations", "users", "demand", "services", "episode"}
    assert len(numeric_keys()) > 60


@pytest.mark.thorough
def test_some_overrides():
    found = list(outcomes(200, seed=5))
    assert [one for one in found if is_wrong(one)] == []
    assert sum(one.was_run for one in found) > 20


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["des", "batch"])
def test_many_overrides(engine):
    found = list(outcomes(5000, seed=1, engine=engine))
    assert [one for one in found if is_wrong(one)] == []
    assert sum(one.was_run for one in found) > 500
