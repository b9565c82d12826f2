"""The values in the paper's code, as defaults beneath the keys of a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from desim_uav.scenario.components import Slot
from desim_uav.scenario.learning import PAPER_LEARNING
from desim_uav.scenario.slots import BATTERY, DEMAND, REWARD


def paper_preset(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """The paper's code as defaults beneath the keys of a file: ``mapping`` with them filled in."""
    filled = dict(mapping)
    drones = mapping.get("drones", {})
    if isinstance(drones, Mapping):
        filled["drones"] = _paper_drones(drones)
    elif isinstance(drones, list):
        filled["drones"] = [_paper_drones(d) if isinstance(d, Mapping) else d for d in drones]
    users = mapping.get("users")
    if isinstance(users, list):
        filled["users"] = [_paper_users(own) for own in users]
    filled = _paper_demand(filled)
    filled = _paper_reward(filled)
    learning = mapping.get("learning", {})
    if isinstance(learning, Mapping):
        filled["learning"] = PAPER_LEARNING | dict(learning)
        for key in ("alpha", "epsilon"):
            if isinstance(learning.get(key), Mapping):
                filled["learning"][key] = PAPER_LEARNING[key] | dict(learning[key])
    return filled


def _paper_reward(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """``mapping`` with a reward of the paper, R3 unless it names a kind, and the code's sign."""
    reward = mapping.get("reward", {})
    if isinstance(reward, Mapping):
        mapping = {**mapping, "reward": {"kind": "multi_service", **reward}}
    return _with_default(mapping, "reward", REWARD, "cost_sign", 1.0)


def _paper_users(group: object) -> object:
    """A group of users, whose demand, if it has one, has the default of the paper's code."""
    own = isinstance(group, Mapping) and isinstance(group.get("demand"), Mapping)
    return _paper_demand(group) if own and isinstance(group, Mapping) else group


def _paper_demand(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """``mapping`` with the default of the paper's code in its demand."""
    return _with_default(mapping, "demand", DEMAND, "none", 0.1)


def _paper_drones(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """Drones, or a type of them, with the default of the paper's code."""
    return _with_default(mapping, "battery", BATTERY, "respawn_after_min", 0.0)


def _with_default(
    mapping: Mapping[str, Any], key: str, slot: Slot, parameter: str, value: float
) -> dict[str, Any]:
    """``mapping`` with a parameter of the component at ``key``, where its kind has one to give."""
    component = mapping.get(key, {})
    if not isinstance(component, Mapping):
        return dict(mapping)
    if parameter not in slot.parameter_names(component.get("kind")):
        return dict(mapping)
    return {**mapping, key: {parameter: value, **component}}
