"""The policy that keeps another one from emptying batteries, by the rules of the shield."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from desim_uav.errors import PolicyError
from desim_uav.model.random.streams import Streams
from desim_uav.model.state import Observation
from desim_uav.policies.base import decide_by, load_policy, memory_of, policy_name, remind, show
from desim_uav.registry import register
from desim_uav.scenario.shield import what_is_unsure
from desim_uav.world import World

if TYPE_CHECKING:
    from desim_uav.engine.episode import Engine
    from desim_uav.engine.masks import Shield


@register("policy", "shielded")
class Shielded:
    """Shields another policy, the base, in a scenario that has no shield (``drones.shielded``).

    The base is shown masks without the actions after which a drone might not reach a station any
    more. If it chooses one nevertheless, the drone does what a shielded drone does on a forbidden
    command. The shield knows what that of a scenario does: the map, and the true places and the
    batteries of all drones.

    A shield of a scenario lets a drone return above ``return_below`` if it cannot hover any more,
    and this one cannot. A planned return counts as a way to a station only if it takes, with a
    hover before it, at most what ``return_below`` leaves. Where all returns count, drones fly as
    with a shield of the scenario, unless positions are noisy.
    """

    besides = "for its shield the map, and the places and batteries of the drones now"
    """What the shield itself uses, in words; the base uses its own information."""

    def __init__(self, argument: str = "", base: Any = None) -> None:
        """Take the base by its name, or as any policy. Raises PolicyError if it cannot be loaded.

        Raises ValueError without a base.
        """
        if base is None and not argument:
            raise ValueError("a shield needs its base: shielded:BASE, as in shielded:greedy")
        self._base: Any = load_policy(argument if base is None else base)
        self.name = f"shielded:{policy_name(argument if base is None else base)}"
        self.ceiling: bool = self._base.ceiling
        self.observation = getattr(self._base, "observation", None)
        self.clairvoyant = bool(getattr(self._base, "clairvoyant", False))
        seed = getattr(self._base, "world_seed", None)
        if seed is not None:
            self.world_seed: int = seed
        self._world: World | None = None
        self._shields: dict[tuple[bool, ...], Shield] = {}

    @staticmethod
    def base_of(argument: str) -> str:
        """Return the name of the base."""
        return argument

    def notice(self, world: World) -> str:
        """Return the warning of the base, for example that it was trained in another world."""
        warning: str = getattr(self._base, "notice", lambda world: "")(world)
        return warning

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Let the base begin. Raises PolicyError if no shield can hold in the world."""
        if self._world is not world:
            self._require_a_hold(world)
            self._world, self._shields = world, {}
        self._base.begin(world, streams, carried)

    def _require_a_hold(self, world: World) -> None:
        scenario = world.scenario
        if not scenario.limited_battery:
            raise PolicyError(f"policy {self.name!r}: no drone has a battery that could be empty")
        if world.free:
            raise PolicyError(
                f"policy {self.name!r}: only drones.shielded: true shields drones that fly freely, "
                "because their commands are checked when they are flown, and not by masks"
            )
        for path, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
            for finding in what_is_unsure(scenario, drones, path):
                raise PolicyError(f"policy {self.name!r}: {finding.message}")

    def watch(self, engine: Engine) -> None:
        """Take the engine of the episode, of which the shield uses the drones, and show it."""
        from desim_uav.engine.masks import Shield

        ceilings = engine.settings.ceilings
        if ceilings not in self._shields:
            self._shields[ceilings] = Shield(engine.world, ceilings)
        self._engine, self._shield = engine, self._shields[ceilings]
        show(self._base, engine)

    def memory(self) -> Any:
        """Return what the base remembers."""
        return memory_of(self._base)

    def remember(self, memory: object) -> None:
        """Let the base remember what ``memory`` has returned."""
        if memory is not None:
            remind(self._base, memory)

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Raise TypeError: all drones are commanded at once (see ``act_jointly``)."""
        raise TypeError("shielded commands all drones at once; call act_jointly")

    def act_jointly(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> list[int]:
        """Return the commands of the base, or what is allowed in place of forbidden ones."""
        assert self._world is not None, "it has begun"
        narrowed = self._shield.narrowed(self._engine, masks)
        commands: Any = decide_by(self._base, observations, narrowed, self._world)
        return self._shield.taken(commands)
