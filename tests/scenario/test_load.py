"""What a scenario file means: defaults, overrides, YAML 1.2, components, and the way back."""

import json
import shutil
from pathlib import Path
from types import MappingProxyType

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desim_uav import shipped
from desim_uav.errors import ScenarioError, UsageError
from desim_uav.model.demand.demand import Dynamic, Poisson
from desim_uav.model.energy.battery import Endurance
from desim_uav.model.mobility.mobility import RandomWalk
from desim_uav.model.motion.motion import BangCoastBang
from desim_uav.model.services import PAPER
from desim_uav.rules.observations import Position
from desim_uav.rules.qoe_reward import QoE
from desim_uav.rules.rewards import Coverage, CoverageBattery, MultiService
from desim_uav.scenario.layout import start_cells, station_cells
from desim_uav.scenario.learning import Schedule
from desim_uav.scenario.load import dump, from_mapping, json_schema, load, loads, scenario_hash
from desim_uav.scenario.map import ListedObstacles
from desim_uav.scenario.schema import EpisodeKeys, Scenario
from desim_uav.scenario.yaml12 import plain_scalar, read

HERE = Path(__file__).parent
PLUG_INS = "plug_ins"


class OwnWalk(RandomWalk):
    """A built-in made one's own, in Python: it inherits a kind, which is not its own."""


@pytest.fixture(autouse=True)
def plug_ins_importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(HERE))


def refusal(text: str, *overrides: str) -> str:
    with pytest.raises(ScenarioError) as caught:
        loads(text, overrides=overrides)
    return str(caught.value)


def test_a_name_is_enough() -> None:
    scenario = loads("name: x")
    assert scenario == Scenario(name="x")
    assert scenario.map.size_m == (2400, 2400)
    assert scenario.drones.battery == Endurance()
    assert scenario.users.mobility == RandomWalk()
    assert scenario.demand == Dynamic()
    assert scenario.services == PAPER
    assert scenario.position_noise is None
    assert scenario.three_d
    assert scenario.limited_battery


def test_the_world_seed_is_the_seed_unless_given() -> None:
    assert loads("seed: 7").effective_world_seed == 7
    assert loads("{seed: 7, world_seed: 0}").effective_world_seed == 0


def test_scenarios_are_frozen() -> None:
    with pytest.raises(ValueError, match="frozen"):
        loads("seed: 7").users.count = 3


def test_in_2d_there_are_no_obstacles() -> None:
    assert loads("map: {dimensions: 2}").map.obstacles is None
    assert loads("map: {dimensions: 2, obstacles: null}").map.obstacles is None


def test_listed_obstacles() -> None:
    obstacles = loads("map: {obstacles: {cells: [[1, 2, 30]]}}").map.obstacles
    assert obstacles == ListedObstacles(cells=((1, 2, 30.0),))


def test_a_low_building_does_not_cut_off() -> None:
    row = ", ".join(f"[{ix}, 5, 19]" for ix in range(10))
    loads(f"map: {{obstacles: {{cells: [{row}]}}}}")


def test_positions_count_the_users() -> None:
    users = loads("users: {positions_m: [[0, 0], [2400, 2400]], clusters: null}").users
    assert users.count == 2
    assert users.clusters is None


def test_null_battery_and_bandwidth_are_unlimited() -> None:
    scenario = loads("drones: {battery: null, bandwidth_kbps: null}\nstations: {count: 0}")
    assert not scenario.limited_battery
    assert scenario.drones.bandwidth_kbps is None


# Layout


def test_stations_of_case_8() -> None:
    assert station_cells(load(shipped.find_scenario("case8"))) == [(5, 9), (8, 3), (1, 3)]


def test_drones_start_on_stations_round_robin() -> None:
    scenario = loads("{stations: {count: 2}, drones: {count: 3}}")
    assert start_cells(scenario) == [(5, 9), (5, 1), (5, 9)]


