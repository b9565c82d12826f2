"""Files of scenarios, each followed by the whole messages with which it is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from desim_uav.errors import ScenarioError
from desim_uav.scenario.load import loads

HERE = Path(__file__).parent


def blocks_of(file: str) -> list[str]:
    """Return the blocks of a file: a scenario's lines, and after ">> " each of its problems."""
    return (HERE / file).read_text().split("\n\n")[1:]


def check_block(block: str) -> None:
    """Check that a scenario is refused with these messages, and no others."""
    lines = block.splitlines()
    text = "\n".join(line for line in lines if not line.startswith(">> "))
    told = [line[3:].replace("HERE", str(HERE)) for line in lines if line.startswith(">> ")]
    assert told
    with pytest.raises(ScenarioError) as caught:
        loads(text, base=HERE, source="mine.yaml")
    assert list(caught.value.problems) == [f"mine.yaml:{message}" for message in told]
