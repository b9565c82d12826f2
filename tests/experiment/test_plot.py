"""``desim-uav plot`` and ``desim-uav video``: what comes of which folder, and what is refused."""

import json
import shutil
import sys

import pytest
from PIL import Image

import desim_uav as du
from desim_uav import cli
from desim_uav.experiment.plot import KINDS
from tests.report.helpers import make_run, make_training
from tests.selection import by_default

OF_FOLDERS = [kind for kind in KINDS if kind not in ("sweep", "delay", "age")]
"""The kinds of figures of runs and trainings."""


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    where = tmp_path_factory.mktemp("plotted")
    small = ("users.count=8", "episode.steps=3")
    for seed in (0, 1):
        make_run(where / f"run{seed}", "case8", "hover", (*small, f"seed={seed}"))
        make_training(
            where / f"trained{seed}",
            "case1",
            ("users.count=4", "episode.steps=3", "learning.episodes=5", f"seed={seed}"),
        )
    links = (*small, "drones.radio={kind: link_classes, power_dbm: 0}")
    make_run(where / "links", "case8", "hover", links, events=False)
    energy = (
        *small,
        "drones.battery={kind: rotary_wing}",
        "stations.charging={kind: swap, minutes: 2}",
    )
    make_run(where / "energy", "case8", "hover", energy, events=False)
    make_run(where / "bare", "case8", "hover", small, events=False)
    gone = shutil.copytree(where / "bare", where / "gone")
    manifest = json.loads((gone / "manifest.json").read_text()) | {"policy": "gone.npz"}
    (gone / "manifest.json").write_text(json.dumps(manifest))
    (gone / "SHA256SUMS").unlink()
    return where


