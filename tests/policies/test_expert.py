"""The imitation and the search in one file: what they learn, and what their files do."""

from __future__ import annotations

import importlib.util
import json
import re
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import desim_uav as du
from desim_uav.env import UavParallelEnv, UavParallelVectorEnv
from desim_uav.policies import load_policy
from desim_uav.policies.mlp import MlpFile
from desim_uav.scenario.load import from_mapping
from tests.command_line import started
from tests.policies.far import FAR

ROOT = Path(__file__).parents[2]
EXPERT = ROOT / "policies" / "expert.py"
torch = pytest.importorskip("torch")
pytestmark = pytest.mark.thorough

SEEN_FAR: dict[str, Any] = FAR | {
    "observation": {"kind": "radar", "cells_x": 7, "cells_y": 7},
    "reward": {"kind": "qoe", "difference": False},
}
"""The same with what the expert sees, and is paid for."""

QUICK = {"envs": 2, "steps": 13, "imitations": 1, "searches": 1, "horizon": 3, "hidden": 8}


@pytest.fixture(scope="module")
def expert() -> Any:
    spec = importlib.util.spec_from_file_location("expert_in_one_file", EXPERT)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def trained(expert: Any, scenario: Any = SEEN_FAR, **changes: Any) -> tuple[Any, Any]:
    """The last network of a short training, as torch has it and as it is saved."""
    saved: list[Any] = []
    options = expert.options_of(**{**QUICK, **changes})
    net = expert.train(from_mapping(scenario), options, saved.append)
    return net, saved[-1]


def test_it_fits_in_one_file():
    assert len(EXPERT.read_text(encoding="utf-8").splitlines()) <= 450


@pytest.mark.parametrize(("passes", "start"), [((8, 0), 0), ((0, 8), 3)])
def test_it_learns_to_fly_to_the_users(
    expert: Any, tmp_path: Path, passes: tuple[int, int], start: int
):
    """By the teacher alone, and by the search alone from nearby: straight there, and then stay."""
    scenario = {**SEEN_FAR, "drones": {**SEEN_FAR["drones"], "start_cells": [[start, 0]]}}
    settings = {"imitations": passes[0], "searches": passes[1], "envs": 8, "horizon": 6}
    fast = {"batch": 16, "rate": 4e-3, "search_rate": 4e-3, "sharp": 9.0}
    network = trained(expert, scenario, **settings, hidden=160, every=1, **fast)[1]
    (tmp_path / "far.npz").write_bytes(network.to_bytes())
    script = tmp_path / "best.csv"
    script.write_text("step,drone,action\n" + "".join(f"{k},0,right\n" for k in range(4 - start)))
    mine, best = (
        du.run(scenario, policy=policy, episodes=2, engine="batch", progress=False).summaries()[0]
        for policy in (tmp_path / "far.npz", script)
    )
    assert mine["qoe3_percent"] == best["qoe3_percent"] > 60


TURNS = [
    lambda x, y: (x, y),
    lambda x, y: (1200 - x, y),
    lambda x, y: (x, 1200 - y),
    lambda x, y: (1200 - x, 1200 - y),
    lambda x, y: (y, x),
    lambda x, y: (y, 1200 - x),
    lambda x, y: (1200 - y, x),
    lambda x, y: (1200 - y, 1200 - x),
]
"""The places of a square map, turned in the order of ``symmetries``."""


