"""``desim_uav.list_runs`` and ``desim-uav ls``: what is in a folder, and what differs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import desim_uav as du
from desim_uav import cli
from desim_uav.errors import UsageError
from desim_uav.run_folder import folder_name

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


def test_entries_of_a_list_differ_by_their_keys():
    for count in (1, 2):
        types = [{"name": "one", "count": count}, {"name": "two", "count": 1}]
        fly(f"of_{count}", drones=types)
    assert du.list_runs()["differs"].tolist() == ["drones.0.count=1", "drones.0.count=2"]


def test_only_trainings_differ_in_how_they_learn():
    keys = {"episode.steps": 4}
    for episodes in (2, 3):
        du.train("case1", keys, episodes=episodes, out=f"runs/t{episodes}", progress=False)
        if episodes == 2:
            for alpha in (0.1, 0.2):
                how: dict[str, Any] = {"policy": "hover", "engine": "des", "progress": False}
                du.run("case1", {**keys, "learning.alpha": alpha}, out=f"runs/r{alpha}", **how)
            assert du.list_runs()["differs"].tolist() == ["", "", ""]
    frame = du.list_runs()
    assert frame["differs"].tolist() == ["learning.episodes=2", "", "", "learning.episodes=3"]
    assert frame["learning.episodes"].tolist() == [2, None, None, 3]


def test_a_damaged_folder_is_told_of_and_another_manifest_is_not(
    capsys: pytest.CaptureFixture[str],
):
    for name in ("half", "sealed", "lacking"):
        fly(name)
    for name in ("half", "sealed"):
        manifest = Path(f"runs/{name}/manifest.json")
        manifest.write_text(manifest.read_text()[:50])
        Path(f"runs/{name}/scenario.yaml").unlink()
    Path("runs/half/SHA256SUMS").unlink()
    Path("runs/lacking/scenario.yaml").unlink()
    for name, text in (("other", '{"icons": []}'), ("begun", "{")):
        Path(f"runs/{name}").mkdir()
        Path(f"runs/{name}/manifest.json").write_text(text)
    assert len(du.list_runs()) == 0
    told = capsys.readouterr().err.splitlines()
    starts = [line.removeprefix("desim-uav: left out: runs/") for line in told]
    assert [" ".join(start.split()[:3]) for start in starts] == [
        "begun/manifest.json: not a",
        "half/manifest.json: not a",
        "lacking/scenario.yaml: cannot be",
        "sealed/manifest.json: the file",
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


def command(monkeypatch: pytest.MonkeyPatch, *arguments: str, of: str = "ls") -> int:
    monkeypatch.setattr("sys.argv", ["desim-uav", of, *arguments])
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


def test_a_folder_says_what_was_set_and_is_never_overwritten():
    how: dict[str, Any] = {"engine": "des", "progress": False, "out": True}
    keys = {"users.count": 6, "episode.steps": 4, "drones.battery": None}
    first = du.run("case8", keys, policy="hover", seed=3, **how)
    again = du.run("case8", dict(reversed(keys.items())), policy="hover", seed=3, **how)
    name = "case8-hover-s3-drones.battery=null-episode.steps=4-users.count=6"
    assert [run.folders for run in (first, again)] == [
        [Path(f"runs/{name}")],
        [Path(f"runs/{name}-2")],
    ]


def test_the_name_of_a_folder_is_short_and_safe():
    scenario = du.load("case8", {"seed": 3})
    names = [
        folder_name(scenario, "hover", ["seed=3", "users.count=2", "users.count=6"]),
        folder_name(scenario, "hover", ["map.size_m=[24, 10]", "demand.file=a/../b.csv"]),
        *(folder_name(scenario, "hover", [f"reward={'x' * 300}{k}"]) for k in (1, 2)),
    ]
    assert names[:2] == [
        "case8-hover-s3-users.count=6",
        "case8-hover-s3-demand.file=a-..-b.csv-map.size_m=-24-10",
    ]
    assert all(len(name) <= 75 for name in names)
    assert len({*names}) == 4


def test_a_longer_training_goes_on_in_its_folder():
    how: dict[str, Any] = {"out": True, "progress": False, "resume": True}
    for episodes in (2, 3):
        learned = du.train("case1", {"episode.steps": 4}, episodes=episodes, **how)
        assert learned.folder == Path("runs/case1-q_learning-s0-episode.steps=4")
    assert learned.episodes == 3


def test_a_label_is_in_the_manifest_the_list_and_the_pages():
    how: dict[str, Any] = {"engine": "des", "progress": False, "out": True, "events": True}
    run = du.run("case8", SMALL, policy="hover", name="<b>first</b> try", **how)
    assert run.manifests[0]["name"] == "<b>first</b> try"
    assert "first" in repr(run)
    du.train("case1", {"episode.steps": 4}, episodes=2, name="second", out=True, progress=False)
    assert du.list_runs()["name"].tolist() == ["<b>first</b> try", "second"]
    run.report("report.html")
    report = Path("report.html").read_text(encoding="utf-8")
    assert "&lt;b&gt;first&lt;/b&gt; try" in report and "<b>first" not in report
    run.replay("replay.html")
    assert "<b>first" not in Path("replay.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["", " ", "two\nlines", "x" * 201], ids=repr)
def test_a_label_is_one_line(name: str, monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(UsageError, match=r"name: .*must be one line of 1 to 200 characters"):
        du.run("tiny", name=name)
    assert command(monkeypatch, "tiny", "--name", name, of="run") == 2
