"""A PyTorch module as a policy: one network that flies every drone.

The module is called with a batch of what drones observe, float32 (drones, features): the numbers
that ``UavParallelEnv`` gives each of them, not scaled. It returns one number for each action,
(drones, actions), the higher the better; the best one that the mask allows is taken. In free
flight it returns the numbers of a command instead, which are cut off at -1 and 1.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

from desim_uav.commands.given import Command
from desim_uav.errors import PolicyError
from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import DECIDES
from desim_uav.model.state import Observation
from desim_uav.policies.network_file import reason
from desim_uav.world import World


class TorchModule:
    """Chooses the best allowed action of each drone by a ``torch.nn.Module``.

    Of equally good actions it takes the first. The module is in evaluation mode while it is called.
    """

    ceiling = True

    def __init__(self, module: Any, name: str) -> None:
        self.module, self.name = module, name
        self._world: World | None = None

    @classmethod
    def of_model(cls, model: Any, name: str) -> TorchModule:
        """Act by a module; tables and messages call the policy ``name``."""
        return cls(model, name)

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Ask the module once. Raises PolicyError if it does not fit the scenario."""
        if world is self._world:
            return
        self._commands = world.commands.of_all("a network")
        self._torch = importlib.import_module("torch")
        self._encode = world.scenario.observation.encode
        self._inputs = max(map(len, world.features_of_types))
        self._outputs = len(self._commands.outputs)
        self._world = world
        self._scores([[0.0] * self._inputs])

    def act(self, observation: Observation, mask: Sequence[bool]) -> Command:
        """Return the command of one drone (see ``act_jointly``)."""
        return self.act_jointly([observation], [mask])[0]

    def act_jointly(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> list[Command]:
        """Return for each drone the forced action, or else the best allowed one or the command."""
        assert self._world is not None, "begin comes first"
        world = self._world
        codes = [self._encode(one, world.facts_of(one.drone)) for one in observations]
        padded = [[*each, *[0.0] * (self._inputs - len(each))] for each in codes]
        commands = self._commands.best(self._scores(padded), masks)
        for k, (one, mask) in enumerate(zip(observations, masks, strict=True)):
            if one.mode not in DECIDES:
                commands[k] = list(mask).index(True)
        return commands

    def _scores(self, codes: Sequence[Sequence[float]]) -> Any:
        """Return the module's numbers, float64 (drones, outputs). Raises PolicyError."""
        torch = self._torch
        expected = (len(codes), self._outputs)
        problem = ""
        scores: Any = None
        training = self.module.training
        try:
            with torch.no_grad():
                like = next(self.module.parameters(), torch.zeros(()))
                batch = torch.tensor(codes, dtype=torch.float32, device=like.device)
                scores = self.module.eval()(batch)
        except Exception as error:  # torch, and the module's own code, may raise anything
            problem = f"it fails on observations float32 ({len(codes)}, {self._inputs}): "
            problem += f"{type(error).__name__}: {reason(error)}"
        finally:
            self.module.train(training)
        if not problem and not isinstance(scores, torch.Tensor):
            problem = f"it returns a {type(scores).__name__}, not a tensor"
        elif not problem and tuple(scores.shape) != expected:
            problem = f"of observations ({len(codes)}, {self._inputs}) it makes numbers "
            problem += f"{tuple(scores.shape)}"
        elif not problem and not torch.isfinite(scores).all():
            problem = "it returns numbers that are not finite"
        if problem:
            raise PolicyError(
                f"policy {self.name!r}: {problem}; needed is a tensor {expected}: one number for "
                f"each {self._commands.output} of each drone"
            )
        return scores.double().cpu().numpy()
