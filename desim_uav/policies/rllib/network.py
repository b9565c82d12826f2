"""A network of RLlib with its connectors, rebuilt from a file's description and numbers."""

from __future__ import annotations

import importlib
import logging
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import ray
import torch
from gymnasium.spaces import Box, Dict, Discrete
from numpy.typing import NDArray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.algorithms.ppo.ppo_catalog import PPOCatalog
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.env import INPUT_ENV_SINGLE_SPACES
from ray.rllib.env.multi_agent_episode import MultiAgentEpisode
from ray.rllib.utils.filter import RunningStat

from desim_uav.model.observations import Feature
from desim_uav.policies.rllib.file import CONNECTORS, MODULES, Saved
from desim_uav.spaces import observation_space
from desim_uav.world import World


def ray_version() -> str:
    """Return the version of Ray that is installed."""
    return str(ray.__version__)


class Network:
    """Chooses the greedy actions of all drones, through the connectors of the training.

    It keeps an episode as RLlib's EnvRunner does, so that filters and recurrent networks find
    there what they found in training. Filters no longer update their statistics.
    """

    def __init__(self, about: dict[str, Any], world: World) -> None:
        """Build all but the weights. Raises ValueError, or RLlib's errors, for wrong settings."""
        self._agents = [f"drone_{drone}" for drone in range(world.scenario.drone_count)]
        mapping = dict(zip(self._agents, about["agents"], strict=True))
        self._module_of = lambda agent, episode, **_: mapping[agent]
        space = observation_space(Feature(*feature) for feature in about["features"])
        actions = len(world.actions)
        self._dtype = space.dtype
        self._mask_size = actions
        mask = Box(0, 1, (actions,), np.int8)
        each = Dict({"observation": space, "action_mask": mask})
        self._observations = Dict(dict.fromkeys(self._agents, each))
        self._actions = Dict({agent: Discrete(actions) for agent in self._agents})
        with _quiet():
            self._to_module, self._to_env = self._pipelines(about)
            self._specs = self._specified(about["modules"])
        self._weights = {name: module["weights"] for name, module in about["modules"].items()}
        self._lowest = [[feature[1] for feature in about["features"]]] * len(self._agents)
        self._shared: dict[str, Any] = {}

    def require(self, statistics: int) -> None:
        """Raise ValueError if the filters do not have this number of statistics."""
        if statistics != statistics_of(self._to_module).size:
            raise ValueError(
                f"it has {statistics:,} statistics, which is not the number that its filters have"
            )

    def fill(self, saved: Saved) -> None:
        """Load the numbers of a file, and compute one decision as a check.

        Raises ValueError, or an error of RLlib's, if the numbers do not fit.
        """
        self.require(saved.statistics.size)
        with _quiet():
            _fill_filters(self._to_module, saved.statistics)
            self._modules = self._built(saved.weights)
        self.begin()
        self.decide(self._lowest, [[True] * self._mask_size] * len(self._agents))

    def begin(self) -> None:
        """Begin an episode."""
        self._episode = MultiAgentEpisode(
            observation_space=dict(self._observations.spaces),
            action_space=dict(self._actions.spaces),
            agent_to_module_mapping_fn=self._module_of,
        )
        self._last: tuple[dict[str, int], dict[str, Any]] | None = None

    def decide(
        self, codes: Sequence[Sequence[float]], masks: Sequence[Sequence[bool]]
    ) -> list[int]:
        """Return the best allowed action of each drone; ``codes`` are the encoded observations."""
        allowed = dict(zip(self._agents, np.array(masks, np.int8), strict=True))
        rows = dict(zip(self._agents, np.array(codes, self._dtype), strict=True))
        self._go_on(rows, allowed)
        with torch.no_grad():
            batch = self._to_module(
                rl_module=self._modules,
                episodes=[self._episode],
                explore=False,
                shared_data=self._shared,
            )
            output = self._to_env(
                rl_module=self._modules,
                batch=self._modules.forward_inference(batch),
                episodes=[self._episode],
                explore=False,
                shared_data=self._shared,
            )
        actions = output.pop(Columns.ACTIONS)[0]
        extra = {
            agent: {column: one[0][agent] for column, one in output.items()} for agent in actions
        }
        for agent, mask in allowed.items():
            if not mask[
                actions[agent]
            ]:  # of a network that knows no masks: what it would else take
                logits = extra[agent][Columns.ACTION_DIST_INPUTS]
                actions[agent] = np.where(mask, logits, -np.inf).argmax()
        self._last = actions, extra
        return [int(actions[agent]) for agent in self._agents]

    def _go_on(self, rows: dict[str, NDArray[Any]], allowed: dict[str, NDArray[np.int8]]) -> None:
        """Add the present observations to the episode."""
        observations = {
            agent: {"observation": rows[agent], "action_mask": allowed[agent]} for agent in rows
        }
        if self._last is None:
            self._episode.add_env_reset(observations=observations)
            return
        actions, extra = self._last
        self._episode.add_env_step(
            observations=observations,
            actions=actions,
            rewards=dict.fromkeys(observations, 0.0),  # nothing that is known here reads them
            terminateds={"__all__": False},
            truncateds={"__all__": False},
            extra_model_outputs=extra,
        )

    def _pipelines(self, about: dict[str, Any]) -> tuple[Any, Any]:
        """Return RLlib's pipelines from the environment to the module and back."""
        pieces = [_connector(connector) for connector in about["connectors"]]
        config = (
            PPOConfig()
            .multi_agent(policies=set(about["modules"]), policy_mapping_fn=self._module_of)
            .env_runners(env_to_module_connector=lambda env=None, spaces=None, device=None: pieces)
        )
        spaces = {INPUT_ENV_SINGLE_SPACES: (self._observations, self._actions)}
        both = (
            config.build_env_to_module_connector(spaces=spaces, device="cpu"),
            config.build_module_to_env_connector(spaces=spaces),
        )
        pipelines = [pipelines_of(one) for one in both]
        if pipelines != about["pipelines"]:
            raise ValueError(f"its pipelines are {about['pipelines']}; RLlib builds {pipelines}")
        return both

    def _specified(self, modules: dict[str, Any]) -> dict[str, RLModuleSpec]:
        """Return the networks to build. Raises ValueError if their weights would not fit."""
        spaces = self._to_module.observation_space
        specs = {
            name: RLModuleSpec(
                module_class=_class_of(MODULES, modules[name]["class"]),
                observation_space=spaces[name],
                action_space=self._actions[self._agents[0]],
                inference_only=True,
                model_config=dict(modules[name]["settings"]),
                catalog_class=PPOCatalog,
            )
            for name in modules
        }
        for name, spec in specs.items():
            with torch.device("meta"):  # which takes no memory, however large the settings are
                shapes = shapes_of(spec.build())
            if shapes != modules[name]["weights"]:
                raise ValueError(f"the weights of {name} do not fit its settings")
        return specs

    def _built(self, weights: NDArray[np.float32]) -> Any:
        """Return the networks with their weights loaded."""
        with torch.random.fork_rng(devices=[]):  # first weights are drawn, and leave no trace
            modules = MultiRLModuleSpec(rl_module_specs=self._specs).build()
        first = 0
        for name in sorted(self._weights):
            state = {}
            for weight, shape in self._weights[name]:
                size = math.prod(shape)
                state[weight] = weights[first : first + size].reshape(shape).copy()
                first += size
            modules[name].set_state(state)
            modules[name].eval()
        return modules


