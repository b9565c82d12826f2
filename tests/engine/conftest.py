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
