"""Recorded requests for volumes and computing: values by hand, errors, the same run as drawn."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from desim_uav import cli
from desim_uav.errors import ScenarioError
from desim_uav.model.catalogue import catalogue
from desim_uav.model.demand.demand import Trace
from desim_uav.model.demand.recorded import recorded_values
from desim_uav.model.services import Compute, Transfer, UniformChoice
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world
from tests.engine.random_aerial import unlike
from tests.verification.engines import engines, row

SERVICES = {
    "call": UniformChoice((1.0,), (64.0,)),
    "file": Transfer((3.0, 8.0)),
    "task": Compute((0.2, 1.0), (500.0, 1000.0), (0.5,)),
}
HEADER = "user,t_s,service,required_s,bandwidth_kbps,volume_mbit,input_mbit,cycles_per_bit\n"


def file_of(folder: Path, text: str, header: str = HEADER) -> Path:
    file = folder / "requests.csv"
    file.write_text(header + text, encoding="utf-8")
    return file


def test_values_are_in_the_units_of_the_service(tmp_path):
    text = "0,1,call,60,64,,,\n0,2,file,,,0.25,,\n1,3,task,,,,0.7,250.5\n"
    values, problems = recorded_values(file_of(tmp_path, text), SERVICES)
    assert problems == []
    assert values == {
        2: [60_000_000, 64_000],
        3: [250_000_000_000, 0],  # 0.25 Mbit in millionths of a bit
        4: [700_000, 250_500, 500_000, 0],  # bits, thousandths of a cycle, the only output
    }


def test_rows_have_a_column_for_each_value_that_any_service_draws(tmp_path):
    trace = Trace(file_of(tmp_path, "1,3,task,,,,0.7,250.5\n1,2,call,60,64,,,\n"))
    own = trace.requests(2, catalogue(SERVICES, dict.fromkeys(SERVICES, 1)), None, 10**8)
    assert own.rows.tolist() == [
        [2_000_000, 0, 60_000_000, 64_000, 0, 0],
        [3_000_000, 2, 700_000, 250_500, 500_000, 0],
    ]
    assert own.offsets.tolist() == [0, 0, 2]


@pytest.mark.parametrize(
    "text, problem",
    [
        ("0,1,call,,64,,,\n", "requests.csv:2: required_s: missing; call asks for a time"),
        ("0,1,call,9,,,,\n", "requests.csv:2: bandwidth_kbps: missing; call asks for a time"),
        ("0,1,file,,,,,\n", "requests.csv:2: volume_mbit: missing; services.file has 2 values"),
        ("0,1,file,,,0,,\n", "requests.csv:2: volume_mbit: 0: must be at least 1e-12"),
        ("0,1,file,,,9e6,,\n", "requests.csv:2: volume_mbit: 9e6: must be at most 1e\\+06"),
        ("0,1,task,,,,1,\n", "requests.csv:2: cycles_per_bit: missing; services.task has 2"),
        (
            "0,1,call,9,9,,,\n0,1,task,,,,2,500\n",
            "requests.csv:3: input_mbit: 2: must be at most 1, the largest of services.task",
        ),
        ("0,1,task,,,,0,500\n", "requests.csv:2: input_mbit: 0: must be at least 1e-06"),
        (
            "0,1,file,,5,3,,\n",
            "requests.csv:2: bandwidth_kbps: 5: services.file must have bandwidth_kbps to take",
        ),
    ],
)
def test_each_problem_has_its_line(tmp_path, text, problem):
    made = scenario(None) | {"services": described()}
    made["demand"] = {"kind": "trace", "file": str(file_of(tmp_path, text))}
    with pytest.raises(ScenarioError, match=problem):
        from_mapping(made)


def test_all_that_is_no_number_is_found_at_once(tmp_path, capsys, monkeypatch):
    lines = [f"0,1,file,,,{cell},," for cell in ("x", "-20", "nan", "inf", "1e400", "2e9")]
    lines += ["0,1,task,,,,-1,nan", f"0,1,{'f' * 500},,,1,,"]
    file_of(tmp_path, "".join(f"{line}\n" for line in lines))
    text = yaml.safe_dump(scenario({"kind": "trace", "file": "requests.csv"}))
    (tmp_path / "own.yaml").write_text(text, encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["desim-uav", "validate", str(tmp_path / "own.yaml")])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    told = [line.split("requests.csv:")[-1] for line in capsys.readouterr().err.splitlines()]
    assert ended.value.code == 3
    unknown = told.pop(0)
    assert unknown.startswith("9: service: 'ffff") and len(unknown) < 300
    finite = "must be a finite number, at least 0"
    assert told == [
        "2: volume_mbit: x: must be a number",
        "3: volume_mbit: -20: must be at least 0",
        f"4: volume_mbit: nan: {finite}",
        f"5: volume_mbit: inf: {finite}",
        f"6: volume_mbit: 1e400: {finite}",
        "7: volume_mbit: 2e9: must be at most 1,000,000,000",
        "8: input_mbit: -1: must be at least 0",
        f"8: cycles_per_bit: nan: {finite}",
    ]


def test_updates_are_for_sensors(tmp_path):
    made = scenario(None)
    made["services"] = {
        "reading": {"kind": "collect", "updates": {"kind": "periodic", "every_s": 9}}
        | {"size_mbit": [1]}
    }
    file = file_of(tmp_path, "0,1,reading,,,,,\n")
    made["demand"] = {"kind": "trace", "file": str(file)}
    with pytest.raises(ScenarioError, match=r"requests\.csv:2: service: 'reading': only sensors"):
        from_mapping(made)


def described() -> dict:
    return {
        "call": {"kind": "hold", "duration_min": [1.0], "bandwidth_kbps": [64]},
        "file": {"kind": "transfer", "volume_mbit": [3, 8]},
        "task": {
            "kind": "compute",
            "input_mbit": [0.2, 1.0],
            "cycles_per_bit": [500, 1000],
            "output_mbit": [0.5],
            "deadline_s": 30,
        },
    }


def scenario(demand: dict | None) -> dict:
    """Drones with a radio and a processor, and users who ask for all three services."""
    return {
        "map": {"size_m": [960, 960], "cells": [4, 4]},
        "drones": {
            "count": 2,
            "radio": {"kind": "link_classes", "power_dbm": 10, "sharing": "equal"},
            "processor": {"ghz": 0.3},
        },
        "users": {"count": 12},
        "services": described(),
        "demand": demand,
        "episode": {"steps": 8},
    }


def recorded(folder: Path, world) -> Path:
    """The requests that an episode draws, written as a trace."""
    asked, services = draw(world, 1, 0).requests, world.scenario.services
    lists = [list(service.values()) for service in services.values()]
    columns = dict.fromkeys(name for own in lists for name in own if name != "duration_min")
    lines = [",".join(("user", "t_s", "service", "required_s", *columns)) + "\n"]
    units = {"volume_mbit": 1e12, "input_mbit": 1e6, "cycles_per_bit": 1e3, "output_mbit": 1e6}
    users = np.repeat(np.arange(len(asked.offsets) - 1), np.diff(asked.offsets))
    for user, (due_us, service, *drawn) in zip(users, asked.rows.tolist(), strict=True):
        own, held = dict(zip(lists[service], drawn, strict=False)), service == 0
        cells = [repr(own["duration_min"] / 1e6) if held else ""]
        for column in columns:
            given = column in own and (held or column != "bandwidth_kbps")
            cells.append(repr(own[column] / units.get(column, 1000.0)) if given else "")
        lines.append(f"{user},{due_us / 1e6!r},{list(services)[service]},{','.join(cells)}\n")
    file = folder / "drawn.csv"
    file.write_text("".join(lines), encoding="utf-8")
    return file


def test_a_recorded_run_is_the_drawn_one(tmp_path):
    """Requests, steps and events, in each engine; and both engines are equal."""
    mix = dict.fromkeys(SERVICES, 1)
    poisson = {"kind": "poisson", "rate_per_hour": 60, "mix": mix}
    one = build_world(from_mapping(scenario(poisson)), 3)
    trace = {"kind": "trace", "file": str(recorded(tmp_path, one))}
    other = build_world(from_mapping(scenario(trace)), 3)
    assert unlike(other, 1) == []
    pairs = zip(engines(one, (True, True)), engines(other, (True, True)), strict=True)
    for of_drawn, of_recorded in pairs:
        logs = []
        for engine in (of_drawn, of_recorded):
            shown, rng = engine.reset(draw(engine.world, 1, 0)), np.random.default_rng(5)
            while not (shown.terminated or shown.truncated):
                shown = engine.step([int(rng.choice(np.flatnonzero(m))) for m in shown.masks])
            logs.append(engine.log)
        assert logs[0].events == logs[1].events
        assert [row(r) for r in logs[0].requests] == [row(r) for r in logs[1].requests]
        services = {request.service for request in logs[0].requests}
        assert len(services) == 3 and len(logs[0].requests) > 40