def test_drones_start_on_the_circle_without_stations() -> None:
    scenario = loads("{stations: {count: 0}, drones: {count: 4, battery: null}}")
    assert start_cells(scenario) == [(5, 9), (9, 5), (5, 1), (1, 5)]


def test_drones_start_where_they_are_told() -> None:
    scenario = loads("drones: {count: 2, start_cells: [[0, 1], [2, 3]]}")
    assert start_cells(scenario) == [(0, 1), (2, 3)]


def test_a_station_off_the_map_is_clipped() -> None:
    assert station_cells(loads("stations: {count: 1, radius_m: 5000}")) == [(5, 9)]


# Shipped scenarios


def test_all_scenarios_are_shipped() -> None:
    assert shipped.scenario_names() == [
        *(f"case{k}" for k in range(1, 10)),
        *("charging_age", "delivery_watch", "edge", "festival", "harvest", "interference"),
        *("old_town", "street_canyon", "tiny", "urban_downlink"),
    ]


@pytest.mark.parametrize("name", shipped.scenario_names())
def test_shipped_scenarios_round_trip(name: str) -> None:
    scenario = load(shipped.scenario_path(name))
    assert scenario.name == name
    assert loads(dump(scenario)) == scenario
    assert scenario_hash(loads(dump(scenario))) == scenario_hash(scenario)


REWARDS = [Coverage()] * 3 + [CoverageBattery()] * 2 + [MultiService()] * 4


@pytest.mark.parametrize(("number", "reward"), list(enumerate(REWARDS, start=1)))
def test_the_nine_cases_pay_as_the_paper(number: int, reward: object) -> None:
    scenario = load(shipped.scenario_path(f"case{number}"))
    assert scenario.reward == reward
    assert scenario.observation == Position()


CASES = {  # dimensions, kbit/s, limited, drones, clusters, users, stations, demand, mobility, noise
    "case1": (2, None, False, 1, 1, 14, 0, "continuous", "static", False),
    "case2": (2, None, False, 2, 2, 20, 0, "continuous", "static", False),
    "case3": (2, None, False, 2, 3, 35, 0, "continuous", "static", False),
    "case4": (2, None, True, 2, 3, 24, 2, "continuous", "static", False),
    "case5": (3, None, True, 2, 2, 24, 2, "continuous", "static", False),
    "case6": (3, 5000, True, 2, 2, 27, 2, "static", "static", False),
    "case7": (3, 5000, True, 2, 3, 41, 2, "static", "static", False),
    "case8": (3, 5000, True, 3, 4, 48, 3, "dynamic", "random_walk", False),
    "case9": (3, 5000, True, 3, 4, 48, 3, "dynamic", "random_walk", True),
}


@pytest.mark.parametrize("name", CASES)
def test_the_nine_cases_are_the_papers(name: str) -> None:
    s = load(shipped.scenario_path(name))
    assert CASES[name] == (
        s.map.dimensions,
        s.drones.bandwidth_kbps,
        s.limited_battery,
        s.drones.count,
        s.users.clusters and s.users.clusters.count,
        s.users.count,
        s.stations.count,
        s.demand.kind,
        s.users.mobility.kind,
        s.position_noise is not None,
    )
    assert s.episode.carry_over


def test_finding_scenarios(tmp_path: Path) -> None:
    file = tmp_path / "case5"
    file.write_text("name: mine")
    assert shipped.find_scenario(str(file)) == file
    assert shipped.find_scenario("case5").name == "case5.yaml"
    with pytest.raises(ScenarioError, match=r"did you mean 'case5'\?.*case1, case2"):
        shipped.find_scenario("cas5")
    with pytest.raises(ScenarioError, match="no such file"):
        shipped.find_scenario("somewhere/case5.yaml")
    with pytest.raises(ScenarioError, match="a folder"):
        shipped.find_scenario(str(tmp_path))


# Overrides


