"""What the benchmark shows a policy that does not know the future: the past and the present.

Such a policy gets a world and random streams whose seeds are derived from the true ones by a
one-way function, so that it cannot draw the sample path again. A planner does not get the engine
of the run, but a copy of its state whose future is drawn anew from the model at each decision epoch
(``policies.planning.future``). What it reads beyond the present is such a draw.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace

from desim_uav.engine.base import RunSettings
from desim_uav.engine.episode import Engine
from desim_uav.model.random.streams import Streams
from desim_uav.model.state import Observation
from desim_uav.policies.planning.future import imagined
from desim_uav.policies.planning.inner import InnerEngine
from desim_uav.policies.planning.links import seen_links
from desim_uav.world import World

SAMPLE = 2**31
"""The number of the imagined future, which no planner uses for its own ones."""


def hidden(seed: int) -> int:
    """Return a seed that tells nothing of another one, from which it is derived."""
    digest = hashlib.sha256(f"desim-uav bench, hidden seed {seed}".encode()).digest()
    return int.from_bytes(digest[:8]) >> 1


class Present:
    """The views of one run that a policy without knowledge of the future is given."""

    def __init__(self, seed: int) -> None:
        self._seed = hidden(seed)
        self._of: World | None = None
        self._world: World | None = None
        self._engine: InnerEngine | None = None

    def world(self, world: World) -> World:
        """Return a world that is as the true one, but with other seeds."""
        if self._world is None or self._of is not world:
            seed = hidden(world.seed)
            seeds = {"seed": self._seed, "world_seed": seed}
            scenario = world.scenario.model_copy(update=seeds)
            self._of, self._world = world, replace(world, seed=seed, scenario=scenario)
            self._engine = None
        return self._world

    def streams(self, streams: Streams) -> Streams:
        """Return streams for the draws of a policy, which are not those of its seed."""
        return Streams(self._seed, streams.purpose, streams.episode, streams.first)

    def observations(self, engine: Engine) -> tuple[Observation, ...]:
        """Return what drones observe of the present state of the true engine.

        An observation that is not part of the package may read the whole state. The true state
        also holds draws of the future, such as the time of each user's next request.
        """
        return self.engine(engine).snapshot().observations

    def engine(self, engine: Engine) -> InnerEngine:
        """Return an engine in the present state of the true one, with a future of its own."""
        world = self.world(engine.world)
        if self._engine is None:
            settings = RunSettings(engine.settings.ceilings, engine.settings.carry_over, False)
            self._engine = InnerEngine(world, settings)
        future = imagined(engine.save(), self._seed, SAMPLE, seen_links(engine))
        self._engine.restore(replace(future, world=world))
        return self._engine
