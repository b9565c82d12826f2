"""What a policy is, and how the command line finds one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from desim_uav.errors import DesimError, PolicyError
from desim_uav.model.state import Observation, Snapshot
from desim_uav.model.streams import Streams
from desim_uav.registry import FAULTS, names, resolve, what_failed
from desim_uav.world import World


class Policy(Protocol):
    """Decides for each drone from its observation and mask alone; it never sees the engine.

    ``ceiling``: are its drones bound by the tallest building? (The baseline's are not.)
    A registered class that is read of a file says with ``file_of(argument)`` which.
    """

    ceiling: bool

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """An episode begins. Drone d may draw from stream d only.

        ``carried``: the drones go on from where the episode before has left them.
        """

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """The command for ``observation.drone``: an index into ``world.actions``.

        Called for every drone at every decision epoch, drones in order.
        """


class JointPolicy(Policy, Protocol):
    """Decides for all drones at once."""

    def act_jointly(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> Sequence[int]:
        """The commands of all drones, in order; called instead of ``act``."""


def decide(policy: Policy, shown: Snapshot) -> list[int]:
    """The policy's commands, drones in order."""
    jointly = getattr(policy, "act_jointly", None)
    if jointly is not None:
        commands = jointly(shown.observations, shown.masks)
    else:
        seen = zip(shown.observations, shown.masks, strict=True)
        commands = [policy.act(observation, mask) for observation, mask in seen]
    return [int(command) for command in commands]


def parts(name: str) -> tuple[str, str]:
    """The kind of a policy, and what is said of it: a file that is no kind's is a table's."""
    kind, _, argument = name.partition(":")
    if name.endswith(".npz") and kind not in names("policy"):
        return "table", name
    return kind, argument


def file_of(name: str) -> Path | None:
    """The file that a policy is read of, where it is of one: its class says which, ``file_of``."""
    kind, argument = parts(name)
    known = resolve("policy", kind) if kind in names("policy") else None
    found: Path | None = getattr(known, "file_of", lambda _: None)(argument) if argument else None
    return found


def load_policy(name: str) -> Policy:
    """A policy by its name, as the command line has it.

    A built-in name, a learned table's ``FILE.npz``, ``script:FILE.csv``, ``sb3:FILE.zip``,
    ``rllib:DIR``, or ``"package.module:Class"``. Raises PolicyError where it cannot be read.
    """
    kind, argument = parts(name)
    try:
        if kind in names("policy"):
            policy: Policy = resolve("policy", kind)(*[argument] if argument else [])
        else:
            policy = resolve("policy", name)()
    except DesimError:
        raise
    except ValueError as error:  # what a built-in, or the registry, finds wrong
        raise PolicyError(f"policy {name!r}: {error or type(error).__name__}") from error
    except FAULTS as error:
        raise PolicyError(f"policy {name!r}: {what_failed(error)}") from error
    for method in ("begin", "act"):
        if not callable(getattr(policy, method, None)):
            raise PolicyError(f"policy {name!r}: it has no method {method!r}")
    if not isinstance(getattr(policy, "ceiling", None), bool):
        raise PolicyError(f"policy {name!r}: 'ceiling' must be True or False")
    return policy