def test_overrides_change_keys_and_list_items() -> None:
    scenario = loads(
        "users: {count: 5}",
        overrides=[
            "users.count=6",
            "map.size_m.0=1200",
            "map.cells=[5, 10]",
            "stations.radius_m=500",
            "drones.battery.autonomy_min=25",
            "position_noise={probability: 0.2}",
            "name=yes",
            "users.count=7",
        ],
    )
    assert scenario.users.count == 7
    assert scenario.map.size_m == (1200, 2400)
    assert scenario.map.cells == (5, 10)
    assert scenario.drones.battery == Endurance(autonomy_min=25)
    assert scenario.position_noise
    assert scenario.position_noise.sigma_cells == 1
    assert scenario.name == "yes"


def test_an_empty_override_is_null() -> None:
    assert loads("name: x", overrides=["map.obstacles="]).map.obstacles is None


def test_an_override_replaces_what_was_wrong() -> None:
    assert loads("users: {count: .nan}", overrides=["users.count=3"]).users.count == 3


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("users.count=-1", "override users.count=-1: must be at least 1"),
        (
            "users.cuont=1",
            "override users.cuont=1: unknown key (did you mean 'count'?); allowed: count,",
        ),
        ("map.size_m.1=0", "override map.size_m.1=0: must be at least 1"),
        (
            "map.size_m.2=1",
            "override map.size_m.2=1: '2' is not an index of this list, which has 2 items",
        ),
        (
            "map.size_m.x=1",
            "override map.size_m.x=1: 'x' is not an index of this list, which has 2 items",
        ),
        ("map={cells: [0, 1]}", "override map={cells: [0, 1]}: map.cells.0: 0: must be at least 1"),
        ("seed=[1", "override seed=[1: invalid YAML: expected ',' or ']'"),
        (
            "stations.count=0",
            "override stations.count=0: a limited battery needs a charging station",
        ),
        ("demand={kind: trace}", "override demand={kind: trace}: demand.file: missing"),
        ("seed=&a 1", "override seed=&a 1: anchor &a: anchors are not allowed"),
    ],
)
def test_a_wrong_override_is_located_at_itself(override: str, message: str) -> None:
    problem = refusal("name: x", override)
    assert problem.startswith(message)
    assert "\n" not in problem


@pytest.mark.parametrize("override", ["users.count", "=3", ".=3", "users.=3", "users..count=3", ""])
def test_an_override_of_another_form_is_a_usage_error(override: str) -> None:
    with pytest.raises(UsageError, match=r"must be key\.path=value"):
        loads("name: x", overrides=[override])


def test_errors_of_file_and_overrides_come_together() -> None:
    problems = refusal("seed: -1\nusers: {count: 0}", "users.count=-1").splitlines()
    assert problems[0].startswith("<string>:1:7: seed: -1: ")
    assert problems[1].startswith("override users.count=-1: ")
    assert len(problems) == 2


# The paper's preset


def test_preset_lies_beneath_the_users_own_keys() -> None:
    scenario = loads("preset: paper")
    assert scenario.drones.battery == Endurance(respawn_after_min=0)
    assert scenario.demand == Dynamic(none=0.1)
    assert loads(dump(scenario)) == scenario
    own = loads(
        "{preset: paper, demand: {kind: poisson, rate_per_hour: 2, none: 0},"
        " drones: {battery: {respawn_after_min: 3}}}"
    )
    assert own.demand == Poisson(2)
    assert own.drones.battery == Endurance(respawn_after_min=3)


def test_preset_pays_and_learns_as_the_paper() -> None:
    scenario = loads("preset: paper")
    assert scenario.reward == MultiService(cost_sign=1)
    learning = scenario.learning
    assert (learning.alpha, learning.gamma) == (Schedule(start=1), 0.95)
    assert learning.epsilon == Schedule(start=1, decay=0.998, end=0.01)
    assert (learning.initial_q, learning.episodes) == ("random", 7000)
    own = loads("{preset: paper, reward: {cost_sign: -1}, learning: {alpha: 0.2, episodes: 9}}")
    assert own.reward == MultiService()
    assert (own.learning.alpha, own.learning.episodes) == (Schedule(start=0.2), 9)
    assert own.learning.epsilon == learning.epsilon
    battery = "drones: {battery: null}, stations: {count: 0}"
    plain = loads(f"{{preset: paper, reward: {{kind: coverage}}, {battery}}}")
    assert plain.reward == Coverage(), "it has no sign to change"


