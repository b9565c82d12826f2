"""Networks of Stable-Baselines3: they act as they were trained, and their files run no code."""

from __future__ import annotations

import base64
import io
import json
import pickle
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pandas as pd
import pytest
from gymnasium.spaces import MultiDiscrete
from gymnasium.wrappers import FlattenObservation

from desim_uav import cli
from desim_uav.env import InTurn, JointActions, UavEnv, UavParallelEnv
from desim_uav.env.configure import configured
from desim_uav.errors import MissingExtraError, PolicyError
from desim_uav.experiment.run import play, run
from desim_uav.measures.tally import headline
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.policies import load_policy, sb3
from desim_uav.policies.base import decide, file_of
from desim_uav.policies.trainings import trainings
from desim_uav.world import World, build_world
from tests.env.helpers import BRITTLE

ON_POLICY = {"n_steps": 32, "batch_size": 32, "n_epochs": 1}
OFF_POLICY = {"learning_starts": 16, "buffer_size": 100, "train_freq": 8}
ALGORITHMS: dict[str, dict[str, Any]] = {
    "PPO": ON_POLICY,
    "A2C": {"n_steps": 16},
    "MaskablePPO": ON_POLICY,
    "DQN": OFF_POLICY,
    "QRDQN": {**OFF_POLICY, "policy_kwargs": {"n_quantiles": 7, "net_arch": [8]}},
}
OF_SEVERAL_DRONES = ["PPO", "A2C", "MaskablePPO"]

POSITION = {**BRITTLE, "users.count": 12, "seed": 3}
LOCAL = {**POSITION, "observation.kind": "local"}
TWO = {**LOCAL, "drones.count": 2}


class OneDrone(gymnasium.Env[Any, Any]):
    """The first drone of a scenario; the others take their first allowed action."""

    def __init__(self, scenario: str, config: dict[str, Any]) -> None:
        self.each = UavParallelEnv(scenario, config)
        self.observation_space = self.each.observation_space("drone_0")["observation"]
        self.action_space = self.each.action_space("drone_0")

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.told, infos = self.each.reset(seed)
        return self.told["drone_0"]["observation"], infos["drone_0"]

    def step(self, action: Any) -> Any:
        first = {agent: int(seen["action_mask"].argmax()) for agent, seen in self.told.items()}
        self.told, *rest = self.each.step({**first, "drone_0": int(action)})
        return self.told["drone_0"]["observation"], *(part["drone_0"] for part in rest)

    def action_masks(self) -> Any:
        return self.told["drone_0"]["action_mask"].astype(bool)


class Lawful:
    """Gives a policy's commands, all of which must be allowed, and counts them."""

    ceiling = True

    def __init__(self, policy: Any) -> None:
        self.policy, self.commands = policy, 0

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        self.policy.begin(world, streams, carried)

    def act(self, observation: Any, mask: Any) -> int:
        raise AssertionError("drones are commanded together")

    def act_jointly(self, observations: Any, masks: Any) -> list[int]:
        commands = list(self.policy.act_jointly(observations, masks))
        assert all(mask[command] for mask, command in zip(masks, commands, strict=True))
        self.commands += len(commands)
        return commands


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """These networks are too small for more."""
    try:
        import torch
    except ModuleNotFoundError:
        yield
        return
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., tuple[Any, Path]]:
    """Train a little, and save: (model, file)."""
    known: dict[str, tuple[Any, Path]] = {}

    def train(algorithm: str, env: gymnasium.Env[Any, Any], **settings: Any) -> tuple[Any, Path]:
        origin = "stable_baselines3" if algorithm in ("PPO", "A2C", "DQN") else "sb3_contrib"
        learner = getattr(pytest.importorskip(origin), algorithm)
        options = {**ALGORITHMS[algorithm], **settings}
        model = learner("MlpPolicy", env, seed=0, device="cpu", **options).learn(64)
        file = tmp_path_factory.mktemp("models") / f"{algorithm}.zip"
        model.save(file)
        return model, file

    def remembered(algorithm: str, make: Callable[..., Any], *where: Any, **settings: Any) -> Any:
        key = repr((algorithm, make, where, settings))
        if key not in known:
            known[key] = train(algorithm, make(*where), **settings)
        return known[key]

    return remembered


