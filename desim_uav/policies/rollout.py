"""The planner that tries each command in simulations, which another policy continues."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.commands.given import Command
from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import DECIDES, Action
from desim_uav.model.state import Observation, Snapshot
from desim_uav.policies.base import decide, decide_by, load_policy, policy_name, show
from desim_uav.policies.planning.options import Option, options_of, split_options
from desim_uav.registry import register
from desim_uav.world import World

if TYPE_CHECKING:
    from desim_uav.engine.episode import Engine
    from desim_uav.policies.planning.ground import Ground

OPTIONS = {
    "samples": Option(4, 1, 1000),
    "horizon": Option(12, 1, 100_000),
    "qoe1": Option(0.5, 0.0, 1.0),
    "doubt": Option(1.0, 0.0, 100.0),
}

NEARLY = 1e-9
"""A gain that is smaller is none, but the rounding of a sum."""


@register("policy", "rollout")
class Rollout:
    """Improves another policy, the base: it tries each command of each drone in simulations.

    In ``samples`` simulations from the present state, the drone gets the command, and then the base
    controls all drones for ``horizon`` steps, or to the end of the episode. Walks, requests and the
    draws of links are drawn from the model, given the present state (``planning.future``), and are
    the same for all commands. The drones choose one after the other: those before have chosen, and
    those after follow the base. A command is better than another one if its mean of QoE1 (with the
    weight ``qoe1``) and QoE3 is better by more than ``doubt`` standard errors over the samples. The
    drone gets the best command, or that of the base if no other one is better.
    """

    ceiling = True
    information = "all users and drones now, and the model of the future; no future"

    def __init__(self, argument: str = "", base: Any = None, **settings: float) -> None:
        """Take the base and options as text, ``BASE+samples=8``, or by their names.

        ``base`` may be any policy: for example a table or a network from a file, whose observation
        the run then has. Raises ValueError without a base and for a bad option, and
        PolicyError if the base cannot be loaded or is a rollout itself.
        """
        name, text = split_options(argument) if base is None else ("", argument)
        if base is None and not name:
            raise ValueError("a rollout needs its base: rollout:BASE, as in rollout:greedy")
        self.options = options_of("rollout", text, settings, OPTIONS)
        self._base: Any = load_policy(name if base is None else base)
        if isinstance(self._base, Rollout) or getattr(self._base, "clairvoyant", False):
            raise ValueError("the base of a rollout must not be a rollout or a clairvoyant")
        self.name = f"rollout:{argument}" if base is None else f"rollout:{policy_name(base)}"
        self._grounds: tuple[Ground, ...] = ()
        self.observation = getattr(self._base, "observation", None)
        seed = getattr(self._base, "world_seed", None)
        if seed is not None:
            self.world_seed: int = seed

    @staticmethod
    def base_of(argument: str) -> str:
        """Return the name of the base."""
        return split_options(argument)[0]

    def notice(self, world: World) -> str:
        """Return the warning of the base, for example that it was trained in another world."""
        warning: str = getattr(self._base, "notice", lambda world: "")(world)
        return warning

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Let the base begin. Raises PolicyError if the scenario cannot be simulated."""
        from desim_uav.policies.planning.ground import grounds_of
        from desim_uav.policies.planning.inner import inner_engine

        goes_on = world.scenario.episode.carry_over
        if not self._grounds or self._grounds[0].world is not world:
            self._grounds = grounds_of(world)
            self._inner = inner_engine("rollout", world, goes_on)
        self._seed, self._world = streams.seed, world
        self._base.begin(world, streams, carried)
        quick = getattr(self._base, "in_rollouts", None)
        self._mind = quick(self.options["horizon"]) if quick is not None else None
        if self._mind is not None:
            self._mind.begin(world, streams, carried)

    def watch(self, engine: Engine) -> None:
        """Take the engine of the episode; its sample path is not looked at."""
        self._engine = engine
        show(self._base, engine)

    def memory(self) -> Any:
        """Return what the base remembers."""
        return self._base.memory() if hasattr(self._base, "memory") else None

    def remember(self, memory: object) -> None:
        """Let the base remember what ``memory`` has returned."""
        if memory is not None:
            self._base.remember(memory)

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Raise TypeError: all drones are commanded at once (see ``act_jointly``)."""
        raise TypeError("rollout commands all drones at once; call act_jointly")

    def act_jointly(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> list[Command]:
        """Return the best command of each drone, in turn."""
        commands = decide_by(self._base, observations, masks, self._world)
        each = zip(observations, masks, commands, strict=True)
        options = [self._options(*one) for one in each]
        commands = [self._safely(d, commands[d], allowed) for d, allowed in enumerate(options)]
        if all(len(each) < 2 for each in options):
            return commands
        self._imagine()
        self._memory = self.memory()
        best = self._scores(commands)
        for drone, allowed in enumerate(options):
            for command in allowed:
                if command == commands[drone]:
                    continue
                tried = [*commands[:drone], command, *commands[drone + 1 :]]
                scores = self._scores(tried)
                if self._is_better(scores - best):
                    best, commands = scores, tried
        if self._mind is None:
            show(self._base, self._engine)
            self.remember(self._memory)
        return commands

    def _options(
        self, observation: Observation, mask: Sequence[bool], command: Command
    ) -> list[Command]:
        """Return the commands that a drone may choose from, if it can reach a station after them.

        There are no moves that are blocked, and no returns if drones may lose their way. Numbers
        that the base has chosen in free flight are among them.
        """
        if observation.mode not in DECIDES:
            return []
        drone = self._engine.drones[observation.drone]
        options = self._grounds[observation.drone].flights.options(drone, mask)
        if not isinstance(command, int):
            options = [command, *options]
        return [one for one in options if self._may(drone, one, observation.battery_s)]

    def _may(self, drone: Any, command: Command, battery_s: float | None) -> bool:
        """Return whether a drone can follow a command and reach a station after it."""
        ground = self._grounds[drone.index]
        action = self._world.actions[command] if isinstance(command, int) else Action.FLY
        if action in (Action.CHARGE, Action.GOTO_CHARGING_STATION):
            return bool(action is Action.CHARGE or ground.flights.return_at >= 0)
        place, flown = ground.flights.leads(drone, command, ground.after)
        if place < 0 or battery_s is None:
            return bool(place >= 0)
        charge = round(battery_s * ground.flights.own.drain_per_s)
        return bool(ground.is_safe(place, ground.units_after(charge, flown)))

    def _safely(self, drone: int, command: Command, allowed: list[Command]) -> Command:
        """Return a command of the base, or that of the allowed ones that leads nearest to home."""
        if command in allowed or not allowed:
            return command
        ground, row = self._grounds[drone], self._engine.drones[drone]

        def units(k: int) -> int:
            place, _ = ground.flights.leads(row, allowed[k], ground.after)
            return int(ground.needs[place])

        return allowed[min(range(len(allowed)), key=lambda k: (units(k), k))]

    def _imagine(self) -> None:
        """Draw the futures in which all commands of this decision epoch are tried."""
        from desim_uav.policies.planning.future import imagined
        from desim_uav.policies.planning.links import seen_links

        now, links = self._engine.save(), seen_links(self._engine)
        self._futures = []
        for sample in range(self.options["samples"]):
            self._inner.take(imagined(now, self._seed, sample, links))
            self._futures.append(self._inner.save())

    def _scores(self, commands: Sequence[Command]) -> NDArray[np.float64]:
        """Return the score of commands in each imagined future."""
        return np.array([self._try(future, commands) for future in self._futures])

    def _is_better(self, gains: NDArray[np.float64]) -> bool:
        """Return whether gains over the imagined futures are positive, and not by mere chance."""
        error = gains.std() / max(len(gains) - 1, 1) ** 0.5
        return bool(gains.mean() > self.options["doubt"] * error + NEARLY)

    def _try(self, future: Any, commands: Sequence[Command]) -> float:
        """Return the score of commands after which the base flies on."""
        from desim_uav.policies.planning.inner import score

        inner = self._inner
        inner.restore(future)
        base = self._base if self._mind is None else self._mind
        show(base, inner)
        if self._mind is None:
            self.remember(self._memory)
        else:
            self._mind.think_like(self._base)
        snapshot: Snapshot = inner.step(commands)
        ends_us = int(self._engine.state.now_us) + self.options["horizon"] * self._world.step_us
        while snapshot.t_us < ends_us and not (snapshot.terminated or snapshot.truncated):
            snapshot = inner.step(decide(base, snapshot, self._world))
        return score(inner, self.options["qoe1"])