def test_preset_leaves_alone_what_has_no_such_parameter() -> None:
    scenario = loads(
        "{preset: paper, demand: {kind: continuous}, drones: {battery: null}, stations: {count: 0}}"
    )
    assert scenario.demand.kind == "continuous"
    assert scenario.drones.battery is None


def test_preset_hides_no_errors() -> None:
    problem = refusal("{preset: paper, drones: 3, demand: dynamic, reward: 4, learning: 5}")
    assert "reward: 4: must be a mapping with a kind" in problem
    assert "learning: 5: must be a mapping" in problem
    assert "drones: 3: must be a mapping" in problem
    assert 'demand: "dynamic": must be a mapping' in problem


# What drones are paid for, see and learn


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("{}", [0.4, 0.4 * 0.9996, 0.4 * 0.9996**10]),
        ("0.3", [0.3] * 3),
        ("1", [1.0] * 3),
        ("{start: 0.8, decay: 1}", [0.8] * 3),
        ("{start: 0.8, decay: 0.5, end: 0}", [0.8, 0.4, 0.8 / 1024]),
        ("{start: 0.8, decay: 0.5, end: 0.5}", [0.8, 0.5, 0.5]),
        ("{start: 0, end: 0.1}", [0.1] * 3),
    ],
)
def test_schedules_over_the_episodes(text: str, values: list[float]) -> None:
    schedule = loads(f"learning: {{epsilon: {text}}}").learning.epsilon
    assert [schedule.at(episode) for episode in (0, 1, 10)] == pytest.approx(values)


def test_the_default_reward_is_for_qoe_and_that_of_the_paper_for_its_code() -> None:
    """The nine cases and the scenarios that were trained with R3 name their rewards."""
    assert loads("{}").reward == loads("reward: {kind: qoe}").reward == QoE(crash=10.0)
    assert loads("preset: paper").reward == MultiService(cost_sign=1.0)
    own = loads("{preset: paper, reward: {low_battery: 0.3}}").reward
    assert own == MultiService(cost_sign=1.0, low_battery=0.3)
    assert loads("{preset: paper, reward: {kind: coverage}}").reward == Coverage()
    for number in range(1, 10):
        assert "\nreward: " in shipped.scenario_path(f"case{number}").read_text(encoding="utf-8")


def test_rewards_weigh_services_there_are() -> None:
    scenario = loads("reward: {kind: multi_service, services: {throughput: 1, edge_computing: 0}}")
    assert scenario.reward == MultiService(services={"throughput": 1, "edge_computing": 0})
    assert loads(dump(scenario)) == scenario
    video = "services: {video: {duration_min: [1], bandwidth_kbps: [5]}}, demand: {mix: {video: 1}}"
    usual = loads(f"{{{video}, reward: {{kind: multi_service}}}}")
    assert usual.reward == MultiService(), "the default may name others"
    own = loads(f"{{{video}, reward: {{kind: multi_service, services: {{video: 0.5}}}}}}")
    assert own.reward.services == {"video": 0.5}
    assert "reward.services.throughput: 1: no such service" in refusal(
        f"{{{video}, reward: {{kind: multi_service, services: {{throughput: 1}}}}}}"
    )