@pytest.fixture
def ask(folders, monkeypatch, capsys, tmp_path):
    """Run a command in an empty folder: its code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def asked(*words):
        words = [str(folders / w[1:]) if str(w).startswith("@") else str(w) for w in words]
        monkeypatch.setattr(sys, "argv", ["desim-uav", *words])
        monkeypatch.setenv("COLUMNS", "300")
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, *capsys.readouterr()

    return asked


@pytest.mark.parametrize("kind", by_default(["battery", "training", "radio"], OF_FOLDERS))
def test_every_kind_has_its_default_place(ask, folders, kind):
    others = {"training": "trained0", "policy": "trained0", "radio": "links", "energy": "energy"}
    source = others.get(kind, "run0")
    code, out, err = ask("plot", kind, f"@{source}")
    place = folders / source / f"{kind}.png"
    assert (code, out, err) == (0, f"{place}\n", "")
    with Image.open(place) as picture:
        assert min(picture.size) > 300


def test_energy_needs_no_folder(ask, folders):
    assert ask("plot", "energy") == (0, "energy.png\n", "")
    code, _, err = ask("plot", "battery")
    assert (code, "battery: give a folder to draw" in err) == (2, True)
    code, _, err = ask("plot", "energy", folders / "links" / "scenario.yaml")
    assert (code, "drones.battery: endurance: energy is drawn for" in err) == (2, True)


def test_energy_of_free_flight(ask, tmp_path):
    assert ask("plot", "energy", "festival") == (0, "energy.png\n", "")
    assert du.plot("energy", "festival", "again.png", drone=2).axes
    assert (tmp_path / "again.png").read_bytes() == (tmp_path / "energy.png").read_bytes()
    code, _, err = ask("plot", "energy", "festival", "--drone", 3)
    assert (code, "drone: 3: festival has the drones 0 to 2" in err) == (2, True)


@pytest.mark.thorough
def test_several_folders_go_to_the_working_one(ask, tmp_path):
    assert ask("plot", "compare", "@run0", "@run1")[:2] == (0, "compare.png\n")
    assert ask("plot", "training", "@trained0", "@trained1")[:2] == (0, "training.png\n")
    assert ask("plot", "policy", "case1.npz")[:2] == (0, "case1.png\n")
    found = sorted(path.name for path in tmp_path.iterdir())
    assert found == ["case1.png", "compare.png", "training.png"]


@pytest.mark.thorough
def test_a_radio_is_that_of_a_scenario_or_of_a_run(ask, folders, tmp_path):
    scenario = folders / "links" / "scenario.yaml"
    assert ask("plot", "radio", scenario) == (0, "radio.png\n", "")
    assert ask("plot", "radio", "@links", "-o", "run.png")[0] == 0
    words = ("--level", 2, "--at", "300,2e3", "-o", "other.png")
    assert ask("plot", "radio", scenario, *words)[0] == 0
    drawn = [(tmp_path / f"{name}.png").read_bytes() for name in ("radio", "run", "other")]
    assert drawn[0] == drawn[1] != drawn[2]


@pytest.mark.parametrize(
    ("name", "begins"),
    [pytest.param("a.svg", b"<?xml", marks=pytest.mark.thorough), ("new/b.PDF", b"%PDF")],
)
def test_the_ending_says_the_format(ask, tmp_path, name, begins):
    assert ask("plot", "services", "@run0", "-o", name)[0] == 0
    assert (tmp_path / name).read_bytes().startswith(begins)


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (
            ("plot", "visit", "@run0"),
            2,
            "unknown figure 'visit' (did you mean 'visits'?); ",
        ),
        (("plot", "services", "@run0", "-o", "a.jpg"), 2, "must end in .png, .pdf or .svg"),
        (("plot", "services", "@run0", "-o", "a"), 2, "must end in .png, .pdf or .svg"),
        (("plot", "battery", "@run0", "@run1"), 2, "battery: give one folder, not 2"),
        (
            ("plot", "battery", "@run0", "--window", 3),
            2,
            "window is an option of training, not of b",
        ),
        (("plot", "battery", "@run0", "--episode", 3), 2, "episode: 3"),
        (("plot", "battery", "@run0", "--drone", 3), 2, "drone: 3"),
        (("plot", "training", "@trained0", "--window", 9), 2, "window: 9: there are 5 episodes"),
        (("plot", "compare", "@run0", "--against", "hovr"), 2, "did you mean 'hover'?"),
        (("plot", "compare", "@run0", "@trained0"), 4, "no such table"),
        (("plot", "compare", "@run0", "@bare"), 4, "hover on seed 0 is given twice"),
        (("plot", "training", "@run0"), 4, "not a training folder"),
        (("plot", "training", "@nowhere"), 4, "no such training folder"),
        (("plot", "policy", "@run0"), 4, "not a training folder: it has no policy.npz"),
        (("plot", "policy", "nowhere.npz"), 4, "not a readable policy file"),
        (("plot", "visits", "@trained0"), 4, "a run folder?"),
        (("plot", "snapshot", "@gone"), 4, "cannot be played again: gone.npz"),
        (("plot", "visits", "@gone"), 4, "run it again with --events"),
        (("plot", "battery", "@gone"), 4, "the run kept no events, and it cannot be played again"),
        (
            ("plot", "delay", "@run0"),
            4,
            "the run has no tasks: none of its services has the kind c",
        ),
        (("plot", "age", "@run0"), 4, "the run has no sensors: no users have the demand sensing"),
        (("plot", "radio", "case8"), 2, "case8: the radio of its drones is disc"),
        (("plot", "radio", "@run0"), 2, "write drones.radio: {kind: link_classes} in the scen"),
        (("plot", "radio", "@links", "--level", 3), 2, "level: 3: case8 has the levels 0 to 2"),
        (("plot", "radio", "@links", "--at", "1,2,3"), 2, "at: 1,2,3: write X,Y in metres"),
        (("plot", "radio", "@links", "--at", "1,x"), 2, "at: 1,x: write X,Y in metres"),
        (("plot", "radio", "@links", "--at", "1,2401"), 2, "at: 1,2401: the map of case8 goes"),
        (("plot", "radio", "@links", "--drone", 0), 2, "drone is an option of visits, policy, b"),
        (("plot", "radio", "case88"), 3, "case88: neither a file nor a shipped scenario"),
        (("plot", "radio", "."), 4, "world.json: not a readable JSON file"),
        (("video", "@run0"), 2, "name the file to write: --gif FILE.gif or --mp4 FILE.mp4"),
        (("video", "@run0", "--gif", "a.mp4"), 2, "--gif a.mp4: the file's name must end in .gif"),
        (("video", "@run0", "--mp4", "a"), 2, "--mp4 a: the file's name must end in .mp4"),
        (("video", "@run0", "--gif", "a.gif", "--fps", 0), 2, "--fps"),
        (("video", "@run0", "--gif", "a.gif", "--fps", 55), 2, "a GIF can have at most 50"),
        (("video", "@run0", "--gif", "a.gif", "--speed", "nan"), 2, "--speed"),
        (("video", "@run0", "--gif", "a.gif", "--episode", 7), 2, "episode: 7"),
        (("video", "@gone", "--gif", "a.gif"), 4, "cannot be played again"),
        (("video", "@trained0", "--gif", "a.gif"), 4, "a run folder?"),
    ],
)
def test_what_is_refused(ask, tmp_path, words, code, message):
    found, out, err = ask(*words)
    assert (found, out) == (code, ""), err
    assert message in " ".join(err.split())
    assert "Traceback" not in err
    assert not any(tmp_path.iterdir())


def test_mixed_scenarios(ask, folders, tmp_path):
    other = make_run(tmp_path / "other", "case8", "hover", ("users.count=9", "episode.steps=3"))
    code, _, err = ask("plot", "compare", "@run0", other)
    assert code == 4 and "its scenario is not that of" in err and "users.count is 9, not 8" in err


def test_a_picture_that_fails_leaves_what_was_there(ask, tmp_path):
    (tmp_path / "old.png").write_bytes(b"old")
    assert ask("plot", "snapshot", "@gone", "-o", "old.png")[0] == 4
    assert (tmp_path / "old.png").read_bytes() == b"old"


@pytest.mark.parametrize("kind", by_default(["battery"], ["visits", "battery", "snapshot"]))
def test_a_run_without_events_gives_the_same_figure(ask, tmp_path, kind):
    for source in ("run0", "bare"):
        assert ask("plot", kind, f"@{source}", "-o", f"{source}.png")[::2] == (0, "")
    assert (tmp_path / "bare.png").read_bytes() == (tmp_path / "run0.png").read_bytes()


def test_a_run_without_events_gives_the_same_film(ask, tmp_path):
    for source in ("run0", "bare"):
        words = ("video", f"@{source}", "--gif", f"{source}.gif", "--fps", "2", "--width", "320")
        assert ask(*words)[::2] == (0, "")
    assert (tmp_path / "bare.gif").read_bytes() == (tmp_path / "run0.gif").read_bytes()


def test_a_film(ask, tmp_path):
    code, out, err = ask("video", "@run0", "--gif", "a.gif", "--fps", "5", "--width", "320")
    assert (code, out, err) == (0, "a.gif\n", "")
    with Image.open(tmp_path / "a.gif") as gif:
        assert (gif.size, gif.n_frames) == ((320, 240), 9)  # three minutes, 24 s a frame
