"""Registers Gymnasium ids for the nine cases, and one for other scenarios.

This module does not import Gymnasium, so that ``import desim_uav`` stays fast.
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

    Each case has one world, that of world seed 0, as in the paper: seeds draw walks and requests
    only. ``world_seed=3`` gives another world, and ``world_seed=None`` a new one per seed.
    ``Uav-v0`` needs a ``scenario``, which determines its world.

    The specs have no ``max_episode_steps``, because an environment truncates its episodes itself,
    after ``episode.steps`` of its scenario. Gymnasium's TimeLimit would not know of a ``config``
    that changes this number, and would cut longer episodes short.
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
    """Register the ids now if Gymnasium has been imported, else as soon as it is imported.

    Gymnasium has had no plug-ins since version 1.0. The ids are available once both packages have
    been imported, in either order, and the command line does not have to import Gymnasium.
    """
    if REGISTRY in sys.modules:
        register_envs()
    elif not any(isinstance(finder, _Awaits) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Awaits())


class _Awaits:
    """Registers the ids at the end of the first import of Gymnasium's registry.

    It is not a subclass of ``importlib.abc.MetaPathFinder``, whose import would slow ``--help``.
    """

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,
        target: ModuleType | None = None,
    ) -> ModuleSpec | None:
        """Find Gymnasium's registry, and no other module, without this finder."""
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
