"""What is given wrongly is answered with one error, which is blamed on what was wrong."""

import sys
from pathlib import Path

import numpy as np
import pytest

import desim_uav as du
from desim_uav.env.session import ActionError
from desim_uav.errors import PolicyError, ScenarioError, SimulationError, UsageError
from desim_uav.scenario.conformance import returns_a_value
from tests.command_line import runner

SHORT = {"episode.steps": 2}
OWN = """
from dataclasses import dataclass
from desim_uav.model.rewards import RowReward

class North:
    ceiling = True
    def begin(self, world, streams, carried=False): pass
    def act(self, observation, mask): return 0

class Half:
    def begin(self, world, streams, carried=False): pass
    def act(self, observation, mask): return 0

@dataclass(frozen=True)
class Gives(RowReward):
    names = ("a",)
    def pay(self, world, state, drone):
        return 1.0

@dataclass(frozen=True)
class Misspelt(RowReward):
    names = ("a",)
    def pay(self, world, state, drone):
        drone.terms[0] = state.observations[drone.index].served_request
"""


@pytest.fixture(autouse=True)
def _somewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("north_of_test.py").write_text(OWN)
    Path("mine.yaml").write_text(
        "name: mine\nstations: {count: 0}\ndrones: {battery: null}\nusers: {count: 3}\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "north_of_test", raising=False)


@pytest.fixture
def cli_run(capsys, monkeypatch):
    return runner(capsys, monkeypatch)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("users.count=x", "desim-uav: override users.count=x: must be a whole number"),
        ("users.cuont=3", "desim-uav: override users.cuont=3: unknown key (did you mean 'count'?)"),
        (
            "drones.battery={autonomy_min: 20}",
            "desim-uav: override drones.battery={autonomy_min: 20}: stations.count: 0: a limited",
        ),
        (
            "map.obstacles.coverage=[0.9, 0.9]",
            "desim-uav: override map.obstacles.coverage=[0.9, 0.9]: map.obstacles: none of 101",
        ),
        (
            "users.clusters.radius_m=[1.0e9, 1.0e9]",
            "desim-uav: override users.clusters.radius_m=[1.0e9, 1.0e9]: users.clusters.radius_m",
        ),
    ],
)
def test_an_override_is_blamed_and_not_the_file(cli_run, override, said):
    for command in ("validate", "run"):
        ended = cli_run(command, "mine.yaml", "-S", override)
        assert ended.code == 3
        assert ended.err.startswith(said)
        assert "mine.yaml" not in ended.err


def test_an_override_from_python_is_blamed_by_its_key():
    with pytest.raises(ScenarioError, match=r"^override users.count=\"x\": must be a whole"):
        du.run("mine.yaml", {"users.count": "x"})
    with pytest.raises(
        ScenarioError, match=r"^override map.obstacles.coverage=\[0.9, 0.9\]: map.o"
    ):
        du.build_world("mine.yaml", 0, {"map.obstacles.coverage": (0.9, 0.9)})
    with pytest.raises(ScenarioError, match=r"^mine.yaml:2:23: stations.count: -1"):
        Path("mine.yaml").write_text("name: mine\nstations: {count:     -1}\n")
        du.run("mine.yaml", {"users.count": 3})


@pytest.mark.parametrize(
    ("overrides", "part"),
    [
        (3, "overrides: 3: must be a text, a mapping"),
        ([3], r"overrides: \[3\]: must be a text, a mapping, a sequence of texts or None"),
        (iter([3]), r"must be a mapping such as {'users.count': 60}, or a list of texts"),
    ],
)
def test_overrides_that_are_none(overrides, part):
    with pytest.raises(UsageError, match=part):
        du.run("tiny", overrides)


def test_one_text_is_one_override():
    assert du.load("tiny", "episode.steps=2").episode.steps == 2


class TestPolicies:
    @pytest.mark.parametrize(
        ("name", "said"),
        [
            ("hover:x", "policy 'hover:x': 'hover' takes nothing after it: write hover"),
            ("x", "unknown policy 'x'; allowed: baseline"),
            ("basline", "unknown policy 'basline' (did you mean 'baseline'?)"),
            ("./north_of_test.py", "name the class in this file, too: ./north_of_test.py:Class"),
            ("./nope.py:North", "cannot import './nope.py:North': no such file"),
            (
                "./north_of_test.py:Nort",
                "has no 'Nort' (did you mean 'North'?)",
            ),
            ("north_of_test:Half", "it has no attribute 'ceiling'; write ceiling = True"),
        ],
    )
    def test_what_is_none_is_said_once(self, name, said):
        with pytest.raises(PolicyError) as caught:
            du.load_policy(name)
        assert said in str(caught.value)
        assert str(caught.value).count("unknown policy") <= 1

    @pytest.mark.thorough
    def test_a_class_in_a_file(self, cli_run):
        ended = cli_run("run", "tiny", "--policy", "./north_of_test.py:North")
        assert (ended.code, ended.out.splitlines()[-1]) == (0, "runs/tiny-north_of_test-North-s1")
        done = du.run("tiny", SHORT, policy=Path("./north_of_test.py:North"))
        assert set(done.steps["action"]) == {"forward"}
        several = du.compare(
            "tiny", SHORT, policies=["./north_of_test.py:North"], seeds=2, episodes=1, jobs=2
        )
        assert len(several.frame) == 2


