"""Levels, ratios and classes of links over time and on maps, against events and by hand."""

from math import atan2, degrees, exp, log10, pi
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import desim_uav as du
from desim_uav.errors import UsageError
from desim_uav.model.rules import Phase

RADIO = {"kind": "link_classes", "power_dbm": 10, "bandwidth_mhz": 2, "interference": "co_channel"}
MAST = RADIO | {"power_dbm": 8, "classes": "mcs", "path_loss": {"kind": "free_space"}}
TOWN = {
    "name": "town",
    "map": {
        **{"size_m": [1000, 800], "cells": [5, 4], "dimensions": 3},
        **{
            "levels": {"min_altitude_m": 60, "max_altitude_m": 90, "step_m": 30},
            "obstacles": {"cells": [[2, 1, 55]]},
        },
    },
    "drones": {"count": 3, "radio": RADIO, "battery": {"autonomy_min": 6}},
    "access_points": [{"at_m": [305, 405], "height_m": 20, "radio": MAST}],
    "association": "strongest",
    "stations": {"count": 2},
    "users": {"count": 8, "mobility": {"kind": "random_walk"}},
    "services": {"file": {"kind": "transfer", "volume_mbit": [20]}},
    "demand": {"kind": "dynamic", "mix": {"file": 1}},
    "episode": {"steps": 12},
}
TOWN["drones"]["radio"] = RADIO | {"sharing": "equal"}
TOWN["access_points"][0]["radio"] = MAST | {"sharing": "equal"}
DRAWN = Path(__file__).parent / "radio.yaml"
NEAR_DB = 6e-5
"""A ratio so near to a threshold may be on either side of it (docs/explanation/sinr.md)."""


def run(scenario, overrides=None, **how):
    usual = {"policy": "random", "engine": "des", "episodes": 1, "warmup": 0}
    return du.run(scenario, overrides, **usual | {"events": True, "progress": False} | how)


@pytest.fixture(scope="module")
def town():
    return run(TOWN)


@pytest.fixture(scope="module")
def drawn():
    """Drawn lines of sight, shadowing and interference; the second episode, after another one."""
    return run(DRAWN, episodes=2)


def thresholds(result, drone):
    fleet = result.scenario.fleet
    own = [each.radio for each in fleet for _ in range(each.count)]
    own += [point.radio for point in result.scenario.access_points]
    return np.array([each.snr_db for each in own[drone].ladder])


def assert_classes_are_those_of_the_ratios(result, frame, at_changes=False):
    assert (frame["link_class"][frame["sinr_db"].isna()] == 0).all()
    heard = frame.dropna(subset="sinr_db")
    for drone, own in heard.groupby("drone"):
        limits_db, ratios = thresholds(result, drone), own["sinr_db"].to_numpy()
        near = np.abs(ratios[:, None] - limits_db).min(axis=1) <= NEAR_DB
        reached = (ratios[:, None] >= limits_db).sum(axis=1)
        assert (near | (reached == own["link_class"])).all()
        assert at_changes or near.mean() < 0.01


@pytest.mark.parametrize("name", ["town", "drawn"])
def test_the_class_is_that_of_the_ratio(name, request):
    result = request.getfixturevalue(name)
    frame = result.levels(every_s=7.3)
    assert frame["link_class"].nunique() > 4
    assert_classes_are_those_of_the_ratios(result, frame)
    assert_classes_are_those_of_the_ratios(result, result.levels(), at_changes=True)


