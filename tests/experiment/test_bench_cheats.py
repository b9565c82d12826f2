"""Each way to cheat in the benchmark is refused, or scored as it deserves."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import stat
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from desim_uav.engine.choose import make_engine
from desim_uav.errors import PolicyError, ScenarioError
from desim_uav.experiment.bench import kept, measure, verify
from desim_uav.experiment.bench.board import board
from desim_uav.experiment.bench.present import Present, hidden
from desim_uav.experiment.bench.run import information
from desim_uav.experiment.bench.score import PRICE, measures_of, score
from desim_uav.experiment.bench.sealed import revealed, seal_of, tracks_of
from desim_uav.experiment.bench.submission import read
from desim_uav.experiment.bench.tasks import SEEDS, TRACKS, find_task
from desim_uav.experiment.bench.verify import differences
from desim_uav.experiment.run import run_settings
from desim_uav.model.geometry.coverage import all_walked
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.policies import load_policy
from desim_uav.policies.base import as_seen
from desim_uav.policies.planning.ground import grounds_of
from desim_uav.policies.planning.sight import look
from desim_uav.sample_path import draw
from desim_uav.shipped import bench_folder
from desim_uav.world import build_world
from tests.command_line import runner

SMALL = "uav-v1/coverage/small"
KEPT = Path(__file__).parents[2] / "analysis" / "leaderboard"

NEVER_CHARGES = '''
import numpy as np

from desim_uav.model.rules import MOVES


class NeverCharges:
    """Flies to the cell around which most users have their homes, and stays until it falls."""

    ceiling = True

    def begin(self, world, streams, carried=False):
        self.world, grid = world, world.grid
        cells = [(x, y) for x in range(grid.cells[0]) for y in range(grid.cells[1])]
        left, self.to = np.ones(len(world.homes), bool), []
        for links in (world.links[number] for number in world.type_numbers):
            radius = links.rings_m[0, world.groups, 0]
            near = [
                left & (np.hypot(*(world.homes[:, :2] - grid.centre(*cell)).T) <= radius)
                for cell in cells
            ]
            best = int(np.argmax([each.sum() for each in near]))
            self.to.append(cells[best])
            left &= ~near[best]

    def act(self, observation, mask):
        (x, y), (to_x, to_y) = observation.cell, self.to[observation.drone]
        way = np.array([to_x - x, to_y - y])
        for k, action in enumerate(self.world.actions):
            dx, dy, _ = MOVES.get(action, (0, 0, 0))
            if mask[k] and way @ np.array([dx, dy]) > 0:
                return k
        return [action.name for action in self.world.actions].index("HOVER")
'''

PEEPING = """
from desim_uav.policies.clairvoyant import Clairvoyant


class Peeping(Clairvoyant):
    clairvoyant = False
    information = "local"

    def __init__(self):
        super().__init__("tries=0")


class Honest(Peeping):
    clairvoyant = True
"""

FORGING = """
from desim_uav.experiment.bench import again, verify
from desim_uav.experiment.bench.submission import ROWS, _read_rows
from desim_uav.policies.hover import Hover


def replay(task, track, seed, commands, ceiling):
    (row,) = _read_rows(FOLDER / ROWS, task)
    return {name: row[name] for name in row if name not in ("training", "seed", "decision_ms")}


verify.replay = replay


class Forging(Hover):
    pass
"""

READING = """
from dataclasses import dataclass

from desim_uav.model.observations import Feature, RowObservation
from desim_uav.policies.baseline import Baseline

SEEN = []


@dataclass(frozen=True)
class Requests(RowObservation):
    information = "local"

    def features(self, facts):
        return tuple(Feature(f"request_{k}", -1e19, 1e19, False) for k in range(facts.users))

    def write(self, world, state, drone):
        users = len(state.users)
        for k in range(users):
            drone.features[k] = 1.0 * state.slot_times[users + k]


class Reading(Baseline):
    information, observation = "local", Requests()

    def act(self, observation, mask):
        SEEN.append(observation.features)
        return super().act(observation, mask)
"""

LOCAL = """
from desim_uav.policies.greedy import Greedy
from desim_uav.rules.observations import Local


class Planning(Greedy):
    information = "local"


class Own(Local):
    pass
