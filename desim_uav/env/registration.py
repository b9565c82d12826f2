"""Gymnasium ids of the nine cases, and one for other scenarios.

Nothing heavy is imported here: ``import desim_uav`` does not wait for Gymnasium.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

CASES = range(1, 10)
CASES_WORLD = 0
"""The world seed of the nine ids."""

ENTRY_POINT = "desim_uav.env.single:UavEnv"
VECTOR = "desim_uav.env.vector:UavVectorEnv"
REGISTRY = "gymnasium.envs.registration"


def register_envs() -> None:
    """Register ``desim_uav/Case1-v0`` … ``Case9-v0`` and ``desim_uav/Uav-v0``, once.

    Each case has one world, that of world seed 0, as the paper has it: seeds draw walks and
    requests only. ``world_seed=3`` gives another world, ``world_seed=None`` a new one per seed.
    ``Uav-v0`` has to be given its ``scenario``, which says what its world is.

    The specs have no ``max_episode_steps``. An environment truncates its episodes itself, after
    ``episode.steps`` of its scenario. Gymnasium's TimeLimit would not know of a ``config`` that
    changes these, and would break off longer episodes in the middle, whose drones then do not
    carry over; where the two agree, it adds nothing.
    """
    from gymnasium.envs.registration import register, registry

    parameters_of: dict[str, dict[str, Any]] = {
        f"desim_uav/Case{number}-v0": {"scenario": f"case{number}", "world_seed": CASES_WORLD}
        for number in CASES
    }
    for name, parameters in {**parameters_of, "desim_uav/Uav-v0": {}}.items():
        if name not in registry:
            register(name, entry_point=ENTRY_POINT, vector_entry_point=VECTOR, kwargs=parameters)


def register_with_gymnasium() -> None:
    """Register now where Gymnasium has been imported, else as soon as it is.

    Gymnasium has had no plug-ins since 1.0: whoever imports the two, in whatever order, may use
    the ids, and the command line, which needs no environments, is not slowed down.
    """
    if REGISTRY in sys.modules:
        register_envs()
    elif not any(isinstance(finder, _Awaits) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Awaits())


class _Awaits:
    """Lets the first import of Gymnasium's registry end with our registration.

    No subclass of ``importlib.abc.MetaPathFinder``, which loads a sixth of what ``--help`` does.
    """

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,
        target: ModuleType | None = None,
    ) -> ModuleSpec | None:
        """Gymnasium's registry as it is found without this; nothing else."""
        if fullname != REGISTRY:
            return None
        sys.meta_path.remove(self)
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                execute(module)
                register_envs()

            spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec
