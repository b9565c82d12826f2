"""Flights that are worked by hand are flown by every engine."""

from __future__ import annotations

import pytest

from desim_uav.engine.choose import ENGINES
from tests.engine.helpers import Flight


@pytest.fixture(scope="module", params=ENGINES)
def engine_name(request: pytest.FixtureRequest) -> str:
    """Return the name of the engine; all tests of a file run with one engine before the next."""
    name: str = request.param
    return name


@pytest.fixture
def every_engine(engine_name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let each engine in turn fly the flights of a test, whose log must then be that engine's."""
    monkeypatch.setattr(Flight, "flown_by", engine_name)


COMPILED_APART = (
    "test_conflicts",
    "test_by_event_against_fixed_step",
    "test_energy_against_fixed_step",
    "test_free_against_fixed_step",
    "test_free_by_event",
    "test_free_by_event_against_fixed_step",
    "test_free_cruise",
    "test_free_flight",
    "test_free_in_wind",
    "test_link_memory",
    "test_links_against_fixed_step",
    "test_mixed",
    "test_radio_engines",
    "test_tasks",
    "test_transfers",
    "test_wind",
    "test_wind_against_fixed_step",
)
"""Files whose tests of the compiled engine need kernels that the nine cases do not use. Those for
links in the air take more than a minute to compile. These tests are thorough; of those that
have the engine as a parameter, the default run has the ones on SimPy."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let tests of the compiled engine that compile much be thorough."""
    for item in items:
        if item.path.stem in COMPILED_APART and _engine_of(item) != "des":
            item.add_marker(pytest.mark.thorough)


def _engine_of(item: pytest.Item) -> str | None:
    """Return the engine that is a parameter of a test, if there is one."""
    params = item.callspec.params.values() if hasattr(item, "callspec") else ()
    return next((value for value in params if isinstance(value, str) and value in ENGINES), None)
