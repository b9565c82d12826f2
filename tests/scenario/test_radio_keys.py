"""Keys of radio, association and transfers that are wrong: each is refused by its whole message."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from desim_uav.errors import ScenarioError
from desim_uav.model.radio.link import LADDERS, LinkClass
from desim_uav.model.radio.path_loss import AlHourani
from desim_uav.model.radio.radio import LinkClasses, Reuse, Shadowing
from desim_uav.rules.sharing import Equal, Held
from desim_uav.scenario.load import dump, from_mapping, json_schema, loads, scenario_hash
from tests.scenario.refused import blocks_of, check_block

HERE = Path(__file__).parent

BLOCKS = blocks_of("radio_keys.txt")

WHOLE = """
drones:
  footprint_radius_m: 500
  radio:
    kind: link_classes
    carier_ghz: 2
    power_dbm: loud
    path_loss: {kind: log_distance, exponent: 0, at_1m_db: 40}
    line_of_sight: sometimes
    shadowing: {los_db: -4, nlos_db: 8}
    classes: [{snr_db: 0, bit_s_hz: 0}, {snr_db: 200, bit_s_hz: 1}]
    interference: {reuse: 0}
    sharing: {kind: fair}
association: {kind: a3, offset_db: 99}
access_points: [{at_m: [0, 0], height_m: 25, radio: {sharing: 4}}]
services: {file: {kind: transfer, volume_mbit: [-1]}}
demand: {mix: {file: 1}}
"""

PROBLEMS = {
    (3, "drones.footprint_radius_m"),
    (6, "drones.radio.carier_ghz"),
    (7, "drones.radio.power_dbm"),
    (8, "drones.radio.path_loss.exponent"),
    (9, "drones.radio.line_of_sight"),
    (10, "drones.radio.shadowing.los_db"),
    (11, "drones.radio.classes.0.bit_s_hz"),
    (11, "drones.radio.classes.1.snr_db"),
    (12, "drones.radio.interference.reuse"),
    (13, "drones.radio.sharing.kind"),
    (14, "association.offset_db"),
    (15, "access_points.0.radio.sharing"),
    (16, "services.file.volume_mbit.0"),
}


@pytest.fixture(autouse=True)
def _own_path_losses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(HERE))


def problems_of(text: str) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        loads(text, source="mine.yaml")
    return list(caught.value.problems)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.splitlines()[-1][3:60])
def test_messages(block: str) -> None:
    check_block(block)


def test_there_are_many() -> None:
    assert len(BLOCKS) > 100


def test_all_problems_of_a_scenario_are_found_at_once() -> None:
    found = [problem.removeprefix("mine.yaml:").split(": ") for problem in problems_of(WHOLE)]
    assert {(int(place.split(":")[0]), key) for place, key, *_ in found} == PROBLEMS
    assert len(found) == len(PROBLEMS)


def numbers(path: str, schema: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """The path and schema of each number within a schema."""
    if isinstance(schema, list):
        for one in schema:
            yield from numbers(path, one)
    elif isinstance(schema, dict):
        if schema.get("type") in ("number", "integer"):
            yield path, schema
        for key, inner in schema.items():
            yield from numbers(f"{path}.{key}", inner)


def test_every_number_has_bounds() -> None:
    schema = json_schema()
    owners = (
        schema["$defs"]["Drones"]["properties"]["radio"],
        schema["$defs"]["AccessPoint"]["properties"],
        schema["properties"]["association"],
    )
    found = [item for owner in owners for item in numbers("", owner)]
    assert len(found) > 30
    for path, number in found:
        assert {"minimum", "exclusiveMinimum"} & number.keys(), path
        assert "maximum" in number, path


def test_the_schema_has_mappings_where_scenarios_have_them() -> None:
    forms = json_schema()["$defs"]["Drones"]["properties"]["radio"]["anyOf"]
    links = next(form for form in forms if form["title"] == "link_classes")["properties"]
    kinds = {form.get("title") for form in links["path_loss"]["anyOf"]}
    assert kinds == {"free_space", "log_distance", "al_hourani", "tr36777", "plug-in"}
    assert {"enum": ["cqi", "mcs"]} in links["classes"]["anyOf"]
    (one,) = [form for form in links["classes"]["anyOf"] if form.get("type") == "array"]
    assert one["items"]["required"] == ["snr_db", "bit_s_hz"]
    assert one["items"]["additionalProperties"] is False


GIVEN: dict[str, Any] = {
    "drones": {
        "radio": {
            "kind": "link_classes",
            "power_dbm": 24,
            "path_loss": {"environment": "high_rise"},
            "line_of_sight": "drawn",
            "shadowing": {"los_db": 4, "nlos_db": 8},
            "classes": [{"snr_db": 0, "bit_s_hz": 0.5}, {"snr_db": 9, "bit_s_hz": 2.123456}],
            "interference": {"reuse": 3},
            "sharing": "equal",
        }
    },
    "association": "a3",
    "access_points": [{"at_m": [3, 4], "height_m": 25, "radio": {"interference": {"reuse": 3}}}],
    "services": {"file": {"kind": "transfer", "volume_mbit": [8, 1e-12]}},
    "demand": {"mix": {"file": 1}},
}
GIVEN["access_points"][0]["radio"]["sharing"] = {"kind": "max_min"}


def test_what_a_scenario_says() -> None:
    scenario = from_mapping(GIVEN)
    radio = scenario.drones.radio
    assert radio == LinkClasses(
        power_dbm=24.0,
        path_loss=AlHourani("high_rise"),
        line_of_sight="drawn",
        shadowing=Shadowing(4.0, 8.0),
        classes=(LinkClass(0.0, 0.5), LinkClass(9.0, 2.123456)),
        interference=Reuse(3),
        sharing=Equal(),
    )
    assert radio.efficiencies() == (500_000, 2_123_456)
    assert (radio.reuse, radio.bandwidth_hz(None)) == (3, 5_000_000)
    assert (scenario.association.margin_db, scenario.association.trigger_us) == (3.0, 160_000)
    (point,) = scenario.access_points
    assert (point.at_m, point.radio.power_dbm, point.counts_in_reward) == ((3.0, 4.0), 30.0, False)
    values = scenario.services["file"].values()
    assert values["volume_mbit"].tolist() == [8 * 10**12, 1]
    assert values["bandwidth_kbps"].tolist() == [0]


def test_it_can_be_written_and_read_again() -> None:
    scenario = from_mapping(GIVEN)
    text = dump(scenario)
    assert "footprint_radius_m" not in text
    assert loads(text) == scenario
    assert dump(loads(text)) == text
    assert scenario_hash(loads(text)) == scenario_hash(scenario)


def test_no_band_for_uploads_leaves_hashes_as_they_were() -> None:
    told = "drones: {{radio: {{kind: link_classes{}}}}}"
    plain, none, some = (
        scenario_hash(loads(told.format(key)))
        for key in ("", ", uplink_mhz: null", ", uplink_mhz: 5")
    )
    assert plain == none != some
    assert loads(dump(loads(told.format(", uplink_mhz: 2.5")))).drones.radio.uplink_hz == 2_500_000


def test_defaults_and_other_names() -> None:
    links = loads("drones: {radio: {kind: link_classes}}").drones.radio
    assert links == LinkClasses()
    assert (links.ladder, links.reuse, links.sharing) == (LADDERS["cqi"], 0, Held())
    hold = "services: {file: {kind: %s, duration_min: [1], bandwidth_kbps: [2]}}\n"
    both = [loads(hold % kind + "demand: {mix: {file: 1}}") for kind in ("hold", "uniform_choice")]
    assert both[0] == both[1]
    assert scenario_hash(both[0]) == scenario_hash(both[1])


def test_links_made_in_python_are_checked_too() -> None:
    assert LinkClasses(interference={"reuse": 2}).reuse == 2
    with pytest.raises(ValueError, match="interference must be none, co_channel or"):
        LinkClasses(interference="everyone")
    with pytest.raises(ValueError, match="class 2: snr_db must rise"):
        LinkClasses(classes=[{"snr_db": 1, "bit_s_hz": 1}, {"snr_db": 0, "bit_s_hz": 2}])
    with pytest.raises(ValueError, match="unknown classes 'cqy'"):
        LinkClasses(classes="cqy")