# YAML 1.2


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None),
        ("~", None),
        ("null", None),
        ("Null", None),
        ("nUll", "nUll"),
        ("true", True),
        ("FALSE", False),
        ("yes", "yes"),
        ("off", "off"),
        ("n", "n"),
        ("0", 0),
        ("-12", -12),
        ("+3", 3),
        ("010", 10),
        ("0o17", 15),
        ("0x1F", 31),
        ("-0x1F", "-0x1F"),
        ("0b11", "0b11"),
        ("1_000", "1_000"),
        ("1:30", "1:30"),
        ("1e3", 1000.0),
        ("1E-3", 0.001),
        (".5", 0.5),
        ("5.", 5.0),
        ("-1.5e+3", -1500.0),
        ("1e", "1e"),
        (".", "."),
        ("-", "-"),
        (".inf", float("inf")),
        ("-.INF", float("-inf")),
        ("inf", "inf"),
        ("nan", "nan"),
        ("2001-01-01", "2001-01-01"),
        ("=", "="),
        ("\u0663", "\u0663"),
    ],
)
def test_plain_scalars(text: str, value: object) -> None:
    found = plain_scalar(text)
    assert found == value
    assert type(found) is type(value)


def test_whole_floats_are_whole_numbers() -> None:
    assert loads("users: {count: 1e3}").users.count == 1000
    assert loads("seed: 5.0").seed == 5


def test_quoted_is_text() -> None:
    assert loads('name: "010"').name == "010"
    assert loads("name: 'true'").name == "true"