@pytest.mark.parametrize("name", ["town", "drawn"])
def test_the_class_changes_where_the_events_say_so(name, request):
    result = request.getfixturevalue(name)
    episode = 1 if name == "drawn" else 0
    frame = result.levels(episode=episode).assign(t_us=lambda f: (f["t_s"] * 1e6).round())
    events = result.events
    events = events[events["kind"].isin(["enter", "class", "exit"])]
    ended = (events["t_us"] == frame["t_us"].max()) & (events["phase"] > Phase.ATTACHMENT)
    events = events[(events["episode"] == episode) & ~ended]
    assert len(events) > 50
    last = events.groupby(["t_us", "user", "drone"])["link_class"].last().fillna(0)
    told = frame.set_index(["t_us", "user", "drone"])["link_class"]
    assert (told.reindex(last.index).to_numpy() == last.to_numpy()).all()
    ordered = frame.sort_values(["user", "drone", "t_us"])
    steps = ordered.groupby(["user", "drone"])["link_class"].diff().fillna(0) != 0
    changed = set(map(tuple, ordered[steps][["t_us", "user", "drone"]].astype(int).to_numpy()))
    assert changed <= set(last.index)


def test_ratios_cross_the_threshold_in_the_microsecond_of_the_event(town):
    events = town.events
    events = events[events["kind"].isin(["enter", "class", "exit"])].iloc[::3]
    events = events[~events["t_us"].isin(town.steps["t_s"] * 1e6) & (events["t_us"] > 0)]
    times_s = [t_us / 1e6 for t in events["t_us"] for t_us in (t - 2, t + 2)]
    frame = town.levels(at_s=times_s).assign(t_us=lambda f: (f["t_s"] * 1e6).round().astype(int))
    frame = frame.set_index(["user", "drone", "t_us"])[["sinr_db", "link_class"]]
    crossings = 0
    for t_us, user, drone in events[["t_us", "user", "drone"]].astype(int).to_numpy():
        around = frame.loc[[(user, drone, t_us - 2), (user, drone, t_us + 2)]]
        reached = (around["sinr_db"].to_numpy()[:, None] >= thresholds(town, drone)).sum(axis=1)
        assert (reached == around["link_class"]).all()
        crossings += reached[0] != reached[1]
    assert crossings > 50


def loss_db(distance_m, height_m, carrier_ghz, town):
    away_m = (distance_m**2 + height_m**2) ** 0.5
    free = 20 * log10(4 * pi * away_m * carrier_ghz * 1e9 / 299_792_458.0)
    if not town:
        return free
    a, b, los_db, nlos_db = 9.61, 0.16, 1.0, 20.0
    share = 1 / (1 + a * exp(-b * (degrees(atan2(height_m, distance_m)) - a)))
    return free + share * los_db + (1 - share) * nlos_db


def test_levels_by_an_own_formula(town):
    """At the ends of steps, where the table of steps has the drones' places."""
    steps, users = town.steps, town.users
    frame = town.levels(at_s=sorted(set(steps["t_s"])))
    noise_dbm, checked = -174 + 7 + 10 * log10(2e6), 0
    for t_s, own in steps[steps["t_s"] < steps["t_s"].max()].groupby("t_s"):
        places = own.set_index("drone")[["x_m", "y_m", "z_m"]]
        now = frame[frame["t_s"] == t_s]
        on = sorted(set(now["drone"][now["level_dbm"].notna()]))  # some take off or land just then
        assert 3 in on
        for user, walk in users.groupby("user"):
            x, y, z = (np.interp(t_s, walk["t_s"], walk[name]) for name in ("x_m", "y_m", "z_m"))
            level = {}
            for drone in on:
                at = [305.0, 405.0, 20.0] if drone == 3 else places.loc[drone].tolist()
                away_m = ((at[0] - x) ** 2 + (at[1] - y) ** 2) ** 0.5
                power = 8 if drone == 3 else 10
                level[drone] = power - loss_db(away_m, at[2] - z, 2.0, drone != 3)
            mw = {drone: 10 ** (dbm / 10) for drone, dbm in level.items()}
            rows = now[now["user"] == user].set_index("drone")
            rows = rows.drop(columns="attached_to")
            for drone in range(4):
                row = rows.loc[drone]
                if drone not in level:
                    assert np.isnan(row["level_dbm"]) and row["link_class"] == 0
                    continue
                others = 10 ** (noise_dbm / 10) + sum(v for k, v in mw.items() if k != drone)
                assert row["level_dbm"] == pytest.approx(level[drone], abs=1e-9)
                assert row["snr_db"] == pytest.approx(level[drone] - noise_dbm, abs=1e-9)
                sinr_db = level[drone] - 10 * log10(others)
                assert row["sinr_db"] == pytest.approx(sinr_db, abs=1e-9)
                checked += 1
    assert checked > 100


