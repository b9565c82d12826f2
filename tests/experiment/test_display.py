"""How far work has come: what is shown without a terminal, and in a notebook."""

import sys
import time
import types

import pytest

from desim_uav.experiment import display, progress
from desim_uav.experiment.display import COMPILING, COMPILING_PARTS


@pytest.fixture
def clock(monkeypatch):
    """A clock that stands still until it is set."""
    now = types.SimpleNamespace(s=0.0)
    monkeypatch.setattr(time, "monotonic", lambda: now.s)
    return now


class TestLines:
    def test_compiling_is_said_when_it_begins(self, capsys):
        with display.display(True, 3, "episodes", compiling=COMPILING):
            assert capsys.readouterr().err == f"desim-uav: {COMPILING}\n"
        assert capsys.readouterr() == ("", "")

    def test_at_most_every_ten_seconds(self, capsys, clock):
        with display.display(True, 2000, "episodes", compiling="") as shown:
            for _ in range(1500):
                clock.s += 0.02
                shown(lambda: "not asked")
        lines = capsys.readouterr().err.splitlines()
        assert [line.partition(" of ")[2] for line in lines] == ["2,000 episodes"] * len(lines)
        assert len(lines) in (2, 3)  # in 30 seconds
        assert lines[0].startswith("desim-uav: 50")

    def test_short_work_says_nothing(self, capsys):
        with display.display(True, 5, "runs", compiling="") as shown:
            for _ in range(5):
                shown(lambda: "runs")
        assert capsys.readouterr() == ("", "")

    def test_quiet(self, capsys, clock):
        with display.display(False, 5, "runs", compiling=COMPILING) as shown:
            clock.s = 100
            shown(lambda: "runs")
        assert capsys.readouterr() == ("", "")

    @pytest.mark.parametrize(("engine", "text"), [("des", COMPILING_PARTS), ("batch", COMPILING)])
    def test_what_is_not_compiled_yet(self, capsys, monkeypatch, engine, text):
        monkeypatch.setattr(progress, "compiled_before", lambda kernel: False)
        with progress.progress(True, 1, engine=engine):
            pass
        assert text in capsys.readouterr().err
        with progress.training_progress(True, 1):
            pass
        assert COMPILING in capsys.readouterr().err


class TestNotebook:
    @pytest.fixture
    def shown(self, monkeypatch):
        """What a notebook has under its cell, one text after the other."""
        texts = []
        handle = types.SimpleNamespace(update=lambda content, raw: texts.append(content))

        def show(content, raw, display_id):
            assert raw and display_id
            texts.append(content)
            return handle

        module = types.SimpleNamespace(display=show)
        monkeypatch.setitem(sys.modules, "IPython.display", module)
        monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
        return texts

    def test_a_line_that_goes_at_the_end(self, shown, capsys, clock):
        with display.display(True, 4, "episodes", compiling="") as told:
            clock.s += 1
            told(lambda: "reward 2")
        first, second, last = shown
        assert first["text/plain"] == "0 of 4 episodes"
        assert second["text/plain"] == "1 of 4 episodes  reward 2"
        assert "1 of 4 episodes" in second["text/html"]
        assert set(last.values()) == {""}
        assert capsys.readouterr() == ("", "")

    def test_compiling(self, shown, clock):
        with display.display(True, 4, "episodes", compiling=COMPILING):
            pass
        assert COMPILING in shown[0]["text/html"]
