"""Which tests of links are thorough because of what they compile."""

from __future__ import annotations

import pytest

COMPILED_APART = (
    "test_air",
    "test_air_bounds",
    "test_air_together",
    "test_link_between",
    "test_link_nested",
    "test_marks",
)
"""Files whose kernels take ten seconds or more to compile; the default run does not need them."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let the tests of these files be thorough."""
    for item in items:
        if item.path.parent.name == "radio" and item.path.stem in COMPILED_APART:
            item.add_marker(pytest.mark.thorough)