def test_the_drone_that_a_user_is_attached_to_is_the_strongest_that_covers_it(town):
    frame = town.levels(every_s=11.0)
    covering = frame[frame["link_class"] > 0]
    best = covering.loc[covering.groupby(["t_s", "user"])["level_dbm"].idxmax()]
    held = frame.groupby(["t_s", "user"])["attached_to"].first()
    held = held[best.set_index(["t_s", "user"]).index]
    assert len(best) > 100 and (held.to_numpy() == best["drone"].to_numpy()).all()
    free = frame.groupby(["t_s", "user"])["link_class"].max() == 0
    assert frame.groupby(["t_s", "user"])["attached_to"].first()[free].isna().all()


@pytest.mark.thorough
@pytest.mark.parametrize("scenario", [TOWN, DRAWN])
def test_both_engines_have_the_same_links(scenario):
    frames = [run(scenario, engine=engine).levels() for engine in ("des", "batch")]
    pd.testing.assert_frame_equal(*frames, check_exact=True)


def test_a_run_that_kept_no_events_is_played_again(town, tmp_path):
    bare = run(TOWN, events=False)
    pd.testing.assert_frame_equal(bare.levels(2, [0, 3]), town.levels(2, [0, 3]))
    folder = bare.save(tmp_path / "run")[0]
    file = du.write_levels(folder, user=2, every_s=50.0, progress=False)
    read = pd.read_csv(file, dtype={"attached_to": "Int64"})
    assert file == folder / "levels.csv"
    pd.testing.assert_frame_equal(read, town.levels(2, every_s=50.0), check_exact=True)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"user": 8}, "user: 8: the users are 0 to 7"),
        ({"drone": [0, 4]}, "drone: 4: the drones and access points are 0 to 3"),
        ({"at_s": 721}, "at_s: 721: the episode is from 0 to 720 s"),
        *(
            ({"every_s": step}, f"^every_s: {text}: must be finite, and at least 1e-06 s$")
            for step, text in ((0.0, "0"), (-1.0, "-1"), (np.nan, "nan"), (np.inf, "inf"))
        ),
        *(({name: []}, f"^{name}: give at least one") for name in ("user", "drone", "at_s")),
        ({"at_s": [1.0, np.nan]}, "at_s: nan: the episode is from 0 to 720 s"),
        ({"every_s": 1.0, "at_s": 2.0}, "give either a step or times"),
        ({"every_s": 1e-5}, "more than 20,000,000 rows"),
        ({"episode": 3}, "^episode: 3: town, random, seed 0 has the episodes 0 to 0"),
    ],
)
def test_what_is_refused(town, how, message):
    with pytest.raises(UsageError, match=message):
        town.levels(**how)


@pytest.mark.parametrize("minute", [-1000, -1, -0.001, 12.001, 1e308, np.nan, np.inf, -np.inf])
def test_a_minute_is_within_the_episode(town, minute):
    with pytest.raises(UsageError) as refused:
        town.map(minute)
    assert str(refused.value) == f"minute: {minute:g}: episode 0 is from minute 0 to 12"


def test_the_first_and_the_last_minute_are_in_the_episode(town):
    pd.testing.assert_frame_equal(town.map(0.0, points=5), town.map(-1e-12, points=5))
    assert len(town.map(12, points=5)) == 20


@pytest.mark.parametrize("every_s", [0.0, -1.0, np.nan, np.inf, 1e308])
def test_a_map_has_a_step_of_a_millisecond_at_least(town, every_s):
    with pytest.raises(UsageError) as refused:
        town.map(every_s=every_s)
    assert str(refused.value) == f"every_s: {every_s:g}: must be finite, and at least 0.001 s"


