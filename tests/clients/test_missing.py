"""Without their libraries, the modules for TorchRL and BenchMARL say what to install."""

from __future__ import annotations

import importlib
import sys

import pytest

from desim_uav.errors import MissingExtraError
from policies import train_benchmarl


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nothing of the libraries be installed, and nothing that uses them be imported yet."""
    for library in ("benchmarl", "tensordict", "torch", "torchrl"):
        monkeypatch.setitem(sys.modules, library, None)
    for module in [name for name in sys.modules if name.startswith("desim_uav.env.benchmarl")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.delitem(sys.modules, "desim_uav.env.torchrl", raising=False)


@pytest.mark.parametrize("extra", ["torchrl", "benchmarl"])
def test_a_missing_library(extra: str, without: None):
    with pytest.raises(MissingExtraError) as problem:
        importlib.import_module(f"desim_uav.env.{extra}")
    assert problem.value.exit_code == 5
    assert f'pip install -e ".[{extra}]"' in str(problem.value)


def test_the_script_ends_with_one_line(without: None, tmp_path, capsys):
    file = tmp_path / "policy.npz"
    assert train_benchmarl.main(["case8", str(file)]) == 5
    assert capsys.readouterr().err.count("\n") == 1
    assert not file.exists()


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (["case8", "policy.npz", "--steps", "0"], 2, "--steps 0: must be from 1 to"),
        (["case8", "policy.npz", "--seed", "-1"], 2, "--seed -1: must be from 0 to"),
        (["case88", "policy.npz"], 3, "case88"),
        (["case8", ".", "--steps", "1"], 2, "exists and is not a file"),
    ],
)
def test_what_cannot_be_asked_for(arguments, code, told, without: None, capsys):
    assert train_benchmarl.main(arguments) == code
    assert told in capsys.readouterr().err
