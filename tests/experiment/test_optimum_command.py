"""``desim-uav optimum``: what it prints, and what it refuses."""

import json
import sys
from dataclasses import dataclass

import pytest

import desim_uav as du
from desim_uav import cli
from desim_uav.errors import ScenarioError
from desim_uav.experiment import optimum
from desim_uav.model.association import Strongest
from desim_uav.model.radio.radio import Disc
from desim_uav.model.services import Transfer
from desim_uav.optimum.cover import Spots
from desim_uav.optimum.process import DroneProcess
from desim_uav.scenario.load import from_mapping
from desim_uav.shipped import bench_folder
from desim_uav.world import build_world

LONE = ("case4", "-S", "drones.count=1")


@pytest.fixture
def told(monkeypatch, capsys):
    """Run a command line: (exit code, what it printed, what it complained of)."""

    def tell(*arguments):
        monkeypatch.setattr(sys, "argv", ["desim-uav", "optimum", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return ended.value.code, *capsys.readouterr()

    return tell


@pytest.fixture
def found(told):
    """The JSON object of a command that went well."""

    def find(*arguments):
        code, out, err = told(*arguments, "--json")
        assert (code, err) == (0, "")
        return json.loads(out, parse_constant=lambda _: pytest.fail("no JSON"))

    return find


KEYS = [
    *("scenario", "seed", "world_seed", "drones", "users", "cover", "instant_at_most_percent"),
    *("fair_cover", "one_drone", "discounted", "runs", "runs_refused"),
]


def test_case_1(found):
    best = found("case1", "--seed", 0)
    assert list(best) == KEYS
    assert (best["scenario"], best["drones"], best["users"]) == ("case1", 1, 14)
    assert best["cover"] == {
        "cells": [[6, 5]],
        "users": 14,
        "qoe3_percent": 100.0,
        "at_most_percent": 100.0,
        "exact": True,
    }
    assert best["fair_cover"]["reward_per_step"] == 1.0
    assert best["one_drone"]["best_reward"]["reward_per_step"] == 1.0
    assert best["discounted"]["gamma"] == 0.95
    steps = best["discounted"]["policy"]["steps"]
    paid = sum(0.95**k * step["reward"] for k, step in enumerate(steps))
    paid += 0.95 ** len(steps) / (1 - 0.95) * steps[-1]["reward"]
    assert best["discounted"]["return"] == pytest.approx(paid, abs=1e-9)


@pytest.mark.thorough
def test_several_drones(found):
    best = found("case3")
    assert best["one_drone"] is None and best["discounted"] is None
    assert best["cover"]["exact"] and best["fair_cover"]["exact"]
    assert len(best["cover"]["cells"]) == 2
    assert best["fair_cover"]["reward_sum"] == 2 * best["fair_cover"]["reward_per_step"]


@pytest.mark.thorough
def test_a_battery(found):
    best = found(*LONE)["one_drone"]
    assert best["over"] == "long run"
    earning, covering = best["best_reward"], best["best_qoe3"]
    assert earning["low"] <= earning["reward_per_step"] <= earning["high"]
    assert earning["high"] - earning["low"] < 1e-9
    assert covering["reward_per_step"] <= earning["reward_per_step"]
    assert earning["qoe3_percent"] <= covering["qoe3_percent"]
    policy = earning["policy"]
    cycle = policy["steps"][policy["again_from"] :]
    mean = sum(step["reward"] for step in cycle) / len(cycle)
    assert mean == pytest.approx(earning["reward_per_step"], abs=1e-12)
    assert list(cycle[0]) == [
        *("action", "cell", "level", "mode", "battery_s", "attached_users", "reward")
    ]


@pytest.mark.thorough
def test_an_episode(found):
    best = found(*LONE, "-S", "episode.carry_over=false")["one_drone"]
    assert best["over"] == "episode"
    steps = best["best_reward"]["policy"]["steps"]
    assert len(steps) == 30
    total = sum(step["reward"] for step in steps)
    assert best["best_reward"]["reward_per_step"] == pytest.approx(total / 30, abs=1e-12)


SHORT = ("case8", "-S", "episode.steps=3", "-S", "users.count=8", "--episodes", 2, "--quiet")


@pytest.mark.thorough
def test_runs(found):
    """Of several drones whose users walk, only runs are bounded."""
    best = found(*SHORT, "--seeds", 2, "--seed", 5)
    assert best["cover"] is best["one_drone"] is best["instant_at_most_percent"] is None
    runs = best["runs"]
    assert [row["seed"] for row in runs["seeds"]] == [5, 6] and runs["episodes"] == 2
    for row in runs["seeds"]:
        assert row["schedule_qoe3_percent"] <= row["qoe3_at_most_percent"] <= 100.0
        assert row["world_seed"] == row["seed"]
    mean = runs["means"]["qoe3_at_most_percent"]
    assert mean["n"] == 2 and mean["low"] <= mean["mean"] <= mean["high"]
    again = du.find_bounds("case8", {"episode.steps": 3, "users.count": 8}, seeds=[5], episodes=2)
    assert again["seeds"] == runs["seeds"][:1]


@pytest.mark.thorough
def test_runs_in_words(told):
    code, out, err = told(*SHORT)
    assert (code, err) == (0, "")
    assert "QoE3, in a run of 2 episode(s)" in out and "no policy exceeds a QoE3 of" in out


def test_runs_that_cannot_be_bounded(found):
    """Drones that end the episode by a crash: the best cells are known nevertheless."""
    best = found("case4", "-S", "drones.battery.on_crash=end_episode", "--quiet")
    assert best["runs"] is None and best["runs_refused"].startswith("drones.battery.on_crash: ")
    assert best["cover"]["exact"]


def test_seeds(found):
    by_seed, by_world = found("case2", "--seed", 3), found("case2", "--world-seed", 3)
    assert (by_seed["seed"], by_world["seed"]) == (3, 0)
    assert by_seed["world_seed"] == by_world["world_seed"] == 3
    assert by_seed["cover"] == by_world["cover"]


@pytest.mark.parametrize(
    "scenario",
    [
        *(("case1",), ("case2",), LONE, ("tiny",)),
        pytest.param(("case3",), marks=pytest.mark.thorough),
    ],
)
def test_a_table(told, scenario):
    code, out, err = told(*scenario)
    assert (code, err) == (0, "")
    assert scenario[0] in out and "hovering" in out and "at any instant" in out
    assert ("forever" in out) == (scenario[0] not in ("case2", "case3"))


def test_many_drones(told, found):
    """The best cover is proven; a fair one is not searched for."""
    many = ("-S", "drones.count=12", "-S", "drones.footprint_radius_m=250")
    crowd = ("-S", "users.count=100", "-S", "users.clusters.count=30")
    best = found("case3", *many, *crowd)
    assert best["cover"]["exact"] and best["fair_cover"] is None
    code, out, _ = told("case3", *many, *crowd)
    assert code == 0 and "reward, hovering" not in out


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (("case8", "-S", "drones.battery.on_crash=end_episode"), "drones.battery.on_crash"),
        ((*LONE, "-S", "reward.kind=multi_service", "-S", "demand.kind=static"), "demand.kind"),
        ((*LONE, "-S", "position_noise.sigma_cells=1"), "position_noise"),
        (
            (*LONE, "-S", "episode.carry_over=false", "-S", "drones.battery.on_crash=end_episode"),
            "drones.battery.on_crash",
        ),
        ((*LONE, "-S", "episode.carry_over=false", "-S", "episode.steps=900000"), "episode.steps"),
    ],
)
def test_what_is_not_known(told, arguments, key):
    code, out, err = told(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith(f"desim-uav: {key}: ") and err.count("\n") == 1


def test_a_scenario_that_is_wrong(told):
    code, out, err = told("case1", "-S", "drones.count=0")
    assert (code, out) == (3, "") and "drones.count" in err


# ---- links that are not the paper's

SOLVED = {
    "drones": {"count": 1, "battery": None},
    "stations": {"count": 0},
    "users": {"count": 5, "mobility": {"kind": "static"}},
    "demand": {"kind": "continuous"},
    "reward": {"kind": "coverage"},
}
CLASSES = {"drones.radio": {"kind": "link_classes"}}
ONLY = "the optimum can be computed only"
NO_CLASSES = (
    f"drones.radio.kind: link_classes: {ONLY} with disc, where a user is covered within "
    "drones.footprint_radius_m"
)
HOLD = {"kind": "hold", "duration_min": [1], "bandwidth_kbps": [100]}
FILM = {"kind": "transfer", "volume_mbit": [1], "bandwidth_kbps": [100]}
TASK = {
    "kind": "compute",
    "input_mbit": [1],
    "cycles_per_bit": [1000],
    "bandwidth_kbps": [100],
}
READING = {
    "kind": "collect",
    "updates": {"kind": "poisson", "mean_s": 60},
    "size_mbit": [1],
    "bandwidth_kbps": [100],
}
MAST = {"at_m": [100, 100], "height_m": 30}


@dataclass(frozen=True)
class Wide(Disc):
    """A disc twice as wide."""

    def radii_m(self, height_m: float, disc_m: float) -> tuple[float, ...]:
        return (2.0 * disc_m,)


@dataclass(frozen=True)
class Best(Strongest):
    """An association of one's own that compares levels."""


@dataclass(frozen=True)
class Film(Transfer):
    """A service of one's own that asks for a volume."""


NOT_THE_PAPERS = {
    "classes": (CLASSES, [NO_CLASSES]),
    "a radio of one's own": (
        {"drones.radio": {"kind": f"{__name__}:Wide"}},
        [NO_CLASSES.replace("link_classes", f"{__name__}:Wide")],
    ),
    "strongest": (
        CLASSES | {"association": "strongest"},
        [
            NO_CLASSES,
            f"association.kind: strongest: {ONLY} with entered_first, which compares no levels",
        ],
    ),
    "a3": (
        CLASSES | {"association": {"kind": "a3"}},
        [NO_CLASSES, f"association.kind: a3: {ONLY} with entered_first, which compares no levels"],
    ),
    "access points": (
        {"access_points": [MAST, MAST]},
        [f"access_points: 2 given: {ONLY} without access points ([])"],
    ),
    "transfers": (
        {"services": {"call": HOLD, "film": FILM}},
        [
            f"services.film.kind: transfer: {ONLY} with services that ask for a time (hold), not "
            "for a volume"
        ],
    ),
    "tasks": (
        {
            "services": {"call": HOLD, "task": TASK},
            "drones.processor": {"cores": 1, "ghz": 1},
            "demand": {"kind": "static", "mix": {"call": 1}},
        },
        [
            f"services.task.kind: compute: {ONLY} with services that ask for a time (hold), not "
            "for a volume"
        ],
    ),
    "sensors": (
        {"services": {"reading": READING}, "demand": {"kind": "sensing", "service": "reading"}},
        [
            f"services.reading.kind: collect: {ONLY} with services that ask for a time (hold), "
            "not for a volume"
        ],
    ),
    "giving way": (
        {"separation_m": 50, "on_conflict": "hover_higher_index"},
        [
            f"on_conflict: hover_higher_index: {ONLY} with log, where no move of a drone is "
            "blocked by another"
        ],
    ),
    "all": (
        CLASSES
        | {
            "association": {"kind": f"{__name__}:Best"},
            "access_points": [MAST],
            "services": {"film": FILM, "own": FILM | {"kind": f"{__name__}:Film"}, "call": HOLD},
            "demand": {"kind": "static", "mix": {"call": 1}},
            "users.mobility": {"kind": "random_walk"},
        },
        [
            NO_CLASSES,
            f"association.kind: {__name__}:Best: {ONLY} with entered_first, which compares no "
            "levels",
            f"access_points: 1 given: {ONLY} without access points ([])",
            f"services.film.kind: transfer: {ONLY} with services that ask for a time (hold), not "
            "for a volume",
            f"services.own.kind: {__name__}:Film: {ONLY} with services that ask for a time "
            "(hold), not for a volume",
        ],
    ),
}
each_of_them = pytest.mark.parametrize(
    ("keys", "problems"), NOT_THE_PAPERS.values(), ids=list(NOT_THE_PAPERS)
)


def settings(keys):
    return [f"{key}={json.dumps(value)}" for key, value in keys.items()]


@pytest.fixture
def nothing_is_computed(monkeypatch):
    """Not even the world may be drawn."""
    monkeypatch.setattr(optimum, "build_world", lambda *_: pytest.fail("a world was drawn"))


@each_of_them
@pytest.mark.usefixtures("nothing_is_computed")
def test_the_command_refuses_other_models(told, tmp_path, keys, problems):
    file = tmp_path / "mine.yaml"
    file.write_text(json.dumps(SOLVED))
    given = [word for setting in settings(keys) for word in ("-S", setting)]
    code, out, err = told(file, *given, "--json")
    assert (code, out) == (3, "")
    assert told_of(err.splitlines(), "desim-uav: override ", problems)


@each_of_them
@pytest.mark.usefixtures("nothing_is_computed")
def test_the_function_refuses_other_models(keys, problems):
    with pytest.raises(ScenarioError) as caught:
        du.find_optimum(SOLVED, keys)
    assert told_of(str(caught.value).splitlines(), "override ", problems)


def told_of(lines, beginning, problems):
    """Return whether each line tells one of the problems, and blames an override for it."""
    return len(lines) == len(problems) and all(
        line.startswith(beginning) and line.endswith(f": {problem}")
        for line, problem in zip(lines, problems, strict=True)
    )


@each_of_them
@pytest.mark.parametrize("solver", [Spots, DroneProcess])
def test_what_it_calls_refuses_other_models(keys, problems, solver):
    """Nobody else who uses it gets a wrong figure, as the best covers of ``reproduce``."""
    scenario = from_mapping(SOLVED, overrides=settings(keys))
    with pytest.raises(ScenarioError) as caught:
        solver(build_world(scenario, 0))
    assert caught.value.problems == tuple(problems)


def test_the_paper_s_model_is_not_refused():
    found = du.find_optimum(SOLVED, {"services": {"call": HOLD}, "association": "entered_first"})
    assert found["one_drone"]["best_qoe3"]["qoe3_percent"] <= found["instant_at_most_percent"]


def test_a_schedule_with_too_many_states_is_refused_before_the_bound_is_computed(told):
    """Episodes of four hours that are carried over are one run, for which prices take minutes."""
    task = bench_folder() / "endurance-small.yaml"
    code, out, err = told(task, "--seed", 1, "--episodes", 4)
    assert (code, out) == (2, "") and "rounds" not in err
    assert "a schedule of 960 steps by " in err and "carry_over: false" in err
