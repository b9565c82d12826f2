"""``users`` as a list of groups: what is read from it, and what is refused by its whole message."""

from __future__ import annotations

import pytest
import yaml

from desim_uav.errors import ScenarioError
from desim_uav.model.demand.demand import Dynamic, Poisson
from desim_uav.model.mobility.mobility import RandomWalk, Static
from desim_uav.scenario.cost import cost, expected_requests
from desim_uav.scenario.doubts import doubts
from desim_uav.scenario.load import dump, json_schema, loads, scenario_hash, to_plain
from desim_uav.scenario.schema import Scenario
from desim_uav.scenario.users import NamedUsers
from tests.scenario.refused import blocks_of, check_block

BLOCKS = blocks_of("group_keys.txt")

TWO = """
users:
- {name: phones, count: 40}
- {name: meters, mobility: {kind: static}, positions_m: [[1, 2], [3, 4]],
   demand: {kind: poisson, rate_per_hour: 6, mix: {data_gathering: 1}}}
"""


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.splitlines()[-1][3:60])
def test_messages(block: str) -> None:
    check_block(block)


def test_the_groups_and_their_users() -> None:
    scenario = loads(TWO)
    phones, meters = scenario.user_groups
    assert isinstance(phones, NamedUsers) and isinstance(meters, NamedUsers)
    assert scenario.group_names == ("phones", "meters")
    assert scenario.user_count == 42
    assert scenario.group_numbers == 40 * (0,) + 2 * (1,)
    assert [type(users.mobility) for users in (phones, meters)] == [RandomWalk, Static]
    assert [type(demand) for demand in scenario.demands] == [Dynamic, Poisson]
    assert [key for key, *_ in scenario.asking] == [("demand",), ("users", 1, "demand")]
    assert phones.clusters == Scenario().user_groups[0].clusters


def test_one_block_is_one_group_without_a_name() -> None:
    scenario = Scenario()
    assert scenario.user_groups == (scenario.users,)
    assert scenario.group_names == ()
    assert scenario.demands == (scenario.demand,)
    assert [counts for *_, counts in scenario.asking] == [(48,)]


def test_a_list_is_written_and_read_back() -> None:
    scenario = loads(TWO)
    again = loads(dump(scenario))
    assert again == scenario
    assert scenario_hash(again) == scenario_hash(scenario)
    phones, meters = to_plain(scenario)["users"]
    assert next(iter(phones)) == "name"
    assert phones["demand"] is None
    assert "count" not in meters


def test_overrides_reach_the_groups() -> None:
    changes = ["users.0.count=7", "users.1.demand.rate_per_hour=9", "users.0.demand.kind=static"]
    scenario = loads(TWO, overrides=changes)
    assert scenario.user_count == 9
    assert scenario.demands[1].rate_per_hour == 9  # type: ignore[attr-defined]
    with pytest.raises(ScenarioError, match=r"override users\.2\.count=1: '2' is not an index"):
        loads(TWO, overrides=["users.2.count=1"])


def test_clusters_follow_the_map_in_each_group() -> None:
    text = "map: {size_m: [1200, 1200], cells: [5, 5]}\nstations: {radius_m: 300}\n" + TWO
    clusters = loads(text).user_groups[0].clusters
    assert clusters is not None
    assert clusters.radius_m == (120.0, 240.0)


def test_costs_are_the_sums_of_groups() -> None:
    groups = "users: [{name: a, count: 30}, {name: b, count: 18}]"
    one, two = loads("users: {count: 48}"), loads(groups)
    for engine in ("des", "batch"):
        assert cost(two, engine).event_count == pytest.approx(cost(one, engine).event_count)
        assert cost(two, engine).memory_bytes == pytest.approx(cost(one, engine).memory_bytes)
    assert expected_requests(two) == pytest.approx(expected_requests(one))


def test_doubts_name_the_group() -> None:
    few = "users: [{name: a}, {name: b, count: 1, demand: {kind: poisson, rate_per_hour: 0.1}}]"
    assert [line.partition(": ")[0] for line in doubts(loads(few))] == ["users.1.demand"]
    unused = "users: [{name: a, demand: {kind: static}}]\ndemand: {kind: dynamic}"
    assert list(doubts(loads(unused))) == [
        "demand: nobody asks by it, because each group of users has a demand of its own"
    ]
    own = loads("users: [{name: a, demand: {kind: static}}]")
    assert list(doubts(loads(dump(own)))) == [], "what is dumped was not given"
    assert "demand" in yaml.safe_load(dump(loads(unused)))


def test_the_description_has_a_line_per_group() -> None:
    lines = repr(loads(TWO)).splitlines()
    assert any(line.split()[:2] == ["users", "42"] for line in lines)
    assert any(line.split()[:2] == ["phones", "40;"] for line in lines)
    assert any("demand poisson" in line for line in lines if line.split()[0] == "meters")


def test_the_schema_of_editors_has_both_forms() -> None:
    schema = json_schema()
    forms = schema["properties"]["users"]["anyOf"]
    assert [form.get("type", form.get("$ref")) for form in forms] == ["#/$defs/Users", "array"]
    assert schema["$defs"]["NamedUsers"]["required"] == ["name"]


def test_the_preset_reaches_the_demand_of_a_group() -> None:
    scenario = loads("preset: paper\nusers: [{name: a, demand: {kind: dynamic}}, {name: b}]")
    assert [demand.none for demand in scenario.demands] == [0.1, 0.1]  # type: ignore[attr-defined]
