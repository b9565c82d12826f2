"""The interface of policies, and how a policy is found by its name."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from desim_uav import array_file
from desim_uav.commands.given import Command
from desim_uav.errors import DesimError, PolicyError, did_you_mean
from desim_uav.model.random.streams import Streams
from desim_uav.model.state import Observation, Snapshot
from desim_uav.policies.answers import commands_of
from desim_uav.policies.function import Answer, FunctionPolicy
from desim_uav.registry import FAULTS, names, resolve, what_failed
from desim_uav.scenario.schema import Scenario
from desim_uav.shipped import find_table, trained_names
from desim_uav.typed import typed
from desim_uav.world import World

if TYPE_CHECKING:
    from desim_uav.engine.episode import Engine


class Policy(Protocol):
    """Chooses each drone's action from its observation and mask alone, without the engine.

    ``ceiling`` says whether the drones may fly no higher than the levels below the ceiling; the
    baseline's drones may. A registered class that is read from a file has a static method
    ``file_of(argument)``, which returns the file's path, and one that improves another policy a
    static method ``base_of(argument)``, which returns the other's name. A policy with an attribute
    ``observation``, a component or None, is run with this observation instead of the scenario's.
    """

    ceiling: bool

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Prepare for an episode in ``world``.

        A random policy draws from ``streams``, for drone d from stream d only. ``carried`` says
        that the drones continue from where the previous episode left them.
        """

    def act(self, observation: Observation, mask: Sequence[bool]) -> int | Sequence[float]:
        """Return the action of ``observation.drone`` as an index into ``world.actions``.

        In free flight, it can also be a sequence with the numbers of a command, from -1 to 1.
        ``mask`` says of each action whether it is allowed. This method is called for every drone
        at every decision epoch, in the order of the drones.
        """


