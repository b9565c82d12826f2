"""The page that replays a run: what it is made of, and what it is refused for."""

import base64
import hashlib
import json
import re
import shutil
import sys
import zlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from desim_uav import cli
from desim_uav.checksums import SUMS
from desim_uav.errors import PolicyError, UsageError
from desim_uav.experiment.replay.again import played_again
from desim_uav.experiment.replay.page import write_replay
from desim_uav.model.energy.charging import Constant, Swap, Tapered
from desim_uav.parquet_file import parquet
from desim_uav.report.batteries import battery_knots
from desim_uav.report.replay.columns import codes, delta, floats, pack, plain
from desim_uav.report.replay.data import KINDS, TAKING, Encoder
from desim_uav.report.replay.page import MODULES, asset, bundle, page
from desim_uav.report.run import Run
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from tests.reference.energy import Rotor
from tests.reference.flight import quickest
from tests.report.unpacked import unpack
from tests.run_to_folder import run_to_folder

US = 1_000_000
SMALL = ("users.count=16", "episode.steps=12", "drones.battery.autonomy_min=6")
FLEET = (
    "[{name: scout, count: 2, motion: {timing: minimum_time, max_speed_mps: 12}, "
    "battery: {autonomy_min: 6, return_below: 0.8}, footprint_radius_m: 300}, "
    "{name: relay, count: 1, battery: {autonomy_min: 9}, bandwidth_kbps: 900}]"
)
MIXED = (
    "[{name: by_cells, count: 2, motion: {timing: minimum_time, max_speed_mps: 12}, "
    "battery: {autonomy_min: 6, return_below: 0.8}}, "
    "{name: free, count: 2, motion: {space: free}, "
    "battery: {autonomy_min: 7, return_below: 0.8}}]"
)
RUNS = {
    "busy": ("case8", "baseline", SMALL),
    "crashing": ("case8", "hover", (*SMALL, "drones.battery.respawn_after_min=2")),
    "ending": ("case8", "hover", (*SMALL, "drones.battery.on_crash=end_episode")),
    "queueing": (
        "case9",
        "random",
        (
            *(*SMALL, "stations.count=1", "drones.count=5", "drones.battery.return_below=0.6"),
            "drones.motion.return_timing=fill_epoch",
        ),
    ),
    "unlimited": ("tiny", "baseline", ()),
    "fleet": ("case8", "random", ("episode.steps=12", "users.count=20", f"drones={FLEET}")),
    "mixed": ("case8", "random", ("episode.steps=12", "users.count=20", f"drones={MIXED}")),
}


