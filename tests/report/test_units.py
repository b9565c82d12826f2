"""The unit of QoE2 is called steps wherever a reader meets it; columns keep the paper's word."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from PIL import ImageDraw

from desim_uav.env import UavEnv
from desim_uav.records import EPISODES, REQUESTS
from tests.env.helpers import play_single

ROOT = Path(__file__).parents[2]
TEXTS = (
    *(("README.md", "CONTRIBUTING.md"), ("docs/*.md", "docs/*/*.md")),
    *(("analysis/*.py", "policies/*.py"), ("desim_uav/**/*.py", "desim_uav/**/*.js")),
)
OTHER_UNIT = re.compile(r"\bit\.[\"'`)|]|\biterations?\b|\bepochs?\b|\bmin(utes?)?\b")
HEADING = re.compile(r"QoE1 ?,? %.*\bQoE2\b(?!\\n|[ ,]*steps)")


def lines() -> Iterator[tuple[str, str]]:
    """Each line that names QoE2, with the place where it stands."""
    for pattern in (one for group in TEXTS for one in group):
        for file in sorted(ROOT.glob(pattern)):
            for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
                if "QoE2" in line:
                    yield f"{file.relative_to(ROOT)}:{number}", line


def test_no_text_gives_qoe2_another_unit():
    named = list(lines())
    assert len(named) > 40
    assert [at for at, line in named if OTHER_UNIT.search(line) and "step" not in line] == []


def test_no_heading_leaves_the_unit_out_beside_a_percent_sign():
    assert [at for at, line in lines() if HEADING.search(line)] == []


def test_the_columns_of_qoe2_are_described_in_steps():
    for table in (EPISODES, REQUESTS):
        about = table.meanings["qoe2_iterations"]
        assert "steps" in about and not OTHER_UNIT.search(about)


def test_the_picture_of_an_environment_writes_it(monkeypatch: pytest.MonkeyPatch):
    written: list[str] = []
    write = ImageDraw.ImageDraw.text

    def text(self: ImageDraw.ImageDraw, where: tuple[float, float], text: str, *others, **named):
        written.append(text)
        write(self, where, text, *others, **named)

    monkeypatch.setattr(ImageDraw.ImageDraw, "text", text)
    env = UavEnv("case8", render_mode="rgb_array")
    for _ in play_single(env, 1, seed=0):
        pass
    env.render()
    measures = [text for text in written if re.fullmatch(r"\d+\.\d+ \S+", text)]
    assert [text.split()[1] for text in measures] == ["%", "steps", "%"]
