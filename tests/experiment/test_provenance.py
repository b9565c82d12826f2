"""What is recorded about how something was made."""

from __future__ import annotations

from desim_uav.experiment.provenance import command
from tests.command_line import ROOT


def test_a_recorded_command_has_no_places_of_this_machine(tmp_path):
    program = str(ROOT / "policies" / "ppo.py")
    given = [program, str(tmp_path / "mine.yaml"), "--steps", "64", "--out", "some/where/a.npz"]
    assert command(given) == ["policies/ppo.py", "mine.yaml", "--steps", "64", "--out", "a.npz"]
    assert command(["policies/ppo.py", "-S", "world_seed=0"]) == [
        "policies/ppo.py",
        "-S",
        "world_seed=0",
    ]
