"""What is allowed and hardly meant is told: recordings, places, and requests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from desim_uav.errors import ScenarioError
from desim_uav.scenario.doubts import doubts, recordings
from desim_uav.scenario.load import dump, load, loads, scenario_hash
from desim_uav.shipped import scenario_names, scenario_path
from desim_uav.world import build_world

WALKS = "user,t_s,x_m,y_m\n"
REQUESTS = "user,t_s,service,required_s,bandwidth_kbps\n"


def fcd(*steps: tuple[float, str]) -> str:
    inner = "\n".join(f'<timestep time="{time}">{movers}</timestep>' for time, movers in steps)
    return f"<fcd-export>\n{inner}\n</fcd-export>\n"


def car(name: str, x_m: float, y_m: float) -> str:
    return f'<vehicle id="{name}" x="{x_m}" y="{y_m}"/>'


def told(tmp_path: Path, text: str, *overrides: str, users: int = 3) -> list[str]:
    """Return the doubts about a scenario whose users walk as in a file, which lasts 180 s."""
    (tmp_path / "walks").write_text(text, encoding="utf-8")
    return list(doubts(walked(tmp_path, *overrides, users=users)))


def walked(tmp_path: Path, *overrides: str, users: int = 3):
    return loads(
        f"users: {{count: {users}, mobility: {{kind: trace, file: walks}}}}\nepisode: {{steps: 3}}",
        base=tmp_path,
        overrides=overrides,
    )


def legs_of(scenario, user: int) -> list[list[float]]:
    legs, offsets = build_world(scenario, 0).walks(0, 0)
    return [list(leg) for leg in legs[offsets[user] : offsets[user + 1]].tolist()]


def test_no_shipped_scenario_is_doubted():
    for name in scenario_names():
        assert list(doubts(load(scenario_path(name)))) == []
        assert list(recordings(load(scenario_path(name)))) == []


GEO = fcd((0, car("a", 8.541232, 47.376888)), (60, car("a", 8.542232, 47.377888)))


def test_longitudes_and_latitudes(tmp_path: Path):
    (doubt,) = told(tmp_path, GEO)
    assert doubt.startswith("users.mobility: ")
    assert "x 8.54123 to 8.54223 m, y 47.3769 to 47.3779 m" in doubt
    assert "hardly metres but longitudes and latitudes in degrees" in doubt
    table = WALKS + "0,0,8.541232,47.376888\n0,60,8.542232,47.377888\n1,0,88.5,47\n"
    assert "in degrees" in told(tmp_path, table)[0]  # far apart, but nobody moves as fast as 1 cm/s


def test_longitudes_and_latitudes_off_the_map(tmp_path: Path):
    with pytest.raises(ScenarioError, match=r"2: \(-0.1, 51.5\) m is off the map .*degrees"):
        told(tmp_path, fcd((0, car("a", -0.1, 51.5)), (9, car("a", -0.1, 51.5001))))


@pytest.mark.parametrize(
    "text",
    [
        WALKS + "0,0,8,47\n0,60,8,47\n",
        WALKS + "0,0,8,47\n0,60,40,47\n",
        WALKS + "0,0,8,47\n1,0,40,47\n",
    ],
)
def test_who_stands_or_walks_near_the_corner_is_not_doubted(tmp_path: Path, text: str):
    assert told(tmp_path, text) == []


def test_containers_are_left_out_with_a_word(tmp_path: Path):
    more = '<container id="c" x="90" y="90"/>'
    (doubt,) = told(tmp_path, fcd((0, car("a", 10, 20) + more), (60, car("a", 70, 20) + more)))
    assert doubt.endswith("walks: 1 container left out; the users are vehicles and persons")


def test_only_containers_are_refused_at_the_file_s_key(tmp_path: Path):
    with pytest.raises(ScenarioError, match=r"1:49: users.mobility.file: .*1 containers, but no"):
        told(tmp_path, fcd((0, '<container id="c" x="90" y="90"/>')))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (fcd((900, car("a", 1, 2)), (960, car("a", 9, 2))), "lasts from 900 to 960 s"),
        (WALKS + "0,900,1,2\n0,960,9,2\n1,0,5,5\n", "lasts from 0 to 960 s"),
        (WALKS, "it has no way points; all users stay at home"),
    ],
)
def test_times_outside_an_episode(tmp_path: Path, text: str, words: str):
    (doubt,) = told(tmp_path, text)
    assert words in doubt
    if text != WALKS:
        assert "nobody moves in an episode of 180 s that begins at begin_s: 0" in doubt


def test_some_appear_too_late(tmp_path: Path):
    text = fcd((0, car("a", 1, 2)), (60, car("a", 9, 2)), (180, car("b", 4, 4)))
    (doubt,) = told(tmp_path, text)
    assert "1 of 2 vehicles and persons appear after the end of an episode at 180 s" in doubt


def test_an_episode_that_begins_within_the_recording(tmp_path: Path):
    text = fcd(
        (0, car("gone", 1, 2) + car("a", 10, 20)),
        (100, car("a", 110, 20)),
        (160, car("b", 7, 7) + car("a", 110, 80)),
    )
    assert told(tmp_path, text, "users.mobility.begin_s=50") == []
    scenario = walked(tmp_path, "users.mobility.begin_s=50")
    us = 1e6
    assert legs_of(scenario, 0) == [
        [0, 60, 20, 1, 0],
        [50 * us, 110, 20, 0, 1],
        [110 * us, 110, 80, 0, 0],
    ]
    assert legs_of(scenario, 1) == [[0, 7, 7, 0, 0], [110 * us, 7, 7, 0, 0]]
    (line,) = recordings(scenario)
    assert line == (
        "users.mobility: walks: 3 vehicles; x 1 to 110 m, y 2 to 80 m; 0 to 160 s, of which an "
        "episode has 50 to 230 s; 1 of 3 users stay at home"
    )


def test_the_same_in_a_table_whose_users_keep_their_numbers(tmp_path: Path):
    text = WALKS + "0,0,1,2\n2,0,10,20\n2,100,110,20\n"
    assert told(tmp_path, text, "users.mobility.begin_s=100") == [
        f"users.mobility: {tmp_path / 'walks'}: nobody moves in an episode of 180 s that begins "
        "at begin_s: 100; the recording lasts from 0 to 100 s"
    ]
    scenario = walked(tmp_path, "users.mobility.begin_s=100")
    assert legs_of(scenario, 0) == [[0, 1, 2, 0, 0]]
    assert legs_of(scenario, 2) == [[0, 110, 20, 0, 0]]


def test_an_episode_that_begins_after_the_recording(tmp_path: Path):
    with pytest.raises(ScenarioError, match="it ends at 9 s, before begin_s: 50"):
        told(tmp_path, fcd((9, car("a", 1, 2))), "users.mobility.begin_s=50")


def test_negative_coordinates_need_an_offset(tmp_path: Path):
    text = fcd((0, car("a", 5.1, -1.65)), (1, car("a", 6.54, -1.65)))
    with pytest.raises(ScenarioError, match=r"offset_m: \[0, 1.65\] moves the recording onto it"):
        told(tmp_path, text)
    shift = "users.mobility.offset_m=[100, 1.65]"
    assert told(tmp_path, text, shift) == []
    first, _ = legs_of(walked(tmp_path, shift), 0)
    assert first[:3] == [0, 105.1, 0]
    assert first[3:] == pytest.approx([1.44, 0])
    with pytest.raises(ScenarioError, match=r"is off the map.*offset_m: \[-5, 1.65\]"):
        told(tmp_path, text, "users.mobility.offset_m=[-5, 0]")


def test_the_new_keys_are_kept_and_leave_hashes_as_they_were(tmp_path: Path):
    text = WALKS + "0,0,1,2\n"
    told(tmp_path, text)
    plain, moved = walked(tmp_path), walked(tmp_path, "users.mobility.begin_s=7")
    zero = walked(tmp_path, "users.mobility.begin_s=0", "users.mobility.offset_m=[0, 0]")
    assert scenario_hash(plain) == scenario_hash(zero) != scenario_hash(moved)
    assert loads(dump(moved)).users.mobility.begin_s == 7.0


def asked(tmp_path: Path, text: str, *overrides: str):
    (tmp_path / "asks").write_text(REQUESTS + text, encoding="utf-8")
    return loads("demand: {kind: trace, file: asks}", base=tmp_path, overrides=overrides)


def test_requests_outside_an_episode(tmp_path: Path):
    text = "0,100,throughput,60,96\n1,1900,throughput,60,96\n2,1799.9,throughput,60,96\n"
    scenario = asked(tmp_path, text)
    (doubt,) = doubts(scenario)
    assert "1 of 3 requests are left out" in doubt
    assert doubt.endswith("from begin_s: 0 to before 1800 s")
    assert list(recordings(scenario)) == [
        "demand: asks: 3 requests of 3 users; 100 to 1900 s, of which an episode has 0 to 1800 s"
    ]
    later = asked(tmp_path, text, "demand.begin_s=100")
    (doubt,) = doubts(asked(tmp_path, text, "demand.begin_s=101"))
    assert "1 of 3 requests are left out" in doubt
    assert doubt.endswith("from begin_s: 101 to before 1901 s")
    assert list(doubts(later)) == [
        f"demand: {tmp_path / 'asks'}: 1 of 3 requests are left out, because they are not made "
        "within an episode: from begin_s: 100 to before 1900 s"
    ]
    requests = build_world(later, 0).requests(0, 0)
    assert requests.rows[:, 0].tolist() == [0, 1_699_900_000]
    (none,) = doubts(asked(tmp_path, ""))
    assert none.endswith("it has no requests")


def test_requests_that_no_drone_can_serve(tmp_path: Path):
    (doubt,) = doubts(asked(tmp_path, "0,1,throughput,60,9000\n0,99,throughput,60,96\n"))
    assert "throughput: requests for 9000 kbit/s are never served" in doubt
    assert "no drone has more than 5000 kbit/s" in doubt
    (doubt,) = doubts(loads("drones: {bandwidth_kbps: 2000}"))
    assert doubt.startswith("services.throughput: requests for 2500 kbit/s are never served")
    assert list(doubts(loads("drones: {bandwidth_kbps: null}"))) == []
    assert (
        list(doubts(loads("drones: {bandwidth_kbps: 50}\ndemand: {mix: {edge_computing: 1}}")))
        == []
    )


@pytest.mark.parametrize(
    "demand",
    [
        "{kind: poisson, rate_per_hour: 1.0e-4}",
        "{kind: profile, begins_at_h: 3, profiles: [[[0, 0], [7, 60], [9, 0]]]}",
    ],
)
def test_hardly_any_requests(demand: str):
    (doubt,) = doubts(loads(f"demand: {demand}"))
    assert doubt.startswith("demand: only ")
    assert "requests are expected in an episode, of all users together" in doubt


ZONE = "drones: {motion: {space: free}}\nmap: {dimensions: 2, no_fly: [{polygon_m: %s}]}\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("users: {positions_m: [[8.54, 47.37], [8.55, 47.38]]}", "users.positions_m: x 8.54 to"),
        (ZONE % "[[8.54, 47.37], [8.55, 47.37], [8.55, 47.38]]", "longitudes and latitudes"),
        (ZONE % "[[2400, 0], [3000, 0], [3000, 9]]", "is off the map of 2400 x 2400 m"),
        (ZONE % "[[0, 5000], [9, 5000], [9, 6000]]", "map.no_fly.0.polygon_m: x 0 to 9 m"),
    ],
)
def test_places_that_are_not_on_the_map(text: str, words: str):
    (doubt,) = doubts(loads(text))
    assert words in doubt


@pytest.mark.parametrize(
    "text",
    [
        "users: {positions_m: [[8, 47]]}",
        "users: {positions_m: [[8, 47], [9, 48]]}",
        ZONE % "[[2300, 0], [3000, 0], [3000, 9]]",
    ],
)
def test_places_that_may_be_meant(text: str):
    assert list(doubts(loads(text))) == []


def test_walks_of_a_recording_are_the_same_without_the_new_keys(tmp_path: Path):
    told(tmp_path, WALKS + "0,12.5,100,100\n0,300,900,300.3\n0,301.5,902,0\n")
    scenario = walked(tmp_path)
    seconds = 287.5
    expected = [
        [0, 100, 100, 0, 0],
        [12.5e6, 100, 100, 800 / seconds, (300.3 - 100) / seconds],
        [300e6, 900, 300.3, 2 / 1.5, (0 - 300.3) / 1.5],
        [301.5e6, 902, 0, 0, 0],
    ]
    assert np.array_equal(legs_of(scenario, 0), expected)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("map: {dimensions: 2}\nassociation: strongest\n", "association compares levels"),
        ("", "drones climb (map.dimensions: 3, map.obstacles)"),
        ("map: {dimensions: 2}\n", ""),
    ],
)
def test_a_path_loss_without_slope(text: str, words: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    loss = '{kind: "radio_plug_ins:Flat"}'
    text += f"drones: {{radio: {{kind: link_classes, path_loss: {loss}}}}}"
    found = list(doubts(loads(text)))
    assert len(found) == bool(words)
    for doubt in found:
        assert doubt.startswith("drones.radio.path_loss: it has no method slope")
        assert doubt.endswith(f"it is needed because {words}")


def test_a_map_in_3d_with_one_level():
    (doubt,) = doubts(loads("map: {obstacles: null}"))
    assert doubt.startswith("map.dimensions: 3: there is one level, at 20 m")
    assert "map.levels.max_altitude_m adds levels" in doubt
    assert list(doubts(loads("map: {obstacles: null, levels: {max_altitude_m: 60}}"))) == []
    assert list(doubts(loads("map: {dimensions: 2}"))) == []


def test_losses_that_were_fitted_at_another_carrier():
    radio = "drones: {radio: {kind: link_classes, carrier_ghz: %s, path_loss: %s}}"
    town = "{kind: al_hourani, environment: urban}"
    (doubt,) = doubts(loads(radio % (28, town)))
    assert doubt.startswith("drones.radio.path_loss: the numbers of 'urban' are for 2 GHz")
    assert "carrier_ghz is 28" in doubt
    own = "{kind: al_hourani, a: 9.6, b: 0.16, eta_los_db: 1, eta_nlos_db: 25}"
    for carrier_ghz, loss in ((2, town), (3.5, town), (28, own)):
        assert list(doubts(loads(radio % (carrier_ghz, loss)))) == []


def test_a_band_for_uploads_that_nothing_uses():
    told = "drones: {radio: {kind: link_classes, uplink_mhz: 5}}\n"
    (doubt,) = [one for one in doubts(loads(told)) if "uplink_mhz" in one]
    assert doubt == (
        "drones.radio.uplink_mhz: 5: this band is idle, because no service has uploads (inputs of "
        "kind compute, or updates of kind collect)"
    )
    told = told.replace("uplink_mhz: 5}", "sharing: equal, uplink_mhz: 5}, processor: {}")
    told += "services: {see: {kind: compute, input_mbit: [1], cycles_per_bit: [9]}}\n"
    told += "demand: {kind: dynamic, mix: {see: 1}}\nreward: {kind: coverage_battery}\n"
    assert not list(doubts(loads(told)))


def test_a_synthetic_city_does_not_give_the_curve_of_al_hourani():
    city = "map: {buildings: {kind: itu, alpha: 0.3, beta: 300, gamma: 12}}"
    assert list(doubts(loads(city))) == [
        "map.buildings: kind: itu: the share of links with line of sight does not follow the "
        "curve of al_hourani"
    ]