def test_a_byte_order_mark_is_tolerated(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_bytes(b"\xef\xbb\xbfname: x\r\nseed: 3\r\n")
    assert load(file).seed == 3


def test_names_that_look_like_numbers_round_trip() -> None:
    for name in ("1e3", "0o7", "true", "null", "5", "no", "1_0", "2001-01-01"):
        scenario = loads(f'name: "{name}"')
        assert loads(dump(scenario)).name == name


# Components


def test_a_plug_in_is_validated_like_a_built_in() -> None:
    kind = f'kind: "{PLUG_INS}:Wind"'
    scenario = loads(f"users: {{mobility: {{{kind}, speed_mps: 3}}}}")
    assert scenario.users.mobility.speed_mps == 3
    assert loads(dump(scenario)) == scenario
    assert "users.mobility.speed_mps: missing" in refusal(f"users: {{mobility: {{{kind}}}}}")
    text = f"users: {{mobility: {{{kind}, speed_mps: 0, note: x}}}}"
    problems = refusal(text).splitlines()
    assert "users.mobility.speed_mps: 0: must be above 0" in problems[0]
    assert "users.mobility.note: unknown key; allowed: kind, speed_mps, heading_deg" in problems[1]


def test_a_plug_in_can_be_any_class() -> None:
    kind = f'kind: "{PLUG_INS}:Plain"'
    scenario = loads(f"users: {{mobility: {{{kind}, speed: 2}}}}")
    assert scenario.users.mobility.speed == 2
    again = loads(dump(scenario))
    assert again.users.mobility.speed == 2
    assert scenario_hash(again) == scenario_hash(scenario)
    negative = refusal(f"users: {{mobility: {{{kind}, speed: -2}}}}")
    assert "users.mobility: " in negative
    assert "ValueError: speed must not be negative" in negative
    assert "TypeError" in refusal(f"users: {{mobility: {{{kind}, pace: 2}}}}")


@pytest.mark.parametrize("kind", ["trace", f'"{PLUG_INS}:Recorded"'])
def test_files_are_relative_to_the_scenario(tmp_path: Path, kind: str) -> None:
    folder = tmp_path / "a"
    folder.mkdir()
    (folder / "walks.csv").write_text("user,t_s,x_m,y_m\n0,0,5,5\n")
    file = folder / "s.yaml"
    file.write_text(f"users: {{mobility: {{kind: {kind}, file: walks.csv}}}}")
    scenario = load(file)
    assert scenario.users.mobility.file == folder / "walks.csv"
    assert loads(dump(scenario)) == scenario
    assert str(folder / "walks.csv") in dump(scenario)


def test_a_scenario_can_be_built_in_python() -> None:
    scenario = Scenario(seed=3, demand=Poisson(2.0))
    assert loads(dump(scenario)) == scenario
    own = Scenario(users={"mobility": OwnWalk(2.0)})
    assert loads(dump(own)) == own
    with pytest.raises(ValueError, match="must be a mapping with a kind"):
        Scenario(demand=3)


def test_from_mapping() -> None:
    mapping = MappingProxyType({"map": {"size_m": (1200.0, 2400)}, "users": {"count": 3}})
    scenario = from_mapping(mapping, overrides=["map.size_m.0=2000"])
    assert scenario.map.size_m == (2000, 2400)
    assert mapping["map"] == {"size_m": (1200.0, 2400)}
    with pytest.raises(ScenarioError, match=r"^<mapping>: users\.count: -1: must be at least 1$"):
        from_mapping({"users": {"count": -1}})
    with pytest.raises(ScenarioError, match="a set is not plain data"):
        from_mapping({"users": {"count": {1}}})
    with pytest.raises(ScenarioError, match="keys must be text"):
        from_mapping({3: 4})
    endless: dict[str, object] = {}
    endless["a"] = endless
    with pytest.raises(ScenarioError, match="nested more than 50 levels deep"):
        from_mapping(endless)


# The hash


def test_the_hash_is_of_what_a_scenario_says() -> None:
    plain = scenario_hash(loads("name: x"))
    assert plain == scenario_hash(loads("{name: y, seed: 0, episode: {step_s: 60.0}}"))
    assert plain != scenario_hash(loads("seed: 1"))
    assert plain != scenario_hash(loads("demand: {none: 0.1}"))
    assert len(plain) == 64


def test_keys_that_came_later_are_hashed_only_if_they_are_changed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    texts = ["name: x", "episode: {carry_over: true}", "drones: {motion: {max_speed_mps: 9}}"]
    with_every_key = [scenario_hash(loads(text)) for text in texts]
    monkeypatch.setattr(EpisodeKeys, "later", ("carry_over",))
    later = BangCoastBang.later
    monkeypatch.setattr(BangCoastBang, "later", (*later, "max_speed_mps"))
    hashes = [scenario_hash(loads(text)) for text in texts]
    assert len(set(hashes)) == 3
    assert not set(hashes) & set(with_every_key)
    monkeypatch.setattr(EpisodeKeys, "later", ())
    monkeypatch.setattr(BangCoastBang, "later", later)
    assert scenario_hash(loads(texts[2])) == with_every_key[2]


def test_the_hash_is_of_the_content_of_files(tmp_path: Path) -> None:
    walks = tmp_path / "walks.csv"
    walks.write_text("user,t_s,x_m,y_m\n0,0,5,5\n")
    (tmp_path / "b").mkdir()
    shutil.copy(walks, tmp_path / "b" / "same.csv")
    mobility = "users: {mobility: {kind: trace, file: %s}}"
    one = loads(mobility % "walks.csv", base=tmp_path)
    other = loads(mobility % "same.csv", base=tmp_path / "b")
    assert scenario_hash(one) == scenario_hash(other)
    walks.write_text("user,t_s,x_m,y_m\n0,0,5,6\n")
    assert scenario_hash(one) != scenario_hash(other)
    walks.unlink()
    with pytest.raises(ScenarioError, match=r"walks\.csv: cannot be read"):
        scenario_hash(one)


# The schema for editors


def test_the_json_schema_names_components_and_plug_ins() -> None:
    schema = json.loads(json.dumps(json_schema()))
    assert set(schema["properties"]) == set(Scenario.model_fields)
    forms = schema["properties"]["demand"]["anyOf"]
    titles = [form["title"] for form in forms]
    kinds = ["continuous", "static", "dynamic", "poisson", "trace", "sensing", "profile"]
    assert titles == [*kinds, "plug-in"]
    poisson = forms[3]
    assert poisson["required"] == ["kind", "rate_per_hour"]
    assert poisson["additionalProperties"] is False


# Whatever the text


KEYS = st.sampled_from([*Scenario.model_fields, "count", "kind", "clusters", "mix", "file", "x"])
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | KEYS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=150, deadline=None)
@given(st.text() | st.text(alphabet="abc: -[]{}\"'\n#&*!|>%@`?,\\x0~<"))
def test_any_text_is_a_scenario_or_a_scenario_error(text: str) -> None:
    for source in (text, f"users: {text}"):
        try:
            loads(source)
        except ScenarioError as error:
            assert error.problems