"""


@pytest.fixture
def cli(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    return runner(capsys, monkeypatch)


@pytest.fixture
def short(monkeypatch):
    """Let runs have a single episode, without warm-up."""
    monkeypatch.setattr(measure, "EPISODES", 1)
    monkeypatch.setattr(measure, "WARMUP", 0)


# ---- crashes


@pytest.mark.thorough
def test_who_never_charges_is_below_the_baseline(tmp_path):
    """It covers more users than the baseline does, at six crashes per drone and episode."""
    (tmp_path / "never.py").write_text(NEVER_CHARGES, encoding="utf-8")
    task, track = find_task("uav-v1/endurance/small"), TRACKS["any"]
    for seed in track.seeds[:2]:
        row = measure.measure(task, track, f"{tmp_path / 'never.py'}:NeverCharges", seed).row
        zero, bound = (of(task, track, seed) for of in (kept.reference_of, kept.bound_of))
        assert row["qoe3_percent"] > zero["qoe3_percent"]
        assert row["crashes_per_drone_episode"] > 5
        paid = score(measures_of(task), row, zero, bound)
        unpaid = score(measures_of(task), row | {"crashes_per_drone_episode": 0}, zero, bound)
        assert paid < -4 and unpaid < PRICE, "a crash costs more than all that flying on can gain"


# ---- the zero


@pytest.mark.thorough
def test_who_calls_itself_baseline_moves_nothing(cli, tmp_path):
    for policy in ("hover", "random"):
        cli("bench", "run", SMALL, "--policy", policy, "--seeds", 1, "--out", policy)
    (before,) = board([read(tmp_path / "random")])
    manifest = tmp_path / "hover" / "manifest.json"
    about = json.loads(manifest.read_text(encoding="utf-8"))
    about["trainings"][0]["policy"] = about["name"] = "baseline"
    manifest.write_text(json.dumps(about), encoding="utf-8")
    (tmp_path / "hover" / "SHA256SUMS").unlink()
    (after,) = board([read(tmp_path / name) for name in ("hover", "random")])
    rows = {row["policy"]: row for row in after["rows"]}
    assert rows["random"]["scores"] == before["rows"][0]["scores"]
    assert rows["baseline"]["score"].value < 0


def test_edited_references_are_refused(tmp_path):
    shutil.copytree(bench_folder(), tmp_path / "set")
    file = tmp_path / "set" / kept.REFERENCES
    kept.kept(kept.REFERENCES, tmp_path / "set")
    file.write_text(file.read_text(encoding="utf-8").replace(",5", ",4"), encoding="utf-8")
    kept._read.cache_clear()
    with pytest.raises(ScenarioError, match="frozen and has been changed"):
        kept.kept(kept.REFERENCES, tmp_path / "set")


def test_references_are_what_the_baseline_reaches():
    task, track = find_task(SMALL), TRACKS["any"]
    seed = track.seeds[1]
    row = measure.measure(task, track, kept.REFERENCE, seed).row
    assert kept.reference_of(task, track, seed) == {
        one.name: row[one.name] for one in measures_of(task)
    }


# ---- the future


def views(task, seed=3_000_000, steps=7):
    """An engine in the middle of an episode, and what a policy is shown of it."""
    scenario = find_task(task).scenario(TRACKS["any"]).model_copy(update={"seed": seed})
    world, policy = build_world(scenario, seed), load_policy("baseline")
    engine = make_engine("batch", world, run_settings(world, policy, False))
    snapshot = engine.reset(draw(world, seed, 0))
    for _ in range(steps):
        snapshot = engine.step([0] * scenario.drone_count)
    return world, engine, Present(seed), snapshot


def test_the_engine_that_planners_see_has_another_future():
    _, engine, present, _ = views("uav-v1/multi-service/small")
    seen, now_us = present.engine(engine), int(engine.state.now_us)
    true, shown = engine.drawn.walks, seen.drawn.walks
    assert (all_walked(*shown, now_us) == all_walked(*true, now_us)).all()
    assert (all_walked(*shown, now_us // 2) == all_walked(*true, now_us // 2)).all()
    later = all_walked(*shown, 2 * now_us) != all_walked(*true, 2 * now_us)
    assert later.any(axis=1).mean() > 0.9
    asked = {tuple(row) for row in engine.drawn.requests.rows.tolist()}
    assert not asked & {tuple(row) for row in seen.drawn.requests.rows.tolist()}
    assert seen.save().path is seen.drawn
    later_us = [event[1:] for event in seen.save().rows.due if event[1] > now_us]
    assert later_us != [event[1:] for event in engine.save().rows.due if event[1] > now_us]
    assert seen.user_states() == engine.user_states()
    for mine, theirs in zip(seen.positions_m(), engine.positions_m(), strict=True):
        assert (mine == theirs).all()


def test_planners_see_the_present_as_it_is():
    world, engine, present, snapshot = views("uav-v1/multi-service/small")
    grounds = grounds_of(world)
    true = look(engine, grounds, snapshot.observations)
    shown = look(present.engine(engine), grounds, snapshot.observations)
    for mine, theirs in zip(shown, true, strict=True):
        assert np.array_equal(mine, theirs) or mine == theirs


def test_no_seed_leads_to_the_sample_path():
    world, engine, present, _ = views("uav-v1/multi-service/small")
    shown = present.world(world)
    streams = present.streams(Streams(3_000_000, Purpose.LEARNER, 2))
    secrets = {world.seed, world.scenario.seed, world.scenario.effective_world_seed}
    public = {shown.seed, shown.scenario.seed, shown.scenario.world_seed, streams.seed}
    assert not secrets & public and public == {hidden(3_000_000)}
    assert (shown.homes == world.homes).all() and streams.episode == 2
    assert present.engine(engine).world is shown
    again = draw(shown, shown.seed, 0).walks
    assert (all_walked(*again, 10**8) != all_walked(*engine.drawn.walks, 10**8)).any()


@pytest.mark.thorough
def test_who_claims_to_see_no_future_sees_none(tmp_path, short):
    """A subclass of the clairvoyant that declares nothing plans for a future that never comes."""
    (tmp_path / "peeping.py").write_text(PEEPING, encoding="utf-8")
    task, track = find_task("uav-v1/multi-service/small"), TRACKS["any"]
    reached = {}
    for name in ("Peeping", "Honest", "greedy"):
        policy = name if name == "greedy" else f"{tmp_path / 'peeping.py'}:{name}"
        rows = [measure.measure(task, track, policy, seed).row for seed in track.seeds[:3]]
        reached[name] = np.array([row["qoe3_percent"] for row in rows])
    assert (reached["Honest"] - reached["Peeping"]).mean() > 1
    assert reached["Peeping"].mean() < reached["greedy"].mean()


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["multi-service", "urban", "endurance", "handover", "edge"])
def test_what_drones_observe_of_the_present_is_as_it_is(name):
    _, engine, present, snapshot = views(f"uav-v1/{name}/small")
    assert present.observations(engine) == snapshot.observations


@pytest.mark.thorough
def test_an_own_observation_does_not_read_what_is_drawn_already(tmp_path, monkeypatch):
    (tmp_path / "reading.py").write_text(READING, encoding="utf-8")
    seen = {}
    for own in (True, False):
        if not own:
            monkeypatch.setattr(measure, "is_shipped", lambda part: True)
        policy = load_policy(f"{tmp_path / 'reading.py'}:Reading")
        recorder = measure.Recorder(policy, 3_000_000)
        scenario = as_seen(find_task("uav-v1/multi-service/small").scenario(TRACKS["any"]), policy)
        world = build_world(scenario, 3_000_000)
        path = draw(world, 3_000_000, 0)
        engine = make_engine("batch", world, run_settings(world, policy, False))
        recorder.begin(world, Streams(3_000_000, Purpose.LEARNER))
        snapshot = engine.reset(path)
        for _ in range(20):
            recorder.watch(engine)
            commands = recorder.act_jointly(snapshot.observations, snapshot.masks)
            snapshot = engine.step(commands)
        seen[own] = np.array(sys.modules[type(policy).__module__].SEEN.pop())
    true = seen[False] < 1e15  # of a user without an open request
    assert true.any() and not (seen[True] == seen[False])[true].any()


# ---- claims, trainings and receipts


def test_what_a_policy_may_read_is_said_beside_what_it_declares(tmp_path):
    (tmp_path / "local.py").write_text(LOCAL, encoding="utf-8")
    scenario = find_task(SMALL).scenario(TRACKS["one"])
    said = information(f"{tmp_path / 'local.py'}:Planning", scenario)
    assert said == "local (as it declares; it is shown all of the present)"
    own = sys.modules[type(load_policy(f"{tmp_path / 'local.py'}:Planning")).__module__].Own()
    assert not measure.is_shipped(own) and measure.is_shipped(scenario.observation)
    assert information("greedy", scenario).endswith("batteries; no future")


def test_a_missing_policy_is_told_before_the_replays(tmp_path, monkeypatch):
    def replayed(*_):
        raise AssertionError("it has begun to replay")

    monkeypatch.setattr("desim_uav.experiment.bench.verify.results_of", replayed)
    found = read(KEPT / "edge-small-one-hover")
    training = found.about.trainings[0].model_copy(update={"policy": "none.npz"})
    about = found.about.model_copy(update={"trainings": [training]})
    with pytest.raises(PolicyError, match=r"none\.npz: no such file of a policy"):
        differences(replace(found, about=about), decide=True)


@pytest.mark.thorough
def test_a_policy_cannot_verify_itself(cli, tmp_path):
    """Its code is run after the replays, and in another process."""
    forging, folder = tmp_path / "forging.py", tmp_path / "forged"
    text = FORGING.replace("FOLDER", f"__import__('pathlib').Path({str(folder)!r})")
    forging.write_text(text, encoding="utf-8")
    policy = f"{forging}:Forging"
    done = cli("bench", "run", SMALL, "--policy", "hover", "--seeds", 1, "--out", folder)
    assert done.code == 0, done.err
    manifest = folder / "manifest.json"
    about = json.loads(manifest.read_text(encoding="utf-8"))
    about["trainings"][0]["policy"] = policy
    manifest.write_text(json.dumps(about), encoding="utf-8")
    rows = pd.read_csv(folder / "rows.csv")
    rows["qoe3_percent"] = 50.0
    rows.to_csv(folder / "rows.csv", index=False)
    (folder / "SHA256SUMS").unlink()
    done = cli("bench", "verify", folder, "--decide", "--receipts", "seen.json")
    done.failed(6, "qoe3_percent: the folder has 50.0, the replay")
    assert "decides otherwise" not in done.err and not (tmp_path / "seen.json").exists()


@pytest.mark.thorough
def test_a_claim_is_worth_what_was_checked(cli, tmp_path):
    done = cli("bench", "run", SMALL, "--policy", "case4.npz", "--seeds", 1, "--out", "table")
    assert done.code == 0, done.err

    def checked():
        return cli("bench", "board", "table", "--receipts", "seen.json", "--json").json[0]["rows"][
            0
        ]["checked"]

    assert cli("bench", "verify", "table", "--receipts", "seen.json").code == 0
    assert checked() == "replayed"
    assert cli("bench", "verify", "table", "--decide", "--receipts", "seen.json").code == 0
    assert checked() == "decided again"
    manifest = tmp_path / "table" / "manifest.json"
    about = json.loads(manifest.read_text(encoding="utf-8"))
    (tmp_path / "table" / "SHA256SUMS").unlink()
    manifest.write_text(json.dumps(about | {"information": "nothing"}), encoding="utf-8")
    assert checked() == "claimed"
    failed = cli("bench", "verify", "table", "--decide", "--receipts", "seen.json")
    failed.failed(6, "information: the folder has 'nothing'")
    about["trainings"][0]["decisions_sha256"] = "0" * 64
    manifest.write_text(json.dumps(about), encoding="utf-8")
    (line,) = differences(read(tmp_path / "table"))
    assert line.startswith("decisions_sha256 of training 0: the folder has '0000")


# ---- the sealed set


def test_a_seal_tells_nothing_and_a_key_everything(cli, tmp_path):
    seal = cli("bench", "seal", "--key", "secret.key").out.strip()
    key = (tmp_path / "secret.key").read_text(encoding="utf-8").strip()
    assert cli("bench", "seal", "--key", "secret.key").out.strip() == seal == seal_of(key)
    assert key not in seal and len(seal) == 64
    cli("bench", "reveal", "--key", "secret.key", "--out", "open")
    tracks = revealed(tmp_path / "open")
    assert {name: len(track.seeds) for name, track in tracks.items()} == SEEDS
    seeds = [seed for track in tracks.values() for seed in track.seeds]
    assert len({*seeds}) == len(seeds) and min(seeds) > 2**40 and max(seeds) < 2**63
    assert tracks["one"].world_seed == 0 and {one.seal for one in tracks.values()} == {seal}
    other = tracks_of(hashlib.sha256(b"").hexdigest(), tmp_path)
    assert not {*other["any"].seeds} & {*seeds}


def test_nobody_else_can_read_a_new_key(cli, tmp_path):
    cli("bench", "seal", "--key", "secret.key")
    assert os.name == "nt" or stat.S_IMODE((tmp_path / "secret.key").stat().st_mode) == 0o600


def test_a_reveal_that_was_interrupted_goes_on(cli, tmp_path, monkeypatch):
    cli("bench", "seal", "--key", "secret.key")
    reveal = ("bench", "reveal", "--key", "secret.key", "--out", "open")
    seen = []

    def interrupted(chosen, tracks, jobs):
        seen.append(tracks)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(kept, "complete", interrupted)
        stopped = cli(*reveal)
    assert (stopped.code, stopped.out) == (130, "")
    assert "interrupted; what was computed is kept" in stopped.err
    monkeypatch.setattr(kept, "complete", lambda *asked: seen.append(asked[1]))
    assert cli(*reveal).code == 0
    assert seen[0] == seen[1]


def test_the_set_of_another_key_is_not_written_over(cli, tmp_path):
    for name in ("one", "two"):
        cli("bench", "seal", "--key", f"{name}.key")
    assert cli("bench", "reveal", "--key", "one.key", "--out", "open").code == 0
    before = (tmp_path / "open" / "registry.json").read_bytes()
    again = cli("bench", "reveal", "--key", "two.key", "--out", "open")
    again.failed(4, "open: it has the revealed set of another key")
    assert (tmp_path / "open" / "registry.json").read_bytes() == before


def test_what_is_no_revealed_set_is_refused(cli, tmp_path):
    (tmp_path / "short.key").write_text("1234", encoding="utf-8")
    cli("bench", "seal", "--key", "short.key").failed(4, "short.key: not a key", "64 digits")
    cli("bench", "reveal", "--key", "none.key").failed(4, "none.key", "cannot be read")
    cli("bench", "seal", "--key", "secret.key")
    cli("bench", "reveal", "--key", "secret.key", "--out", "open")
    file = tmp_path / "open" / "registry.json"
    content = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps(content | {"key": "0" * 64}), encoding="utf-8")
    with pytest.raises(PolicyError, match="seal: it is not that of the key"):
        revealed(tmp_path / "open")


def revealed_with(folder, references):
    """A revealed set with this file of references, whose hash its registry has, if it is there."""
    folder.mkdir()
    file, content = folder / kept.REFERENCES, "" if references is None else references
    if references is not None:
        file.write_text(references, encoding="utf-8")
    key = "0" * 64
    files = {file.name: hashlib.sha256(content.encode()).hexdigest()}
    about = {"benchmark": "uav-v1", "seal": seal_of(key), "key": key, "files": files}
    (folder / "registry.json").write_text(json.dumps(about), encoding="utf-8")
    return revealed(folder)["any"]


@pytest.mark.parametrize(
    ("references", "said"),
    [
        (None, "cannot be read: No such file"),
        ("", "its columns must be task, track, seed, measure, value"),
        ("task,track,seed,measure\n", "its columns must be"),
        ("{row}\n", "its columns must be"),
        ("{columns}\n{row},5\n", "must be task, track, seed, measure, value"),
        ("{columns}\n\n{row}\n", r"\[\] must be task, track, seed, measure, value"),
        ("{columns}\n{row}\n{row}\n", "is the second value of this measure in this run"),
        ("{columns}\n{task},any,first,qoe3_percent,5.0\n", "'first'.* must be task, track, seed"),
        ("{columns}\n{task},any,1,qoe3_percent,five\n", "'five'.* must be task, track, seed"),
        ("{columns}\n{task},any,1,qoe3_percent,nan\n", "a value that is not finite"),
        ("{columns}\nuav-v1/none,any,1,qoe3_percent,5.0\n", "an unknown task or track"),
        ("{columns}\n{task},none,1,qoe3_percent,5.0\n", "an unknown task or track"),
        ("{columns}\n{task},any,1,fairness,5.0\n", "a measure that does not count"),
        ('{columns}\n"{row}\n', "unexpected end of data"),
    ],
)
def test_a_broken_revealed_set_is_refused(tmp_path, references, said):
    """The message names the file and what is wrong with it."""
    row, columns = f"{SMALL},any,1,qoe3_percent,5.0", ",".join(kept.COLUMNS)
    if references is not None:
        references = references.format(columns=columns, row=row, task=SMALL)
    track = revealed_with(tmp_path / "open", references)
    with pytest.raises(PolicyError, match=f"references.csv: .*{said}"):
        kept.reference_of(find_task(SMALL), track, 1)


def test_a_revealed_set_without_the_values_of_a_run_is_not_verified(tmp_path, monkeypatch):
    """Without its bound a score would count against 100 %; an unnamed task has no scores at all."""
    found = {kept.REFERENCES: {"qoe3_percent": 5.0}, kept.BOUNDS: {"qoe3_percent": 9.0}}
    monkeypatch.setattr(verify, "computed", lambda *_: found)
    row, columns = f"{SMALL},any,1,qoe3_percent,5.0", ",".join(kept.COLUMNS)
    track = revealed_with(tmp_path / "open", f"{columns}\n{row}\n")
    (line,) = verify.of_set(find_task(SMALL), track, 1)
    assert "bounds.csv: seed 1: qoe3_percent: it has no value, and computed anew it is 9.0" in line
    lines = verify.of_set(find_task(SMALL), track, 2)
    assert ["references.csv" in lines[0], "bounds.csv" in lines[1]] == [True, True]
    assert verify.of_set(find_task("uav-v1/edge/small"), track, 1) == []


@pytest.mark.thorough
def test_a_competition_on_a_sealed_set(cli, tmp_path, monkeypatch):
    """Its submissions are not those of the public set, and its references its own."""
    from desim_uav.experiment.bench import sealed

    few = {name: replace(track, seeds=track.seeds[:1]) for name, track in TRACKS.items()}
    monkeypatch.setattr(sealed, "TRACKS", few)
    cli("bench", "seal", "--key", "secret.key")
    assert cli("bench", "reveal", SMALL, "--key", "secret.key", "--out", "open").code == 0
    run = ("bench", "run", SMALL, "--policy", "case4.npz", "--track", "any")
    assert cli(*run, "--revealed", "open", "--out", "table").code == 0
    assert cli("bench", "verify", "table", "--revealed", "open", "--decide").code == 0
    (table,) = cli("bench", "board", "table", "--revealed", "open", "--json").json
    assert table["rows"][0]["score"]["value"] != 0 and table["rows"][0]["all_seeds"] == 1
    cli("bench", "verify", "table").failed(4, "seal: it is", "--revealed")
    forge(tmp_path / "open" / "references.csv", "qoe3_percent", 1.0)
    forge(tmp_path / "open" / "bounds.csv", "qoe1_percent", 99.0)
    forged = cli("bench", "verify", "table", "--revealed", "open")
    assert forged.code == 6 and len(forged.err.splitlines()) == 2
    assert "references.csv: seed" in forged.err and "qoe3_percent: it has 1.0, and" in forged.err
    assert "bounds.csv: seed" in forged.err and "qoe1_percent: it has 99.0, and" in forged.err


def forge(file, measure, value):
    """Write another value of a measure, and the hash of the file, into a revealed set."""
    rows = [line.split(",") for line in file.read_text(encoding="utf-8").splitlines()]
    lines = [",".join([*row[:4], str(value)] if row[3] == measure else row) for row in rows]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    registry = json.loads((file.parent / "registry.json").read_text(encoding="utf-8"))
    registry["files"][file.name] = hashlib.sha256(file.read_bytes()).hexdigest()
    (file.parent / "registry.json").write_text(json.dumps(registry), encoding="utf-8")
