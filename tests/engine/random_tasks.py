"""Random scenarios of everything at once, in which some services compute."""

from __future__ import annotations

from typing import Any

from desim_uav.world import World
from tests.engine.random_all import CONTINUOUS, one_of_all
from tests.engine.random_parts import Dice, accepted

DISCIPLINES = ("first_come", "first_come", "processor_sharing", "earliest_deadline")
ORDERS = ("first_come", "first_come", "earliest_deadline")
OFFLOADING = ("always", "always", "never", "shortest", "split", "split")


def scenario(seed: int) -> dict[str, Any]:
    """A scenario of everything in which all drones and masts compute.

    What ``random_all`` draws for a seed is drawn first, and changed as little as possible.
    """
    made, dice = one_of_all(seed), Dice(seed + 700_000)
    senders = [*made["drones"], *made["access_points"]]
    held = any(each.get("radio", {}).get("sharing", "held") == "held" for each in senders)
    discipline = dice.of(*DISCIPLINES)
    for each in senders:
        each["processor"] = {
            "cores": dice.of(1, 1, 2, 4),
            "ghz": dice.of(0.05, 0.3, 2.5),
            "sharing": dice.of(discipline, discipline, *DISCIPLINES),
            "on_ground": dice.of(True, False),
        }
        if "capacity_wh" in (each.get("battery") or {}):
            each["processor"] |= {"kappa": dice.of(1e-28, 4e-26), "electronics_w": dice.of(0, 3.5)}
    made["users"]["processor"] = {"ghz": dice.of(0.02, 0.5), "transmit_w": dice.of(0.0, 0.1)}
    made["offloading"] = dice.of(*OFFLOADING)
    services = {name: task(dice, held) for name in dice.of(["vision"], ["vision", "maps"])}
    if dice.of(True, False, False) and not held:
        services["rounds"] = tandem(dice)
    mixed = dice.of(True, False)
    made["services"] = {**made["services"], **services} if mixed else services
    mix = {name: 1 + 2 * (name in services) for name in made["services"]}
    if made["demand"]["kind"] == CONTINUOUS["kind"]:
        made["demand"] = {"kind": "poisson", "rate_per_hour": 200}
    made["demand"] |= {"mix": mix}
    if made["reward"]["kind"] == "multi_service":
        made["reward"]["services"] = dict.fromkeys(mix, 0.3)
    everywhere = dice.of(True, True, False)
    for each in senders:
        if everywhere or dice.of(True, False, False):
            each["backhaul"] = {"kind": "capacity", "kbps": dice.of(80, 350.5, 1000, 6000)}
    if dice.of(True, False):
        for service in services.values():
            service.update({"handover": "migrate"} if service["kind"] == "compute" else {})
    with_uplinks(senders, dice)
    return made


def with_uplinks(senders: list[dict[str, Any]], dice: Dice) -> None:
    """Give uploads a band of their own, at all radios with classes, at some of them or at none."""
    likely = dice.of((True,), (True, False), (False,), (False,))
    for each in senders:
        if each.get("radio", {}).get("kind") == "link_classes" and dice.of(*likely):
            each["radio"] = each["radio"] | {"uplink_mhz": dice.of(0.1, 0.4, 2.5)}


def relaying(seed: int) -> dict[str, Any]:
    """The same scenario with backhauls everywhere, whose users are soon elsewhere than their tasks.

    Small inputs take a while to compute, and results are large.
    """
    made, dice = scenario(seed), Dice(seed + 800_000)
    for each in [*made["drones"], *made["access_points"]]:
        each["backhaul"] = {"kind": "capacity", "kbps": dice.of(350.5, 1000, 1000, 6000)}
        each["processor"] |= {"ghz": dice.of(0.05, 0.2), "cores": dice.of(2, 4)}
    made["users"]["mobility"] = {"kind": "random_walk", "speed_mps": 25, "leg_s": dice.of(9, 31)}
    made["offloading"] = dice.of("always", "always", "split")
    for service in made["services"].values():
        if service["kind"] == "compute":
            late = {"deadline_s": dice.of(60, 150), "on_deadline": dice.of("count", "drop")}
            amounts = {"input_mbit": [0.02, 0.05], "cycles_per_bit": [9000]}
            service |= {**amounts, "output_mbit": [3, 12, 40], **dice.of({}, late)}
    return made


def migrating(seed: int) -> dict[str, Any]:
    """The same scenario with long queues, whose tasks follow their users to other processors."""
    made, dice = relaying(seed), Dice(seed + 900_000)
    for each in [*made["drones"], *made["access_points"]]:
        each["processor"] |= {"ghz": dice.of(0.02, 0.1), "cores": 1, "sharing": dice.of(*ORDERS)}
        each["backhaul"] = {"kind": "capacity", "kbps": dice.of(90, 350.5, 1000)}
    for service in made["services"].values():
        if service["kind"] == "compute":
            service |= {"input_mbit": dice.of([0.02, 0.4], [0.3, 1.5]), "handover": "migrate"}
            service |= {"output_mbit": dice.of([0], [0.5, 3])}
    return made


def task(dice: Dice, held: bool) -> dict[str, Any]:
    """A service of tasks, most of which have deadlines."""
    late: dict[str, Any] = {"deadline_s": dice.of(0.7, 5, 17.5, 60)}
    late["on_deadline"] = dice.of("count", "drop", "drop", "leave")
    rates = {"bandwidth_kbps": [150, 600]} if held else {}
    return {
        "kind": "compute",
        "input_mbit": dice.of([0.01, 0.5], [2], [0.3, 6, 25]),
        "cycles_per_bit": dice.of([5, 100], [700.125], [40, 2000]),
        "output_mbit": dice.of([0], [0.0, 0.2], [3, 0.4]),
        "handover": dice.of("resume", "restart"),
        **dice.of(late, late, {}),
        **rates,
    }


def tandem(dice: Dice) -> dict[str, Any]:
    """A service with its stages in any order."""
    orders = ("lcp", "lpc", "clp", "cpl", "plc", "pcl")
    amounts = {"link_s": dice.of(0.0, 0.004), "core_s": dice.of(2.0, 9.5), "pause_s": 1.5}
    return {"kind": "tests.staged:Tandem", "order": dice.of(*orders), **amounts}


def world_of(seed: int) -> World:
    """The world of a random scenario with tasks."""
    return accepted(scenario, seed)


def relaying_world_of(seed: int) -> World:
    """The world of a random scenario whose results come over backhauls, with several senders."""
    return accepted(relaying, seed, lambda made: made.drone_count + len(made.access_points) > 2)


def migrating_world_of(seed: int) -> World:
    """The world of a random scenario whose tasks migrate, with several senders."""
    return accepted(migrating, seed, lambda made: made.drone_count + len(made.access_points) > 2)
