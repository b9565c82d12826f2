"""An episode in continuous time, against the engine that flew it."""

from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from desim_uav.engine.des import Simulation
from desim_uav.errors import PolicyError, UsageError
from desim_uav.experiment.run import run_settings
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import US, Mode, Phase
from desim_uav.parquet_file import parquet
from desim_uav.policies import load_policy
from desim_uav.policies.base import decide
from desim_uav.report.playback import Playback
from desim_uav.report.run import Run
from desim_uav.sample_path import draw
from tests.report.helpers import make_run

SMALL = ("users.count=16", "episode.steps=12", "drones.battery.autonomy_min=6")
MIXED = (
    "[{name: by_cells, count: 2, motion: {timing: minimum_time, max_speed_mps: 12}, "
    "battery: {autonomy_min: 6, return_below: 0.8}}, "
    "{name: free, count: 2, motion: {space: free}, "
    "battery: {autonomy_min: 7, return_below: 0.8}}]"
)
KINDS = {
    "busy": ("case8", "baseline", SMALL),
    "crashing": ("case8", "hover", (*SMALL, "drones.battery.respawn_after_min=2")),
    "noisy": ("case9", "random", SMALL),
    "ended": ("case8", "hover", (*SMALL, "drones.battery.on_crash=end_episode")),
    "queueing": (
        *("case8", "random"),
        (
            *("users.count=16", "stations.count=1", "drones.count=4"),
            *("drones.battery.autonomy_min=20", "drones.battery.return_below=0.9"),
        ),
    ),
    "unlimited": ("tiny", "baseline", ()),
    "computing": (
        *("case8", "random"),
        (
            *("users.count=16", "episode.steps=12", "users.processor={ghz: 0.02}"),
            *("drones.battery.autonomy_min=6", "drones.battery.return_below=0.3"),
            "drones.processor={cores: 1, ghz: 0.2}",
            "drones.radio={kind: link_classes, sharing: equal}",
            "access_points=[{at_m: [1200, 1200], height_m: 20, radio: {kind: link_classes, "
            "sharing: equal}, processor: {cores: 2, ghz: 0.1}}]",
            "services={vision: {kind: compute, input_mbit: [1, 4], cycles_per_bit: [3000], "
            "output_mbit: [0.5], deadline_s: 200, on_deadline: drop}}",
            *("demand.mix={vision: 1}", "reward={kind: coverage_battery}", "offloading=split"),
        ),
    ),
    "mixed": ("case8", "random", ("episode.steps=12", "users.count=16", f"drones={MIXED}")),
}


@pytest.fixture(scope="module", params=KINDS)
def played(request, tmp_path_factory):
    """A run of three episodes, and what its engine showed at each decision epoch."""
    scenario, policy, overrides = KINDS[request.param]
    folder = tmp_path_factory.mktemp("played") / request.param
    run = Run(make_run(folder, scenario, policy, overrides, episodes=3))
    return run, engine_states(run, policy)


def engine_states(run, policy_name):
    policy, world, seed = load_policy(policy_name), run.world, run.manifest["seed"]
    engine = Simulation(world, run_settings(world, policy, False))
    states = {}
    for episode in range(3):
        carried = run.scenario.episode.carry_over and engine.truncated and not engine.terminated
        path = draw(world, seed, episode)
        policy.begin(world, Streams(seed, Purpose.LEARNER, episode), carried)
        shown = engine.reset(path)
        while True:
            users = engine.user_states(), engine.queues()
            told = (shown, engine.positions_m(), users, engine.measures())
            states[episode, shown.t_us] = told
            if shown.terminated or shown.truncated:
                break
            shown = engine.step(decide(policy, shown, world))
    return states


def test_it_tells_what_the_engine_showed(played):
    run, states = played
    modes, tasks = set(), Counter()
    playbacks = [Playback(run, episode) for episode in range(3)]
    for (episode, t_us), (shown, (drones_m, users_m), (users, queues), measures) in states.items():
        over = shown.terminated or shown.truncated
        moment = playbacks[episode].at(t_us, Phase.ATTACHMENT if over else Phase.RESPAWN)
        assert moment.drones_m == pytest.approx(drones_m, abs=1e-6)
        assert moment.users_m == pytest.approx(users_m, abs=1e-6)
        assert [mode.name for mode in moment.modes] == [o.mode.name for o in shown.observations]
        assert moment.states == users
        if not over:  # then its tasks are closed
            assert moment.queues == queues
            for queue in queues:
                tasks.update(queue._asdict())
        for seen, battery_s, held in zip(
            shown.observations,
            moment.batteries_s,
            [np.sum(moment.holders == d) for d in range(len(moment.modes))],
            strict=True,
        ):
            assert battery_s == (None if seen.battery_s is None else pytest.approx(seen.battery_s))
            assert held == seen.attached_users or over
        exact = slice(1 if queues else 0, None)  # the film counts a share of all stages together
        for told, known in zip(moment.measures[exact], measures[exact], strict=True):
            assert told == (None if known is None else pytest.approx(known, abs=1e-9)) or t_us == 0
        modes |= set(moment.modes)
    assert Mode.FLYING in modes
    if run.world.services.has_tasks:
        assert min(tasks.values()) > 10