def shapes_of(module: Any) -> list[list[Any]]:
    """Return [name, shape] of each weight that a module needs to act."""
    others = tuple(f"{name}." for name in module.get_non_inference_attributes())
    state = module.state_dict()
    return [[name, list(w.shape)] for name, w in state.items() if not name.startswith(others)]


def pipelines_of(pipeline: Any) -> list[str]:
    """Return the names of a pipeline's connectors, in order."""
    return [type(piece).__name__ for piece in pipeline.connectors]


def statistics_of(pipeline: object) -> NDArray[np.float64]:
    """Return the statistics of a pipeline's filters: mean and sum of squares per number."""
    parts: list[Any] = [np.zeros(0)]
    for _, _, running in _running(pipeline):
        parts += [
            [running.num_pushes],
            running.mean_array.ravel(),
            running.sum_sq_diff_array.ravel(),
        ]
    return np.concatenate(parts).astype(np.float64)


def _running(pipeline: Any) -> Iterator[tuple[Any, dict[str, Any], Any]]:
    """Yield the filters of a pipeline, each with its state and its statistics of one agent."""
    for piece in pipeline.connectors:
        if type(piece).__name__ == "MeanStdFilter":
            state = piece.get_state()
            for agent in sorted(state):
                (running,) = state[agent]["running_stats"]
                yield piece, {agent: state[agent]}, RunningStat.from_state(running)


def _fill_filters(pipeline: object, statistics: NDArray[np.float64]) -> None:
    """Load the statistics of the training into the filters."""
    first = 0
    for piece, state, running in list(_running(pipeline)):
        size = running.mean_array.size
        part = statistics[first : first + 1 + 2 * size]
        first += len(part)
        running.num_pushes = int(part[0])
        running.mean_array = part[1 : 1 + size].reshape(running.mean_array.shape).copy()
        running.sum_sq_diff_array = part[1 + size :].reshape(running.mean_array.shape).copy()
        (agent,) = state
        piece.set_state({agent: {**state[agent], "running_stats": [running.to_state()]}})


def _connector(about: dict[str, Any]) -> Any:
    """Return a known connector that no longer updates its statistics."""
    settings = dict(about["settings"])
    if about["class"] in ("FlattenObservations", "MeanStdFilter"):
        settings["multi_agent"] = True
    if about["class"] == "MeanStdFilter":
        settings["update_stats"] = False
    return _class_of(CONNECTORS, about["class"])(**settings)


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress the warnings that RLlib raises about its own code."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(before)


def _class_of(where: dict[str, str], name: str) -> Any:
    return getattr(importlib.import_module(where[name]), name)