@pytest.fixture
def tiny(trained: Any) -> Path:
    """The file of a network that was trained on tiny."""
    return trained("MaskablePPO", UavEnv, "tiny")[1]


def loaded(file: Path, world: World) -> Any:
    policy: Any = load_policy(f"sb3:{file}")
    policy.begin(world, Streams(0, Purpose.LEARNER, 0))
    return policy


def predicted(model: Any, seen: Any, mask: Any) -> Any:
    """The model's own actions; of one that knows no masks, what it would take of the allowed."""
    if type(model).__name__ == "MaskablePPO":
        return np.atleast_1d(model.predict(seen, deterministic=True, action_masks=mask)[0])
    actions = np.atleast_1d(model.predict(seen, deterministic=True)[0])
    allowed = mask.reshape(len(actions), -1)
    values = preferences(model, seen).reshape(allowed.shape)
    legal = allowed[range(len(actions)), actions]
    return np.where(legal, actions, np.where(allowed, values, -np.inf).argmax(axis=1))


def preferences(model: Any, seen: Any) -> Any:
    """How much a model without masks likes each action."""
    import torch

    batch, _ = model.policy.obs_to_tensor(seen)
    with torch.no_grad():
        if hasattr(model, "q_net"):
            return model.q_net(batch).numpy()
        if hasattr(model, "quantile_net"):
            return model.quantile_net(batch).mean(dim=1).numpy()
        shown = model.policy.get_distribution(batch).distribution
        parts = shown if isinstance(shown, list) else [shown]
        return torch.cat([part.probs for part in parts], dim=1).numpy()


# ---- they act as they were trained


@pytest.mark.parametrize(
    ("scenario", "config", "algorithm"),
    [("tiny", {"observation.kind": kind}, name) for kind in ("position", "local")
     for name in ALGORITHMS]
    + [("case1", {}, "MaskablePPO")]
    + [("case8", config, name) for config in (POSITION, LOCAL) for name in OF_SEVERAL_DRONES],
)  # fmt: skip
def test_a_controller_of_all_drones(
    scenario: str, config: dict[str, Any], algorithm: str, trained: Any
):
    model, file = trained(algorithm, UavEnv, scenario, config)
    env = UavEnv(scenario, config)
    policy = loaded(file, env.session.world)
    for _ in range(2):
        seen, _ = env.reset()
        over = False
        while not over:
            commands = decide(policy, env.session.snapshot, env.session.world)
            assert commands == predicted(model, seen, env.action_masks()).tolist()
            assert (
                env.action_masks().reshape(len(commands), -1)[range(len(commands)), commands].all()
            )
            seen, _, terminated, truncated, _ = env.step(
                commands if len(commands) > 1 else commands[0]
            )
            over = terminated or truncated


@pytest.mark.parametrize("config", [POSITION, TWO], ids=["position", "local"])
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_pilot_of_each_drone(algorithm: str, config: dict[str, Any], trained: Any):
    model, file = trained(algorithm, OneDrone, "case8", config)
    env = UavParallelEnv("case8", config)
    policy = loaded(file, env.session.world)
    assert policy.act_jointly is None
    rng = np.random.default_rng(0)
    changed = 0
    for _ in range(2):
        told, _ = env.reset()
        while env.agents:
            shown = env.session.snapshot
            commands = decide(policy, shown, env.session.world)
            for (seen, mask), command, observation in zip(
                map(dict.values, told.values()), commands, shown.observations, strict=True
            ):
                assert mask[command]
                assert [command] == predicted(model, seen, mask).tolist()
                some = rng.permutation(np.arange(len(mask)) < 3)
                assert [policy.act(observation, some)] == predicted(model, seen, some).tolist()
                changed += not some[model.predict(seen, deterministic=True)[0]]
            told, *_ = env.step(dict(zip(env.agents, commands, strict=True)))
    assert changed > 30


