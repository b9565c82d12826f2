"""What a submission keeps of commands, of every kind of flight; and its round trip in new tasks."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from desim_uav.array_file import Stored, pack
from desim_uav.experiment.bench import board as boards
from desim_uav.experiment.bench import commands as kept_commands
from desim_uav.experiment.bench import kept, measure, run, verify
from desim_uav.experiment.bench.commands import ARRAYS, FREELY, Commands
from desim_uav.experiment.bench.submission import FORMAT, read
from desim_uav.experiment.bench.tasks import TRACKS, find_task
from desim_uav.run_folder import RunPlace
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world
from tests.command_line import runner

NEW = ("edge", "harvest", "handover", "dispatch")


def world_of(*motions):
    """A world with a drone of each of these motions; the first one has a battery."""
    drones = [
        {"name": f"type{k}", "count": 1, "motion": motion, **({"battery": None} if k else {})}
        for k, motion in enumerate(motions)
    ]
    made = {
        "map": {"dimensions": 2},
        "drones": drones,
        "stations": {"count": 1},
        "users": {"count": 2},
        "decisions": {"kind": "event", "patience_s": 30},
    }
    return build_world(from_mapping(made), 0)


@pytest.fixture(scope="module")
def mixed():
    return world_of({"space": "free", "reach": "map"}, {"timing": "minimum_time"})


EPISODES = [[[[0.25, -1 / 3, 1.0], 2], [4, 0]], [], [[[1e-17, -0.0, -1.0], 1]]]
"""Three episodes of two drones, of which the first flies freely; the second one has no epoch."""


def test_commands_come_back_as_they_were(mixed):
    commands = kept_commands.noted(EPISODES, mixed)
    assert commands.epochs.tolist() == [2, 0, 1] and commands.flights == 2
    assert commands.actions.tolist() == [[FREELY, 2], [4, 0], [FREELY, 1]]
    both = kept_commands.joined([commands, commands])
    assert {name: array.dtype for name, array in both.items()} == ARRAYS
    for again in kept_commands.parted(both):
        assert [*kept_commands.given(again, mixed)] == EPISODES
        assert again.first_unlike(commands) is None
        of_both = map(kept_commands.decisions_sha256, ([again], [commands]))
        assert len({*of_both}) == 1


def test_the_first_difference_is_found(mixed):
    commands = kept_commands.noted(EPISODES, mixed)
    for change, where in (
        (lambda all_: all_[0][1].__setitem__(1, 3), (0, 1, 1)),
        (lambda all_: all_[2][0][0].__setitem__(0, 2e-17), (2, 0, 0)),
        (lambda all_: all_[1].append([1, 1]), (1, 0, 0)),
    ):
        other = json.loads(json.dumps(EPISODES))
        change(other)
        assert commands.first_unlike(kept_commands.noted(other, mixed)) == where


def test_equal_decisions_have_one_digest_and_others_another(mixed):
    def digest(epochs, actions):
        rows = np.array(actions, np.int16).reshape(-1, 1)
        return kept_commands.decisions_sha256([Commands(np.array(epochs), rows, np.empty((0, 0)))])

    assert digest([1, 1], [0, 1]) == digest([1, 1], [0, 1])
    assert len({digest(*each) for each in (([2], [0, 1]), ([1, 1], [0, 1]), ([2], [1, 0]))}) == 3


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"epochs": [[2, 0, 2]]}, "epochs: they are not 3 together"),
        ({"epochs": [[3, -1, 1]]}, "epochs: one is negative"),
        ({"actions": [[FREELY, 2], [4, -2], [FREELY, 1]]}, "actions: one is less than -1"),
        ({"actions": [[FREELY, 2], [4, 0], [0, 1]]}, "numbers: 2 rows, but"),
        ({"numbers": [[0.0, 0.0, 0.0], [0.0, np.nan, 0.0]]}, "numbers: one is not finite"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(mixed, change, said):
    arrays = kept_commands.joined([kept_commands.noted(EPISODES, mixed)])
    with pytest.raises(ValueError, match=said):
        kept_commands.parted(arrays | {name: np.array(value) for name, value in change.items()})


def test_commands_of_other_drones_are_refused(mixed):
    commands = kept_commands.noted(EPISODES, mixed)
    by_cells = world_of({"timing": "minimum_time"}, {"timing": "minimum_time"})
    for world, other, said in (
        (by_cells, commands, "numbers must be 0"),
        (mixed, replace(commands, actions=commands.actions + 100), "the commands have 99 for"),
    ):
        with pytest.raises(ValueError, match=said):
            [*kept_commands.given(other, world)]


def test_a_drone_without_a_choice_has_its_only_action():
    assert measure._with_a_choice([0.5, 0.5], [False, True, False]) == 1
    assert measure._with_a_choice(7, [False, False, True]) == 2
    assert measure._with_a_choice([0.5, 0.5], [True, True, False]) == [0.5, 0.5]


# ---- round trips


@pytest.fixture
def short(monkeypatch):
    """Let the protocol have one episode after one of warm-up, on one seed."""
    for module in (measure, run, verify):
        for name in {"EPISODES", "WARMUP"} & {*vars(module)}:
            monkeypatch.setattr(module, name, 1)
    monkeypatch.setattr(verify, "FIXED", verify.FIXED | {"episodes": 1, "warmup": 1})

    def zero(task, track, seed):
        return kept.computed(task, track, seed)[kept.REFERENCES]

    def here(submission, jobs, on_run):  # another process would fly the whole protocol
        policies = [each.policy for each in submission.about.trainings]
        place = RunPlace(submission.folder.parent / "again" / submission.folder.name, "again")
        seeds = submission.about.seeds
        made = run.submit(submission.task, submission.track, policies, place, seeds=seeds)
        return read(made.folder)

    monkeypatch.setattr(verify, "decided_again", here)
    monkeypatch.setattr(boards, "reference_of", zero)
    monkeypatch.setattr(boards, "bound_of", lambda *_: {})


@pytest.fixture
def cli(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    return runner(capsys, monkeypatch)


@pytest.mark.thorough
@pytest.mark.parametrize("family", NEW)
def test_a_round_trip_in_each_new_task(cli, tmp_path, short, family):
    """The baseline has the score 0 less its crashes; random commands and a planner replay too."""
    for policy in ("baseline", "random", "greedy"):
        done = cli(
            *("bench", "run", f"uav-v1/{family}/small", "--policy", policy, "--track", "any"),
            *("--seeds", 1, "--out", policy),
        )
        assert done.code == 0, done.err
        done = cli("bench", "verify", policy, "--decide")
        assert done.code == 0, done.err
    (table,) = cli("bench", "board", "baseline", "random", "greedy", "--json").json
    rows = {row["policy"]: row for row in table["rows"]}
    crashes = rows["baseline"]["crashes_per_drone_episode"]
    assert rows["baseline"]["score"]["value"] == -crashes
    assert rows["greedy"]["score"]["value"] > rows["random"]["score"]["value"] or family == "edge"


@pytest.mark.thorough
def test_a_command_of_free_flight_cannot_be_changed(cli, tmp_path, short):
    """A place that is a millimetre away is another run; epochs that are left over are named."""
    task = "uav-v1/dispatch/small"
    cli("bench", "run", task, "--policy", "random", "--track", "any", "--seeds", 1, "--out", "a")
    file = tmp_path / "a" / "commands.npz"
    assert file.stat().st_size < 20_000
    stored = Stored(file, "file of commands", list(ARRAYS), FORMAT)
    arrays = stored.arrays()
    (tmp_path / "a" / "SHA256SUMS").unlink()
    numbers = arrays["numbers"].copy()
    numbers[3, 0] -= np.sign(numbers[3, 0]) * 1e-6
    more = {name: arrays[name].copy() for name in ("epochs", "actions")}
    more["epochs"][0, -1] += 1
    more["actions"] = np.concatenate([more["actions"], [[1, 1]]]).astype("<i2")
    fewer = {"epochs": arrays["epochs"].copy(), "actions": arrays["actions"][:-1]}
    fewer["epochs"][0, -1] -= 1
    fewer["numbers"] = arrays["numbers"][: (fewer["actions"] == FREELY).sum()]
    for change, said in (
        ({"numbers": numbers}, "digest: the folder has"),
        (more, "more decision epochs than an episode"),
        (fewer, "fewer decision epochs than an episode"),
    ):
        file.write_bytes(pack(stored.about, **arrays | change))
        assert any(said in line for line in verify.differences(read(tmp_path / "a")))


# ---- references and bounds


def test_a_bound_of_qoe3_counts_crashes(monkeypatch):
    """QoE3 less 10 points for each crash per drone and episode must not exceed it."""
    task, track = find_task("uav-v1/endurance/small"), TRACKS["one"]
    monkeypatch.setattr(verify, "bound_of", lambda *_: {"qoe3_percent": 60.0})
    for qoe3, crashes, lines in ((59.0, 0.0, 0), (61.0, 0.0, 1), (64.0, 0.5, 0), (66.0, 0.5, 1)):
        row = {"seed": 100, "qoe3_percent": qoe3, "crashes_per_drone_episode": crashes}
        assert len(verify._of_bound(task, track, row)) == lines


def test_a_bound_below_which_nobody_can_be_is_checked(monkeypatch):
    task, track = find_task("uav-v1/harvest/small"), TRACKS["one"]
    monkeypatch.setattr(verify, "bound_of", lambda *_: {"age_s": 60.0})
    for age_s, lines in ((59.0, 1), (60.0, 0), (300.0, 0)):
        assert len(verify._of_bound(task, track, {"seed": 100, "age_s": age_s})) == lines


@pytest.mark.parametrize("writes", range(4))
def test_an_interruption_leaves_a_set_that_can_be_read(tmp_path, monkeypatch, writes):
    """Of the files of references and bounds and the registry some are old and some are new."""
    (tmp_path / "registry.json").write_text('{"files": {}}', encoding="utf-8")
    names = (kept.REFERENCES, kept.BOUNDS)
    key = ("uav-v1/edge/small", "one", 100, "deadlines_met_percent")
    old, new = ({name: {key: value} for name in names} for value in (40.0, 50.0))
    kept.write(tmp_path, old)
    true, done = kept.write_at, []

    def interrupted(file, content):
        if len(done) == writes:
            raise KeyboardInterrupt
        done.append(file)
        true(file, content)

    monkeypatch.setattr(kept, "write_at", interrupted)
    with pytest.raises(KeyboardInterrupt):
        kept.write(tmp_path, new)
    kept._read.cache_clear()
    values = [kept.kept(name, tmp_path)[key] for name in names]
    assert values == [50.0 if writes > k + 1 else 40.0 for k in range(2)]
    monkeypatch.setattr(kept, "write_at", true)
    kept.write(tmp_path, new)
    assert [kept.kept(name, tmp_path) for name in names] == [new[name] for name in names]
    assert set(json.loads((tmp_path / "registry.json").read_text(encoding="utf-8"))) == {"files"}
