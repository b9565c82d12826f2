"""Random scenarios of everything at once: both engines equal, and no rule broken after any event.

    python -m tests.verification.everything [FIRST [END]]

prints a line for each seed whose scenario fails, and then what was in the scenarios. The compiled
engine has to do the same as the SimPy engine, bit for bit, which is audited after each event: what
must hold in a state, Little's law, work conservation, and conservation of bits, of updates and of
energy. The tables of both engines are audited as well.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator

import numpy as np

from desim_uav.engine.base import RunSettings
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.des import Simulation
from desim_uav.registry import kind_name
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World
from tests.audit.ages import audit_logs
from tests.audit.invariants import audit
from tests.engine.random_everything import world_of
from tests.verification.engines import differences

MANY = 400
EPISODES = 2


def examined(seeds: Iterable[int]) -> Iterator[tuple[int, str | Counter[str]]]:
    """Yield, for each seed, what its scenario had in it, or what failed."""
    for seed in seeds:
        try:
            yield seed, examine(world_of(seed), seed)
        except AssertionError as broken:
            yield seed, str(broken).partition("\n")[0] or "an assertion without a message"


def examine(world: World, seed: int) -> Counter[str]:
    """Fly two episodes in both engines under random commands, some drones without a ceiling.

    Return what the scenario has, and how often each kind of event happened. Raises AssertionError
    if both engines differ, or if an audit fails.
    """
    rng = np.random.default_rng(seed)
    ceilings = tuple((rng.random(world.scenario.drone_count) < 0.5).tolist())
    told = RunSettings(ceilings, world.scenario.episode.carry_over, keep_events=True)
    one, other = Simulation(world, told, audit=audit), BatchSimulation(world, told)
    logs, others, counted = [], [], Counter(dict.fromkeys(parts_of(world.scenario), 1))
    for episode in range(EPISODES):
        unlike = differences(one, other, seed, episode)
        assert not unlike, f"engines differ in {', '.join(unlike)}"
        logs.append(one.log)
        others.append(other.log)
        counted.update(f"event {event[2]}" for event in one.log.events or ())
    if any(service >= 0 for service in world.senses):
        audit_logs(logs, world)
        audit_logs(others, world)
    return counted


def parts_of(scenario: Scenario) -> Iterator[str]:
    """Yield the parts of the model that a scenario has."""
    senders = [*scenario.fleet, *scenario.access_points]
    kinds = {kind_name(service) for service in scenario.services.values()}
    radios = [sender.radio for sender in senders if sender.radio is not None]
    has = {
        "groups": len(scenario.user_groups) > 1,
        "tasks": "compute" in kinds,
        "sensors": "collect" in kinds,
        "backhauls": any(sender.backhaul is not None for sender in senders),
        "access points": bool(scenario.access_points),
        "several types": len(scenario.fleet) > 1,
        "free flight": scenario.free,
        "mixed fleet": scenario.mixed,
        "interference": any(getattr(radio, "reuse", 0) for radio in radios),
        "by event": scenario.decisions.by_event,
        "carried over": scenario.episode.carry_over,
        "commanded shares": kind_name(scenario.offloading) == "commanded",
        "wind": any(scenario.wind_mps),
        "batteries": scenario.limited_battery,
    }
    return (name for name, there in has.items() if there)


def main(first: int = 0, end: int = MANY) -> int:
    """Examine the scenarios of some seeds, and print what was found."""
    begun, failed, counted = time.monotonic(), 0, Counter[str]()
    for seed, found in examined(range(first, end)):
        if isinstance(found, str):
            failed += 1
            print(f"seed {seed}: {found}", flush=True)
        else:
            counted.update(found)
        if (seed + 1 - first) % 20 == 0:
            print(f"{seed + 1 - first} in {time.monotonic() - begun:.0f} s", flush=True)
    for name, count in sorted(counted.items()):
        print(f"  {name}: {count}")
    print(f"{end - first} scenarios, {failed} failed, {time.monotonic() - begun:.0f} s")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:3])))