@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_snapshot_is_of_a_minute_of_the_episode(town, dimensions):
    result = town if dimensions == 3 else run("tiny")
    lasts = result.episodes["duration_s"].iloc[0] / 60
    result.plot("snapshot", minute=lasts)
    with pytest.raises(UsageError, match=f"^minute: {lasts + 1:g}: episode 0 is from minute 0 to"):
        result.plot("snapshot", minute=lasts + 1)


def test_the_paper_s_disc_has_no_levels():
    result = run("tiny")
    with pytest.raises(UsageError, match=r"tiny: its links have no level.*link_classes"):
        result.levels()
    frame = result.map(1, points=20)
    assert frame[["level_dbm", "snr_db", "sinr_db"]].isna().all().all()
    radius_m = result.scenario.drones.footprint_radius_m
    at = result.steps.query("step == 0").iloc[0]
    away_m = np.hypot(frame["x_m"] - at["x_m"], frame["y_m"] - at["y_m"])
    assert (frame["link_class"] == (away_m <= radius_m)).all() and frame["link_class"].any()
    assert (frame["drone"].notna() == (away_m <= radius_m)).all()


@pytest.mark.parametrize("sight", ["mean", "buildings"])
def test_a_place_receives_what_a_user_there_does(sight):
    """Users who stand where the map has places."""
    places = [[x, y] for x in (25.0, 375.0, 475.0, 725.0) for y in (25.0, 175.0, 425.0, 775.0)]
    users = {"users": {"positions_m": places, "mobility": {"kind": "static"}}}
    own = {"drones.radio": RADIO | {"sharing": "equal", "line_of_sight": sight}}
    result = run(TOWN | users, overrides=own)
    frame = result.map(3.5, points=20)
    links = result.levels(at_s=210.0)
    covering = links.assign(merit=links["level_dbm"] + 1e6 * (links["link_class"] > 0))
    best = covering.dropna(subset="merit").set_index("user")
    best = best.loc[best.groupby("user")["merit"].idxmax().index].sort_values("merit")
    best = best.groupby(level="user").last()
    where = frame.set_index(["x_m", "y_m"])
    for user, place in enumerate(places):
        row, one = where.loc[tuple(place)], best.loc[user]
        for name in ("level_dbm", "snr_db", "sinr_db", "link_class"):
            assert row[name] == one[name], (place, name)
        assert (row["drone"] == one["drone"]) if one["link_class"] else pd.isna(row["drone"])


def test_the_mean_map_is_the_mean_of_maps(town):
    maps = [town.map(minute, points=10) for minute in (2.0, 6.0, 10.0)]
    mean = town.map(points=10, every_s=240.0)
    for name in ("link_class", "snr_db", "sinr_db", "level_dbm"):
        apart = sum(each[name] for each in maps) / 3
        np.testing.assert_allclose(mean[name], apart, rtol=1e-12)
    covered = sum(each["drone"].notna() for each in maps) / 3
    np.testing.assert_allclose(mean["covered"], covered)


def test_a_figure_of_maps(town, tmp_path):
    figure = town.plot("map", tmp_path / "map.csv", minute=3)
    read = pd.read_csv(tmp_path / "map.csv", dtype={"drone": "Int64"})
    pd.testing.assert_frame_equal(read, town.map(3), check_exact=True)
    titles = [axes.get_title(loc="left") or axes.get_title() for axes in figure.axes]
    assert [title.split(" of")[0] for title in titles if title] == [
        *("class", "SNR", "SINR", "who has the best link")
    ]
    assert len(town.plot("map", tmp_path / "map.parquet").table) == 100 * 80
    assert len(pd.read_parquet(tmp_path / "map.parquet")) == 100 * 80
    with pytest.raises(UsageError, match=r"^minute: 13: episode 0 is from minute 0 to 12$"):
        town.plot("map", minute=13)
    with pytest.raises(UsageError, match=r"must end in \.png, \.pdf or \.svg"):
        town.plot("visits", tmp_path / "visits.csv")
