"""What a policy is, and how the command line finds one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

from desim_uav.errors import DesimError, PolicyError
from desim_uav.model.state import Observation, Snapshot
from desim_uav.model.streams import Streams
from desim_uav.policies.function import Choice, Function
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


class Learned(Protocol):
    """Whatever has learned a policy, such as the result of a training."""

    @property
    def policy(self) -> Policy:
        """The policy that was learned."""


PolicyLike = str | Path | Policy | type[Policy] | Choice | Learned
"""What can be given as a policy: a name or a file as the command line takes it, a policy or a
class of one, a plain function of an observation and a mask, or the result of a training."""


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


def load_policy(policy: PolicyLike) -> Policy:
    """Return the policy that a name, a file, an object or a function stands for.

    A name is a built-in one, a learned table's ``FILE.npz``, ``script:FILE.csv``,
    ``sb3:FILE.zip``, ``rllib:DIR``, or ``"package.module:Class"``. A ``Path`` needs no prefix. See
    ``PolicyLike`` for everything else. Raises PolicyError if it is no policy or cannot be read.
    """
    if isinstance(policy, str | Path):
        return _checked(_of_name(policy_name(policy)), policy_name(policy))
    if isinstance(policy, type):
        return _checked(_made(policy, policy_name(policy)), policy_name(policy))
    given: Any = policy
    if not hasattr(given, "act") and hasattr(given, "policy"):
        given = given.policy
    if not hasattr(given, "act") and callable(given):
        given = Function(given)
    return _checked(given, policy_name(policy))


FILES = {".csv": "script:", ".zip": "sb3:"}
"""How a policy's name begins if it is read from a file that ends like this."""


def policy_name(policy: PolicyLike) -> str:
    """Return what tables and messages call a policy: for an object or a function, where it is from.

    An object can say its name itself, in an attribute ``name``.
    """
    if isinstance(policy, Path):
        return FILES.get(policy.suffix.lower(), "") + str(policy)
    if isinstance(policy, str):
        return policy
    given: Any = policy
    if not isinstance(given, type):
        if not hasattr(given, "act") and hasattr(given, "policy"):
            given = given.policy
        if isinstance(name := getattr(given, "name", None), str):
            return name
        if not hasattr(given, "act") and callable(given):
            return Function(given).name
        given = type(given)
    return f"{given.__module__}:{given.__qualname__}"


def _of_name(name: str) -> Any:
    """Make the policy of a name. Raises PolicyError."""
    kind, argument = parts(name)
    try:
        if kind in names("policy"):
            return resolve("policy", kind)(*[argument] if argument else [])
        return resolve("policy", name)()
    except DesimError:
        raise
    except ValueError as error:  # what a built-in, or the registry, finds wrong
        raise PolicyError(f"policy {name!r}: {error or type(error).__name__}") from error
    except FAULTS as error:
        raise PolicyError(f"policy {name!r}: {what_failed(error)}") from error


def _made(policy: type, name: str) -> Any:
    """Make a policy of a class. Raises PolicyError."""
    try:
        return policy()
    except FAULTS as error:
        raise PolicyError(f"policy {name!r}: {what_failed(error)}") from error


def _checked(policy: Any, name: str) -> Policy:
    """Return it if it has what a policy needs. Raises PolicyError."""
    for method in ("begin", "act"):
        if not callable(getattr(policy, method, None)):
            raise PolicyError(f"policy {name!r}: it has no method {method!r}")
    if not isinstance(getattr(policy, "ceiling", None), bool):
        raise PolicyError(f"policy {name!r}: 'ceiling' must be True or False")
    checked: Policy = policy
    return checked