class JointPolicy(Policy, Protocol):
    """Chooses the actions of all drones at once."""

    def act_jointly(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> Sequence[int | Sequence[float]]:
        """Return the actions of all drones in their order. It is called instead of ``act``."""


class PlanningPolicy(JointPolicy, Protocol):
    """Sees more than the drones do: it is shown the engine before its first decision.

    ``information`` says what it uses of it, because nothing keeps a planner from using all.
    """

    information: str

    def watch(self, engine: Engine) -> None:
        """Take the engine of the episode, at the decision epoch at which it begins to decide."""


class Remembering(Policy, Protocol):
    """A policy that remembers something between its decisions, beside what ``begin`` prepares.

    All other policies decide on what they are shown alone, so that nothing has to be saved of them.
    """

    def memory(self) -> Any:
        """Return what the policy remembers now, as plain data that JSON has."""

    def remember(self, memory: object) -> None:
        """Remember what ``memory`` has returned, after ``begin`` in the same world."""


class Trained(Protocol):
    """A model of Stable-Baselines3, or an algorithm of RLlib."""

    def save(self, path: object) -> Any:
        """Save it."""


class Module(Protocol):
    """A ``torch.nn.Module`` that flies every drone (see ``policies.module``)."""

    def forward(self, *args: Any) -> Any:
        """Return a number for each action of each drone."""


class Network(Protocol):
    """A network of ``policies/ppo.py`` (see ``policies.mlp.Mlp``)."""

    about: dict[str, Any]

    def scores(self, features: Sequence[float]) -> Any:
        """Return the number of each action."""


class Learned(Protocol):
    """An object with a learned policy, such as the result of a training."""

    @property
    def policy(self) -> Policy:
        """The policy that was learned."""


PolicyLike = str | Path | Policy | type[Policy] | Answer | Learned | Trained | Module | Network
"""Everything that is accepted as a policy: a name or a file as on the command line, a policy object
or class, a plain function of an observation and a mask, the result of a training, or a model in
memory: of Stable-Baselines3, RLlib or PyTorch, or a network of ``policies/ppo.py``."""


def show(policy: Policy, engine: Engine) -> None:
    """Show a policy the engine of the present episode if it is a planner."""
    watch = getattr(policy, "watch", None)
    if watch is not None:
        watch(engine)


def decide(policy: Policy, snapshot: Snapshot, world: World) -> list[Command]:
    """Return the policy's actions for a snapshot, in the order of the drones (``decide_by``)."""
    return decide_by(policy, snapshot.observations, snapshot.masks, world)


def decide_by(
    policy: Policy,
    observations: Sequence[Observation],
    masks: Sequence[Sequence[bool]],
    world: World,
) -> list[Command]:
    """Return the policy's actions for what all drones observe, in their order.

    Each is an index into ``World.actions`` or, in free flight, the numbers of a command. Raises
    NoCommandError if the policy has answered anything else.
    """
    jointly = getattr(policy, "act_jointly", None)
    if jointly is not None:
        commands = jointly(observations, masks)
    else:
        pairs = zip(observations, masks, strict=True)
        commands = [policy.act(observation, mask) for observation, mask in pairs]
    return commands_of(commands, world)


def memory_of(policy: Policy) -> Any:
    """Return what a policy remembers now (see ``Remembering``); None if it remembers nothing."""
    return getattr(policy, "memory", lambda: None)()


def remind(policy: Policy, memory: object) -> None:
    """Let a policy that has begun remember what ``memory_of`` has returned."""
    getattr(policy, "remember", lambda memory: None)(memory)


def parts(name: str) -> tuple[str, str]:
    """Split a policy's name into its kind and its argument.

    ``FILE.npz`` alone is a network, a dispatcher or a planner if it holds the weights of one, else
    a table.
    """
    kind, _, argument = name.partition(":")
    if name.endswith(".npz") and kind not in names("policy"):
        arrays = array_file.names_in(find_table(name))
        for array, learned in (("dispatch", "dispatcher"), ("planner", "planner")):
            if array in arrays:
                return learned, name
        return "mlp" if {"scale", "weights"} <= arrays else "table", name
    return kind, argument


def file_of(name: str) -> Path | None:
    """Return the file that a policy, or its base, is read from, or None without a file."""
    base = base_of(name)
    if base is not None:
        return file_of(base)
    file: Path | None = _of_argument("file_of", name)
    return file


def base_of(name: str) -> str | None:
    """Return the name of the policy that a policy improves, or None if it improves none."""
    base: str | None = _of_argument("base_of", name)
    return base or None


def _of_argument(method: str, name: str) -> Any:
    """Return what a method of a registered class says of the argument in a name, or None."""
    kind, argument = parts(name)
    class_ = resolve("policy", kind) if kind in names("policy") else None
    return getattr(class_, method, lambda _: None)(argument) if argument else None


@typed
def load_policy(policy: PolicyLike) -> Policy:
    """Return the policy that a name, a file, an object or a function stands for.

    A name is that of a built-in policy, ``FILE.npz`` for a learned table or a network,
    ``script:FILE.csv``, ``sb3:FILE.zip``, ``rllib:DIR``, or ``"package.module:Class"``, whose
    module may also be a file: ``"FILE.py:Class"``. A ``Path``
    needs no prefix. ``PolicyLike`` lists everything else that is accepted. Raises PolicyError for
    anything that is not a policy or cannot be read.
    """
    if isinstance(policy, str | Path):
        return _checked(_of_name(policy_name(policy)), policy_name(policy))
    if isinstance(policy, type):
        return _checked(_instance(policy, policy_name(policy)), policy_name(policy))
    candidate: Any = policy
    adapter = _adapter_of(candidate)
    if adapter is not None:
        return _checked(adapter.of_model(candidate, policy_name(policy)), policy_name(policy))
    if not hasattr(candidate, "act") and hasattr(candidate, "policy"):
        candidate = candidate.policy
    if not hasattr(candidate, "act") and callable(candidate):
        candidate = FunctionPolicy(candidate)
    return _checked(candidate, policy_name(policy))


MODELS = {
    "desim_uav.policies.mlp:Mlp": "desim_uav.policies.mlp:NetworkPolicy",
    "stable_baselines3.common.base_class:BaseAlgorithm": "desim_uav.policies.sb3:StableBaselines",
    "ray.rllib.algorithms.algorithm:Algorithm": "desim_uav.policies.rllib.adapter:RLlib",
    "torch.nn.modules.module:Module": "desim_uav.policies.module:TorchModule",
}
"""The classes of models that are no policies themselves, each with the policy that acts by one.

They are named, and not imported, because their libraries may not be installed.
"""


def _adapter_of(candidate: object) -> Any:
    """Return the class of the policy that acts by a model, or None for everything else."""
    if hasattr(candidate, "act"):
        return None
    for one in type(candidate).__mro__:
        adapter = MODELS.get(f"{one.__module__}:{one.__qualname__}")
        if adapter is not None:
            module, _, name = adapter.partition(":")
            return getattr(importlib.import_module(module), name)
    return None


def as_seen(scenario: Scenario, policy: PolicyLike) -> Scenario:
    """Return the scenario with the observation that a policy needs, if it names one.

    Nothing else that happens in a run depends on the observation. Raises as ``load_policy`` does.
    """
    observation = getattr(load_policy(policy), "observation", None)
    if observation is None or observation == scenario.observation:
        return scenario
    return scenario.model_copy(update={"observation": observation})


FILES = {".csv": "script:", ".zip": "sb3:"}
"""The prefix of a policy's name by the suffix of the file that it is read from."""


def policy_name(policy: PolicyLike) -> str:
    """Return the name of a policy for tables and messages.

    An object is called by its attribute ``name`` if it has one, else by its module and class. A
    function is called by its module and name.
    """
    if isinstance(policy, Path):
        return FILES.get(policy.suffix.lower(), "") + str(policy)
    if isinstance(policy, str):
        return policy
    candidate: Any = policy
    if not isinstance(candidate, type) and _adapter_of(candidate) is None:
        if not hasattr(candidate, "act") and hasattr(candidate, "policy"):
            candidate = candidate.policy
        if isinstance(name := getattr(candidate, "name", None), str):
            return name
        if not hasattr(candidate, "act") and callable(candidate):
            return FunctionPolicy(candidate).name
    if not isinstance(candidate, type):
        candidate = type(candidate)
    return f"{candidate.__module__}:{candidate.__qualname__}"


def _of_name(name: str) -> Any:
    """Make the policy with this name. Raises PolicyError."""
    kind, argument = parts(name)
    class_ = resolve("policy", kind) if kind in names("policy") else None
    if class_ is None and ":" not in name:
        raise PolicyError(_unknown(name))
    if class_ is not None and argument and not inspect.signature(class_).parameters:
        raise PolicyError(f"policy {name!r}: {kind!r} takes nothing after it: write {kind}")
    try:
        if class_ is not None:
            return class_(*[argument] if argument else [])
        return resolve("policy", name)()
    except DesimError:
        raise
    except ValueError as error:  # what a built-in, or the registry, finds wrong
        raise PolicyError(f"policy {name!r}: {error or type(error).__name__}") from error
    except FAULTS as error:
        raise PolicyError(f"policy {name!r}: {what_failed(error)}") from error


def _unknown(name: str) -> str:
    """Return what is wrong with a name that is no policy's."""
    if name.endswith(".py"):
        return f"policy {name!r}: name the class in this file, too: {name}:Class"
    kinds = names("policy")
    hint = did_you_mean(name, [*kinds, *trained_names()])
    return (
        f"unknown policy {name!r}{hint}; allowed: {', '.join(kinds)}, FILE.npz, "
        '"package.module:Class" or FILE.py:Class'
    )


def _instance(policy: type, name: str) -> Any:
    """Make an instance of a policy class. Raises PolicyError."""
    try:
        return policy()
    except FAULTS as error:
        raise PolicyError(f"policy {name!r}: {what_failed(error)}") from error


def _checked(policy: Any, name: str) -> Policy:
    """Return the policy if it has everything that a policy needs. Raises PolicyError if not."""
    for method in ("begin", "act"):
        if not callable(getattr(policy, method, None)):
            raise PolicyError(f"policy {name!r}: it has no method {method!r}")
    if not hasattr(policy, "ceiling"):
        raise PolicyError(
            f"policy {name!r}: it has no attribute 'ceiling'; write ceiling = True if its drones "
            "fly no higher than the levels below the ceiling, else False"
        )
    if not isinstance(policy.ceiling, bool):
        raise PolicyError(
            f"policy {name!r}: 'ceiling' is {policy.ceiling!r}; it must be True or False"
        )
    checked: Policy = policy
    return checked