def city(turn: Any) -> dict[str, Any]:
    """Two drones and four users on a square map, all of them turned."""
    users = [turn(x, y) for x, y in ((130, 700), (500, 710), (900, 250), (1100, 1150))]
    start = [[int(at // 240) for at in turn(*place)] for place in ((360, 600), (840, 120))]
    return {
        **SEEN_FAR,
        "map": {"size_m": [1200, 1200], "cells": [5, 5], "dimensions": 2},
        "drones": {"count": 2, "start_cells": start, "battery": None},
        "users": {"positions_m": users, "mobility": {"kind": "static"}},
    }


@pytest.mark.parametrize("k", range(8))
def test_a_turned_map_is_seen_as_the_map_is_turned(expert: Any, k: int):
    """What drones see and do on a turned map is what they see and do, turned."""
    shown = []
    for turn, action in ((TURNS[0], 2), (TURNS[k], None)):
        env = UavParallelVectorEnv(from_mapping(city(turn)), 1)
        world = env.sessions[0].world
        features, signs, actions = expert.symmetries(world)[k]
        low, scale = expert.scaling(world)
        env.reset(seed=0)
        command = list(actions).index(2) if action is None else action
        seen = env.step(np.array([[command, 4]]))[0]
        shown.append((seen[0] - low) * scale)
    plain, turned = shown
    assert np.allclose(plain[:, features] * signs, turned, atol=1e-6)
    assert len(expert.symmetries(world)) == 8


def test_a_search_finds_what_an_environment_gains(expert: Any):
    """Each action of a drone is tried, and then the network's best ones follow."""
    scenario = {**SEEN_FAR, "drones": {**SEEN_FAR["drones"], "start_cells": [[3, 0]]}}
    options = expert.options_of(**{**QUICK, "gamma": 0.5})
    city = expert.City(from_mapping(scenario), options)
    net = expert.Net(city.env.sessions[0].world, 8)
    with torch.no_grad():
        for one in net.layers:
            one.weight.zero_()
        net.layers[-1].bias[4], net.layers[-1].bias[-1] = 1.0, 3.0  # hover; each value is 3
    seen, masks = city.begin()
    best, values = net.best(seen, masks)
    assert best.tolist() == [[4], [4]] and values.tolist() == [3.0, 3.0]
    gains = city.search(net, [0, 1], best, masks)
    returns = []
    for action in range(5):
        env = UavParallelEnv(from_mapping(scenario))
        env.reset(seed=0)
        paid = [env.step({"drone_0": one})[1]["drone_0"] for one in (action, 4, 4)]
        returns.append(paid[0] + paid[1] / 2 + paid[2] / 4)
    assert returns[2] > returns[4] == 0
    assert gains[0, 0].tolist() == pytest.approx([one - returns[4] for one in returns])
    assert gains[0].tolist() == gains[1].tolist()


def test_returns_end_with_the_value_of_the_last_state(expert: Any):
    """By hand, for gamma 1/2 and lambda 1/4; the second step ends an episode."""
    options = expert.options_of(gamma=0.5, decay=0.25)
    values = torch.tensor([[9.0], [5.0], [7.0], [3.0]])
    rewards, over = torch.tensor([[2.0], [4.0], [8.0]]), torch.tensor([[False], [True], [False]])
    found = expert.returns_of(values, rewards, over, options).flatten().tolist()
    second = 4 / 2 + 7 / 2
    assert found == [2 / 2 + (0.25 * second + 0.75 * 5) / 2, second, 8 / 2 + 3 / 2]


def test_a_file_computes_what_the_network_does(expert: Any):
    net, network = trained(expert)
    rng = np.random.default_rng(0)
    for _ in range(20):
        seen = rng.normal(size=len(network.low)).astype(np.float32)
        with torch.no_grad():
            logits, _, _ = net(torch.from_numpy((seen - network.low) * network.scale))
        assert np.allclose(network.scores(seen.tolist()), logits.numpy(), atol=1e-4)


def test_one_seed_gives_one_result(expert: Any):
    one, again, other = (trained(expert, seed=seed)[1].to_bytes() for seed in (3, 3, 4))
    assert one == again != other


@pytest.mark.parametrize("drones", [1, 5])
def test_one_network_flies_any_number_of_drones(drones: int):
    changes = {"drones.count": drones, "drones.shielded": True, "episode.steps": 8}
    run = du.run("case8", changes, policy="expert_case8.npz", engine="batch", progress=False)
    assert run.summaries()[0]["crashes"] == 0
    assert run.steps["drone"].nunique() == drones


def test_the_shipped_file_says_where_it_comes_from():
    about = load_policy("expert_case8.npz").about  # type: ignore[attr-defined]
    assert about["world_seed"] is None, "it is for any world"
    assert about["training"]["command"][0] == "policies/expert.py"


def test_it_is_interrupted_and_says_what_is_wrong(tmp_path: Path):
    (tmp_path / "far.yaml").write_text(json.dumps(SEEN_FAR))
    quick = ("--envs", 2, "--steps", 13, "--hidden", 8, "--out", tmp_path / "far.npz")
    with started(EXPERT, tmp_path / "far.yaml", *quick, "--imitations", 4096) as running:
        for line in running.stderr:
            if re.match(r"imitation [0-9]+", line) and (tmp_path / "far.npz").exists():
                break
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=60)
    assert running.returncode == 130 and out == "" and "interrupted" in err
    assert MlpFile(tmp_path / "far.npz").about["training"]["processor"]
    for arguments, code, message in (
        (("none.yaml",), 3, "none.yaml"),
        ((tmp_path / "far.yaml", "--gamma", 2), 2, "--gamma 2.0: must be from 0.0"),
        ((tmp_path / "far.yaml", "-S", "observation={kind: local}"), 2, "radar"),
        (("case8", "-S", "drones.motion.space=free"), 2, "from cell to cell"),
    ):
        with started(EXPERT, *arguments) as failed:
            out, err = failed.communicate(timeout=60)
        assert (failed.returncode, out) == (code, ""), err
        assert message in err and "Traceback" not in err