@settings(max_examples=50, deadline=None)
@given(content=st.binary())
def test_any_bytes_are_a_scenario_or_a_scenario_error(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    file = tmp_path_factory.getbasetemp() / "any.yaml"
    file.write_bytes(content)
    try:
        load(file)
    except ScenarioError as error:
        assert error.problems


@pytest.mark.thorough
@settings(max_examples=150, deadline=None)
@given(st.dictionaries(KEYS, VALUES, max_size=4))
def test_any_mapping_is_a_scenario_or_a_scenario_error(mapping: dict[str, object]) -> None:
    try:
        scenario = from_mapping(mapping)
    except ScenarioError as error:
        assert error.problems
    else:
        assert loads(dump(scenario)) == scenario


@settings(max_examples=100, deadline=None)
@given(st.text(max_size=12), VALUES)
def test_any_override_is_a_scenario_or_an_error(path: str, value: object) -> None:
    for override in (f"{path}={value}", f"users.{path}={value!r}", f"map={value}"):
        try:
            loads("name: x", overrides=[override])
        except (ScenarioError, UsageError) as error:
            assert str(error)


@pytest.mark.parametrize(
    ("text", "alpha", "epsilon"),
    [
        ("{}", (1, 0.9996, 0.1), (0.4, 0.9996, 0.02)),
        ("{alpha: 0.1, epsilon: 0.2}", (0.1, 1, 0), (0.2, 1, 0)),
        ("{alpha: {start: 0.5}, epsilon: {end: 0.05}}", (0.5, 0.9996, 0.1), (0.4, 0.9996, 0.05)),
    ],
)
def test_what_a_schedule_does_not_say_is_as_by_default(text: str, alpha, epsilon) -> None:
    learning = loads(f"learning: {text}").learning
    assert (learning.alpha.start, learning.alpha.decay, learning.alpha.end) == alpha
    assert (learning.epsilon.start, learning.epsilon.decay, learning.epsilon.end) == epsilon


def test_the_papers_schedules_are_the_defaults_of_its_preset() -> None:
    given = "preset: paper\nlearning: {epsilon: {end: 0.05}, alpha: {decay: 0.9}}"
    learning = loads(given).learning
    epsilon = learning.epsilon
    assert (epsilon.start, epsilon.decay, epsilon.end) == (1, 0.998, 0.05)
    assert (learning.alpha.start, learning.alpha.decay, learning.alpha.end) == (1, 0.9, 0)
    assert loads("preset: paper\nlearning: {alpha: 0.2}").learning.alpha.start == 0.2


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("a:\t1\t# one\nb\t:\t2", {"a": 1, "b": 2}),
        ('{\n\t"a":\t[1,\t2],\n\t"b":3\n}\n', {"a": [1, 2], "b": 3}),
        ("-\ta\n-\tb\n", ["a", "b"]),
        ("a:\n  b: 1\n\t\n  \t# empty lines\n  c: 2\n", {"a": {"b": 1, "c": 2}}),
    ],
)
def test_tabs_between_tokens(text: str, data: object) -> None:
    """YAML 1.2 allows them, and so does JSON, which is a part of it."""
    found = read(text)
    assert (found.data, found.problems) == (data, [])


@pytest.mark.parametrize("text", ["a:\n\tb: 1", "a: b\tc", "a: x\x85y"])
def test_no_tab_indents_or_is_in_a_word(text: str) -> None:
    """A next line (U+0085) would end a line in YAML 1.1 and not in 1.2."""
    assert read(text).broken