def test_between_epochs_a_battery_is_that_of_an_endurance(played):
    run, _ = played
    if not run.scenario.limited_battery:
        assert set(Playback(run, 0).at(0).batteries_s) == {None}
        return
    airborne = landed = 0
    for episode in range(3):
        playback, events = Playback(run, episode), run.of("events", episode)
        own = events[events["user"].isna()]
        changes_us = {
            drone: of_drone["t_us"].to_numpy() for drone, of_drone in own.groupby("drone")
        }
        for t_s in np.arange(3.0, playback.duration_us / US - 7, 7.0):
            now, then = (playback.at(round(t * US)) for t in (t_s, t_s + 1))
            for drone, mode in enumerate(now.modes):
                mine = changes_us[drone]
                if ((mine >= t_s * US) & (mine <= (t_s + 1) * US)).any():
                    continue
                change = then.batteries_s[drone] - now.batteries_s[drone]
                if mode in (Mode.FLYING, Mode.RETURNING):
                    assert change == pytest.approx(-1.0, abs=1e-6)
                    airborne += 1
                elif mode is Mode.CHARGING:
                    capacity = run.world.type_of(drone).capacity
                    assert change == pytest.approx(capacity / US / 300, abs=1e-6)
                    landed += 1
                else:
                    assert change == pytest.approx(0.0, abs=1e-6)
    assert airborne > 10
    assert landed > 10 or run.scenario.stations.count != 1


def test_a_return_at_the_pace_of_a_step_is_half_way_after_half_a_step(tmp_path):
    slowly = ("drones.motion.return_timing=fill_epoch",)
    run = Run(make_run(tmp_path / "run", "case4", "baseline", slowly))
    legs = run.of("legs", 0)
    hop = legs[(legs["mode"] == "returning") & (legs["duration_s"] > 0)].iloc[0]
    assert hop["duration_s"] == 60.0
    shown_m = Playback(run, 0).at(round((hop["t_s"] + 30) * US)).drones_m[hop["drone"]]
    half_way = [(hop[f"{axis}_from_m"] + hop[f"{axis}_to_m"]) / 2 for axis in "xyz"]
    assert shown_m == pytest.approx(half_way, abs=1e-6)


def test_a_run_without_events(tmp_path):
    run = Run(make_run(tmp_path / "r", "tiny", "baseline", events=False))
    with pytest.raises(PolicyError, match="kept no events"):
        Playback(run, 0).at(0)
    with pytest.raises(PolicyError, match=r"is .* a run folder\?"):
        Playback(Run(tmp_path), 0).at(0)


def test_the_world_is_that_of_the_folder(tmp_path):
    folder = make_run(tmp_path / "r", "case8", "hover", ("episode.steps=1", "seed=3"))
    assert Run(folder).world.seed == 3
    text = (folder / "world.json").read_text()
    (folder / "world.json").write_text(text.replace("2400.0", "2401.0", 1))
    (folder / "SHA256SUMS").unlink()
    assert Run(folder).world.grid.width_m == 2401


def test_episodes_are_asked_for_by_their_number(tmp_path):
    run = Run(make_run(Path(tmp_path / "r"), "tiny", "baseline", episodes=2, warmup=1))
    assert run.episode(None) == 0
    assert run.episode(-1) == -1
    with pytest.raises(UsageError, match=r"^episode: 5: .* has the episodes -1 to 1"):
        run.episode(5)


def test_events_and_legs_of_another_run(tmp_path):
    folder = make_run(tmp_path / "r", "case8", "baseline", SMALL)
    (folder / "SHA256SUMS").unlink()
    events, legs = (pd.read_parquet(folder / f"{name}.parquet") for name in ("events", "legs"))
    for name, frame, message in (
        ("events", events[events["kind"] != "stop"], "not every serve has a stop"),
        ("legs", legs[legs["drone"] > 0], "the drones or modes are not those of the scenario"),
        ("legs", legs[legs["t_s"] != 60], "a departure has no leg"),
    ):
        (folder / f"{name}.parquet").write_bytes(parquet(name, frame))
        with pytest.raises(PolicyError, match=message):
            Playback(Run(folder), 0).at(0)
        (folder / "events.parquet").write_bytes(parquet("events", events))
        (folder / "legs.parquet").write_bytes(parquet("legs", legs))
