"""``desim_uav.list_runs`` and ``desim-uav ls``: what is in a folder, and what differs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import desim_uav as du
from desim_uav import cli
from desim_uav.errors import UsageError

SMALL: dict[str, Any] = {"users.count": 6, "episode.steps": 4}


@pytest.fixture(autouse=True)
def _somewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)


def fly(out: str, policy: str = "hover", **keys: Any) -> Any:
    how: dict[str, Any] = {"engine": "des", "progress": False, "seed": 3}
    return du.run("case8", {**SMALL, **keys}, policy=policy, out=f"runs/{out}", **how)


def test_measures_and_what_differs_within_a_scenario():
    one = fly("one")
    fly("two", **{"users.count": 8})
    fly("three", "baseline", **{"drones.battery": None})
    du.train("case1", {"episode.steps": 4}, episodes=2, out="runs/four", progress=False)
    frame = du.list_runs().set_index("run")
    assert [*frame.index] == ["runs/one", "runs/two", "runs/three", "runs/four"]
    assert frame["kind"].tolist() == ["run", "run", "run", "training"]
    assert frame["policy"].tolist() == ["hover", "hover", "baseline", "q_learning"]
    assert frame["seed"].tolist() == [3, 3, 3, 0]
    assert frame["differs"].tolist() == [
        "drones.battery=endurance users.count=6",
        "drones.battery=endurance users.count=8",
        "drones.battery=null users.count=6",
        "",
    ]
    assert frame["users.count"].tolist() == [6, 8, 6, None]
    assert frame.loc["runs/one", "qoe3_percent"] == one.qoe()["qoe3_percent"]
    assert frame.loc["runs/four", ["qoe1_percent", "crashes"]].isna().all()


def test_keys_of_a_component_differ_within_a_kind_only():
    fly("one", **{"drones.battery.autonomy_min": 20})
    fly("two", **{"drones.battery.autonomy_min": 25})
    assert du.list_runs()["differs"].tolist() == [
        "drones.battery.autonomy_min=20",
        "drones.battery.autonomy_min=25",
    ]


def test_what_cannot_be_read_is_left_out_with_a_notice(capsys: pytest.CaptureFixture[str]):
    for name in ("one", "two", "three"):
        fly(name)
    with Path("runs/two/scenario.yaml").open("a") as file:
        file.write("# more\n")
    Path("runs/three/manifest.json").write_text("{}")
    Path("runs/three/SHA256SUMS").unlink()
    assert du.list_runs()["run"].tolist() == ["runs/one"]
    told = capsys.readouterr().err
    assert "left out: runs/two/scenario.yaml: the file has changed" in told
    assert "left out: runs/three/manifest.json: not the manifest of a run: " in told


def test_what_is_being_written_and_scenarios_alone_are_no_runs():
    fly("one")
    Path("runs/one").rename("runs/.unfinished-1")
    Path("runs/mine").mkdir()
    Path("runs/mine/scenario.yaml").write_text("name: mine\n")
    assert len(du.list_runs()) == 0


def test_no_folder():
    with pytest.raises(UsageError, match=r"^nowhere: there is no such folder$"):
        du.list_runs("nowhere")


def command(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["desim-uav", "ls", *arguments])
    with pytest.raises(SystemExit) as end:
        cli.main()
    return int(end.value.code or 0)


def test_the_command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    fly("one")
    fly("two", **{"users.count": 8})
    assert command(monkeypatch) == 0
    shown = capsys.readouterr().out
    assert "runs/two" in shown
    assert "users.count=8" in shown
    assert command(monkeypatch, ".", "--json") == 0
    first, second = json.loads(capsys.readouterr().out)
    assert (first["run"], second["users.count"]) == ("runs/one", 8)
    Path("empty").mkdir()
    assert command(monkeypatch, "empty") == 0
    assert "empty: no run or training is there" in capsys.readouterr().err
    assert command(monkeypatch, "nowhere") == 2