def test_a_pilot_of_the_only_drone_flies_each_of_many(trained: Any):
    config = {**LOCAL, "drones.count": 1}
    model, file = trained("DQN", UavEnv, "case8", config)
    assert loaded(file, UavEnv("case8", config).session.world).act_jointly is not None
    env = UavEnv("case8", LOCAL)
    policy = loaded(file, env.session.world)
    assert policy.act_jointly is None
    seen, _ = env.reset()
    masks = env.action_masks().reshape(3, -1)
    expected = [
        predicted(model, own, mask)[0] for own, mask in zip(seen.reshape(3, -1), masks, strict=True)
    ]
    assert decide(policy, env.session.snapshot, env.session.world) == expected


def wrapped(wrappers: tuple[Callable[[Any], Any], ...], config: dict[str, Any]) -> Any:
    env: Any = UavEnv("case8", config)
    for wrapper in wrappers:
        env = wrapper(env)
    return env


def chosen_by(model: Any, env: Any, seen: Any) -> tuple[list[int], Any]:
    """What a model lets all drones do, from its environment, which it steps; and what is next."""
    n, drones = 9, env.unwrapped.drones
    if isinstance(env, InTurn):
        actions = []
        for _ in range(drones):
            (action,) = predicted(model, seen, env.action_masks())
            actions.append(int(action))
            seen, _, *over, _ = env.step(actions[-1])
        return actions, (seen, any(over))
    masks = env.get_wrapper_attr("action_masks")()
    actions = predicted(model, seen, masks).tolist()
    seen, _, *over, _ = env.step(actions if len(actions) > 1 else actions[0])
    if len(actions) == 1:
        actions = [actions[0] // n**k % n for k in reversed(range(drones))]
    return actions, (seen, any(over))


@pytest.mark.thorough
@pytest.mark.parametrize("config", [POSITION, TWO], ids=["position", "local"])
@pytest.mark.parametrize(
    ("algorithm", "wrappers"),
    [
        ("DQN", (JointActions,)),
        ("QRDQN", (FlattenObservation, JointActions)),
        ("MaskablePPO", (JointActions,)),
        ("DQN", (InTurn,)),
        ("MaskablePPO", (InTurn,)),
        ("PPO", (FlattenObservation,)),
    ],
)
def test_networks_that_were_trained_on_wrappers_fly(
    algorithm: str, wrappers: Any, config: dict[str, Any], trained: Any
):
    """They command what they would choose in their environment, if masks are heeded."""
    model, file = trained(algorithm, wrapped, wrappers, config)
    env, flown = wrapped(wrappers, config), UavEnv("case8", config)
    policy = loaded(file, flown.session.world)
    assert policy.act_jointly is not None
    (seen, _), _ = env.reset(seed=5), flown.reset(seed=5)
    over, different = False, set()
    while not over:
        commands = decide(policy, flown.session.snapshot, flown.session.world)
        mine, (seen, over) = chosen_by(model, env, seen)
        assert commands == mine
        different.add(tuple(mine))
        flown.step(np.array(commands))
    assert len(different) > 1


def test_so_many_joint_actions_that_no_network_has_them():
    """Their number would not fit into a space either."""
    world = build_world(configured("case8", {**LOCAL, "drones.count": 25}), 0)
    assert {str(each.actions) for each in trainings(world)} == {
        str(MultiDiscrete([9] * 25)),
        "Discrete(9)",
    }


@pytest.mark.parametrize(
    ("algorithm", "settings"),
    [
        ("PPO", {"net_arch": [8], "activation_fn": "ELU", "ortho_init": False}),
        ("PPO", {"net_arch": {"pi": [], "vf": [4]}, "share_features_extractor": False}),
        ("MaskablePPO", {"net_arch": {"pi": [8, 4], "vf": []}, "activation_fn": "ReLU"}),
        ("DQN", {"net_arch": [], "activation_fn": "Tanh"}),
    ],
)
def test_networks_of_other_forms(algorithm: str, settings: dict[str, Any], trained: Any):
    torch = pytest.importorskip("torch")
    if "activation_fn" in settings:
        settings = {**settings, "activation_fn": getattr(torch.nn, settings["activation_fn"])}
    model, file = trained(algorithm, UavEnv, "case1", policy_kwargs=settings)
    env = UavEnv("case1")
    policy = loaded(file, env.session.world)
    env.reset()
    for x in range(10):
        for y in range(10):
            seen = env.session.snapshot.observations[0]._replace(features=(x, y))
            mask = env.action_masks()
            assert [policy.act(seen, mask)] == predicted(model, np.array([x, y]), mask).tolist()


def test_worlds_with_more_levels_or_fewer(trained: Any):
    """The spaces are those of all worlds of a scenario; with a world seed, of one."""
    config = {**POSITION, "map.levels.step_m": 7}
    found = {
        world_seed: UavEnv("case8", {**config, "world_seed": world_seed})
        for world_seed in (None, 1, 2, 3)
    }
    levels = {seed: env.observation_space.nvec[2] for seed, env in found.items()}
    assert len(set(levels.values())) > 2
    _, wide = trained("A2C", UavEnv, "case8", config)
    for env in found.values():
        loaded(wide, env.session.world)
    low, *_, high = sorted((1, 2, 3), key=lambda seed: levels[seed])
    _, narrow = trained("A2C", UavEnv, "case8", {**config, "world_seed": low})
    loaded(narrow, build_world(configured("case8", config), low))
    with pytest.raises(PolicyError, match=f"trained on .*10, 10, {levels[low]}, 8, .*; case8 has"):
        loaded(narrow, found[high].session.world)


def test_a_network_is_built_once_for_a_world(tiny: Path, monkeypatch: pytest.MonkeyPatch):
    built = []
    monkeypatch.setattr(sb3, "_network", lambda *_: built.append(1))
    policy = load_policy(f"sb3:{tiny}")
    one, other = UavEnv("tiny").session.world, UavEnv("tiny", {"seed": 5}).session.world
    for world in (one, one, other, one):
        policy.begin(world, Streams(0, Purpose.LEARNER, 0))
    assert len(built) == 3


def test_a_network_is_the_base_of_a_rollout(tiny: Path):
    name = f"rollout:sb3:{tiny}+samples=1+horizon=1"
    assert file_of(name) == tiny
    world = build_world(configured("tiny"), 0)
    ((log, _),) = play(world, load_policy(name), "mine", 0, engine="batch")
    assert all(step.action == step.action_taken for step in log.steps)


def test_nothing_of_torch_is_changed(tiny: Path):
    torch = pytest.importorskip("torch")
    before = torch.get_rng_state(), torch.get_num_threads(), torch.is_grad_enabled()
    env = UavEnv("tiny")
    env.reset()
    decide(loaded(tiny, env.session.world), env.session.snapshot, env.session.world)
    assert torch.equal(torch.get_rng_state(), before[0])
    assert (torch.get_num_threads(), torch.is_grad_enabled()) == before[1:]


# ---- from the command line


def test_the_command_line_runs_a_network(trained: Any, tmp_path: Path):
    _, file = trained("PPO", UavEnv, "case8", LOCAL)
    folder = tmp_path / "out"
    changes = [f"{key}={json.dumps(value)}" for key, value in LOCAL.items()]
    start = "import sys; from desim_uav.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", start, "run", "case8", "--json", "-q"]
    command += ["--policy", f"sb3:{file}"]
    command += [part for change in changes for part in ("-S", change)]
    command += ["--episodes", "2", "--out", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["policy"] == f"sb3:{file}"
    steps = pd.read_parquet(folder / "steps.parquet")
    world = build_world(configured("case8", LOCAL), 3)
    played = play(world, load_policy(f"sb3:{file}"), "mine", 3, episodes=2)
    taken = [step.action for log, _ in played for step in log.steps]
    assert len(taken) == 2 * 30 * 3
    names = [world.actions[action].name.lower() for action in taken]
    assert steps["action"].astype(str).str.lower().tolist() in (names, [str(a) for a in taken])
    assert (steps["action"] == steps["action_taken"]).all(), (
        "the same in another process, all legal"
    )


def test_the_exit_code_of_a_misfit(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(sys, "argv", ["desim-uav", "run", "case8", "--policy", f"sb3:{tiny}"])
    monkeypatch.setattr(sys.modules["desim_uav.cli.main"], "end_politely", lambda: None)
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 4
    printed = capsys.readouterr()
    assert printed.out == ""
    assert str(tiny) in printed.err
    assert "Traceback" not in printed.err
    assert not list(tmp_path.rglob("*.parquet"))


# ---- files that do not fit


def test_a_misfit_says_what_was_trained_and_what_the_scenario_has(tiny: Path):
    with pytest.raises(PolicyError) as problem:
        loaded(tiny, UavEnv("case8", POSITION).session.world)
    one = "10, 10, 2, 8"
    assert str(problem.value) == (
        f"{tiny}: the network was trained on observations MultiDiscrete[3, 3] "
        "and actions Discrete[5]; "
        f"case8 has observations MultiDiscrete[{one}, {one}, {one}] and actions "
        f"MultiDiscrete[9, 9, 9], or observations MultiDiscrete[{one}] and actions Discrete[9], or "
        "what FlattenObservation, JointActions and InTurn make of these"
    )


@pytest.mark.parametrize("config", [{"observation.kind": "local"}, {"map.cells": [2, 4]}])
def test_the_same_number_of_inputs_is_not_enough(config: dict[str, Any], tiny: Path):
    if "map.cells" in config:
        config = {**config, "drones.start_cells": [[0, 1]]}
    with pytest.raises(PolicyError, match="trained on"):
        loaded(tiny, UavEnv("tiny", config).session.world)


@pytest.mark.parametrize(
    ("key", "shown", "reason"),
    [
        ("observation_space", {":type:": "<class 'gymnasium.spaces.dict.Dict'>"}, "Dict"),
        ("action_space", {":type:": "<class 'gymnasium.spaces.box.Box'>", "_shape": [2]}, "Box"),
    ],
)
def test_other_spaces(key: str, shown: dict[str, Any], reason: str, tiny: Path, tmp_path: Path):
    file = rewritten(tiny, tmp_path, **{key: shown})
    with pytest.raises(PolicyError, match=f"trained on .*{reason}"):
        loaded(file, UavEnv("tiny").session.world)


def test_weights_that_do_not_fit_the_settings(tiny: Path, tmp_path: Path):
    file = rewritten(tiny, tmp_path, policy_kwargs={"net_arch": [7]})
    with pytest.raises(PolicyError, match="its weights do not fit"):
        loaded(file, UavEnv("tiny").session.world)


# ---- files that are none, and files that lie in wait


class Touch:
    """A pickle of this touches a file when it is loaded."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self) -> Any:
        return Path.touch, (self.file,)


def rewritten(file: Path, folder: Path, /, **changes: Any) -> Path:
    """A copy, with keys of its data changed, or members (``policy_pth``) replaced."""
    copy = folder / "copy.zip"
    with zipfile.ZipFile(file) as old, zipfile.ZipFile(copy, "w") as new:
        data = json.loads(old.read("data"))
        weights = changes.pop("policy_pth", old.read("policy.pth"))
        new.writestr("data", json.dumps({**data, **changes}))
        new.writestr("policy.pth", weights)
    return copy


def handmade(folder: Path, **changes: Any) -> Path:
    """What can be seen of a file, without the libraries."""
    spaces = {
        "observation_space": {":type:": "<class 'a.MultiDiscrete'>", "nvec": "[3 3]"},
        "action_space": {":type:": "<class 'a.Discrete'>", "n": "5"},
    }
    policy = {
        "__module__": "stable_baselines3.common.policies",
        "__init__": "<function ActorCriticPolicy.__init__ at 0x7f>",
    }
    data = {"policy_class": policy, "policy_kwargs": {}, **spaces, **changes}
    file = folder / "handmade.zip"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("data", json.dumps(data))
        archive.writestr("policy.pth", b"")
    return file


def refused(file: Path, *parts: str) -> None:
    with pytest.raises(PolicyError) as problem:
        load_policy(f"sb3:{file}")
    message = str(problem.value)
    assert message.startswith(f"{file}: ")
    assert "\n" not in message
    assert problem.value.exit_code == 4
    for part in parts:
        assert part in message


def test_pickles_are_passed_over(tiny: Path, tmp_path: Path):
    touched = tmp_path / "touched"
    trap = base64.b64encode(pickle.dumps(Touch(touched))).decode()
    with zipfile.ZipFile(tiny) as archive:
        data = json.loads(archive.read("data"))
    pickled = [key for key, value in data.items() if ":serialized:" in str(value)]
    assert {"policy_class", "observation_space", "action_space"} <= set(pickled)
    traps = {key: {**data[key], ":serialized:": trap} for key in pickled}
    kwargs = {":type:": "<class 'dict'>", ":serialized:": trap}
    file = rewritten(tiny, tmp_path, **{**traps, "policy_kwargs": kwargs, "env": kwargs})

    env = UavEnv("tiny")
    env.reset()
    shown, world = env.session.snapshot, env.session.world
    assert decide(loaded(file, world), shown, world) == decide(loaded(tiny, world), shown, world)
    assert not touched.exists()
    pickle.loads(base64.b64decode(trap))
    assert touched.exists(), "the trap works"


def test_weights_that_are_code(tiny: Path, tmp_path: Path):
    torch = pytest.importorskip("torch")
    touched = tmp_path / "touched"
    for content in (Touch(touched), {"action_net.weight": Touch(touched)}):
        trap = io.BytesIO()
        torch.save(content, trap)
        refused(rewritten(tiny, tmp_path, policy_pth=trap.getvalue()), "not a readable network")
    refused(rewritten(tiny, tmp_path, policy_pth=pickle.dumps(Touch(touched))))
    assert not touched.exists()


def test_weights_that_are_not_numbers(tiny: Path, tmp_path: Path):
    torch = pytest.importorskip("torch")
    for value in (float("nan"), float("inf")):
        with zipfile.ZipFile(tiny) as archive:
            weights = torch.load(io.BytesIO(archive.read("policy.pth")), weights_only=True)
        weights["action_net.bias"][2] = value
        content = io.BytesIO()
        torch.save(weights, content)
        refused(rewritten(tiny, tmp_path, policy_pth=content.getvalue()), "action_net.bias")


def test_what_is_no_file_of_a_network(tmp_path: Path):
    file = tmp_path / "model.zip"
    refused(file, "No such file")
    refused(tmp_path, "directory")
    file.write_bytes(b"not a zip")
    refused(file, "zip")
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("data", "{}")
    refused(file, "policy.pth")
    for data in ("{", "[]", "{}", '{"policy_class": 3}', "[" * 100_000, b"\xff"):
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr("data", data)
            archive.writestr("policy.pth", b"")
        refused(file, "not a readable network")


def test_what_is_too_large(tiny: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    for name in ("data", "policy.pth"):
        monkeypatch.setitem(sb3.LARGEST, name, 100)
        refused(tiny, f"{name} is larger than")
        monkeypatch.undo()
    inner = io.BytesIO()
    with zipfile.ZipFile(inner, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("archive/data/0", bytes(10**6))
    assert len(inner.getvalue()) < 10**4
    monkeypatch.setitem(sb3.LARGEST, "policy.pth", 10**5)
    refused(rewritten(tiny, tmp_path, policy_pth=inner.getvalue()), "policy.pth is larger than")


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("stable_baselines3.common.policies", "MultiInputActorCriticPolicy"),
        ("stable_baselines3.common.policies", "ActorCriticCnnPolicy"),
        ("sb3_contrib.common.recurrent.policies", "RecurrentActorCriticPolicy"),
        ("stable_baselines3.sac.policies", "CnnPolicy"),
        ("__main__", "ActorCriticPolicy"),
        ("os", "system"),
    ],
)
def test_other_policies(module: str, name: str, tmp_path: Path):
    shown = {"__module__": module, "__init__": f"<function {name}.__init__ at 0x7f>"}
    refused(handmade(tmp_path, policy_class=shown), f"its policy is {module}.{name}; ", "MlpPolicy")
    refused(handmade(tmp_path, policy_class={"__module__": "mine"}), "its policy is mine.?")


@pytest.mark.parametrize(
    ("key", "shown"),
    [
        ("features_extractor_class", "<class 'my_module.Extractor'>"),
        ("activation_fn", "<class 'my_module.ReLU'>"),
        ("activation_fn", "<class 'torch.nn.modules.activation.Threshold'>"),
        ("net_arch", [10**9]),
        ("net_arch", [64] * 1000),
        ("net_arch", {"pi": [64], "other": [64]}),
        ("net_arch", "[64]"),
        ("net_arch", [True]),
        ("n_quantiles", 10**9),
        ("share_features_extractor", "yes"),
    ],
)
def test_settings_that_cannot_be_trusted(key: str, shown: Any, tmp_path: Path):
    pytest.importorskip("stable_baselines3")
    for pickled in ({}, {":type:": "<class 'dict'>", ":serialized:": "gASVCw=="}):
        kwargs = {**pickled, "ortho_init": True, key: shown}
        refused(handmade(tmp_path, policy_kwargs=kwargs), f"policy_kwargs: {key}: ")


def test_a_custom_features_extractor_is_refused_by_name(trained: Any):
    layers = pytest.importorskip("stable_baselines3.common.torch_layers")
    kwargs = {"features_extractor_class": layers.FlattenExtractor}
    _, file = trained("PPO", UavEnv, "tiny", policy_kwargs=kwargs)
    refused(file, "features_extractor_class")


@pytest.mark.parametrize("name", ["sb3", "sb3:"])
def test_a_network_needs_its_file(name: str):
    with pytest.raises(PolicyError, match=r"sb3:FILE\.zip"):
        load_policy(name)


def test_a_missing_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.policies", None)
    file = handmade(tmp_path)
    with pytest.raises(MissingExtraError) as problem:
        load_policy(f"sb3:{file}")
    assert problem.value.exit_code == 5
    assert f"sb3:{file}" in str(problem.value)
    assert 'pip install -e ".[sb3]"' in str(problem.value)


def test_the_libraries_are_imported_only_for_a_network():
    code = (
        "import sys, desim_uav.policies; print({'torch', 'stable_baselines3'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


# ---- the recipe


def most_users(world: World) -> int:
    """The users that the best cell covers, counted without rounding."""
    radius_m = Fraction(world.scenario.drones.footprint_radius_m)

    def covered(ix: int, iy: int) -> int:
        x, y = map(Fraction, world.grid.centre(ix, iy))
        return sum(
            (Fraction(u) - x) ** 2 + (Fraction(v) - y) ** 2 <= radius_m**2
            for u, v, _ in world.homes.tolist()
        )

    nx, ny = world.grid.cells
    return max(covered(ix, iy) for ix in range(nx) for iy in range(ny))


def test_the_recipe(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    pytest.importorskip("sb3_contrib")
    from policies.train_maskable_ppo import main

    file = tmp_path / "model.zip"
    main(["case8", str(file), "--steps", "400", "--seed", "4"])
    assert f"desim-uav run case8 --seed 4 --policy sb3:{file}" in capsys.readouterr().out
    world = build_world(configured("case8", {"seed": 4}), 4)
    ((log, _),) = play(world, Lawful(load_policy(f"sb3:{file}")), "mine", 4)
    assert all(step.action == step.action_taken for step in log.steps)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_maskable_ppo_finds_the_best_cell_of_case_1(seed: int, tmp_path: Path):
    pytest.importorskip("sb3_contrib")
    from policies.train_maskable_ppo import train

    file = tmp_path / "model.zip"
    train("case1", 20_000, seed).save(file)
    world = build_world(configured("case1"), seed)
    assert world.scenario.episode.carry_over
    policy = Lawful(load_policy(f"sb3:{file}"))
    results = run(world, policy, "mine", seed, episodes=20, warmup=2)
    assert policy.commands == 22 * 30
    done = headline(results.requests, results.episodes)
    best = most_users(world) / 14
    assert best > 0.5
    assert done["reward_mean"] / 30 >= 0.95 * best
    assert done["qoe3_percent"] >= 0.95 * 100 * best