def make(where, name, policy, overrides=(), events=True, **options):
    settings = {"episodes": 2, "warmup": 1, "command": []} | options
    run_to_folder(
        load(scenario_path(name), overrides),
        policy,
        keep_events=events,
        out=where,
        **settings,
    )
    return where


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A run of each kind, with its events: one warm-up episode, two counted ones."""
    where = tmp_path_factory.mktemp("runs")
    for name, run in RUNS.items():
        make(where / name, *run)
    return where


@pytest.fixture(params=RUNS)
def folder(request, folders):
    """Each run in turn, not to be changed."""
    return Run(folders / request.param)


@pytest.fixture
def busy(folders, tmp_path):
    """A run that may be spoilt."""
    return shutil.copytree(folders / "busy", tmp_path / "busy")


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """A run that has kept no events."""
    return make(tmp_path_factory.mktemp("bare") / "run", "case8", "baseline", SMALL, events=False)


@pytest.fixture(scope="module")
def hovering(tmp_path_factory):
    """The same scenario, seed and world as ``busy``, under another policy."""
    return make(tmp_path_factory.mktemp("other") / "hovering", "case8", "hover", SMALL)


def spoil_json(file, **changes):
    content = json.loads(file.read_text(encoding="utf-8")) | changes
    file.write_text(json.dumps(content), encoding="utf-8")
    (file.parent / SUMS).unlink(missing_ok=True)


def spoil_table(run, name, column, value, row=None):
    """Change the first row of episode 0, or another."""
    frame = pd.read_parquet(run / f"{name}.parquet")
    frame.loc[(frame["episode"] == 0).idxmax() if row is None else row, column] = value
    (run / f"{name}.parquet").write_bytes(parquet(name, frame))
    (run / SUMS).unlink(missing_ok=True)


class TestColumns:
    def test_come_back(self):
        rng = np.random.default_rng(0)
        whole = rng.integers(-(2**40), 2**40, 500)
        found = unpack(
            pack(
                {
                    "near": delta(np.cumsum(rng.integers(-3, 1000, 500))),
                    "far": delta(whole),
                    "small": plain([0, -1, 1, 63, 64, -64, -65, 8191, 8192, 2**52]),
                    "code": codes([0, 255, 7]),
                    "exact": floats([0.1, -1e300, 1e-300]),
                    "none": plain([]),
                }
            )
        )
        rng = np.random.default_rng(0)
        rng.integers(-(2**40), 2**40, 500)
        assert found["near"].tolist() == np.cumsum(rng.integers(-3, 1000, 500)).tolist()
        assert found["far"].tolist() == whole.tolist()
        assert found["small"].tolist() == [0, -1, 1, 63, 64, -64, -65, 8191, 8192, 2**52]
        assert found["code"].tolist() == [0, 255, 7]
        assert found["exact"].tolist() == [0.1, -1e300, 1e-300]
        assert found["none"].tolist() == []

    def test_a_scale_is_how_finely_they_are_kept(self):
        (found,) = unpack(pack({"x": delta([1.004, 1.006, -2.5], 0.01)})).values()
        assert found == pytest.approx([1.0, 1.01, -2.5])

    def test_small_differences_take_a_byte_each(self):
        block = zlib.decompress(pack({"t": delta(range(10**6, 10**6 + 5000))}))
        assert len(block.partition(b"\n")[2]) < 5010


class TestBlocks:
    @pytest.fixture(params=(-1, 0, 1))
    def episode(self, request, folder):
        """The tables of an episode, and what the page is given of it."""
        tables = folder.of_episode(request.param)
        encoder = Encoder(folder)
        return tables, unpack(encoder.episode(request.param, tables)), encoder

    def test_events_stand_in_a_readers_order_and_are_all_there(self, episode):
        tables, columns, _ = episode
        events = tables["events"]
        names = {"t_us": "t_us", "phase": "phase", "kind": "kind", "drone": "drone"}
        names |= {"user": "user", "request": "request_id", "station": "station"}
        rows = sorted(
            zip(
                *(
                    (KINDS.index(word) for word in events[name])
                    if name == "kind"
                    else events[name].fillna(-1).astype(int)
                    for name in names.values()
                ),
                strict=True,
            ),
            key=lambda row: (*row[:2], TAKING.get(KINDS[row[2]], 0)),
        )
        held = zip(*(columns[f"event.{name}"].astype(int) for name in names), strict=True)
        assert list(held) == rows

    def test_requests_steps_and_places(self, episode):
        tables, columns, encoder = episode
        requests, steps, users = (tables[name] for name in ("requests", "steps", "users"))
        assert (columns["request.t_us"] / US).tolist() == requests["t_request_s"].tolist()
        assert (columns["request.required_us"] / US).tolist() == requests["requested_s"].tolist()
        asked = [encoder.services[int(k)] for k in columns["request.service"]]
        assert asked == requests["service"].tolist()
        assert columns["step.reward"].tolist() == steps["reward"].tolist()
        assert columns["walk.count"].sum() == len(users)
        assert columns["walk.t_us"] / US == pytest.approx(users["t_s"].to_numpy())
        for axis in "xy":
            assert columns[f"walk.{axis}"] == pytest.approx(
                users[f"{axis}_m"].to_numpy(), abs=0.006
            )

    def test_batteries_go_through_what_was_recorded(self, episode):
        tables, columns, encoder = episode
        if not encoder.types[0].limited:
            assert not [name for name in columns if name.startswith("battery")]
            return
        ends = np.cumsum(columns["battery.count"]).astype(int)
        for drone, own in tables["steps"].groupby("drone"):
            part = slice(ends[drone] - int(columns["battery.count"][drone]), ends[drone])
            knots = [*zip(columns["battery.t_us"][part], columns["battery.us"][part], strict=True)]
            assert [t for t, _ in knots] == sorted(t for t, _ in knots)
            records = zip(own["t_s"] * US, own["battery_s"] * US, strict=True)
            for record in records:
                assert pytest.approx(record) in knots

    def test_a_battery_drains_a_second_a_second_until_the_drone_lands(self, episode):
        tables, columns, encoder = episode
        events = tables["events"]
        ends = np.cumsum(columns["battery.count"]).astype(int) if encoder.types[0].limited else []
        for landing in events[events["kind"] == "land"].itertuples():
            first = ends[landing.drone] - int(columns["battery.count"][landing.drone])
            times = columns["battery.t_us"][first : ends[landing.drone]]
            held = columns["battery.us"][first : ends[landing.drone]]
            k = int(np.flatnonzero(times == landing.t_us)[0])
            if k:
                assert held[k - 1] - held[k] == pytest.approx(times[k] - times[k - 1], abs=10)

    def test_a_battery_is_carried_into_the_next_episode(self, folder):
        encoder = Encoder(folder)
        if not encoder.types[0].limited:
            return
        begins, carried = {}, {}
        for number in (0, 1):
            columns = unpack(encoder.episode(number, folder.of_episode(number)))
            first = np.cumsum(columns["battery.count"]).astype(int)
            first -= columns["battery.count"].astype(int)
            begins[number] = columns["battery.us"][first].tolist()
            steps = folder.of_episode(number - 1)["steps"]
            last = steps[steps["step"] == steps["step"].max()]
            carried[number] = (last["battery_s"] * US).tolist()
        if folder.folder.name == "ending":  # begins afresh after a crash that ended the one before
            assert begins[1] == [own.capacity for own in encoder.types]
        else:
            assert begins == {n: pytest.approx(values) for n, values in carried.items()}

    def test_every_leg_has_the_profile_it_was_flown_by(self, episode):
        tables, columns, encoder = episode
        legs = tables["legs"].sort_values("drone", kind="stable")
        flown = legs["duration_s"].to_numpy() > 0
        assert ((columns["leg.profile"] >= 0) == flown).all()
        for number, duration_s in zip(
            columns["leg.profile"][flown], legs["duration_s"][flown], strict=True
        ):
            shares = encoder.flights.profiles[int(number)]
            assert shares[-1][:2] == pytest.approx([duration_s, 1.0])


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    where = tmp_path_factory.mktemp("asked") / "run"
    scenario = load(Path(__file__).parent / "asked.yaml")
    run_to_folder(scenario, "random", keep_events=True, out=where, episodes=1, warmup=0, command=[])
    return where


@pytest.fixture(scope="module")
def block(asked):
    folder = Run(asked)
    encoder, tables = Encoder(folder), folder.of_episode(0)
    return tables, unpack(encoder.episode(0, tables)), encoder


class TestEnergyAndDecisions:
    """Two drones with energy, one with a battery by time, one without; all asked by event."""

    def test_steps_end_when_they_ended(self, block):
        tables, columns, _ = block
        ends_s = tables["steps"]["t_s"].drop_duplicates().tolist()
        assert (columns["step.t_us"] / US).tolist() == ends_s
        assert len(ends_s) > 40
        assert len({*np.diff(ends_s).round(6)}) > 10
        assert len(columns["step.told"]) == 4 * len(ends_s)

    def test_batteries_and_legs_go_on_in_the_next_episode(self, tmp_path):
        overrides = ("episode.carry_over=true", "episode.steps=5")
        scenario = load(Path(__file__).parent / "asked.yaml", overrides)
        out, told = tmp_path / "run", {"warmup": 0, "command": []}
        run_to_folder(scenario, "random", keep_events=True, out=out, episodes=4, **told)
        folder, held, begun = Run(out), None, 0
        encoder = Encoder(folder)
        for episode in range(4):
            tables = folder.of_episode(episode)
            columns = unpack(encoder.episode(episode, tables))
            ends = np.cumsum(columns["battery.count"]).astype(int)
            first = columns["battery.us"][ends[:3] - columns["battery.count"][:3].astype(int)]
            assert held is None or first.tolist() == held
            held = columns["battery.us"][ends[:3] - 1].tolist()
            legs = tables["legs"]
            going_on = legs.query("t_s < 0 and t_s + duration_s > 0 and mode == 'flying'")
            begun += len(going_on)
            for leg in going_on.itertuples():
                told_at = tables["events"].query("kind == 'decide' and drone == @leg.drone")
                crashed = tables["events"].query("kind == 'crash' and drone == @leg.drone")
                if crashed.empty:
                    assert told_at["t_us"].min() == round((leg.t_s + leg.duration_s) * US)
        assert begun > 0

    def test_batteries_in_flight_are_those_of_the_energy_model(self, block):
        """Against a quadrature of the power over the speed of each flight."""
        tables, columns, _ = block
        ends = np.cumsum(columns["battery.count"]).astype(int)
        hover_w = Rotor().power_w(0.0, 0.0)
        compared = 0
        for leg in tables["legs"].query("duration_s > 0 and drone < 2").itertuples():
            part = slice(
                ends[leg.drone] - int(columns["battery.count"][leg.drone]), ends[leg.drone]
            )
            t_s, held_s = columns["battery.t_us"][part] / US, columns["battery.us"][part] / US
            inside = (t_s >= leg.t_s) & (t_s <= leg.t_s + leg.duration_s)
            up = np.sign(leg.z_to_m - leg.z_from_m)
            length_m = sum(
                abs(getattr(leg, f"{a}_to_m") - getattr(leg, f"{a}_from_m")) for a in "xyz"
            )
            flight = quickest(length_m, 12.0, 4.0)
            if inside.sum() < 5:
                continue  # cut off by a crash
            elapsed_s = np.linspace(0.0, t_s[inside][-1] - t_s[inside][0], 1001)
            flown_m = np.array([flight.flown_m(t) for t in elapsed_s])
            speeds = np.gradient(flown_m, elapsed_s)
            watts = [Rotor().power_w(0.0 if up else v, up * v) for v in speeds]
            used_j = np.trapezoid(watts, elapsed_s)
            assert (held_s[inside][0] - held_s[inside][-1]) * hover_w == pytest.approx(used_j, 1e-3)
            compared += 1
        assert compared > 20

    def test_powers_are_those_of_the_energy_model(self, block):
        *_, encoder = block
        hover_w, seen_w = Rotor().power_w(0.0, 0.0), set()
        for powers, profile in zip(encoder.flights.powers, encoder.flights.profiles, strict=True):
            if powers is None:
                continue  # of the relay or of the tethered drone
            duration_s = profile[-1][0]
            assert powers[0] == (0.0, pytest.approx(hover_w, rel=2e-3))
            assert powers[-1] == pytest.approx((duration_s, hover_w), rel=2e-3)
            middle = min(powers, key=lambda power: abs(power[0] - duration_s / 2))
            seen_w.add(round(middle[1]))
        climbing = Rotor().power_w(0.0, quickest(20.0, 12.0, 4.0).speed_mps)
        expected = (Rotor().power_w(12.0, 0.0), climbing, hover_w)
        assert seen_w == {round(power_w) for power_w in expected}

    def test_batteries_go_through_what_was_recorded(self, block):
        tables, columns, _ = block
        ends = np.cumsum(columns["battery.count"]).astype(int)
        for drone, own in tables["steps"].query("drone < 3").groupby("drone"):
            part = slice(ends[drone] - int(columns["battery.count"][drone]), ends[drone])
            knots = [*zip(columns["battery.t_us"][part], columns["battery.us"][part], strict=True)]
            assert [t for t, _ in knots] == sorted(t for t, _ in knots)
            for record in zip(own["t_s"] * US, own["battery_s"] * US, strict=True):
                assert pytest.approx(record, abs=1.0) in knots
        assert columns["battery.count"][3] == 0

    def test_a_battery_rises_on_a_pad_and_in_a_replacement_only(self, block):
        tables, columns, _ = block
        ends = np.cumsum(columns["battery.count"]).astype(int)
        rises = {"charge": 0, "respawn": 0}
        for drone, own in tables["events"].query("drone < 3 and user.isna()").groupby("drone"):
            part = slice(ends[drone] - int(columns["battery.count"][drone]), ends[drone])
            t_us, held_us = columns["battery.t_us"][part], columns["battery.us"][part]
            for k in np.flatnonzero(np.diff(held_us) > 1):
                last = own[own["t_us"] <= t_us[k]].query("kind in ('charge', 'respawn')").iloc[-1]
                rises[last["kind"]] += 1
                ended = own[(own["t_us"] > last["t_us"]) & (own["t_us"] < t_us[k + 1])]["kind"]
                assert not {"charged", "crash"} & {*ended}
        assert min(rises.values()) > 0

    def test_the_page_is_told_of_types_and_of_epochs(self, asked):
        html = write_replay(asked).file.read_text(encoding="utf-8")
        (data,) = re.findall(r'<script type="application/json" id="runs">(.*?)</script>', html)
        (run,) = json.loads(data)["runs"]
        assert run["by_event"] is True
        assert [kind["name"] for kind in run["types"]] == ["scout", "relay", "tethered"]
        assert [kind["capacity_wh"] for kind in run["types"]] == [20.0, None, None]
        assert [kind["hover_w"] for kind in run["types"]] == [
            pytest.approx(168.484, abs=0.01),
            None,
            None,
        ]
        assert len(run["powers"]) == len(run["profiles"])

    @pytest.mark.parametrize("value", [0.0, 1e6, float("nan")])
    def test_ends_of_steps_that_do_not_fit_are_refused(self, asked, tmp_path, value):
        run = shutil.copytree(asked, tmp_path / "run")
        spoil_table(run, "steps", "t_s", value)
        with pytest.raises(PolicyError, match=r"steps\.parquet: t_s"):
            write_replay(run)


class TestBatteryKnots:
    """A battery of 600 s that charges in 300 s: two seconds a second."""

    def knots(self, records, events, begins_with=600, charging=None):
        records = [(t * US, b * US) for t, b in records]
        events = [(t * US, kind) for t, kind in events]
        found = battery_knots(
            begins_with * US, records, events, 600 * US, charging or Constant(5.0)
        )
        return [(t / US, b / US) for t, b in found]

    def test_in_the_air(self):
        assert self.knots([(60, 540), (120, 480)], []) == [(0, 600), (60, 540), (120, 480)]

    def test_charged_between_two_records(self):
        records = [(60, 560), (120, 600)]
        events = [(70, "land"), (75, "charge"), (100, "charged")]
        assert self.knots(records, events) == [
            *((0, 600), (60, 560), (70, 550), (75, 550), (100, 600), (120, 600))
        ]

    def test_charging_at_the_end(self):
        events = [(70, "land"), (80, "charge")]
        assert self.knots([(60, 400), (120, 470)], events)[2:4] == [(70, 390), (80, 390)]

    def test_a_swap_is_a_jump(self):
        records, events = [(60, 400), (120, 380)], [(70, "land"), (80, "charge"), (170, "charged")]
        found = self.knots([*records, (180, 600)], events, charging=Swap(minutes=1.5))
        assert (80, 380) in found
        assert {charge for t, charge in found if 70 <= t < 170} == {380}
        assert found[-2:] == [(170, 600), (180, 600)]

    def test_a_tapered_charge_is_curved(self):
        own, capacity = Tapered(full_charge_min=10.0), 600 * US
        begins = round(0.1 * capacity)
        takes_us = own.until_full_us(begins, capacity)
        events = [(90 * US, "land"), (90 * US, "charge"), (90 * US + takes_us, "charged")]
        found = battery_knots(capacity, [(60 * US, capacity // 8)], events, capacity, own)
        charging = [knot for knot in found if knot[0] > 90 * US]
        assert len(charging) > 10
        assert charging[-1] == (90 * US + takes_us, round(0.99 * capacity))
        for t_us, charge in charging:
            assert charge == pytest.approx(own.charged(begins, t_us - 90 * US, capacity), abs=20)
        assert (90 * US, pytest.approx(begins, abs=20)) in found

    def test_waiting_at_the_end(self):
        assert self.knots([(60, 400), (120, 390)], [(70, "land")])[2:] == [(70, 390), (120, 390)]

    def test_a_crash_and_another_drone_at_a_record(self):
        records = [(60, 0), (120, 0), (180, 540)]
        events = [(50, "deplete"), (50, "crash"), (120, "respawn")]
        assert self.knots(records, events, begins_with=50) == [
            *((0, 50), (50, 0), (60, 0), (120, 0), (120, 0), (120, 600), (180, 540))
        ]


class TestPage:
    def test_holds_the_episodes_asked_for(self, folders):
        folder = Run(folders / "busy")
        assert folder.chosen(None) == [0, 1]
        assert folder.chosen("-1-1") == [-1, 0, 1]
        assert folder.chosen("1,-1") == [-1, 1]
        assert folder.chosen("-1--1") == [-1]

    @pytest.mark.parametrize("text", ["2", "0-5", "x", "", "1-0", "0-", "--", "0,,1"])
    def test_refuses_others(self, folders, text):
        with pytest.raises(UsageError, match=r"^episodes: "):
            Run(folders / "busy").chosen(text)

    @pytest.mark.thorough
    def test_of_ten_episodes_of_case_8_is_small(self, tmp_path):
        run = make(tmp_path / "ten", "case8", "baseline", episodes=10, warmup=0)
        done = write_replay(run)
        assert done.episodes == list(range(10))
        assert done.size == (run / "replay.html").stat().st_size < 500_000

    def test_leaves_out_what_has_no_room_unless_asked_for(self, busy):
        done = write_replay(busy, most_bytes=1)
        assert (done.episodes, done.left_out) == ([0], [1])
        done = write_replay(busy, episodes="0-1", most_bytes=1)
        assert (done.episodes, done.left_out) == ([0, 1], [])

    def test_is_the_same_from_the_same_run(self, busy):
        pages = [write_replay(busy).file.read_bytes() for _ in range(2)]
        assert pages[0] == pages[1]

    def test_that_fails_leaves_the_one_before(self, busy):
        before = write_replay(busy).file.read_bytes()
        spoil_table(busy, "events", "user", 99)
        with pytest.raises(PolicyError):
            write_replay(busy)
        assert (busy / "replay.html").read_bytes() == before
        assert not [file for file in busy.iterdir() if file.name.startswith(".")]

    def test_asks_for_nothing_and_lets_only_its_own_script_run(self, busy):
        html = write_replay(busy).file.read_text(encoding="utf-8")
        (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', html)
        (script,) = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
        (style,) = re.findall(r"<style>(.*?)</style>", html, re.DOTALL)
        for name, text in (("script-src", script), ("style-src", style)):
            digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
            assert f"{name} 'sha256-{digest}'" in policy
        assert policy.startswith("default-src 'none'")
        assert "unsafe" not in policy
        assert not re.findall(r"(?:https?:)?//[a-z]+\.[a-z]", re.sub(r"//.*", "", html))
        assert not re.findall(r"\b(?:src|href)=\"(?!data:)", html)
        assert not re.findall(r"\son\w+=", html)
        assert not re.findall(r"\sstyle=", html)

    def test_writes_text_only(self):
        script = bundle()
        for word in ("innerHTML", "outerHTML", "insertAdjacent", "document.write", "eval(", "</"):
            assert word not in script
        assert not re.findall(r"^(?:import|export) ", script, re.MULTILINE)

    def test_modules_come_behind_those_they_import(self):
        for number, name in enumerate(MODULES):
            wanted = re.findall(r'from "\./(\w+)\.js"', asset(f"{name}.js"))
            assert set(wanted) <= set(MODULES[:number])

    def test_names_are_data(self):
        name = "</script><img src=x onerror=alert(1)>&\"'\u2028"
        html = page(({"scenario": name}, [b"block"])).decode()
        assert "<img" not in html
        assert "\u2028" not in html
        (data,) = re.findall(r'<script type="application/json" id="runs">(.*?)</script>', html)
        assert json.loads(data)["runs"] == [{"scenario": name}]


class TestSideBySide:
    def test_is_one_page_of_both_that_is_the_same_each_time(self, busy, hovering):
        done = write_replay(busy, beside=hovering)
        assert done.file == busy / "replay-hovering.html"
        html = done.file.read_text(encoding="utf-8")
        (data,) = re.findall(r'<script type="application/json" id="runs">(.*?)</script>', html)
        assert [run["policy"] for run in json.loads(data)["runs"]] == ["baseline", "hover"]
        blocks = re.findall(r'id="(episode-\d-\d)"', html)
        assert blocks == ["episode-0-0", "episode-0-1", "episode-1-0", "episode-1-1"]
        before = done.file.read_bytes()
        assert write_replay(busy, beside=hovering).file.read_bytes() == before

    def test_without_events_is_played_again(self, bare, hovering, busy, tmp_path):
        again = write_replay(bare, tmp_path / "again.html", beside=hovering)
        kept = write_replay(busy, tmp_path / "kept.html", beside=hovering)
        assert (again.played_again, kept.played_again) == (True, False)
        assert again.file.read_bytes() == kept.file.read_bytes()

    def test_some_episodes(self, busy, hovering):
        assert write_replay(busy, episodes="1", beside=hovering).episodes == [1]
        assert write_replay(busy, beside=hovering, most_bytes=1).left_out == [1]

    @pytest.mark.parametrize(
        ("overrides", "options", "reason"),
        [
            (("users.count=17",), {}, r"scenario \(users.count\): users.count: 16 and 17"),
            (("seed=3", "world_seed=0"), {}, "seed: 0 and 3"),
            (("world_seed=4",), {}, "world_seed: 0 and 4"),
            ((), {"episodes": 1}, r"episodes: 0 to 1 \(2\) and 0 to 0 \(1\); name common ones"),
        ],
    )
    def test_refuses_what_is_not_on_common_seeds(self, busy, tmp_path, overrides, options, reason):
        other = make(tmp_path / "other", "case8", "hover", (*SMALL, *overrides), **options)
        with pytest.raises(PolicyError, match=rf"because they differ in {reason}"):
            write_replay(busy, beside=other)
        assert not (busy / "replay-other.html").exists()

    def test_refuses_another_world(self, busy, hovering, tmp_path):
        other = shutil.copytree(hovering, tmp_path / "other")
        world = json.loads((other / "world.json").read_text(encoding="utf-8"))
        spoil_json(other / "world.json", users=world["users"][::-1])
        with pytest.raises(PolicyError, match=r"they differ in world\.json"):
            write_replay(busy, beside=other)


class TestPlayedAgain:
    def test_gives_the_events_that_a_run_would_have_kept(self, bare, folders):
        kept = Run(folders / "busy")
        for number, tables in played_again(Run(bare), [0, 1]):
            for name in ("events", "legs"):
                stored = kept.of_episode(number)[name].reset_index(drop=True)
                pd.testing.assert_frame_equal(tables[name], stored)

    def test_gives_the_page_of_a_run_with_events(self, bare, folders, tmp_path):
        again = write_replay(bare, tmp_path / "again.html")
        kept = write_replay(folders / "busy", tmp_path / "kept.html")
        assert (again.played_again, kept.played_again) == (True, False)
        assert (tmp_path / "again.html").read_bytes() == (tmp_path / "kept.html").read_bytes()

    def test_an_interrupted_run(self, bare, tmp_path):
        run = shutil.copytree(bare, tmp_path / "run")
        spoil_json(run / "manifest.json", episodes_asked=50, interrupted=True)
        assert write_replay(run).episodes == [0, 1]

    def test_with_legs_missing(self, busy):
        (busy / "legs.parquet").unlink()
        assert write_replay(busy).played_again

    @pytest.mark.parametrize(
        ("table", "column", "value"),
        [
            ("requests", "served_s", 1.25),
            ("steps", "x_m", 1.0),
            ("users", "x_m", 1.0),
            ("episodes", "crashes", 7),
        ],
    )
    def test_another_outcome_is_refused(self, bare, tmp_path, table, column, value):
        run = shutil.copytree(bare, tmp_path / "run")
        spoil_table(run, table, column, value)
        with pytest.raises(
            PolicyError, match=rf"{table}\.parquet differs from what is computed now.*--events"
        ):
            write_replay(run)
        assert not (run / "replay.html").exists()

    @pytest.mark.parametrize(
        ("changes", "reason"),
        [
            ({"policy": "gone.npz"}, "gone.npz"),
            ({"policy": "no_such_module:Policy"}, "no_such_module"),
            ({"policy": "random"}, "ceiling of policy"),
            ({"seed": 5}, r"\.parquet differs"),
            ({"world_seed": 5}, "world.json"),
        ],
    )
    def test_what_cannot_be_made_again_says_how_to_mend_it(self, bare, tmp_path, changes, reason):
        run = shutil.copytree(bare, tmp_path / "run")
        spoil_json(run / "manifest.json", **changes)
        with pytest.raises(PolicyError, match=rf"the run kept no events.*{reason}.*--events"):
            write_replay(run)


class TestRefused:
    @pytest.mark.parametrize(
        ("key", "value", "problem"),
        [
            ("size_m", [0, 2400], "size_m.0: must be above 0"),
            ("size_m", "<b>", "size_m: must be a list"),
            ("cells", [10], "cells: must have at least 2 items"),
            ("cells", [10, 11], "but scenario.yaml has"),
            ("cell_height_m", [[1]], "cell_height_m: must be 10 lists of 10 heights"),
            (
                "cell_height_m",
                [["<b>"] * 10] * 10,
                "cell_height_m.0.0: must be a number",
            ),
            ("stations", [[10, 0]], "stations: must be cells .ix, iy. below .10, 10."),
            ("stations", [[1.5, 0]], "stations.0.0: must be a whole number"),
            ("clusters", [{"x_m": 1, "y_m": 2}], "clusters.0.radius_m: missing"),
            (
                "clusters",
                [{"x_m": 1, "y_m": 2, "radius_m": True}],
                "clusters.0.radius_m: must be",
            ),
            ("users", [], "users: must have at least 1 item"),
            ("users", [[1, 2, None]], "users.0.2: must be a number"),
            ("users", [[1, 2, float("nan")]], "users.0.2: must be a finite number"),
            ("users", [[1, 2, 10**400]], "users.0.2: is too large"),
        ],
    )
    def test_a_world(self, busy, key, value, problem):
        if key == "cells" and len(value) == 2:
            spoil_json(busy / "world.json", cell_height_m=[[0] * 11] * 10)
        spoil_json(busy / "world.json", **{key: value})
        with pytest.raises(PolicyError, match=rf"world\.json: .*{problem}"):
            write_replay(busy)

    @pytest.mark.parametrize("text", ["", "[1]", "{", "[" * 100_000, "{}"])
    def test_files_that_are_no_json_or_another(self, busy, text):
        for name in ("world.json", "manifest.json"):
            before = (busy / name).read_text(encoding="utf-8")
            (busy / name).write_text(text, encoding="utf-8")
            with pytest.raises(PolicyError, match=name):
                write_replay(busy)
            (busy / name).write_text(before, encoding="utf-8")

    @pytest.mark.parametrize(
        ("key", "value"),
        [
            ("scenario", 1),
            ("policy", None),
            ("seed", True),
            ("engine", "x"),
            ("ceilings", ["none"]),
            ("ceilings", ["x"] * 3),
        ],
    )
    def test_a_manifest(self, busy, key, value):
        spoil_json(busy / "manifest.json", **{key: value})
        with pytest.raises(
            PolicyError, match=rf"manifest\.json: (not the manifest of a run: )?{key}(\.0)?: "
        ):
            write_replay(busy)

    @pytest.mark.parametrize(
        ("table", "column", "value", "problem"),
        [
            ("events", "kind", "<img>", "kind: '<img>' is not known"),
            ("events", "user", 16, "user: not of this run"),
            ("events", "user", None, "user: not of this run"),
            ("events", "drone", -2, "drone: not of this run"),
            ("events", "t_us", -1, "t_us: not of this run"),
            ("events", "phase", 14, "phase: not of this run"),
            ("requests", "service", "<img>", "service: '<img>' is not in scenario.yaml"),
            ("requests", "request_id", 5, "request_id: not numbered"),
            ("requests", "requested_s", 0.0, "requested_s: below"),
            ("requests", "bandwidth_kbps", -1.0, "bandwidth_kbps: out of range"),
            ("steps", "action_taken", "dance", "action_taken: 'dance' is not known"),
            ("steps", "reward", None, "reward: empty or far too large"),
            ("steps", "drone", 7, "not a row for each step and drone"),
            ("users", "x_m", 1e300, "x_m: empty or far too large"),
            ("users", "user", 99, "user: not of this run"),
            ("legs", "mode", "sailing", "mode: 'sailing' is not known"),
            ("legs", "t_s", 5.0, "begins after 0"),
            ("legs", "drone", 9, "drone: not of this run"),
            ("episodes", "duration_s", -1.0, "duration_s: -1"),
        ],
    )
    def test_tables_that_do_not_fit(self, busy, table, column, value, problem):
        spoil_table(busy, table, column, value)
        with pytest.raises(PolicyError, match=re.escape(f"{table}.parquet: ") + f".*{problem}"):
            write_replay(busy)

    def test_a_transit_that_this_scenario_does_not_have(self, busy):
        frame = pd.read_parquet(busy / "legs.parquet")
        row = frame[(frame["episode"] == 0) & (frame["duration_s"] > 0)].index[0]
        spoil_table(busy, "legs", "duration_s", 59.0, row)
        with pytest.raises(PolicyError, match=r"legs\.parquet: duration_s: 240 m take 60 s"):
            write_replay(busy)


class TestCommand:
    @pytest.fixture
    def replay(self, capsys, monkeypatch, tmp_path):
        monkeypatch.chdir(tmp_path)

        def run(*arguments):
            capsys.readouterr()
            monkeypatch.setattr(sys, "argv", ["desim-uav", "replay", *map(str, arguments)])
            with pytest.raises(SystemExit) as end:
                cli.main()
            return (end.value.code or 0, *capsys.readouterr())

        return run

    def test_prints_where_the_page_is(self, replay, busy, tmp_path):
        assert replay(busy) == (0, f"{busy / 'replay.html'}\n", "")
        assert replay(busy, "--html", "here.html") == (0, "here.html\n", "")
        assert (tmp_path / "here.html").read_bytes() == (busy / "replay.html").read_bytes()

    def test_two_runs(self, replay, busy, folders):
        code, out, err = replay(busy, folders / "busy")
        assert (code, out, err) == (0, f"{busy / 'replay-busy.html'}\n", "")
        code, out, err = replay(busy, folders / "queueing")
        assert (code, out) == (4, "")
        assert err.startswith("desim-uav: ") and "they differ in scenario (" in err

    def test_json(self, replay, busy):
        code, out, _ = replay(busy, "--json", "--episodes", "1")
        found = json.loads(out)
        size = (busy / "replay.html").stat().st_size
        assert code == 0
        assert found == {
            "html": str(busy / "replay.html"),
            "bytes": size,
            "episodes": [1],
            "left_out": [],
            "played_again": False,
        }

    def test_opens_it(self, replay, busy, monkeypatch):
        opened = []
        monkeypatch.setattr("webbrowser.open", opened.append)
        replay(busy, "--open")
        assert opened == [(busy / "replay.html").as_uri()]

    def test_says_what_it_leaves_out(self, replay, busy, monkeypatch):
        monkeypatch.setattr("desim_uav.experiment.replay.page.MOST_BYTES", 1)
        code, _, err = replay(busy)
        assert code == 0
        assert "it holds episodes 0 to 0" in err and "--episodes" in err

    @pytest.mark.parametrize(
        ("arguments", "code", "part"),
        [
            (["nowhere"], 4, "no such run folder"),
            ([], 2, "RUN_DIR"),
        ],
    )
    def test_what_is_no_run(self, replay, arguments, code, part):
        ended, out, err = replay(*arguments)
        assert (ended, out) == (code, "")
        assert part in err and "Traceback" not in err

    def test_errors_are_one_line(self, replay, busy):
        code, out, err = replay(busy, "--episodes", "7")
        assert (code, out) == (2, "")
        assert "there is no episode 7; there are -1 to 1" in err
        code, out, err = replay(busy, "--html", "page.pdf")
        assert code == 2 and "--html page.pdf: the file's name must end in .html" in err
        code, out, err = replay(busy, "--html", busy / "world.json/page.html")
        assert (code, out) == (2, "")
        assert err.startswith("desim-uav: --html ") and "world.json/page.html: " in err
        (busy / "world.json").write_text("{}", encoding="utf-8")
        (busy / SUMS).unlink()
        code, out, err = replay(busy)
        assert (code, out, err) == (
            4,
            "",
            f"desim-uav: {busy / 'world.json'}: not the world of a run: size_m: missing\n",
        )
