"""The scripts of analysis/ run and say something sound."""

import re
import runpy
import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[1] / "analysis"


def test_learned_against_optimum(capsys: pytest.CaptureFixture[str], monkeypatch):
    script = str(SCRIPTS / "learned_against_optimum.py")
    monkeypatch.setattr(sys, "argv", [script, "1", "20"])
    runpy.run_path(script, run_name="__main__")
    rows = re.findall(r"^\| 0 \| (\w+) \| (.*) \|$", capsys.readouterr().out, re.MULTILINE)
    assert [algorithm for algorithm, _ in rows] == ["q_learning", "sarsa"]
    for _, cells in rows:
        reward, best, share, qoe3, best_qoe3 = map(float, cells.split(" | "))
        assert share == pytest.approx(reward / best, abs=2e-3) and share <= 1
        assert qoe3 <= best_qoe3