class TestOwnComponents:
    def test_a_reward_that_returns_a_number(self):
        for engine in ("des", "batch"):
            with pytest.raises(ScenarioError, match="its method 'pay' returns a value"):
                du.run("tiny", SHORT | {"reward": {"kind": "north_of_test:Gives"}}, engine=engine)

    def test_what_returns_a_value(self):
        def early(x):
            if x:
                return
            x.y = 1

        assert not returns_a_value(early)
        assert returns_a_value(lambda x: x + 1)
        assert returns_a_value(lambda: 1)
        assert not returns_a_value(lambda: None)

    @pytest.mark.parametrize(
        ("engine", "error"), [("des", SimulationError), ("batch", ScenarioError)]
    )
    def test_a_field_that_a_row_does_not_have(self, engine, error):
        with pytest.raises(error) as caught:
            du.run("tiny", SHORT | {"reward": {"kind": "north_of_test:Misspelt"}}, engine=engine)
        assert "(did you mean 'served_requests'?); it has mode, x, y, level" in str(caught.value)


class TestNothingToDo:
    def test_nothing_to_resume(self, cli_run):
        short = ("-S", "episode.steps=2")
        ended = cli_run("train", "tiny", *short, "--episodes", 2, "--resume", "--out", "typo", "-q")
        assert "--resume: typo holds no training, so there is nothing to resume" in ended.err
        ended = cli_run("train", "tiny", *short, "--episodes", 2, "--resume", "--out", "typo", "-q")
        assert ended.err == ""
        with pytest.warns(du.DesimWarning, match="kept holds no sweep, so there is nothing to res"):
            how = {"seeds": 1, "episodes": 1, "warmup": 0, "resume": True}
            du.sweep("tiny", {"episode.steps": [2, 3]}, out="kept", **how)

    def test_nothing_to_sweep(self):
        how = {"seeds": 1, "episodes": 1, "warmup": 0}
        with pytest.warns(du.DesimWarning, match="no key has several values, so nothing is swept"):
            du.sweep("tiny", {"episode.steps": 2}, out="one", **how)
        with pytest.raises(UsageError, match=r"episode.steps: there is no value to sweep"):
            du.sweep("tiny", {"episode.steps": []}, out="none", **how)


class TestEnvironments:
    @pytest.mark.parametrize("actions", [None, [], np.array([0])])
    def test_actions_of_agents_are_a_mapping(self, actions):
        env = du.UavParallelEnv("tiny", SHORT)
        env.reset(seed=1)
        with pytest.raises(
            ActionError, match=r"must be a mapping .* one for each of \['drone_0'\]"
        ):
            env.step(actions)

    @pytest.mark.parametrize("seed", [np.int64(3), np.int64(2**40)])
    def test_seeds_of_numpy(self, seed):
        for made in (du.UavEnv, du.UavParallelEnv):
            env = made("tiny", SHORT)
            env.reset(seed=seed)
            assert env.session.seed == int(seed)

    @pytest.mark.parametrize("seed", ["x", 1.5, -1])
    def test_seeds_that_are_none(self, seed):
        from gymnasium.error import Error

        for made in (du.UavEnv, du.UavParallelEnv):
            with pytest.raises(Error, match=r"^seed:? (-1|'x'|1.5): must be a whole number"):
                made("tiny", SHORT).reset(seed=seed)

    def test_numbers_of_environments(self):
        from gymnasium.error import Error

        assert du.UavVectorEnv("tiny", np.int64(2), SHORT).num_envs == 2
        with pytest.raises(Error, match="num_envs: 'x': must be a whole number"):
            du.UavVectorEnv("tiny", "x")


def test_where_ppo_is():
    with pytest.raises(ScenarioError, match=r"PPO is trained by policies/ppo.py of the checkout"):
        du.train("tiny", algorithm="ppo")
